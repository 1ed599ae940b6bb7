"""The GeoPose Protocol, version 2: a request with a photo and readings of sensors as JSON, and its answer.

The protocol is that of github.com/OpenArCloud/oscp-geopose-protocol, whose README.md has names, types and units of the
fields, and the header with the version. What it leaves open is as in its own programs: the photo is a JPEG or PNG file
whatever its imageFormat (demo_client.py), the answer has the id and the timestamp of the request, and errors of the
request have the status 400 (demo_server.py). The quaternion is that of OGC's GeoPose for the camera's axes x forward,
y left, z up, as the AR client github.com/OpenArCloud/sparcl expects it (convertAugmentedCityCam2WebQuat).
"""

import base64
import dataclasses
import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
import pyproj  # noqa: F401  for geographic coordinates, so that the start says if it is missing
from fastapi import HTTPException
from numpy.typing import NDArray

from colmap_lazyloc.inputs import PositionPrior
from colmap_lazyloc.pose_formats.conventions import written
from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, Frame
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.registry import FORMATS
from colmap_lazyloc.result import Result

PATHS = ("/scrs/geopose", "/geopose")  # of services in use, and of the protocol's own examples
VERSION = re.compile(r"application/vnd\.oscp\+json\s*;\s*version=([0-9.]+)")
MAX_NUM_VALUES = 10_000  # in a request, because an empty list of two characters takes 64 bytes
RAW_CHANNELS = {"RGBA32": 4, "GRAY8": 1}  # of imageFormat, without a file around the pixels
UNKNOWN_CAMERAS = ("", "UNKNOWN", "UNKNOWN_CAMERA")
OTHER_NAMES = {"THIN_PRISM": "THIN_PRISM_FISHEYE"}  # of the protocol's JavaScript client; the parameters are the same
SIGMAS = 2.0  # in the accuracy of a position, whose confidence is 95 % in W3C's Geolocation Sensor
UNKNOWN_HEIGHT_STDDEV_M = 1000.0
MIN_ACCURACY_M = 1e-6  # of what is known at all
MAX_SIDE = 65535  # of a photo, in pixels, as of a JPEG file
MAX_NUMBER = 1e18  # of any field; JSON has no infinity, but Python reads 1e999 as one
UNKNOWN = -1.0  # an accuracy, as services in use write it

Pixels = NDArray[np.uint8]


@dataclasses.dataclass(frozen=True)
class GeoPoseRequest:
    """A request: its photo, a file or pixels (height x width x 1 or 3), and arguments of Localizer.localize_photo."""

    id: str
    timestamp: float  # in milliseconds
    photo: bytes | Pixels
    fields: dict[str, Any]


def check_version(accept: str) -> None:
    """Refuses other versions of the protocol; a request need not state one."""
    version = VERSION.search(accept)
    if version is not None and version.group(1).partition(".")[0] != "2":
        _refuse(f"Accept: the version is {version.group(1)[:20]}, but this service has 2.0 of the GeoPose Protocol")


def parse(body: bytes, origin: GeoOrigin, max_pixels: int) -> GeoPoseRequest:
    """Parses the body of a request for a model with an origin on the Earth."""
    # Each value but one follows a comma, a colon or a bracket. Base64 has none of these.
    if sum(map(body.count, (b",", b":", b"["))) > MAX_NUM_VALUES:
        _refuse(f"the request has more than {MAX_NUM_VALUES} values")
    try:
        request = json.loads(body)
    except (ValueError, RecursionError):
        _refuse("the request is not JSON")
    if _value(request, "type", str, "geopose") != "geopose":
        _refuse("type: must be geopose")
    readings = _value(request, "sensorReadings", dict)
    if not isinstance(readings.get("cameraReadings"), list):  # version 1 has one list of all readings
        _refuse("sensorReadings.cameraReadings: is missing")
    cameras = readings["cameraReadings"]
    if len(cameras) != 1:
        _refuse(f"sensorReadings.cameraReadings: must have one photo, but has {len(cameras)}")
    fields: dict[str, Any] = {"camera": _camera(cameras[0])}
    places = _value(readings, "geolocationReadings", list, [])
    fields["position"] = _position(places, _number(cameras[0], "timestamp", 0.0), origin)
    photo = _photo(cameras[0], max_pixels)
    return GeoPoseRequest(_value(request, "id", str), _number(request, "timestamp"), photo, fields)


def answer(request: GeoPoseRequest, result: Result, origin: GeoOrigin) -> str:
    """Returns the answer for a localized photo as JSON."""
    assert result.pose is not None
    (pose,) = Frame(GEOGRAPHIC).from_local([result.pose], origin)
    rotation, (longitude, latitude, height) = written(pose, FORMATS["geopose"].convention)
    content = {
        "id": request.id,
        "timestamp": request.timestamp,
        "accuracy": _accuracy(result.pose_covariance_in_map),
        "type": "geopose",
        "geopose": {
            "position": {"lat": float(latitude), "lon": float(longitude), "h": float(height)},
            "quaternion": dict(zip("xyzw", map(float, rotation))),
        },
    }
    return json.dumps(content) + "\n"


