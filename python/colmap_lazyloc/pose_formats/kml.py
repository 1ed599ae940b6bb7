"""Writes KML 2.2 of OGC: a point on the ground for each photo, with an arrow in its heading.

KML's altitudes are above the sea, which needs a model of the geoid; so heights above the ellipsoid are among the values
of a point, and not in its coordinates.
"""

import xml.etree.ElementTree as ET

from colmap_lazyloc.pose_formats.point_values import values_of
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses
from colmap_lazyloc.pose_formats.text import words

KML = "http://www.opengis.net/kml/2.2"
ARROW = "http://earth.google.com/images/kml-icons/track-directional/track-0.png"  # points to the north


def text(raw: RawPoses) -> str:
    """Returns the file."""
    ET.register_namespace("", KML)
    root = ET.Element(f"{{{KML}}}kml")
    document = _add(root, "Document")
    _add(document, "name", "colmap_lazyloc")
    for pose in raw.written:
        _add_point(document, pose)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_point(document: ET.Element, pose: RawPose) -> None:
    """Adds a photo; the order of elements is that of the schema."""
    values = values_of(pose)
    point = _add(document, "Placemark")
    _add(point, "name", pose.name or "")
    icon = _add(_add(point, "Style"), "IconStyle")
    _add(icon, "heading", words(values["heading_deg"]))
    _add(_add(icon, "Icon"), "href", ARROW)
    data = _add(point, "ExtendedData")
    for name, value in values.items():
        if value is not None:
            _add(_add(data, "Data", name=name), "value", value if isinstance(value, str) else words(value))
    _add(_add(point, "Point"), "coordinates", words(*map(float, pose.vector[:2]), separator=","))


def _add(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, f"{{{KML}}}{tag}", attributes)
    element.text = text
    return element
