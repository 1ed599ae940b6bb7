"""Reads and writes the XML file of cameras that Metashape exports.

Poses are in a frame of the chunk. The transform of the component or of the chunk leads from there to local coordinates,
or to geocentric ones (ECEF) if the reference is geographic or projected.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import (
    FISHEYE_KIND,
    PERSPECTIVE_KIND,
    SPHERICAL_KIND,
    brown_camera,
    coefficients,
    fisheye_camera,
    number,
    refuse_others,
    spherical_camera,
)
from colmap_lazyloc.pose_formats.conventions import nearest_rotation
from colmap_lazyloc.pose_formats.frames import GEOCENTRIC, Frame, Similarity
from colmap_lazyloc.pose_formats.geo import GeoOrigin, local_axes, to_geocentric
from colmap_lazyloc.pose_formats.naming import short_names
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, matrix_parts
from colmap_lazyloc.pose_formats.text import numbers, read_xml, report_unused, words, words_of

MAX_SKEW_PX = 1.0  # of b2, which COLMAP's camera models lack; it moves pixels at the border by less than half of it
FISHEYE = ("fisheye", "equidistant_fisheye")  # the second since version 2.1
TYPES = {PERSPECTIVE_KIND: "frame", FISHEYE_KIND: "fisheye", SPHERICAL_KIND: "spherical"}
HOLDS = {PERSPECTIVE_KIND: "fy k1 k2 k3 p1 p2", FISHEYE_KIND: "fy k1 k2 k3 k4 p1 p2", SPHERICAL_KIND: ""}
EXCHANGED = {"p1": "p2", "p2": "p1"}  # Metashape's p1 is OpenCV's p2, and the other way round
WGS84 = (
    'GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.01745329251994328],AUTHORITY["EPSG","4326"]]'
)
COEFFICIENTS = {"k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2"}
KNOWN = COEFFICIENTS | words_of("f fx fy cx cy resolution covariance date")  # elements of a calibration


def parse(source: Source) -> RawPoses:
    root = read_xml(source.path)
    chunks = [chunk for chunk in root.iter("chunk") if chunk.find(".//camera/transform") is not None]
    if not chunks:
        raise InputError(f"{source.path}: has no chunk with aligned cameras: export the cameras as 'Agisoft XML'")
    if len(chunks) > 1:
        logger.warning("%s: has %d chunks: only the first is read", source.path, len(chunks))
    chunk = chunks[0]
    sensors = {sensor.get("id"): sensor for sensor in chunk.findall("sensors/sensor")}
    cameras = {camera.get("id"): camera for camera in chunk.iter("camera")}
    of_chunk = _similarity(chunk.find("transform"))
    of_parts = {part.get("id"): _similarity(part.find("transform")) for part in chunk.findall("components/component")}
    # Cameras without a transform are not aligned, but for those that a rig's master leads.
    aligned = [camera for camera in cameras.values() if _is_aligned(camera, cameras)]
    aligned = _of_one_world(aligned, cameras, of_parts, source)
    intrinsics: dict[str | None, Camera | None] = {}

    def parse_camera(camera: ET.Element) -> RawPose:
        sensor_id = camera.get("sensor_id")
        rotation, centre = matrix_parts(_matrix(camera, sensors, cameras))
        if sensor_id not in intrinsics:
            intrinsics[sensor_id] = None if source.camera is not None else _camera(sensors[sensor_id])
        label = camera.attrib["label"]
        similarity = of_parts.get(_part_of(camera, cameras)) or of_chunk
        return RawPose(rotation, centre, label, camera=intrinsics[sensor_id], similarity=similarity)

    poses = each(aligned, parse_camera, lambda camera: camera.get("label"))
    is_on_earth = _has_reference(chunk) and (of_chunk or any(of_parts.values()))
    return RawPoses(poses, Frame(GEOCENTRIC) if is_on_earth else Frame())


def _is_aligned(camera: ET.Element, cameras: Mapping[str | None, ET.Element]) -> bool:
    master = cameras.get(camera.get("master_id"))
    return any(one is not None and one.find("transform") is not None for one in (camera, master))


def _part_of(camera: ET.Element, cameras: Mapping[str | None, ET.Element]) -> str | None:
    """Returns the component that a camera belongs to, or that its rig's master does."""
    master = cameras.get(camera.get("master_id"))
    own = camera.get("component_id")
    return own if own is not None or master is None else master.get("component_id")


