"""Tests of databases and models made by pycolmap 4: rigs, frames, pose priors, every camera model of COLMAP 3.10.

The output must be readable by pycolmap 4, with rigs, frames, cameras and poses unchanged.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc.poses import Pose
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera, to_rigid3d
from colmap_lazyloc.testing import synthetic

pycolmap = pytest.importorskip("pycolmap", minversion="4")

# Camera 1 is the reference of the rig, 2 its other camera; each of the others is a rig of its own.
MODELS = {
    1: ("PINHOLE", [520, 515, 322, 238]),
    2: ("SIMPLE_RADIAL", [500, 320, 240, -0.05]),
    3: ("SIMPLE_PINHOLE", [510, 318, 242]),
    4: ("SIMPLE_RADIAL_FISHEYE", [480, 320, 240, 0.02]),
    5: ("RADIAL", [505, 321, 239, -0.04, 0.01]),
    6: ("RADIAL_FISHEYE", [470, 320, 240, 0.02, -0.005]),
    7: ("OPENCV", [500, 505, 320, 240, -0.05, 0.01, 1e-3, -1e-3]),
    8: ("OPENCV_FISHEYE", [460, 465, 320, 240, 0.01, 0.002, 0, 0]),
    9: ("FULL_OPENCV", [500, 500, 320, 240, -0.05, 0.01, 1e-3, 1e-3, 0.001, 0.01, 0, 0]),
    10: ("FOV", [480, 480, 320, 240, 0.6]),
    11: ("THIN_PRISM_FISHEYE", [470, 470, 320, 240, 0.01, 0, 1e-3, 0, 0, 0, 1e-3, 0]),
}
MODELS_OF_COLMAP4 = {
    "RAD_TAN_THIN_PRISM_FISHEYE": [470, 470, 320, 240, 0.01, 0, 0, 0, 0, 0, 1e-3, 0, 0, 0, 0, 0],
    "SIMPLE_DIVISION": [500, 320, 240, -0.05],
    "DIVISION": [500, 505, 320, 240, -0.05],
    "SIMPLE_FISHEYE": [480, 320, 240],
    "FISHEYE": [480, 485, 320, 240],
    "EUCM": [480, 485, 320, 240, 0.5, 1.1],
    "EQUIRECTANGULAR": [640, 480],
}
RIG_ID = 77
NUM_FRAMES = 4  # frames of the rig whose images are database images
OTHER_FROM_REFERENCE = pycolmap.Rigid3d(
    pycolmap.Rotation3d(Rotation.from_euler("y", 12, degrees=True).as_quat()), [-0.4, 0.03, 0.02]
)


class Camera(synthetic.Camera):
    """A camera of any model; pycolmap projects points."""

    @property
    def colmap(self):
        camera = to_pycolmap_camera(self.intrinsics(), self.camera_id)
        camera.has_prior_focal_length = True
        return camera

    def image_from_cam(self, points_in_cam):
        return self.colmap.img_from_cam(points_in_cam)

    def is_in_front(self, points_in_cam):
        return super().is_in_front(points_in_cam) | self.colmap.is_spherical()


def make_frames():
    """Returns frame id -> (rig id, rig_from_world, {camera_id: image name}).

    These are rig frames of the database, one of queries, then a query for each other camera. Ids of frames are far from
    those of images.
    """
    frames = {}
    for i, centre in enumerate(synthetic.arc(NUM_FRAMES)):
        pose = to_rigid3d(synthetic.looking_at(centre, [0.1, 0, 0]))
        frames[100 + i] = (RIG_ID, pose, {1: f"database/left_{i}.jpg", 2: f"database/right_{i}.jpg"})
    pose = to_rigid3d(synthetic.looking_at([0.5, -0.8, -5.2], [0, 0.1, 0]))
    frames[200] = (RIG_ID, pose, {1: "query/left.jpg", 2: "query/right.jpg"})
    for camera_id in list(MODELS)[2:]:
        pose = to_rigid3d(synthetic.looking_at([0.3 * camera_id - 2, 0.4, -5], [0, 0, 0.1], roll_deg=camera_id))
        frames[200 + camera_id] = (camera_id, pose, {camera_id: f"query/{MODELS[camera_id][0]}.jpg"})
    return frames


def make_scene(frames, models):
    rng = np.random.default_rng(4)
    points = rng.uniform(-1.2, 1.2, (300, 3))
    cameras = {camera_id: Camera(camera_id, name, 640, 480, params) for camera_id, (name, params) in models.items()}
    scene = synthetic.Scene(cameras, {}, {}, [], points)
    for _, rig_from_world, names in frames.values():
        for camera_id, name in names.items():
            pose = Pose.of(OTHER_FROM_REFERENCE * rig_from_world if camera_id == 2 else rig_from_world)
            keypoints, owners = synthetic.observe(cameras[camera_id], pose, points, 0.1, 0.8, rng)
            scene.images[name] = synthetic.Image(name, len(scene.images) + 1, camera_id, pose, keypoints, owners)
    scene.query_names = [name for name in scene.images if name.startswith("query")]
    for query_name in scene.query_names:
        for name in scene.database_names:
            scene.pairs[name, query_name] = synthetic.match(scene.images[name], scene.images[query_name], 0.2, rng)
    return scene


def make_rigs(scene):
    rig = pycolmap.Rig(rig_id=RIG_ID)
    rig.add_ref_sensor(scene.cameras[1].colmap.sensor_id)
    rig.add_sensor(scene.cameras[2].colmap.sensor_id, OTHER_FROM_REFERENCE)
    rigs = [rig]
    for camera_id in list(scene.cameras)[2:]:
        rigs.append(pycolmap.Rig(rig_id=camera_id))
        rigs[-1].add_ref_sensor(scene.cameras[camera_id].colmap.sensor_id)
    return rigs


def make_frame(frame_id, rig_id, names, images):
    frame = pycolmap.Frame(frame_id=frame_id, rig_id=rig_id)
    for name in names.values():
        frame.add_data_id(images[name].data_id)
    return frame


def colmap_images(scene):
    return {
        name: pycolmap.Image(name=name, camera_id=image.camera_id, image_id=image.image_id)
        for name, image in scene.images.items()
    }


def write_database(path, scene, frames):
    images = colmap_images(scene)
    with pycolmap.Database.open(str(path)) as database:
        for camera in scene.cameras.values():
            database.write_camera(camera.colmap, use_camera_id=True)
        for rig in make_rigs(scene):
            database.write_rig(rig, use_rig_id=True)
        for name, image in images.items():
            database.write_image(image, use_image_id=True)
            database.write_keypoints(image.image_id, scene.images[name].keypoints)
            prior = pycolmap.PosePrior(corr_data_id=image.data_id, position=scene.images[name].pose.cam_in_world + 0.5)
            database.write_pose_prior(prior)
        for frame_id, (rig_id, _, names) in frames.items():
            database.write_frame(make_frame(frame_id, rig_id, names, images), use_frame_id=True)
        for (name1, name2), pair in scene.pairs.items():
            database.write_matches(scene.images[name1].image_id, scene.images[name2].image_id, pair.matches)
    return path


def make_model(scene, frames):
    """Makes a model of the database images, with all cameras and rigs, as COLMAP's mapper leaves them."""
    reconstruction = pycolmap.Reconstruction()
    for camera in scene.cameras.values():
        reconstruction.add_camera(camera.colmap)
    for rig in make_rigs(scene):
        reconstruction.add_rig(rig)
    images = colmap_images(scene)
    for frame_id, (rig_id, rig_from_world, names) in frames.items():
        if all(name in scene.query_names for name in names.values()):
            continue
        frame = make_frame(frame_id, rig_id, names, images)
        frame.rig_from_world = rig_from_world
        reconstruction.add_frame(frame)
        for name in names.values():
            images[name].frame_id = frame_id
            reconstruction.add_image(images[name])
    return reconstruction


