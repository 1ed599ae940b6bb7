"""Reads and writes tables with a row for each photo: its name, where the camera was, how it was turned, and its
intrinsics."""

import csv
import dataclasses
import functools
import io
from collections.abc import Sequence

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import (
    CAMERA_NAMES,
    PERSPECTIVE_KIND,
    SizeOfPhoto,
    both,
    brown_camera,
    coefficients,
    named_camera,
    number,
    refuse_others,
)
from colmap_lazyloc.pose_formats.conventions import COLMAP, Convention
from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, Frame
from colmap_lazyloc.pose_formats.naming import short_names
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import MakeCamera, RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.text import Names, Row, Table, words

NAME = (
    *("name", "image", "image_name", "imagefile", "file", "filename", "file_name", "file_path", "label"),
    *("sourcefile", "photo", "photoid"),
)
LATITUDE = ("latitude", "lat", "gpslatitude")
LONGITUDE = ("longitude", "lon", "lng", "long", "gpslongitude")
HEIGHT = ("height_m", "altitude", "alt", "elevation", "ellipsoidal_height", "gpsaltitude", "z")
HEMISPHERES = (  # columns with the signs of others, as exiftool writes them: "S" or "South"
    (LONGITUDE, ("gpslongituderef", "longituderef", "lonref"), "W"),
    (LATITUDE, ("gpslatituderef", "latituderef", "latref"), "S"),
)
CENTRE = (("x", "px", "easting"), ("y", "py", "northing"), ("z", "pz"))
TRANSLATION = ("tx", "ty", "tz")
QUATERNION = ("qw", "qx", "qy", "qz")
YAW = ("yaw", "heading", "azimuth", "gimbalyawdegree", "yaw_deg")
PITCH = ("pitch", "gimbalpitchdegree", "pitch_deg")
ROLL = ("roll", "gimbalrolldegree", "roll_deg")
ANGLES = ("omega", "phi", "kappa")
EXPECTED = (
    "name; x, y, z (the centre) or latitude, longitude, altitude or tx, ty, tz (cam_from_world, as COLMAP's); qw, qx, "
    "qy, qz or yaw, pitch, roll or omega, phi, kappa"
)
FILM_MM = 36.0
FILM_COEFFICIENTS = ("k1", "k2", "k3", "k4", "t1", "t2")
TANGENTIAL = {"t1": "p2", "t2": "p1"}  # in OpenCV's order
REALITY_CAPTURE_HOLDS = {PERSPECTIVE_KIND: "k1 k2 k3 p1 p2"}
REALITY_CAPTURE = ("#name", "x", "y", "alt", "heading", "pitch", "roll", "f", "px", "py", *FILM_COEFFICIENTS)
IN_PIXELS = {"f", "fx", "fy", "flx", "fly", "cx", "cy"}
ROTATION_MATRIX = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))  # of Metashape, beside angles
ALIASES = {"width": "w", "height": "h", "heightpx": "h", "f": "fx", "model": "cameramodel"}
CAMERA_COLUMNS = CAMERA_NAMES | ALIASES.keys()


def parse(source: Source) -> RawPoses:
    """Reads a table of one's own."""
    if is_reality_capture(Head(source.path)):
        raise InputError(
            f"{source.path}: is a list of RealityCapture, by its #name, whose angles have another meaning: give the "
            "format realitycapture, or remove the # if it is a table of your own"
        )
    table = Table(source.path)
    vector, frame, convention = _position(table)
    rotation, convention = _rotation(table, convention)
    table.require(EXPECTED, NAME, *vector, *rotation)

    def parse_row(row: Row) -> RawPose:
        turn = row.numbers(*rotation)
        turn += [0.0] * (3 - len(turn))  # without a column for roll
        return RawPose(turn, position_of(row, vector), row.text(NAME), camera=camera_of_row(row))

    poses = each(table.rows(), parse_row, lambda row: row.label)
    table.report_unused(CAMERA_COLUMNS.union(ROTATION_MATRIX))
    if vector == TRANSLATION:
        logger.info("%s: tx, ty, tz are taken as COLMAP's cam_from_world (x, y, z would be the centre)", source.path)
    return RawPoses(poses, frame, convention)


def _position(table: Table) -> tuple[tuple[Names, ...], Frame, Convention]:
    """Returns the columns of the positions, and what they are."""
    of_centre = Convention("world_from_cam", vector="centre")
    if table.has(LATITUDE, LONGITUDE):
        # With a width, the height is that of the image.
        heights = HEIGHT if table.has("width") else (*HEIGHT, "height")
        return (LONGITUDE, LATITUDE, heights), Frame(GEOGRAPHIC), of_centre
    if table.has(*TRANSLATION):
        if table.has(*CENTRE):
            raise InputError(
                f"{table.path}: has x, y, z (the centre, beside world_from_cam) and tx, ty, tz (cam_from_world): keep "
                "those that belong to its rotations"
            )
        return TRANSLATION, Frame(), COLMAP
    return CENTRE, Frame(), of_centre


def position_of(row: Row, columns: Sequence[Names]) -> list[float]:
    """Returns three coordinates; a longitude or latitude is negative if another column says west or south."""
    values = row.numbers(*columns)
    for index, (axis, names, letter) in enumerate(HEMISPHERES):
        if columns[index] == axis and row.has(names) and row.text(names)[:1].upper() == letter:
            values[index] = -abs(values[index])
    return values