def _of_one_world(
    aligned: Sequence[ET.Element],
    cameras: Mapping[str | None, ET.Element],
    of_parts: Mapping[str | None, Similarity | None],
    source: Source,
) -> list[ET.Element]:
    """Returns the cameras of the components with a transform, or else of the largest: coordinates of one without a
    transform are its own."""
    count = Counter(_part_of(camera, cameras) for camera in aligned)
    if len(count) < 2 or len(count.keys() - {None}) < 2 or all(of_parts.get(part) for part in count):
        return list(aligned)
    kept = {part for part in count if of_parts.get(part)} or {max(count, key=lambda part: count[part])}
    logger.warning(
        "%s: %d photos of %d other components are left out, because they have no transform to the same coordinates",
        source.path,
        sum(number for part, number in count.items() if part not in kept),
        len(count) - len(kept),
    )
    return [camera for camera in aligned if _part_of(camera, cameras) in kept]


def _matrix(
    camera: ET.Element, sensors: Mapping[str | None, ET.Element], cameras: Mapping[str | None, ET.Element]
) -> NDArray[np.float64]:
    """Returns the 4x4 matrix of a camera: its own, or in a multi-camera system that of its master with the place of its
    sensor beside the master's."""
    own = camera.findtext("transform")
    if own is not None:
        return np.reshape(numbers(own, 16), (4, 4))
    sensor = sensors[camera.get("sensor_id")]
    if sensor.find("rotation") is None or sensor.find("translation") is None:
        raise ValueError("it is a camera of a rig (master_id), whose sensor has no rotation and translation")
    beside = np.eye(4)
    beside[:3, :3] = np.reshape(numbers(sensor.findtext("rotation"), 9), (3, 3))
    beside[:3, 3] = numbers(sensor.findtext("translation"), 3)
    return np.reshape(numbers(cameras[camera.get("master_id")].findtext("transform"), 16), (4, 4)) @ beside


def _similarity(element: ET.Element | None) -> Similarity | None:
    """Returns a transform; None if there is none."""
    if element is None or element.find("rotation") is None:
        return None
    rotation, _ = nearest_rotation(numbers(element.findtext("rotation"), 9))
    translation = np.array(numbers(element.findtext("translation", "0 0 0"), 3))
    return Similarity(float(element.findtext("scale", "1")) * rotation, translation)


def _has_reference(chunk: ET.Element) -> bool:
    """True if the chunk has a reference on the Earth, not just local coordinates."""
    reference = (chunk.findtext("reference") or "").strip()
    return bool(reference) and not reference.startswith("LOCAL_CS")


