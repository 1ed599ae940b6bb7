"""Reads and writes reconstruction.json of OpenSfM and OpenDroneMap, and reads shots.geojson of OpenDroneMap.

Lengths of the image are relative to its longer side, from its centre.
"""

import functools
import json
import pathlib
from typing import Any

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import (
    CAMERA_NAMES,
    FISHEYE_KIND,
    PERSPECTIVE_KIND,
    SPHERICAL_KIND,
    SizeOfPhoto,
    both,
    brown_camera,
    coefficients,
    fisheye_camera,
    number,
    refuse_others,
    spherical_camera,
)
from colmap_lazyloc.pose_formats.frames import Frame, Similarity
from colmap_lazyloc.pose_formats.geo import GeoOrigin, find_crs, from_geodetic
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.text import numbers, read_json, report_unused, words_of
from colmap_lazyloc.text_files import read_lines

TOPOCENTRIC = "reconstruction.topocentric.json"
HOLDS = {PERSPECTIVE_KIND: "fy k1 k2 k3 p1 p2", FISHEYE_KIND: "fy k1 k2 k3 k4", SPHERICAL_KIND: ""}
TYPES = {  # with the coefficients that a camera of this type must have
    PERSPECTIVE_KIND: ("brown", "k1 k2 k3 p1 p2"),
    FISHEYE_KIND: ("fisheye_opencv", "k1 k2 k3 k4"),
    SPHERICAL_KIND: ("spherical", ""),
}
# Keys that are read, and those of points, meshes, GPS and rigs beside the poses. Poses are those of photos as they are
# stored, whatever their orientation.
KNOWN = CAMERA_NAMES | words_of(
    "cameras shots points referencella biases rigcameras riginstances rotation translation camera orientation "
    "capturetime gpsdop gpsposition gpsaccuracy compass gravity skey sequencekey vertices faces scale covariance "
    "mergecc projectiontype width height focal focalx focaly focalprior k1prior k2prior filename"
)
MAX_NUM_TRIED = 5  # photos, for the zone of UTM
MAX_GRID_ERROR_M = 5.0  # between the two positions of a photo in shots.geojson


def parse(source: Source) -> RawPoses:
    path = source.path
    if path.name == "reconstruction.json" and path.with_name(TOPOCENTRIC).is_file():
        path = path.with_name(TOPOCENTRIC)
        logger.info("%s: is projected; %s beside it is read", source.path, TOPOCENTRIC)
    parts = read_json(path)
    if not parts:
        raise InputError(f"{path}: has no reconstruction")
    # Take the largest, because parts that are not connected have coordinates of their own.
    largest = max(parts, key=lambda part: len(part["shots"]))
    if len(parts) > 1:
        count = sum(len(part["shots"]) for part in parts if part is not largest)
        logger.warning("%s: %d photos of %d other parts are left out", path, count, len(parts) - 1)
    frame, similarity = _frame(path, largest.get("reference_lla"), source)

    def parse_shot(shot: tuple[str, dict[str, Any]]) -> RawPose:
        name, values = shot
        camera = functools.partial(_camera, largest["cameras"][values["camera"]])
        rotation, translation = numbers(values["rotation"], 3), numbers(values["translation"], 3)
        return RawPose(rotation, translation, name, camera=camera, similarity=similarity)

    poses = each(largest["shots"].items(), parse_shot, lambda shot: shot[0])
    report_unused(path, [largest, *largest["shots"].values(), *(largest.get("cameras") or {}).values()], KNOWN)
    return RawPoses(poses, frame)


def text(raw: RawPoses) -> str:
    """Returns reconstruction.json, with a place on the Earth if the frame has one."""
    cameras = {pose.camera: "" for pose in raw.written if isinstance(pose.camera, Camera)}
    ids = {camera: f"camera {index}" for index, camera in enumerate(cameras, start=1)}
    shots = {
        pose.name: {
            "rotation": np.asarray(pose.rotation).tolist(),
            "translation": np.asarray(pose.vector).tolist(),
            "camera": ids[pose.camera],
        }
        for pose in raw.written
        if isinstance(pose.camera, Camera)
    }
    part: dict[str, Any] = {
        "cameras": {name: _written_camera(camera) for camera, name in ids.items()},
        "shots": shots,
        "points": {},
    }
    origin = raw.frame.origin
    if origin is not None:
        place = origin.latitude_deg, origin.longitude_deg, origin.height_m
        part["reference_lla"] = dict(zip(("latitude", "longitude", "altitude"), place))
    return json.dumps([part], indent=2, ensure_ascii=False) + "\n"


def _written_camera(camera: Camera) -> dict[str, Any]:
    """Returns a camera as OpenSfM has it: the inverse of `_camera`."""
    kind, values = coefficients(camera)
    name, expected = TYPES[kind]
    longer = max(camera.width, camera.height)
    written: dict[str, Any] = {"projection_type": name, "width": camera.width, "height": camera.height}
    if kind == SPHERICAL_KIND:
        return written
    written |= {f"focal_{axis}": values[f"f{axis}"] / longer for axis in "xy"}
    written |= {"c_x": (values["cx"] - camera.width / 2) / longer, "c_y": (values["cy"] - camera.height / 2) / longer}
    return written | {key: values.get(key, 0.0) for key in expected.split()}


