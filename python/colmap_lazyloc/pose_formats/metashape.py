"""Reads the XML file of cameras that Metashape exports.

Poses are world_from_cam with COLMAP's axes, in a frame of the chunk. The transform of the component or of the chunk
leads from there to local coordinates, or to geocentric ones (ECEF) if the reference is geographic or projected.
"""

import dataclasses
import pathlib
import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import brown_camera, fisheye_camera
from colmap_lazyloc.pose_formats.geo import GeoOrigin, to_geodetic
from colmap_lazyloc.pose_formats.posed_images import (
    PosedImage,
    PosedImages,
    Source,
    nearest_rotation,
    numbers,
)
from colmap_lazyloc.poses import Pose

GEOCENTRIC = "EPSG:4978"
MAX_SKEW_PX = 1.0  # of b2, which COLMAP's camera models lack; it moves pixels at the border by less than half of it


@dataclasses.dataclass(frozen=True, eq=False)
class Similarity:
    """A transform to the world: x -> scale rotation x + translation."""

    scale: float
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


def read(source: Source) -> PosedImages:
    chunk = _read_chunk(source.path)
    cameras = {sensor.get("id"): sensor for sensor in chunk.findall("sensors/sensor")}
    transforms = {part.get("id"): _similarity(part.find("transform")) for part in chunk.findall("components/component")}
    chunk_transform = _similarity(chunk.find("transform"))
    poses, intrinsics = {}, {}
    for camera in chunk.iter("camera"):
        matrix, name = camera.find("transform"), source.find_photo(camera.get("label"))
        if matrix is None or name is None:
            continue
        world_from_chunk = transforms.get(camera.get("component_id")) or chunk_transform
        poses[name] = _in_world(np.reshape(numbers(matrix.text, 16), (4, 4)), world_from_chunk)
        if camera.get("sensor_id") not in intrinsics:
            intrinsics[camera.get("sensor_id")] = source.camera or _camera(cameras[camera.get("sensor_id")])
    sensor_ids = {source.find_photo(camera.get("label")): camera.get("sensor_id") for camera in chunk.iter("camera")}
    origin = None
    if poses and _is_geocentric(chunk) and any(part is not None for part in (chunk_transform, *transforms.values())):
        origin, poses = _to_local(poses, source.origin)
    images = [
        PosedImage(name, intrinsics[sensor_ids[name]], Pose.from_centre(rotation.T, centre))
        for name, (rotation, centre) in poses.items()
    ]
    return PosedImages(images, origin)


_Pose = tuple[NDArray[np.float64], NDArray[np.float64]]  # world_from_cam and the centre


def _read_chunk(path: pathlib.Path) -> ET.Element:
    try:
        chunk = ET.fromstring(path.read_bytes()).find(".//chunk")
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}: is not XML: {error}") from None
    if chunk is None:
        raise InputError(f"{path}: has no chunk: export the cameras as 'Agisoft XML'")
    return chunk


def _similarity(element: ET.Element | None) -> Similarity | None:
    """Returns a transform; None if there is none."""
    if element is None or element.find("rotation") is None:
        return None
    rotation = nearest_rotation(np.reshape(numbers(element.findtext("rotation"), 9), (3, 3)))
    translation = np.array(numbers(element.findtext("translation", "0 0 0"), 3))
    return Similarity(float(element.findtext("scale", "1")), rotation, translation)


def _in_world(matrix: NDArray[np.float64], world_from_chunk: Similarity | None) -> _Pose:
    rotation, centre = nearest_rotation(matrix[:3, :3]), matrix[:3, 3]
    if world_from_chunk is None:
        return rotation, centre
    similarity = world_from_chunk
    return (
        similarity.rotation @ rotation,
        similarity.scale * (similarity.rotation @ centre) + similarity.translation,
    )


def _is_geocentric(chunk: ET.Element) -> bool:
    """True if the chunk has a reference on the Earth, not just local coordinates."""
    reference = (chunk.findtext("reference") or "").strip()
    return bool(reference) and not reference.startswith("LOCAL_CS")


def _to_local(poses: dict[str, _Pose], origin: GeoOrigin | None) -> tuple[GeoOrigin, dict[str, _Pose]]:
    """Turns geocentric poses into a local frame."""
    centres = np.array([centre for _, centre in poses.values()])
    if origin is None:
        mean = to_geodetic(GEOCENTRIC, centres.mean(axis=0)[None])[0]
        origin = GeoOrigin(*(round(value, 8) for value in mean.tolist()))
    axes, local = origin.axes(), origin.from_geocentric(centres)
    return origin, {name: (axes @ rotation, centre) for (name, (rotation, _)), centre in zip(poses.items(), local)}


def _camera(sensor: ET.Element) -> Camera:
    """Returns the adjusted camera of a sensor, or else the initial one."""
    calibrations = sensor.findall("calibration")
    label = sensor.get("label")
    if not calibrations:
        raise InputError(f"sensor '{label}' has no calibration")
    calibration = next((item for item in calibrations if item.get("class") == "adjusted"), calibrations[0])
    resolution = calibration.find("resolution")
    if resolution is None:
        resolution = sensor.find("resolution")
    if resolution is None:
        raise InputError(f"sensor '{label}' has no resolution")
    width, height = int(resolution.get("width", "")), int(resolution.get("height", ""))

    def value(tag: str) -> float:
        return float(calibration.findtext(tag, "0"))

    if abs(value("b2")) > MAX_SKEW_PX:
        raise InputError(f"sensor '{label}' has a skew b2, which COLMAP's camera models lack: calibrate it without b2")
    size, focal = (width, height), (value("f") + value("b1"), value("f"))
    centre = width / 2 + value("cx"), height / 2 + value("cy")
    radial = value("k1"), value("k2"), value("k3"), value("k4")
    kind = calibration.get("type", "frame")
    if kind == "fisheye":
        return fisheye_camera(size, focal, centre, radial)
    if kind != "frame":
        raise InputError(f"sensor '{label}' is of the type {kind}, which is not supported")
    # Metashape's p1 is OpenCV's p2, and the other way round.
    return brown_camera(size, focal, centre, radial, (value("p2"), value("p1")))
