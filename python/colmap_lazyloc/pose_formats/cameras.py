"""Makes COLMAP's cameras from the coefficients of other programs, and the other way round."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from colmap_lazyloc.model import CAMERA_MODELS, Camera
from colmap_lazyloc.pose_formats.text import words_of

MAX_IMAGE_SIZE = 1 << 20  # pixels; more is a mistake
# What real cameras have; a photo that is a part of another one has its principal point far from its middle.
FOCAL_LENGTHS = 0.05, 50.0  # relative to the longer side
PRINCIPAL_POINTS = 0.02, 0.98  # relative to the width and the height
MAX_ROUNDING = 2e-3  # relative, of a focal length that is also given as an angle
# What named_camera reads, and the size of the photos.
CAMERA_NAMES = words_of(
    "w h fx fy flx fly cx cy cameraanglex cameraangley cameramodel isfisheye k1 k2 k3 k4 k5 k6 p1 p2"
)
COEFFICIENT = re.compile(r"[bkpst]\d|s[xy]\d+|skew|xi")
SizeOfPhoto = Callable[[], tuple[int, int]]  # looks up the width and height in pixels
PERSPECTIVE = ("OPENCV", "FULL_OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
FISHEYE = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE")

PERSPECTIVE_KIND, FISHEYE_KIND, SPHERICAL_KIND = "perspective", "fisheye", "spherical"
# The parameters of COLMAP's camera models that other programs have, too.
_PARAMS = {
    "SIMPLE_PINHOLE": (PERSPECTIVE_KIND, "f cx cy"),
    "PINHOLE": (PERSPECTIVE_KIND, "fx fy cx cy"),
    "SIMPLE_RADIAL": (PERSPECTIVE_KIND, "f cx cy k1"),
    "RADIAL": (PERSPECTIVE_KIND, "f cx cy k1 k2"),
    "OPENCV": (PERSPECTIVE_KIND, "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": (PERSPECTIVE_KIND, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "SIMPLE_FISHEYE": (FISHEYE_KIND, "f cx cy"),
    "FISHEYE": (FISHEYE_KIND, "fx fy cx cy"),
    "SIMPLE_RADIAL_FISHEYE": (FISHEYE_KIND, "f cx cy k1"),
    "RADIAL_FISHEYE": (FISHEYE_KIND, "f cx cy k1 k2"),
    "OPENCV_FISHEYE": (FISHEYE_KIND, "fx fy cx cy k1 k2 k3 k4"),
    "THIN_PRISM_FISHEYE": (FISHEYE_KIND, "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    "EQUIRECTANGULAR": (SPHERICAL_KIND, "width height"),
}


def coefficients(camera: Camera) -> tuple[str, dict[str, float]]:
    """Returns the kind of a camera, and its numbers by name: the inverse of the functions below.

    These are `fx`, `fy`, `cx`, `cy` in pixels, and the coefficients that are not 0; of a spherical camera none. The
    kind of a camera that only COLMAP has is its model.
    """
    kind, names = _PARAMS.get(camera.model, (camera.model, ""))
    values = dict(zip(names.split(), camera.params))
    if "f" in values:
        values |= {"fx": values["f"], "fy": values.pop("f")}
    if kind == SPHERICAL_KIND:
        values = {}
    return kind, {name: value for name, value in values.items() if value != 0 or not COEFFICIENT.fullmatch(name)}


def brown_camera(
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: tuple[float, ...] = (),
    tangential: tuple[float, float] = (0.0, 0.0),
) -> Camera:
    """Returns a camera with Brown's distortion: k1, k2, k3 and p1, p2 in OpenCV's order. Pixels are COLMAP's."""
    k1, k2, k3, *rest = (*radial, 0.0, 0.0, 0.0)
    if any(rest):
        raise ValueError("a camera has a coefficient k4, which COLMAP's camera models lack: calibrate it with k1 to k3")
    pinhole = (*focal, *centre)
    if k3 != 0:
        return Camera("FULL_OPENCV", *size, (*pinhole, k1, k2, *tangential, k3, 0.0, 0.0, 0.0))
    if any((k1, k2, *tangential)):
        return Camera("OPENCV", *size, (*pinhole, k1, k2, *tangential))
    return Camera("PINHOLE", *size, pinhole)


def fisheye_camera(
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: tuple[float, ...] = (),
    tangential: tuple[float, float] = (0.0, 0.0),
) -> Camera:
    """Returns an equidistant camera: k1 to k4 and p1, p2 in OpenCV's order."""
    k1, k2, k3, k4 = (*radial, 0.0, 0.0, 0.0, 0.0)[:4]
    if any(tangential):
        return Camera("THIN_PRISM_FISHEYE", *size, (*focal, *centre, k1, k2, *tangential, k3, k4, 0.0, 0.0))
    return Camera("OPENCV_FISHEYE", *size, (*focal, *centre, k1, k2, k3, k4))


def spherical_camera(size: tuple[int, int]) -> Camera:
    return Camera("EQUIRECTANGULAR", *size, (float(size[0]), float(size[1])))