@pytest.fixture(scope="module")
def frames():
    return make_frames()


@pytest.fixture(scope="module")
def scene(frames):
    return make_scene(frames, MODELS)


@pytest.fixture(scope="module")
def database_path(scene, frames, tmp_path_factory):
    return write_database(tmp_path_factory.mktemp("colmap4") / "database.db", scene, frames)


def bits(rigid3d):
    return [*rigid3d.rotation.quat, *rigid3d.translation]


def assert_same_rigs(written, expected):
    assert sorted(written.rigs) == sorted(expected.rigs)
    for rig_id, rig in expected.rigs.items():
        assert written.rig(rig_id).ref_sensor_id == rig.ref_sensor_id
        sensors = {sensor.id: bits(pose) for sensor, pose in rig.non_ref_sensors.items()}
        assert {sensor.id: bits(pose) for sensor, pose in written.rig(rig_id).non_ref_sensors.items()} == sensors


def assert_same_frames(written, expected):
    for frame_id, frame in expected.frames.items():
        assert written.frame(frame_id).rig_id == frame.rig_id
        assert bits(written.frame(frame_id).rig_from_world) == bits(frame.rig_from_world)
        written_ids, ids = (sorted(data.id for data in some.data_ids) for some in (written.frame(frame_id), frame))
        assert written_ids == ids


def assert_same_cameras(written, expected):
    assert sorted(written.cameras) == sorted(expected.cameras)
    for camera_id, camera in expected.cameras.items():
        assert written.camera(camera_id).model == camera.model
        assert list(written.camera(camera_id).params) == list(camera.params)


