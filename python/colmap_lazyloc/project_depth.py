"""Makes depth maps of posed images by projecting the points of a laser scan or of a COLMAP model.

    python -m colmap_lazyloc.project_depth MODEL --points POINTS --output_path MAPS

MODEL is the folder of a COLMAP model. POINTS is a PLY file, or a folder with points3D.bin, in the coordinates of the
model. The command writes a file NAME.npy to MAPS for each image, for `colmap lazy_localizer --depth_path MAPS`. The
depth of a pixel is the depth of the nearest point at this pixel or within --splat_px pixels of it. The depth of a pixel
without points is unknown. Choose --max_size so small that each pixel of a surface has a point; otherwise, points behind
the surface appear in the map.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence
from typing import BinaryIO

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError, Parser, command
from colmap_lazyloc.model import Camera, Model, read_model
from colmap_lazyloc.points import read_points
from colmap_lazyloc.poses import Pose

_PLY_TYPES = {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8", "uchar": "u1", "uint8": "u1"}
_PLY_TYPES |= {"char": "i1", "int8": "i1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2"}
_PLY_TYPES |= {"int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"}
_PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(path: pathlib.Path) -> Array:
    """Returns the vertices of a PLY file, n x 3. They must be its first element, as they are in clouds and meshes."""
    try:
        with path.open("rb") as file:
            encoding, num_vertices, properties = _read_ply_header(file)
            if encoding == "ascii":
                table: Array = np.loadtxt(file, max_rows=num_vertices, ndmin=2)
                columns = [table[:, list(properties).index(axis)] for axis in "xyz"]
            else:
                order = _PLY_ORDERS[encoding]
                row = np.dtype([(name, order + _PLY_TYPES[kind]) for name, kind in properties.items()])
                table = np.frombuffer(file.read(row.itemsize * num_vertices), row)
                columns = [table[axis] for axis in "xyz"]
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise InputError(f"{path}: no readable PLY file with x, y, z: {error}") from None
    points = np.stack(columns, axis=1).astype(float)
    if len(points) != num_vertices:
        raise InputError(f"{path}: is cut off")
    return points[np.all(np.isfinite(points), axis=1)]


def _read_ply_header(file: BinaryIO) -> tuple[str, int, dict[str, str]]:
    """Returns encoding, number of vertices, and the types of a vertex's properties by name."""
    if file.readline().strip() != b"ply":
        raise ValueError("it does not begin with `ply`")
    encoding, num_vertices, element = "", 0, ""
    properties: dict[str, str] = {}
    for line in iter(file.readline, b""):
        words = line.decode(errors="replace").split()
        if words[:1] == ["end_header"]:
            return encoding, num_vertices, properties
        if words[:1] == ["format"]:
            encoding = words[1]
        elif words[:1] == ["element"]:
            if not element and words[1] != "vertex":
                raise ValueError("vertices are not its first element")
            element = words[1]
            if element == "vertex":
                num_vertices = int(words[2])
        elif words[:1] == ["property"] and element == "vertex":
            properties[words[-1]] = words[1]
    raise ValueError("its header does not end")


def project(camera: Camera, points_in_cam: Array) -> Array:
    """Returns the pixels of points in front of a camera of any of COLMAP's models."""
    try:
        import pycolmap
    except ImportError:
        raise InputError("projecting points needs pycolmap (pip install pycolmap)") from None
    colmap_camera = pycolmap.Camera(
        model=camera.model, width=camera.width, height=camera.height, params=list(camera.params)
    )
    return np.asarray(colmap_camera.img_from_cam(points_in_cam))


def depth_map(camera: Camera, pose: Pose, points: Array, max_size: int, splat_px: int) -> Array:
    """Returns the depths along the optical axis, 0 where no point is; the longer side has at most max_size pixels."""
    scale = min(1.0, max_size / max(camera.width, camera.height))
    width, height = round(camera.width * scale), round(camera.height * scale)
    in_cam = pose(points)
    # Leave out points far outside the image, where a distortion may fold them back into it.
    reach = np.hypot(camera.width, camera.height) / max(camera.width, camera.height)
    in_cam = in_cam[(in_cam[:, 2] > 0) & (np.hypot(in_cam[:, 0], in_cam[:, 1]) < 2 * reach * in_cam[:, 2])]
    xy = project(camera, in_cam) * (width / camera.width, height / camera.height)
    is_inside = np.all((xy >= 0) & (xy < (width, height)), axis=1)
    col, row = np.floor(xy[is_inside]).astype(int).T
    depths = np.full((height, width), np.inf, np.float32)
    for down in range(-splat_px, splat_px + 1):
        for right in range(-splat_px, splat_px + 1):
            y, x = row + down, col + right
            hits = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            np.minimum.at(depths, (y[hits], x[hits]), in_cam[is_inside][hits, 2].astype(np.float32))
    return np.where(np.isfinite(depths), depths, np.float32(0))


def write_depth_maps(model: Model, points: Array, output_path: pathlib.Path, max_size: int, splat_px: int) -> int:
    """Writes NAME.npy for each image of the model that sees a point; returns their number."""
    num_maps = 0
    for name, image in model.images.items():
        depths = depth_map(model.cameras[image.camera_id], image.pose, points, max_size, splat_px)
        if not np.any(depths):
            continue
        path = output_path / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, depths)
        num_maps += 1
    return num_maps


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model_path", type=pathlib.Path, help="folder with a COLMAP model: the images and their poses")
    parser.add_argument(
        "--points", type=pathlib.Path, required=True, help="3D points: PLY file, or folder with points3D.bin"
    )
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="folder for the depth maps")
    parser.add_argument(
        "--max_size", type=int, default=640, help="maximum width and height of a depth map in pixels; default: 640"
    )
    parser.add_argument(
        "--splat_px",
        type=int,
        default=1,
        help="a point also sets the depth of the pixels around it, up to this distance in pixels; default: 1",
    )
    return parser.parse_args(arguments)


@command(extra="hloc")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    if options.max_size < 1 or options.splat_px < 0:
        raise InputError("--max_size must be at least 1, --splat_px at least 0")
    points = read_points(options.points).xyz if options.points.is_dir() else read_ply(options.points)
    model = read_model(options.model_path)
    num_maps = write_depth_maps(model, points, options.output_path, options.max_size, options.splat_px)
    print(f"{num_maps} depth maps of {len(model.images)} images from {len(points)} points in {options.output_path}")


if __name__ == "__main__":
    sys.exit(main())
