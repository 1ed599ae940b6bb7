"""Tests of poses: conversions, errors, and files that are read as they were written."""

import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc.poses import Pose, look_at, read_poses, write_poses

ORIENTATION = Rotation.from_euler("xyz", [100, 20, -35], degrees=True)


def turned(angle_deg, axis=(0.6, 0.0, 0.8)):
    return (Rotation.from_rotvec(np.radians(angle_deg) * np.array(axis)) * ORIENTATION).as_matrix()


@pytest.mark.parametrize("angles", [(0, 0, 0), (180, 0, 0), (0, 180, 0), (0, 0, 180), (179, 1, 2), (100, 20, -35)])
def test_rotation_matrix_is_kept(angles):
    rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    pose = Pose.from_matrix(rotation, [1, 2, 3])
    np.testing.assert_allclose(pose.rotation, rotation, atol=1e-15)
    assert np.linalg.norm(pose.qvec) == pytest.approx(1, abs=1e-15) and pose.qvec[0] >= 0


def test_quaternion_need_not_be_normalized():
    qvec = ORIENTATION.as_quat(scalar_first=True)
    np.testing.assert_allclose(Pose(-3 * qvec, np.zeros(3)).rotation, ORIENTATION.as_matrix(), atol=1e-15)


def test_centre_is_mapped_to_the_origin():
    pose = Pose.from_centre(ORIENTATION.as_matrix(), [3.0, -2.0, 1.5])
    np.testing.assert_allclose(pose.cam_in_world, [3.0, -2.0, 1.5])
    np.testing.assert_allclose(pose(np.array([[3.0, -2.0, 1.5]])), np.zeros((1, 3)), atol=1e-15)


def test_product_transforms_one_after_the_other():
    b_from_a, a_from_world = (Pose.from_matrix(turned(angle), [angle, -1.0, 2.0]) for angle in (20, 70))
    points = np.random.default_rng(0).normal(size=(4, 3))
    np.testing.assert_allclose((b_from_a @ a_from_world)(points), b_from_a(a_from_world(points)), atol=1e-13)
    np.testing.assert_allclose(b_from_a.inverse()(b_from_a(points)), points, atol=1e-13)


@pytest.mark.parametrize("angle_deg", [1e-7, 1e-3, 90, 179.999])
def test_rotation_error_is_exact_for_small_and_large_angles(angle_deg):
    truth = Pose.from_matrix(turned(0), np.zeros(3))
    _, error_deg = Pose.from_matrix(turned(angle_deg), np.zeros(3)).errors(truth)
    assert error_deg == pytest.approx(angle_deg, rel=1e-6)


def test_error_of_a_pose_and_itself_is_zero():
    pose = Pose.from_matrix(turned(12), [4.0, 5.0, 6.0])
    assert pose.errors(pose) == (0, 0) and pose.errors(Pose(-pose.qvec, pose.tvec)) == (0, 0)


def test_camera_looks_at_the_target_with_down_below():
    rotation = look_at([1.0, 2.0, 3.0], [1.0, 7.0, 3.0], down=(0, 0, -1))
    np.testing.assert_allclose(rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    rolled = look_at([1.0, 2.0, 3.0], [1.0, 7.0, 3.0], down=(0, 0, -1), roll_deg=90)
    np.testing.assert_allclose(rolled, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)


def test_file_keeps_every_bit(tmp_path):
    rng = np.random.default_rng(0)
    poses = {f"a b/{i}.jpg": Pose.from_matrix(turned(50 * i), 1e6 * rng.normal(size=3)) for i in range(3)}
    write_poses(tmp_path / "folder" / "poses.txt", poses)
    again = read_poses(tmp_path / "folder" / "poses.txt")
    assert {name: pose.bits() for name, pose in again.items()} == {name: pose.bits() for name, pose in poses.items()}
    assert struct.unpack("<7d", poses["a b/1.jpg"].bits())[4:] == tuple(poses["a b/1.jpg"].tvec)