def _frame(path: pathlib.Path, reference: dict[str, Any] | None, source: Source) -> tuple[Frame, Similarity | None]:
    """Returns the frame at the reference; OpenDroneMap replaces the coordinates in it by those of a grid, minus whole
    metres, and leaves the reference."""
    if reference is None:
        return Frame(), None
    origin = GeoOrigin(*(float(reference[key]) for key in ("latitude", "longitude", "altitude")))
    project = path.absolute().parent.parent
    coords = project / "odm_georeferencing" / "coords.txt"
    if path.name == TOPOCENTRIC or not (coords.is_file() or path.absolute().parent.name == "opensfm"):
        return Frame(origin=origin), None
    if coords.is_file():
        return Frame(origin=origin), _from_grid(origin, coords)
    if source.crs is not None:
        raise InputError(f"--crs {source.crs}: OpenDroneMap's offset is missing: keep odm_georeferencing/coords.txt")
    logger.warning(
        "%s: OpenDroneMap may have changed the coordinates to a grid, so that they are used without a place on the "
        "Earth: keep %s beside it, or odm_georeferencing/coords.txt",
        path,
        TOPOCENTRIC,
    )
    return Frame(), None


def _from_grid(origin: GeoOrigin, coords: pathlib.Path) -> Similarity:
    """Returns the transform to the local frame from the grid of coords.txt, which has its name and its offset.

    OpenDroneMap makes the coordinates by a linear transform, that of the grid at the origin: this is its inverse.
    """
    name, offset = read_lines(coords)[:2]
    crs = find_crs(grid_name(name))
    x, y = numbers(offset, 2)
    corners = origin.to_geodetic(np.concatenate([np.zeros((1, 3)), np.eye(3)]))
    zero, *units = from_geodetic(crs, corners)
    matrix = np.linalg.inv(np.stack([unit - zero for unit in units], axis=1))
    return Similarity(matrix, -matrix @ (zero - (x, y, 0.0)))


def grid_name(text: str) -> str:
    """Returns the name of a grid for pyproj; OpenDroneMap writes `WGS84 UTM 32N`."""
    words = text.split()
    if words[:2] == ["WGS84", "UTM"]:
        return f"EPSG:{326 if words[2].endswith('N') else 327}{int(words[2][:-1]):02}"
    return text.strip()


def _camera(values: dict[str, Any], _: SizeOfPhoto | None = None) -> Camera:
    kind = values.get("projection_type", "perspective")
    width, height = size = int(values["width"]), int(values["height"])
    longer = max(size)
    focal_x, focal_y = (number(values, name, number(values, "focal")) * longer for name in ("focal_x", "focal_y"))
    x, y = both(values, ("c_x", "c_y"))
    centre = width / 2 + x * longer, height / 2 + y * longer
    k1, k2, k3, k4, p1, p2 = (number(values, key) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    refuse_others(values, {"k1", "k2", "k3", "k4", "p1", "p2"})
    if kind in ("perspective", "simple_radial", "radial", "brown"):
        return brown_camera(size, (focal_x, focal_y), centre, (k1, k2, k3, k4), (p1, p2))
    if kind in ("fisheye", "fisheye_opencv"):
        return fisheye_camera(size, (focal_x, focal_y), centre, (k1, k2, k3, k4), (p1, p2))
    if kind in ("spherical", "equirectangular"):
        return spherical_camera(size)
    raise InputError(f"the camera type {kind} is not supported")


def parse_shots(source: Source) -> RawPoses:
    """Reads shots.geojson. Positions (centres) and rotations are in a grid, whose zone follows from the coordinates."""
    features = read_json(source.path)["features"]
    grid = next((found for feature in features[:MAX_NUM_TRIED] if (found := _grid_of(feature)) is not None), None)
    if grid is None:
        logger.warning("%s: its translations are not in UTM, so that they belong to no known place", source.path)
    camera_of_all = None if source.camera is not None else _only_camera(source.path)

    def parse_feature(feature: dict[str, Any]) -> RawPose:
        values = feature["properties"]
        camera = camera_of_all or functools.partial(_camera, values)
        return RawPose(values["rotation"], values["translation"], str(values["filename"]), camera=camera)

    poses = each(features, parse_feature)
    report_unused(source.path, [item.get("properties") for item in features if isinstance(item, dict)], KNOWN)
    return RawPoses(poses, Frame(grid))


def _only_camera(path: pathlib.Path) -> Camera | None:
    """Returns the camera of cameras.json in the project, because shots.geojson has no distortion; None if not known."""
    for folder in (path.absolute().parent, path.absolute().parent.parent):
        if (folder / "cameras.json").is_file():
            cameras = list(read_json(folder / "cameras.json").values())
            if len(cameras) == 1:
                return _camera(cameras[0])
    logger.warning(
        "%s: has no distortion of the lens: give --camera, or keep cameras.json of one camera beside it", path
    )
    return None


def _grid_of(feature: dict[str, Any]) -> str | None:
    """Returns the zone of UTM in which a photo's geographic coordinates are its translation."""
    try:
        longitude, latitude, height = numbers(feature["geometry"]["coordinates"], 3)
        position = np.array(numbers(feature["properties"]["translation"], 3))
    except (KeyError, TypeError, ValueError):
        return None
    middle = int((longitude + 180) // 6) + 1
    for zone in (middle, middle - 1, middle + 1):
        grid = f"EPSG:{326 if latitude >= 0 else 327}{(zone - 1) % 60 + 1:02}"
        (found,) = from_geodetic(find_crs(grid), np.array([[latitude, longitude, height]]))
        if np.linalg.norm(found - position) < MAX_GRID_ERROR_M:
            return grid
    return None
