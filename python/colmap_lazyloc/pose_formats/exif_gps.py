"""Reads where photos were taken from the GPS fields of EXIF. Needs Pillow."""

import dataclasses
import math
import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.pose_formats.geo import GeoOrigin, is_height, to_geocentric
from colmap_lazyloc.pose_formats.posed_images import Position, Positions, list_images, open_photo

TITLE = "GPS"
BELOW_SEA_LEVEL = (1, b"\x01")
DEFAULT_STDDEV_M = 5.0
MAX_STDDEV_M = 1e5  # larger ones, such as 999999, mean that it is not known
# EXIF's altitudes are above the sea, which differs from the ellipsoid by up to 100 m.
HEIGHT_STDDEV_M = 50.0
HEIGHT_RATIO = 1.5  # of the error of GPS in height to that in the plane
# Standard deviations of RTK in metres, as DJI writes them into XMP, as an attribute or as an element.
RTK = re.compile(rb"drone-dji:RtkStd(Lat|Lon|Hgt)(?:\s*=\s*[\"']|>)\s*([0-9.]+)")


@dataclasses.dataclass(frozen=True)
class GpsPosition:
    """A position of EXIF: degrees, and metres. The altitude may be missing."""

    name: str
    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None
    stddev_m: float
    accuracy_m: float | None = None  # standard deviation in space, if the photo states one
    time: str = ""  # when it was taken; such texts have the order of the times


def read_positions(folder: pathlib.Path) -> list[GpsPosition]:
    """Reads the positions of the photos below a folder; those without GPS are left out, and counted."""
    names = list_images(folder)
    positions = read_photos({name: folder / name for name in names})
    if positions and len(positions) < len(names):
        logger.warning("%d of %d photos have no GPS", len(names) - len(positions), len(names))
    return positions


def read_photos(paths: Mapping[str, pathlib.Path]) -> list[GpsPosition]:
    """Reads the positions of photos, whose paths are given by name; those without GPS are left out."""
    return [position for name, path in paths.items() if (position := _read_photo(name, path)) is not None]


def in_local_frame(positions: Sequence[GpsPosition], origin: GeoOrigin | None = None) -> Positions:
    """Returns the positions that have an altitude, in the order in which they were taken, in the local frame at an
    origin, by default in their middle."""
    used = [photo for photo in sorted(positions, key=lambda photo: photo.time) if photo.altitude_m is not None]
    if not used:
        return Positions((), origin, TITLE)
    geodetic = np.array([[photo.latitude_deg, photo.longitude_deg, photo.altitude_m] for photo in used], float)
    origin = origin or _middle(used)
    points = origin.from_geodetic(*geodetic.T).tolist()
    photos = (Position(photo.name, (x, y, z), photo.accuracy_m) for photo, (x, y, z) in zip(used, points))
    return Positions(tuple(photos), origin, TITLE)


def write_positions(path: pathlib.Path, positions: Sequence[GpsPosition], origin: GeoOrigin | None) -> GeoOrigin:
    """Writes lines `name x y z sx sy sz` for --query_position_path in the frame of the origin, which is returned."""
    if not positions:
        raise InputError("no photo has a position (GPS) in EXIF")
    origin = origin or _middle(positions)
    lines = []
    for position in positions:
        height = origin.height_m if position.altitude_m is None else position.altitude_m
        x, y, z = origin.from_geodetic(position.latitude_deg, position.longitude_deg, height)[0].tolist()
        deviation = f"{position.stddev_m:.6g} {position.stddev_m:.6g} {HEIGHT_STDDEV_M:g}"
        lines.append(f"{position.name} {x:.17g} {y:.17g} {z:.17g} {deviation}\n")
    path.write_text("".join(lines), encoding="utf-8")
    return origin


def _middle(positions: Sequence[GpsPosition]) -> GeoOrigin:
    """Returns the mean of positions; that of their altitudes is 0 if all are missing."""
    altitudes = [photo.altitude_m for photo in positions if photo.altitude_m is not None] or [0.0]
    rows = [(photo.latitude_deg, photo.longitude_deg, np.mean(altitudes)) for photo in positions]
    return GeoOrigin.in_the_middle(to_geocentric(np.array(rows, float)))


def _read_photo(name: str, path: pathlib.Path) -> GpsPosition | None:
    """Returns the position of a photo; None if it has none that makes sense."""
    from PIL.ExifTags import GPS, IFD, Base

    try:
        with open_photo(path) as photo:
            exif = photo.getexif()
            gps: dict[int, Any] = dict(exif.get_ifd(IFD.GPSInfo))
            taken = exif.get_ifd(IFD.Exif)
            time = f"{taken.get(Base.DateTimeOriginal, '')}.{taken.get(Base.SubsecTimeOriginal, '')}"
            rtk = _rtk_stddev(photo)
        latitude = _degrees(gps[GPS.GPSLatitude]) * (-1 if _text(gps[GPS.GPSLatitudeRef]) == "S" else 1)
        longitude = _degrees(gps[GPS.GPSLongitude]) * (-1 if _text(gps[GPS.GPSLongitudeRef]) == "W" else 1)
    except Exception:  # Pillow's errors for damaged files are of many types
        return None
    # Without a fix, cameras write 0, 0.
    if not (abs(latitude) <= 90 and abs(longitude) <= 180) or (latitude, longitude) == (0, 0):
        return None
    altitude = _number(gps.get(GPS.GPSAltitude))
    if altitude is not None and gps.get(GPS.GPSAltitudeRef) in BELOW_SEA_LEVEL:
        altitude = -altitude
    if altitude is not None and not is_height(altitude):
        altitude = None
    stddev = _number(gps.get(GPS.GPSHPositioningError))
    if stddev is None or not 0 < stddev < MAX_STDDEV_M:
        return GpsPosition(name, latitude, longitude, altitude, DEFAULT_STDDEV_M, rtk, time)
    accuracy = rtk or stddev * math.hypot(1, HEIGHT_RATIO)
    return GpsPosition(name, latitude, longitude, altitude, stddev, accuracy, time)


def _rtk_stddev(photo: Any) -> float | None:
    """Returns the standard deviation in space that RTK states; None if it states none, or zeros."""
    segments = (data for marker, data in getattr(photo, "applist", ()) if marker == "APP1")
    found = {axis: float(value) for data in segments for axis, value in RTK.findall(data)}
    return math.hypot(*found.values()) if len(found) == 3 and all(found.values()) else None


def _number(value: Any) -> float | None:
    """Returns a number; None for what cameras write if they do not know it, such as 0/0."""
    try:
        number = float(value)
    except (ArithmeticError, TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _degrees(values: Any) -> float:
    """Returns the degrees of degrees, minutes and seconds."""
    degrees, minutes, seconds = (float(value) for value in values)
    return degrees + minutes / 60 + seconds / 3600


def _text(value: Any) -> str:
    return (value.decode() if isinstance(value, bytes) else str(value)).strip("\0 ").upper()