def _accuracy(covariance: NDArray[np.float64] | None) -> dict[str, float]:
    """Returns the means of the standard deviations along three axes, in metres, and about these, in degrees."""
    if covariance is None:
        return {"position": UNKNOWN, "orientation": UNKNOWN}
    stddevs = np.sqrt(np.diag(covariance))
    return {"position": float(stddevs[:3].mean()), "orientation": math.degrees(stddevs[3:].mean())}


def _camera(reading: Any) -> dict[str, Any] | None:
    """Returns the intrinsics of a reading; None if it has none."""
    params = _value(reading, "params", dict, {})
    model = _value(params, "model", str, "").upper()
    if not model.isprintable():
        _refuse("model: has a character that cannot be printed")
    numbers = _value(params, "modelParams", list, [])
    width, height = _size(reading)
    if model in UNKNOWN_CAMERAS or not numbers:
        return None
    return {"model": OTHER_NAMES.get(model, model), "width": width, "height": height, "params": numbers}


def _position(readings: Sequence[Any], time: float, origin: GeoOrigin) -> PositionPrior | None:
    """Returns the position that was read nearest to a time in milliseconds, in the model's coordinates; None if no
    reading has an accuracy."""
    usable = [place for place in map(_place, readings) if place.accuracy > 0]
    if not usable:
        return None
    place = min(usable, key=lambda place: abs(place.timestamp - time))
    height, up_stddev = origin.height_m, UNKNOWN_HEIGHT_STDDEV_M
    if place.altitude is not None and place.altitude_accuracy > 0:
        height, up_stddev = place.altitude, max(place.altitude_accuracy, MIN_ACCURACY_M) / SIGMAS
    (point,) = origin.from_geodetic([place.latitude], [place.longitude], [height])
    stddev = max(place.accuracy, MIN_ACCURACY_M) / SIGMAS
    return point, (stddev, stddev, up_stddev)


@dataclasses.dataclass(frozen=True)
class _Place:
    """A reading of a position, in degrees and metres; an accuracy of 0 is unknown."""

    timestamp: float
    latitude: float
    longitude: float
    altitude: float | None
    accuracy: float
    altitude_accuracy: float


def _place(reading: Any) -> _Place:
    latitude, longitude = _number(reading, "latitude"), _number(reading, "longitude")
    if not (abs(latitude) <= 90 and abs(longitude) <= 360):
        _refuse(f"geolocationReadings: {latitude:g}, {longitude:g} is not a latitude and longitude")
    altitude = _number(reading, "altitude") if reading.get("altitude") is not None else None
    accuracy, altitude_accuracy = (_number(reading, name, 0.0) for name in ("accuracy", "altitudeAccuracy"))
    return _Place(_number(reading, "timestamp", 0.0), latitude, longitude, altitude, accuracy, altitude_accuracy)


def _photo(reading: Any, max_pixels: int) -> bytes | Pixels:
    """Returns the file of a photo, or its pixels if it has no file around them."""
    orientation = _value(reading, "imageOrientation", dict, {})
    if _value(orientation, "mirrored", bool, False):
        _refuse("imageOrientation: the photo is mirrored, so that it cannot be localized")
    try:
        data = base64.b64decode(_value(reading, "imageBytes", str), validate=True)
    except ValueError:
        _refuse("imageBytes: is not Base64")
    form = _value(reading, "imageFormat", str, "").upper()
    if form == "DEPTH":
        raise HTTPException(415, "imageFormat: DEPTH is no photo")
    channels = RAW_CHANNELS.get(form, 0)  # 0: a file, whatever its format is called
    width, height = _size(reading)
    if not channels or width * height * channels != len(data):
        return data
    if width * height > max_pixels:
        raise HTTPException(413, f"the photo has {width} x {height} pixels, more than {max_pixels / 1e6:g} megapixels")
    return np.frombuffer(data, np.uint8).reshape(height, width, channels)[:, :, :3]


def _size(reading: Any) -> tuple[int, int]:
    size = _value(reading, "size", list)
    if len(size) != 2 or not all(isinstance(n, int | float) and 0 < n <= MAX_SIDE and n == int(n) for n in size):
        _refuse("size: must be the width and height of the photo")
    return int(size[0]), int(size[1])


def _number(of: Any, name: str, default: float | None = None) -> float:
    number: float = _value(of, name, (int, float), default)
    if isinstance(number, bool) or not abs(number) < MAX_NUMBER:
        _refuse(f"{name}: must be a number")
    return number


def _value(of: Any, name: str, kind: type | tuple[type, ...], default: Any = None) -> Any:
    """Returns a value of an object; null is as good as none, and one without a default must be there."""
    if not isinstance(of, Mapping):
        _refuse(f"{name}: is missing")
    value = of.get(name)
    value = default if value is None else value
    if value is None:
        _refuse(f"{name}: is missing")
    if not isinstance(value, kind):
        kinds = {str: "a text", dict: "an object", list: "a list", bool: "true or false"}
        _refuse(f"{name}: must be {kinds.get(kind, 'a number') if isinstance(kind, type) else 'a number'}")
    return value


def _refuse(text: str) -> NoReturn:
    raise HTTPException(400, text)