def named_camera(values: Mapping[str, Any], size_of_photo: SizeOfPhoto) -> Camera:
    """Makes a camera of values with the names of transforms.json, without their underscores."""
    if any(name.startswith("ftheta") for name in values):
        raise ValueError("its f-theta lens is not supported: calibrate it as OPENCV_FISHEYE")
    size = size_of(values) or size_of_photo()
    model = str(values.get("cameramodel") or "OPENCV").upper()
    if model == "EQUIRECTANGULAR":
        return spherical_camera(size)
    focal_x = _focal(values, "x", size[0])
    focal_y = _focal(values, "y", size[1]) or focal_x
    focal_x = focal_x or focal_y
    if focal_x is None or focal_y is None:
        raise ValueError("there is no focal length (fl_x, fx or camera_angle_x)")
    focal, centre = (focal_x, focal_y), both(values, ("cx", "cy"), (size[0] / 2, size[1] / 2))
    k1, k2, k3, k4, k5, k6 = (number(values, f"k{index}") for index in range(1, 7))
    tangential = number(values, "p1"), number(values, "p2")
    refuse_others(values, {"k1", "k2", "k3", "k4", "p1", "p2"} | ({"k5", "k6"} if model == "FULL_OPENCV" else set()))
    if model in FISHEYE or str(values.get("isfisheye")).lower() in ("true", "1"):
        return fisheye_camera(size, focal, centre, (k1, k2, k3, k4), tangential)
    if model == "FULL_OPENCV" and any((k4, k5, k6)):
        return Camera(model, *size, (*focal, *centre, k1, k2, *tangential, k3, k4, k5, k6))
    if model not in PERSPECTIVE:
        raise ValueError(f"the camera model {model} is not supported")
    return brown_camera(size, focal, centre, (k1, k2, k3, k4), tangential)


def contradicted_angles(values: Mapping[str, Any], size: tuple[int, int]) -> dict[str, float]:
    """Returns the angles of view that named_camera does not use, because there is another focal length."""
    found = {}
    for axis, length in zip("xy", size):
        name = f"cameraangle{axis}"
        used, other = _focal(values, axis, length), _focal({name: values.get(name)}, axis, length)
        if used and other and abs(other / used - 1) > MAX_ROUNDING:
            found[f"camera_angle_{axis}, which contradicts the focal length"] = values[name]
    return found


def size_of(values: Mapping[str, Any]) -> tuple[int, int] | None:
    """Returns the width and height among named values; None if they are missing."""
    width, height = (number(values, short, number(values, name)) for short, name in (("w", "width"), ("h", "height")))
    return (round(width), round(height)) if width and height else None


def number(values: Mapping[str, Any], name: str, default: float = 0.0) -> float:
    """Returns a value as a number; the default if there is none."""
    value = values.get(name)
    return default if value is None else float(value)


def both(
    values: Mapping[str, Any], names: tuple[str, str], defaults: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Returns two values as numbers, or the defaults if there is neither; refuses one without the other."""
    given = [name for name in names if values.get(name) is not None]
    if len(given) == 1:
        raise ValueError(f"a camera has {given[0]}, but of {' and '.join(names)} both are needed")
    return number(values, names[0], defaults[0]), number(values, names[1], defaults[1])


def refuse_others(values: Mapping[str, Any], known: set[str]) -> None:
    """Refuses a camera with a coefficient that would be dropped; `known`: those that are used."""
    for name, value in values.items():
        if isinstance(value, list) and "dist" in name and any(map(float, value)):
            raise ValueError(f"a camera has a list {name} of unknown order: name its coefficients k1, k2, p1, p2")
        if name not in known and COEFFICIENT.fullmatch(name) and number(values, name) != 0:
            raise ValueError(f"a camera has a coefficient {name}, which COLMAP's camera models lack or name otherwise")


def check_camera(camera: Camera) -> None:
    """Refuses a camera that cannot be."""
    num_params = dict(CAMERA_MODELS).get(camera.model)
    if num_params != len(camera.params):
        raise ValueError(f"there are {len(camera.params)} parameters for the camera model {camera.model}")
    if not (0 < camera.width <= MAX_IMAGE_SIZE and 0 < camera.height <= MAX_IMAGE_SIZE):
        raise ValueError(f"the size is {camera.width} x {camera.height}")
    if not all(map(math.isfinite, camera.params)) or not camera.params[0] > 0:
        raise ValueError("the focal length or the distortion cannot be")
    if camera.model != "EQUIRECTANGULAR":
        _check_pinhole(camera)


def _check_pinhole(camera: Camera) -> None:
    """Refuses focal lengths and principal points that are not in pixels of the photo."""
    has_one = camera.model.startswith("SIMPLE_") or camera.model in ("RADIAL", "RADIAL_FISHEYE")
    num_focal = 1 if has_one else 2
    longer = max(camera.width, camera.height)
    size = f"an image of {camera.width} x {camera.height} pixels"
    for focal in camera.params[:num_focal]:
        if not FOCAL_LENGTHS[0] * longer <= focal <= FOCAL_LENGTHS[1] * longer:
            raise ValueError(f"the focal length is {focal:.6g} pixels for {size}")
    for name, value, length in zip(("cx", "cy"), camera.params[num_focal:], (camera.width, camera.height)):
        if not PRINCIPAL_POINTS[0] * length <= value <= PRINCIPAL_POINTS[1] * length:
            raise ValueError(f"the principal point's {name} is {value:.6g} pixels for {size}")


def _focal(values: Mapping[str, Any], axis: str, length: float) -> float | None:
    """Returns the focal length in pixels along an axis; None if it is not given."""
    for name in (f"fl{axis}", f"f{axis}"):
        if values.get(name) is not None:
            return float(values[name])
    if values.get(f"cameraangle{axis}") is None:
        return None
    angle = float(values[f"cameraangle{axis}"])
    if not 0 < angle < math.pi:
        raise ValueError(f"camera_angle_{axis} is {angle:.6g}, but must be between 0 and pi: is it in degrees?")
    return length / (2 * math.tan(angle / 2))
