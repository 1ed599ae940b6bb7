"""What a file is, by its content, and what to export instead of files that cannot be read."""

import pathlib
import re
from collections.abc import Callable, Sequence

from colmap_lazyloc.model import is_model
from colmap_lazyloc.pose_formats.text import SEPARATOR_LINE, column_names, header_of, separator_of, simple_name, split

HEAD_BYTES = 1 << 16


class Head:
    """The beginning of a file."""

    def __init__(self, path: pathlib.Path):
        self.path, self.name = path, path.name.lower()
        self.is_folder = path.is_dir()
        self.data = b""
        if not self.is_folder:
            with path.open("rb") as file:
                self.data = file.read(HEAD_BYTES)
        self.text = self.data.decode("utf-8", "replace").lstrip("\ufeff \t\r\n")
        lines = [line.strip() for line in self.text.splitlines() if line.strip()]
        lines = lines[1:] if lines and SEPARATOR_LINE.fullmatch(lines[0]) else lines
        self.body = [line for line in lines if not line.startswith("#")]
        self.first_line = self.body[0] if self.body else ""
        self.first_row = self.first_line.replace(",", " ").split()
        self.num_numbers = self.count_numbers(self.first_row)
        like = next((line for line in lines[:5] if separator_of(line)), "")
        # Names of columns stand in a comment, or in the first other line.
        heads = [line for line in lines[:5] if line.startswith("#") or line == self.first_line]
        self.names = {simple_name(word) for line in heads for word in split(line.lstrip("# "), like)}
        above = lines[: lines.index(self.first_line)] if self.body else lines
        head, self.first_data_line = header_of(above, self.body)
        self.columns = [] if head is None else column_names(head)  # the simple names of a header

    @property
    def is_model(self) -> bool:
        return self.is_folder and is_model(self.path)

    @property
    def is_reality_capture(self) -> bool:
        """True if the names of columns begin as those of RealityCapture, also below a line `#cameras 12`."""
        return re.match(r"(#cameras \d+\s+)?#name,", self.text) is not None

    @property
    def has_matrices(self) -> bool:
        """True for matrices of 16 numbers in a line, or of 4 numbers in 4 lines, or for a folder of text files."""
        if self.is_folder:
            return any(path.suffix == ".txt" for path in self.path.iterdir())
        rows = [line.replace(",", " ").split() for line in self.body[: 5 if self.num_numbers == 3 else 4]]
        counts = [self.count_numbers(row) for row in rows]
        return counts[:1] == [16] or (
            counts[-4:] == [4, 4, 4, 4] and [float(word) for word in rows[-1]] == [0, 0, 0, 1]
        )

    @property
    def is_table(self) -> bool:
        """True if the first line has a separator of columns, and a name; or if there is a header."""
        has_separator = separator_of(self.first_line or self.text[:200]) is not None
        return bool(self.columns) or (has_separator and self.num_numbers == 0)

    @staticmethod
    def count_numbers(words: Sequence[str]) -> int:
        """Returns how many words there are, if all are numbers; else 0."""
        try:
            return len([float(word) for word in words])
        except ValueError:
            return 0

    def has(self, *names: str) -> bool:
        """True if a table has columns with all of these names."""
        return all(any(word in self.names for word in name.split("|")) for name in names)

    def json(self, *keys: str) -> bool:
        """True if it is JSON with these keys."""
        return self.text[:1] in ("{", "[") and all(re.search(rf'"({key})"\s*:', self.text) for key in keys)

    def xml(self, name: str) -> bool:
        return self.text.startswith("<") and name in self.text

    def starts(self, *texts: str | bytes) -> bool:
        return any(
            self.data.startswith(text) if isinstance(text, bytes) else self.text.startswith(text) for text in texts
        )


