"""Reads BlocksExchange, the XML of ContextCapture (iTwin Capture), which Metashape and others write, too."""

import dataclasses
import functools
import xml.etree.ElementTree as ET

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import SizeOfPhoto, brown_camera, refuse_others
from colmap_lazyloc.pose_formats.conventions import Convention
from colmap_lazyloc.pose_formats.frames import Frame
from colmap_lazyloc.pose_formats.geo import find_crs
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, of_largest_part
from colmap_lazyloc.pose_formats.text import read_xml, report_unused, words_of

CONVENTION = Convention("cam_from_world", rotation="matrix", vector="centre")
ORIENTATIONS = {"XRightYDown": "opencv", "XRightYUp": "opengl"}
DISTORTION = {"k1", "k2", "k3", "p1", "p2"}
# Elements of photos and of their groups that are read, and those of names, places of files, EXIF, masks and depths.
KNOWN = words_of(
    "name imagedimensions cameramodeltype cameramodelband focallength focallengthpixels sensorsize cameraorientation "
    "principalpoint distortion aspectratio skew photo id imagepath pose component exifdata maskpath neardepth "
    "mediandepth fardepth"
)
MATRIX = [f"M_{row}{column}" for row in range(3) for column in range(3)]


def parse(source: Source) -> RawPoses:
    root = read_xml(source.path)
    groups = list(root.iter("Photogroup"))
    photos = [
        (group, photo) for group in groups for photo in group.iter("Photo") if photo.find("Pose/Center") is not None
    ]
    if not photos:
        raise InputError(f"{source.path}: has no photo with a pose")
    orientation = _orientation(photos[0][0])
    components: dict[str | None, str | None] = {}

    def parse_photo(item: tuple[ET.Element, ET.Element]) -> RawPose:
        group, photo = item
        if _orientation(group) != orientation:
            raise ValueError(f"its CameraOrientation is not {orientation}, as that of the first photo")
        rotation = [_number(photo, f"Pose/Rotation/{name}") for name in MATRIX]
        centre = [_number(photo, f"Pose/Center/{axis}") for axis in "xyz"]
        name = photo.findtext("ImagePath") or ""
        components[name] = photo.findtext("Component")
        return RawPose(rotation, centre, name, camera=functools.partial(_camera, group))

    poses = each(photos, parse_photo, lambda item: item[1].findtext("ImagePath"))
    poses = of_largest_part(poses, lambda pose: components[pose.name], source.path)
    elements = [*groups, *(photo for _, photo in photos)]
    report_unused(source.path, [{child.tag: True for child in element} for element in elements], KNOWN)
    convention = dataclasses.replace(CONVENTION, camera_axes=ORIENTATIONS[orientation])
    return RawPoses(poses, _frame(root), convention)


def _number(element: ET.Element, path: str, default: float | None = None) -> float:
    text = element.findtext(path)
    if text is None and default is None:
        raise ValueError(f"there is no {path}")
    return float(text) if text is not None else float(default or 0)


def _orientation(group: ET.Element) -> str:
    orientation = group.findtext("CameraOrientation", "XRightYDown")
    if orientation not in ORIENTATIONS:
        raise ValueError(f"the CameraOrientation {orientation} is not supported: export XRightYDown")
    return orientation


def _frame(root: ET.Element) -> Frame:
    """Returns the reference system of the block."""
    names = {srs.findtext("Id"): srs.findtext("Definition", "") for srs in root.iter("SRS")}
    name = names.get(root.findtext("Block/SRSId"), "").strip()
    if not name or name.upper().startswith("LOCAL"):
        return Frame()
    if not find_crs(name).is_projected:
        raise InputError(f"the reference system {name[:60]} is not supported: export a projected one, or a local one")
    return Frame(name)


def _camera(group: ET.Element, _: SizeOfPhoto) -> Camera:
    if group.findtext("CameraModelType", "Perspective") != "Perspective":
        raise ValueError("only the CameraModelType Perspective is supported")
    if _number(group, "AspectRatio", 1) != 1 or _number(group, "Skew", 0) != 0:
        raise ValueError("a camera has an AspectRatio or a Skew, which is not supported: calibrate it without")
    width, height = size = tuple(int(_number(group, f"ImageDimensions/{name}")) for name in ("Width", "Height"))
    focal = _number(group, "FocalLengthPixels", 0)
    focal = focal or _number(group, "FocalLength") / _number(group, "SensorSize") * max(size)
    centre = _number(group, "PrincipalPoint/x", width / 2), _number(group, "PrincipalPoint/y", height / 2)
    k1, k2, k3, p1, p2 = (_number(group, f"Distortion/{name}", 0) for name in ("K1", "K2", "K3", "P1", "P2"))
    refuse_others({child.tag.lower(): child.text for child in group.iterfind("Distortion/*")}, DISTORTION)
    # As in Metashape, P1 is OpenCV's p2, and the other way round.
    return brown_camera((width, height), (focal, focal), centre, (k1, k2, k3), (p2, p1))
