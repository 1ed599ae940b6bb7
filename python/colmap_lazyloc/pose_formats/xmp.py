"""Reads and writes the XMP files that RealityCapture and RealityScan have beside photos: a folder with one for each.

Their values mean what "RealityCapture XMP Camera Math" of its support says: the rotation from the world to the camera,
row by row, the centre of the camera, and intrinsics as in its table.
"""

import functools
import pathlib
import xml.etree.ElementTree as ET

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import SizeOfPhoto
from colmap_lazyloc.pose_formats.naming import ENDING as PHOTO_ENDING
from colmap_lazyloc.pose_formats.naming import files_by_name, inside
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, of_largest_part
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.table import FILM_COEFFICIENTS, film_camera, film_values
from colmap_lazyloc.pose_formats.text import numbers, read_xml, report_unused, words, words_of

ENDING = ".xmp"
XCR = "http://www.capturingreality.com/ns/xcr/1.1#"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
META = "adobe:ns:meta/"
ROTATION, POSITION, COEFFICIENTS = "Rotation", "Position", "DistortionCoeficients"  # spelled so
INTRINSICS = {"f": "FocalLength35mm", "px": "PrincipalPointU", "py": "PrincipalPointV"}  # by their names in the table
MODELS = ("perspective", "brown3", "brown3t2", "brown4", "brown4t2")
FIXED = {"Skew": 0.0, "AspectRatio": 1.0}  # what COLMAP's camera models lack
# What is read, and the priors, groups and uses of a photo in a project.
KNOWN = words_of(
    "rotation position distortioncoeficients focallength35mm principalpointu principalpointv skew aspectratio "
    "distortionmodel xmpmeta xmptk rdf description about version poseprior coordinates calibrationprior "
    "calibrationgroup distortiongroup intexturing incoloring inmeshing componentid latitude longitude altitude"
)


def is_one(head: Head) -> bool:
    """True for a file with a pose, or for a folder of them."""
    paths = head.path.rglob(f"*{ENDING}") if head.is_folder else [head.path]
    return any(file.xml("xmpmeta") and f":{ROTATION}" in file.text for file in map(Head, paths))


def parse(source: Source) -> RawPoses:
    """Reads a folder of files, or one; the names of photos are those of the files without their endings."""

    given: dict[str, dict[str, str]] = {}

    def parse_file(file: tuple[str, pathlib.Path]) -> RawPose:
        name, path = file
        values = given[name] = _values(path)
        camera = functools.partial(_camera, values) if INTRINSICS["f"] in values else None
        rotation = np.reshape(numbers(values[ROTATION], 9), (3, 3))
        return RawPose(rotation, numbers(values[POSITION], 3), name, camera=camera)

    poses = each(files_by_name(source.path, ENDING), parse_file, lambda file: file[1].name)
    report_unused(source.path, given.values(), KNOWN)
    return RawPoses(of_largest_part(poses, lambda pose: _component(given[pose.name or ""]), source.path))


def _component(values: dict[str, str]) -> str | None:
    """Returns the component of a photo; None for coordinates that all components share."""
    return None if values.get("Coordinates") == "absolute" else values.get("ComponentId")


def _values(path: pathlib.Path) -> dict[str, str]:
    """Returns what a file says, by name: RealityCapture writes poses as elements, RealityScan also as attributes."""
    values = {}
    for element in read_xml(path).iter():
        values[element.tag] = element.text or ""
        values |= {name.rpartition("}")[2]: value for name, value in element.attrib.items()}
    return values


def _camera(values: dict[str, str], size_of_photo: SizeOfPhoto) -> Camera:
    """Returns a camera by the names of RealityCapture's table."""
    model = values.get("DistortionModel", MODELS[0])
    if model not in MODELS:
        raise ValueError(f"the distortion model {model} is not supported: export with one of {', '.join(MODELS)}")
    for name, value in FIXED.items():
        if abs(float(values.get(name, value)) - value) > 1e-9:
            raise ValueError(f"a camera has the {name} {values[name]}, which COLMAP's camera models lack")
    coefficients = values.get(COEFFICIENTS, "0 0 0 0 0 0").split()
    found = dict(zip(FILM_COEFFICIENTS, coefficients, strict=True))
    found |= {short: values[name] for short, name in INTRINSICS.items() if name in values}
    return film_camera(found, size_of_photo)


def write(path: pathlib.Path, raw: RawPoses) -> None:
    """Writes a folder of files."""
    of_file: dict[str, str] = {}
    for pose in raw.written:
        name = pose.name or ""
        file = inside(path, PHOTO_ENDING.sub("", name) + ENDING)
        if of_file.setdefault(str(file).casefold(), name) != name:
            raise InputError(
                f"{file.relative_to(path)}: would belong to '{name}' and '{of_file[str(file).casefold()]}'"
            )
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(_text(pose), encoding="utf-8", newline="")


def _text(pose: RawPose) -> str:
    """Returns a file, whose pose and intrinsics RealityCapture may refine."""
    for prefix, space in (("x", META), ("rdf", RDF), ("xcr", XCR)):
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{META}}}xmpmeta")
    about = ET.SubElement(ET.SubElement(root, f"{{{RDF}}}RDF"), f"{{{RDF}}}Description")
    attributes = {"Version": "3", "PosePrior": "initial", "Coordinates": "absolute"}
    elements = {ROTATION: words(pose.rotation), POSITION: words(pose.vector)}
    if isinstance(pose.camera, Camera):
        focal, px, py, *coefficients = film_values(pose.camera)
        # The smallest model that holds them: k1 to k3, then the tangential ones.
        model = "brown3t2" if any(coefficients[4:]) else "brown3" if any(coefficients) else "perspective"
        attributes |= {"DistortionModel": model, "CalibrationPrior": "initial"}
        attributes |= dict(zip(INTRINSICS.values(), map(words, (focal, px, py))))
        attributes |= {name: words(value) for name, value in FIXED.items()}
        elements[COEFFICIENTS] = words(coefficients)
    for name, value in attributes.items():
        about.set(f"{{{XCR}}}{name}", value)
    for name, value in elements.items():
        ET.SubElement(about, f"{{{XCR}}}{name}").text = value
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