@pytest.mark.parametrize("write", ["write_binary", "write_text"])
def test_model_with_rigs_there_and_back(localize, scene, database_path, frames, tmp_path, write):
    model = make_model(scene, frames)
    (tmp_path / "model").mkdir()
    getattr(model, write)(str(tmp_path / "model"))
    run = localize("--database_path", database_path, "--input_path", tmp_path / "model")
    run.assert_localized(scene, scene.query_names, 0.01, 0.1)

    written = pycolmap.Reconstruction(str(run.output_path / "model"))
    assert_same_rigs(written, model)
    assert_same_frames(written, model)
    assert_same_cameras(written, model)
    poses = {image.name: image.cam_from_world() for image in written.images.values()}
    assert sorted(poses) == sorted(scene.images)
    for name, pose in run.poses.items():
        position_error, rotation_error_deg = Pose.of(poses[name]).errors(pose)
        assert position_error < 1e-12 and rotation_error_deg < 1e-5, name
    frame_of = {image.name: written.frame(image.frame_id) for image in written.images.values()}
    assert frame_of["query/left.jpg"].rig_id == frame_of["query/right.jpg"].rig_id == RIG_ID
    assert all(frame_of[f"query/{MODELS[camera_id][0]}.jpg"].rig_id == camera_id for camera_id in list(MODELS)[2:])
    written.write_binary(str(tmp_path))  # COLMAP checks all of a model here


def test_depth_maps(localize, scene, database_path, frames, tmp_path):
    """One image with a depth map is enough for a query of every camera model, and for a rig."""
    (tmp_path / "model").mkdir()
    make_model(scene, frames).write_binary(str(tmp_path / "model"))
    arguments = ["--database_path", database_path, "--input_path", tmp_path / "model"]
    arguments += ["--LazyLocalizer.num_retrieved", 1, "--LazyLocalizer.min_confidence", 0.5]
    lone = {name for name in scene.query_names if name not in ("query/left.jpg", "query/right.jpg")}
    without = localize(*arguments)
    assert {without.statuses[name] for name in lone} == {"SCALE_UNOBSERVABLE"}
    folder = synthetic.write_depth_maps(tmp_path / "maps", scene)
    run = localize(*arguments, "--depth_path", folder, "--LazyLocalizer.depth_is_metric", 1)
    run.assert_localized(scene, scene.query_names, 0.05, 0.5)
    assert all(run.results[name]["depth"]["fixes"] == "distance" for name in lone)


def test_leave_one_out_takes_the_query_out_of_its_frame(localize, scene, database_path, frames, tmp_path):
    model = make_model(scene, frames)
    (tmp_path / "model").mkdir()
    model.write_binary(str(tmp_path / "model"))
    # No database image is localized, because none are matched with each other; none may be left in a frame.
    run = localize(
        "--database_path", database_path, "--input_path", tmp_path / "model", "--LazyLocalizer.leave_one_out", 1
    )
    assert set(run.statuses.values()) == {"NO_PAIRS"}
    written = pycolmap.Reconstruction(str(run.output_path / "model"))
    assert written.num_images() == written.num_frames() == 0
    assert_same_rigs(written, model)


@pytest.mark.parametrize("name", MODELS_OF_COLMAP4)
def test_camera_model_of_colmap4(localize, frames, tmp_path, name):
    """The spherical camera stands amid the points, because it also sees behind itself. A program built against a COLMAP
    without the model says so and what to do."""
    models = {1: MODELS[1], 2: MODELS[2], 3: (name, MODELS_OF_COLMAP4[name])}
    frames = {frame_id: frame for frame_id, frame in frames.items() if frame_id < 200}
    centre = [0.2, -0.1, 0.3] if name == "EQUIRECTANGULAR" else [0.2, -0.1, -5]
    frames[200] = (3, to_rigid3d(synthetic.looking_at(centre, [0, 0, 1])), {3: "query/new.jpg"})
    scene = make_scene(frames, models)
    database_path = write_database(tmp_path / "database.db", scene, frames)
    (tmp_path / "model").mkdir()
    make_model(scene, frames).write_binary(str(tmp_path / "model"))
    run = localize("--database_path", database_path, "--input_path", tmp_path / "model")
    if run.exit_code == 0:
        run.assert_localized(scene, ["query/new.jpg"], 0.02, 0.2)
        written = pycolmap.Reconstruction(str(run.output_path / "model"))
        assert written.camera(3).model_name == name and list(written.camera(3).params) == MODELS_OF_COLMAP4[name]
    else:
        assert run.stderr.count("\n") == 1
        assert f"does not know camera model {name}: build against a newer COLMAP 4" in run.stderr


def test_stale_rigs_are_named(localize, scene, database_path, frames, tmp_path):
    """COLMAP 3 leaves such rigs: it writes its model beside the rigs.bin of an earlier one."""
    (tmp_path / "model").mkdir()
    make_model(scene, frames).write_binary(str(tmp_path / "model"))
    synthetic.write_model(tmp_path / "model", scene, names=scene.query_names)
    run = localize("--database_path", database_path, "--input_path", tmp_path / "model")
    assert run.exit_code == 1
    assert run.stderr.count("\n") == 1 and "images.bin: image" in run.stderr and "in no frame" in run.stderr