def _rotation(table: Table, convention: Convention) -> tuple[tuple[Names, ...], Convention]:
    """Returns the columns of the rotations, and what they are."""
    if table.has(*QUATERNION) or convention == COLMAP:
        return quaternion_columns(table, convention)
    if table.has(*ANGLES):
        return ANGLES, dataclasses.replace(convention, camera_axes="opengl", rotation="omega, phi, kappa")
    roll = (ROLL,) if table.has(ROLL) else ()
    return (YAW, PITCH, *roll), dataclasses.replace(convention, camera_axes="rfu", rotation="yaw, pitch, roll")


def quaternion_columns(
    table: Table, convention: Convention, names: tuple[str, ...] = QUATERNION
) -> tuple[tuple[Names, ...], Convention]:
    """Returns the columns of a quaternion in the order in which the table has them."""
    places = [table.find(name) for name in names]
    if places[0] is not None and places[1] is not None and places[0] > places[1]:
        return (*names[1:], names[0]), dataclasses.replace(convention, rotation="quaternion", quaternion="xyzw")
    return names, dataclasses.replace(convention, rotation="quaternion", quaternion="wxyz")


def camera_of_row(row: Row) -> MakeCamera | None:
    """Returns the intrinsics in the row of a table; None if it has none."""
    values = {ALIASES.get(name, name): value for name, value in row.values.items()}
    if not {"fx", "flx", "cameraanglex"} & set(values):
        return None
    units = [row.unit(name) for name in sorted(IN_PIXELS.intersection(row.values))]
    return functools.partial(_camera_in_pixels, values, units)


def _camera_in_pixels(values: dict[str, str], units: Sequence[str], size_of_photo: SizeOfPhoto) -> Camera:
    other = next(filter(None, units), None)
    if other is not None:
        raise ValueError(f"the intrinsics are in {other}, not in pixels")
    return named_camera(values, size_of_photo)


def is_reality_capture(head: Head) -> bool:
    """True for a table of RealityCapture or RealityScan with headings; there are ones without intrinsics."""
    if not head.has("pitch", "roll", "heading|yaw"):
        return False
    has_intrinsics = head.has("f35mm|pxnorm") or head.has("f", "t1|px")
    is_list = head.is_reality_capture and head.has("alt|z")
    return has_intrinsics or is_list or (head.starts("#") and head.has("alt", "heading"))


def parse_reality_capture(source: Source) -> RawPoses:
    """Reads "Internal/External camera parameters" of RealityCapture, and of RealityScan 2, which has other names.

    At heading, pitch and roll 0 a camera looks down, with the top of its image to the north.
    """
    table = Table(source.path)
    position: tuple[Names, ...] = ("x", "y", ("alt", "z"))
    angles: tuple[Names, ...] = (("heading", "yaw"), "pitch", "roll")
    table.require("name, x, y, alt, heading (or yaw), pitch, roll", "name", *position, *angles)

    def parse_row(row: Row) -> RawPose:
        camera = functools.partial(film_camera, row.values)
        return RawPose(row.numbers(*angles), row.numbers(*position), row.text("name"), camera=camera)

    poses = each(table.rows(), parse_row, lambda row: row.label)
    table.report_unused(("f", "f35mm", "px", "py", "pxnorm", "pynorm", *FILM_COEFFICIENTS))
    return RawPoses(poses, Frame(true_north=True))


def film_camera(values: dict[str, str], size_of_photo: SizeOfPhoto) -> Camera:
    """Returns a camera with the focal length of a film 36 mm wide, and the principal point relative to the longer side
    of the photo, from its middle."""
    if not {"f", "f35mm"} & set(values):
        raise ValueError("there are no intrinsics: give them as --camera")
    size = size_of_photo()
    longer = max(size)
    focal = number(values, "f35mm" if "f35mm" in values else "f") / FILM_MM * longer
    px, py = both(values, ("pxnorm", "pynorm") if "pxnorm" in values else ("px", "py"))
    k1, k2, k3, k4, t1, t2 = (number(values, name) for name in FILM_COEFFICIENTS)
    refuse_others(values, set(FILM_COEFFICIENTS))
    centre = size[0] / 2 + px * longer, size[1] / 2 + py * longer
    return brown_camera(size, (focal, focal), centre, (k1, k2, k3, k4), (t2, t1))


def reality_capture_text(raw: RawPoses) -> str:
    """Returns "Internal/External camera parameters"; a photo without intrinsics has empty cells."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(REALITY_CAPTURE)
    for pose, name in zip(raw.written, short_names([pose.name or "" for pose in raw.written])):
        camera = film_values(pose.camera) if isinstance(pose.camera, Camera) else None
        cells = [""] * (3 + len(FILM_COEFFICIENTS)) if camera is None else [words(value) for value in camera]
        table.writerow([name, *map(words, pose.vector), *map(words, pose.rotation), *cells])
    return file.getvalue()


def film_values(camera: Camera) -> list[float]:
    """Returns the intrinsics in a row: the inverse of `film_camera`."""
    _, values = coefficients(camera)
    longer = max(camera.width, camera.height)
    centre = (values["cx"] - camera.width / 2) / longer, (values["cy"] - camera.height / 2) / longer
    rest = [values.get(TANGENTIAL.get(name, name), 0.0) for name in FILM_COEFFICIENTS]
    return [values["fx"] / longer * FILM_MM, *centre, *rest]