def _camera(sensor: ET.Element) -> Camera:
    """Returns the adjusted camera of a sensor, or else the initial one."""
    calibrations = sensor.findall("calibration")
    label = sensor.get("label")
    if not calibrations:
        raise ValueError(f"sensor '{label}' has no calibration")
    calibration = next((item for item in calibrations if item.get("class") == "adjusted"), calibrations[0])
    resolution = calibration.find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    if resolution is None:
        raise ValueError(f"sensor '{label}' has no resolution")
    width, height = size = int(resolution.get("width", "")), int(resolution.get("height", ""))
    values = {child.tag: child.text or "" for child in calibration}
    refuse_others(values, COEFFICIENTS)
    report_unused(f"sensor '{label}'", [values], KNOWN)
    if abs(number(values, "b2")) > MAX_SKEW_PX:
        raise ValueError(f"sensor '{label}' has a skew b2, which COLMAP's camera models lack: calibrate it without b2")
    if number(values, "b2") != 0:
        logger.warning("sensor '%s': its skew b2 of %s pixels is left out", label, values["b2"])
    if "fx" in values:  # PhotoScan up to 1.2: its principal point is from the corner
        focal = number(values, "fx"), number(values, "fy")
        centre = number(values, "cx", width / 2), number(values, "cy", height / 2)
    else:
        focal = number(values, "f") + number(values, "b1"), number(values, "f")
        centre = width / 2 + number(values, "cx"), height / 2 + number(values, "cy")
    radial = tuple(number(values, name) for name in ("k1", "k2", "k3", "k4"))
    tangential = number(values, EXCHANGED["p1"]), number(values, EXCHANGED["p2"])
    kind = calibration.get("type") or sensor.get("type") or "frame"
    if kind == "spherical":
        return spherical_camera(size)
    if kind not in ("frame", *FISHEYE):
        raise ValueError(f"sensor '{label}' is of the type {kind}, which is not supported")
    return (fisheye_camera if kind in FISHEYE else brown_camera)(size, focal, centre, radial, tangential)


def text(raw: RawPoses) -> str:
    """Returns the file: a chunk, which has a transform from the model to the Earth if the frame has an origin."""
    root = ET.Element("document", version="2.0.0")
    chunk = ET.SubElement(root, "chunk", label="colmap_lazyloc", enabled="true")
    sensors, cameras = ET.SubElement(chunk, "sensors"), ET.SubElement(chunk, "cameras")
    ids: dict[object, str] = {}
    names = short_names([pose.name or "" for pose in raw.written], has_ending=False)
    for index, (pose, label) in enumerate(zip(raw.written, names)):
        if pose.camera not in ids:
            ids[pose.camera] = str(len(ids))
            _add_sensor(sensors, ids[pose.camera], pose.camera if isinstance(pose.camera, Camera) else None)
        camera = ET.SubElement(cameras, "camera", id=str(index), sensor_id=ids[pose.camera], label=label)
        rows = np.column_stack([pose.rotation, pose.vector])
        ET.SubElement(camera, "transform").text = words(rows, (0, 0, 0, 1))
    if raw.frame.origin is not None:
        _add_place(chunk, raw.frame.origin)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_sensor(sensors: ET.Element, sensor_id: str, camera: Camera | None) -> None:
    """Adds a camera: the inverse of `_camera`; without intrinsics if these are None."""
    kind, values = (PERSPECTIVE_KIND, {}) if camera is None else coefficients(camera)
    sensor = ET.SubElement(sensors, "sensor", id=sensor_id, label=f"camera {sensor_id}", type=TYPES[kind])
    if camera is None:
        return
    size = {"width": str(camera.width), "height": str(camera.height)}
    ET.SubElement(sensor, "resolution", size)
    calibration = ET.SubElement(sensor, "calibration", {"type": TYPES[kind], "class": "adjusted"})
    ET.SubElement(calibration, "resolution", size)
    if kind == SPHERICAL_KIND:
        return
    named = {"f": values["fy"], "cx": values["cx"] - camera.width / 2, "cy": values["cy"] - camera.height / 2}
    named |= {"b1": values["fx"] - values["fy"]} if values["fx"] != values["fy"] else {}
    named |= {EXCHANGED.get(name, name): value for name, value in values.items() if name in COEFFICIENTS}
    for name, value in named.items():
        ET.SubElement(calibration, name).text = words(value)


def _add_place(chunk: ET.Element, origin: GeoOrigin) -> None:
    """Adds the transform from the local frame to geocentric coordinates."""
    place = np.array([[origin.latitude_deg, origin.longitude_deg, origin.height_m]])
    transform = ET.SubElement(chunk, "transform")
    ET.SubElement(transform, "rotation").text = words(local_axes(origin).T)
    ET.SubElement(transform, "translation").text = words(to_geocentric(place))
    ET.SubElement(transform, "scale").text = words(1)
    ET.SubElement(chunk, "reference").text = WGS84