_READABLE = "give a file of one of the formats of lazyloc import"
# Files that cannot be read: what they are, how they are known, and what to do.
FOREIGN: Sequence[tuple[str, Callable[[Head], bool], str]] = (
    ("sfm_data of openMVG", lambda f: f.json("sfm_data_version"), "convert it by openMVG_main_openMVG2Colmap"),
    (
        "an SfMData file of Meshroom",
        lambda f: f.name.endswith(".sfm") or f.json("views", "poses", "intrinsics"),
        "export by Meshroom's node ExportColmap, or ConvertSfMFormat to Bundler",
    ),
    ("a keyframe of Polycam", lambda f: f.json("t_00"), "give the folder of all keyframes"),
    (
        "a list of cameras of OpenDroneMap",
        lambda f: f.json("projection_type"),
        "give odm_report/shots.geojson of the project",
    ),
    ("a list of nerfstudio", lambda f: f.json("transform", "scale"), "give the transforms.json of the data"),
    ("a camera path of nerfstudio", lambda f: f.json("camera_path"), "give the transforms.json of the data"),
    ("an XMP file without a pose", lambda f: f.xml("xmpmeta"), "export XMP files with the poses of the cameras"),
    (
        "a file of Pix4D with matrices of its own coordinates",
        lambda f: f.starts("fileName imageWidth") or f.name.endswith(("_pmatrix.txt", ".p4d")),
        "give calibrated_external_camera_parameters.txt",
    ),
    (
        "a trajectory of Open3D in JSON",
        lambda f: f.json("class_name", "parameters"),
        "write it by Open3D with the ending .log",
    ),
    ("a project of Metashape", lambda f: f.name.endswith((".psx", ".psz")), "export the cameras as 'Agisoft XML'"),
    (
        "a reference table of Metashape",
        lambda f: "#coordinatesystem" in f.text[:200].lower() or f.has("label", "x/longitude|x/east|x/easting"),
        "export the cameras as 'Agisoft XML'",
    ),
    (
        "a list of RealityCapture with omega, phi, kappa, which have another order there",
        lambda f: f.is_reality_capture and f.has("omega", "phi", "kappa"),
        "export 'Internal/External camera parameters'",
    ),
    ("a database of COLMAP (SQLite)", lambda f: f.starts(b"SQLite format 3"), "give the folder of a model"),
    ("text in UTF-16", lambda f: f.starts(b"\xff\xfe", b"\xfe\xff"), "save it in UTF-8"),
    ("a point cloud or mesh (PLY)", lambda f: f.starts("ply\n", "ply\r"), "it has no cameras: give their poses"),
    ("a point cloud (LAS)", lambda f: f.starts(b"LASF"), "it has no cameras: give their poses"),
    ("Gaussian splats", lambda f: f.name.endswith((".ksplat", ".splat", ".spz")), "give the cameras.json beside them"),
    ("a graph of g2o or TORO", lambda f: f.starts("VERTEX"), "export poses in TUM's format"),
    ("an OBJ mesh", lambda f: f.name.endswith((".obj", ".mtl", ".glb", ".fbx")), "it has no cameras: give their poses"),
    ("a ROS bag", lambda f: f.starts(b"#ROSBAG", b"\x89MCAP"), "export the trajectory in TUM's format, by evo_traj"),
    ("a USDZ or zip archive", lambda f: f.starts(b"PK\x03\x04"), "unpack it and give the file of the poses"),
    ("a gzip archive", lambda f: f.starts(b"\x1f\x8b"), "unpack it and give the file of the poses"),
    ("an array of numpy", lambda f: f.starts(b"\x93NUMPY"), "write the matrices as text, one in each line"),
    ("a pickle of Python", lambda f: f.starts(b"\x80\x03", b"\x80\x04", b"\x80\x05"), "write the poses as CSV"),
    ("an HDF5 file", lambda f: f.starts(b"\x89HDF"), "write the poses as CSV"),
    (
        "a file of a COLMAP model",
        lambda f: (
            f.name in ("images.txt", "images.bin", "cameras.txt", "cameras.bin", "points3d.txt", "points3d.bin")
            or f.has("imageid", "cameraid")
        ),
        "give the folder of the model",
    ),
    (
        "the track of a receiver or of a drone",
        lambda f: f.name.endswith((".gpx", ".srt", ".nmea", ".pos")) or f.has("latitude", "longitude", "gimbalmode"),
        "it does not name photos: give the folder of photos with GPS (exif)",
    ),
    ("JSON of an unknown kind", lambda f: f.text[:1] in ("{", "["), f"{_READABLE}: transforms.json, for example"),
    ("XML of an unknown kind", lambda f: f.text.startswith("<"), f"{_READABLE}: Agisoft XML, for example"),
    ("a photo", lambda f: f.starts(b"\xff\xd8\xff", b"\x89PNG", b"II*\0", b"MM\0*"), "give the file of its pose"),
    ("a binary file", lambda f: b"\0" in f.data, _READABLE),
)


def foreign(head: Head) -> str | None:
    """Returns what a file is that cannot be read, and what to do; None if it is not known."""
    for title, is_one, advice in FOREIGN:
        if is_one(head):
            return f"is {title}: {advice}"
    return None
