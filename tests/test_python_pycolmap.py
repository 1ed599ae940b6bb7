"""Tests that pycolmap's objects are accepted wherever a model, a pose or a camera is."""

import subprocess
import sys

import numpy as np
import pycolmap
import pytest

import colmap_lazyloc as ll
from colmap_lazyloc import evaluate
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.hloc import localize_lazyloc
from colmap_lazyloc.model import Camera, Model, poses_of, read_model
from colmap_lazyloc.poses import Pose, read_poses, write_poses
from colmap_lazyloc.pycolmap_types import to_rigid3d
from test_hloc_to_database import hloc_files
from test_python_hloc import arguments_of
from test_python_processes import ENVIRONMENT

__all__ = ["hloc_files"]  # a fixture

IS_POSE_A_METHOD = callable(pycolmap.Image.cam_from_world)  # since 3.12, which has rigs
RIG_OFFSET = (0.5, 0.0, 0.0)


@pytest.fixture
def reconstruction(noisy):
    return pycolmap.Reconstruction(str(noisy.model_path))


def test_model_has_the_bits_of_the_files(noisy, reconstruction):
    expected, found = read_model(noisy.model_path), Model.of(reconstruction)
    assert found.cameras == expected.cameras and sorted(found.images) == sorted(expected.images)
    for name, image in expected.images.items():
        other = found.images[name]
        assert (other.camera_id, other.image_id) == (image.camera_id, image.image_id)
        assert max(other.cam_from_world.errors(image.cam_from_world)) < 1e-9


def test_localizer_takes_a_reconstruction(noisy, reconstruction):
    name = noisy.scene.query_names[0]
    expected = ll.Localizer(noisy.database_path, noisy.model_path).localize(name).pose
    images = Model.of(reconstruction).images
    cameras = {image.name: reconstruction.cameras[image.camera_id] for image in reconstruction.images.values()}
    for model in (
        reconstruction,
        {name: (to_rigid3d(image.cam_from_world), cameras[name]) for name, image in images.items()},
        {image.name: (image, cameras[image.name]) for image in reconstruction.images.values()},
    ):
        found = ll.Localizer(noisy.database_path, model).localize(name).pose
        assert max(found.errors(expected)) < 1e-6


def test_rig_takes_poses_of_pycolmap(noisy, reconstruction):
    localizer = ll.Localizer(noisy.database_path, reconstruction)
    poses = {name: noisy.scene.images[name].pose for name in noisy.scene.query_names[:2]}
    expected = localizer.localize_rig(poses)
    found = localizer.localize_rig({name: to_rigid3d(pose) for name, pose in poses.items()})
    assert all(result.is_localized for result in expected.values())
    for name, result in found.items():
        assert max(result.pose.errors(expected[name].pose)) < 1e-9


def test_hloc_takes_a_reconstruction(hloc_files):
    folder, _, _ = hloc_files
    arguments = arguments_of(folder)
    localize_lazyloc.main(**arguments)
    expected = read_poses(folder / "results.txt")
    localize_lazyloc.main(**arguments | {"reference_sfm": pycolmap.Reconstruction(str(folder / "model"))})
    found = read_poses(folder / "results.txt")
    assert sorted(found) == sorted(expected)
    assert all(max(found[name].errors(pose)) < 1e-6 for name, pose in expected.items())


def test_evaluation_takes_poses_of_pycolmap(noisy, reconstruction, tmp_path):
    moved = {name: to_rigid3d(pose) for name, pose in poses_of(reconstruction).items()}
    name, lost = sorted(moved)[:2]
    moved[name].translation = np.array(moved[name].translation) + (0.0, 0.0, 0.25)
    del moved[lost]
    errors = evaluate.evaluate(moved, reconstruction, [name, lost, sorted(moved)[-1]])
    assert errors[name][0] == pytest.approx(0.25) and errors[name][1] == pytest.approx(0, abs=1e-6)
    assert errors[lost] is None and max(errors[sorted(moved)[-1]]) < 1e-6
    write_poses(tmp_path / "poses.txt", moved)
    assert max(read_poses(tmp_path / "poses.txt")[name].errors(moved[name])) < 1e-9


def test_camera_has_the_parameters():
    camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=[500, 320, 240, 0.01])
    assert Camera.of(camera) == Camera("SIMPLE_RADIAL", 640, 480, (500.0, 320.0, 240.0, 0.01))


def test_image_without_a_pose_has_none(reconstruction):
    image = pycolmap.Image(name="query.jpg", camera_id=1, image_id=1000)
    with pytest.raises(InputError, match=r"query\.jpg"):
        Pose.of(image)
    if not IS_POSE_A_METHOD:
        reconstruction.add_image(image)
    else:
        frame = pycolmap.Frame(frame_id=1000, rig_id=next(iter(reconstruction.rigs)))
        frame.add_data_id(image.data_id)
        reconstruction.add_frame(frame)
        image.frame_id = 1000
        reconstruction.add_image(image)
    assert 1000 in reconstruction.images and "query.jpg" not in Model.of(reconstruction).images


@pytest.mark.skipif(not IS_POSE_A_METHOD, reason="pycolmap has no rigs")
def test_pose_of_an_image_in_a_rig():
    """The second camera of a rig has the frame's pose and its own place in the rig."""
    reconstruction, rig = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1)
    frame = pycolmap.Frame(frame_id=1, rig_id=1)
    images = []
    for index in (1, 2):
        camera = pycolmap.Camera(camera_id=index, model="PINHOLE", width=64, height=48, params=[50, 50, 32, 24])
        reconstruction.add_camera(camera)
        if index == 1:
            rig.add_ref_sensor(camera.sensor_id)
        else:
            rig.add_sensor(camera.sensor_id, pycolmap.Rigid3d(pycolmap.Rotation3d(), RIG_OFFSET))
        images.append(pycolmap.Image(name=f"{index}.jpg", camera_id=index, image_id=index))
        frame.add_data_id(images[-1].data_id)
    frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d([0, 0, 0.6, 0.8]), [1, 2, 3])
    reconstruction.add_rig(rig)
    reconstruction.add_frame(frame)
    for image in images:
        image.frame_id = 1
        reconstruction.add_image(image)
    found = poses_of(reconstruction)
    np.testing.assert_allclose(found["1.jpg"].tvec, (1, 2, 3))
    np.testing.assert_allclose(found["2.jpg"].tvec, (1.5, 2, 3))
    np.testing.assert_allclose(found["2.jpg"].qvec, (0.8, 0, 0, 0.6))


def test_objects_are_read_without_pycolmap():
    """The types have the attributes alone: reading them imports nothing."""
    program = """
import sys, types
from colmap_lazyloc.model import Model
def thing(**attributes):
    return types.SimpleNamespace(**attributes)
pose = thing(rotation=thing(quat=[0, 0, 0.6, 0.8]), translation=[1, 2, 3])
model = thing(
    cameras={1: thing(model="PINHOLE", width=64, height=48, params=[50, 50, 32, 24])},
    images={3: thing(name="a", camera_id=1, has_pose=True, cam_from_world=lambda: pose),
            4: thing(name="b", camera_id=1, registered=False, cam_from_world=pose)},
)
assert list(Model.of(model).images) == ["a"]
assert Model.of(model).images["a"].cam_from_world.text() == "0.80000000000000004 0 0 0.59999999999999998 1 2 3"
assert "pycolmap" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True, env=ENVIRONMENT)
