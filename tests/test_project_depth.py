"""python -m colmap_lazyloc.project_depth: depth maps from points of a scan or a model."""

import struct

import numpy as np
import pytest

from colmap_lazyloc import project_depth
from colmap_lazyloc.model import Camera, Image, write_model
from colmap_lazyloc.poses import Pose

CAMERA = Camera("SIMPLE_RADIAL", 80, 60, (70.0, 40.0, 30.0, -0.05))
POSE = Pose(np.array([1.0, 0, 0, 0]), np.array([0.0, 0, 1]))  # the camera is at z = -1
POINTS = np.array([[0.0, 0, 1], [0.0, 0, 3], [0.4, 0.2, 3], [0, 0, -4]])  # the second is hidden, the last is behind


@pytest.fixture
def model_path(tmp_path):
    return write_model(tmp_path / "model", {1: CAMERA}, [Image("left/a.jpg", 1, POSE, 1)])


def ply(points, encoding):
    header = f"ply\nformat {encoding} 1.0\ncomment made by a test\nelement vertex {len(points)}\n"
    header += "property uchar red\nproperty float x\nproperty float y\nproperty double z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if encoding == "ascii":
        return (header + "".join(f"7 {x} {y} {z}\n" for x, y, z in points) + "3 0 1 2\n").encode()
    order = "<" if encoding == "binary_little_endian" else ">"
    return header.encode() + b"".join(struct.pack(order + "Bffd", 7, *point) for point in points) + b"\3" + bytes(12)


def points3d(points):
    rows = (struct.pack("<Q3d3BdQII", i + 1, *point, 0, 0, 0, 0.5, 1, 1, 0) for i, point in enumerate(points))
    return struct.pack("<Q", len(points)) + b"".join(rows)


def check_map(path):
    depths = np.load(path)
    assert depths.dtype == np.float32 and depths.shape == (30, 40)
    assert depths[15, 20] == 2  # the nearest point, in half the image's resolution
    distorted = 0.1 * (1 - 0.05 * (0.1**2 + 0.05**2))
    column, row = int((40 + 70 * distorted) / 2), int((30 + 35 * distorted) / 2)
    assert depths[row, column] == 4
    assert np.count_nonzero(depths) == 18  # two points of 3 x 3 pixels


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_scan(model_path, tmp_path, encoding, capsys):
    scan = tmp_path / "scan.ply"
    scan.write_bytes(ply(POINTS, encoding))
    arguments = [str(model_path), "--points", str(scan), "--output_path", str(tmp_path / "maps"), "--max_size", "40"]
    assert not project_depth.main(arguments)
    check_map(tmp_path / "maps" / "left" / "a.jpg.npy")
    assert capsys.readouterr().out.startswith("1 depth maps of 1 images from 4 points")


def test_points_of_a_model(model_path, tmp_path):
    (model_path / "points3D.bin").write_bytes(points3d(POINTS))
    arguments = [str(model_path), "--points", str(model_path), "--output_path", str(tmp_path), "--max_size", "40"]
    assert not project_depth.main(arguments)
    check_map(tmp_path / "left" / "a.jpg.npy")


@pytest.mark.parametrize("content", [b"", b"ply\nformat ascii 1.0\n", ply(POINTS, "binary_little_endian")[:-40]])
def test_bad_scan(model_path, tmp_path, content, capsys):
    scan = tmp_path / "scan.ply"
    scan.write_bytes(content)
    assert project_depth.main([str(model_path), "--points", str(scan), "--output_path", str(tmp_path / "maps")]) == 1
    error = capsys.readouterr().err.strip()
    assert str(scan) in error and "\n" not in error
    assert not (tmp_path / "maps").exists()
