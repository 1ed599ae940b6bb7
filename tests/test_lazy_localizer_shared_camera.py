"""Tests of queries without intrinsics that one camera took: one in the database, or `--ImageReader.single_camera`."""

import numpy as np
import pytest

import colmap_lazyloc
from colmap_lazyloc.testing import synthetic

OPTION = ("--ImageReader.single_camera", 1)
WIDTH, HEIGHT, FOCAL_PX = 640, 500, 560.0
NUM_QUERIES, NOISE_PX = 12, 0.7


def make_scene(zooms):
    """Makes a scene whose queries have a lens with distortion and a shifted principal point; zooms: of each query."""
    scene = synthetic.make_scene(
        synthetic.arc(10), synthetic.arc(NUM_QUERIES, radius=5, height=-0.7), NOISE_PX, outlier_ratio=0.2
    )
    rng = np.random.default_rng(3)
    for i, (name, zoom) in enumerate(zip(scene.query_names, zooms, strict=True)):
        image = scene.images[name]
        image.camera_id = 2 + i
        camera = synthetic.Camera(
            2 + i, "SIMPLE_RADIAL", WIDTH, HEIGHT, [zoom * FOCAL_PX, WIDTH / 2 + 6, HEIGHT / 2 - 4, -0.12]
        )
        scene.cameras[2 + i] = camera
        image.keypoints, image.point_of_keypoint = synthetic.observe(
            camera, image.pose, scene.points, NOISE_PX, 0.7, rng
        )
        for database in scene.database_names:
            scene.pairs[database, name] = synthetic.match(scene.images[database], image, 0.2, rng)
    return scene


def of_database_cameras(scene, num_cameras):
    """Returns the scene whose database has so many cameras for the queries, in turn."""
    changed = guessed(scene)
    for i, name in enumerate(scene.query_names):
        changed.images[name].camera_id = 2 + i % num_cameras
    return changed


def guessed(scene):
    """Returns the scene with the cameras that COLMAP makes for photos without EXIF."""
    changed = scene.copy()
    for camera in changed.cameras.values():
        if camera.camera_id > 1:
            camera.params, camera.has_prior_focal_length = [1.2 * WIDTH, WIDTH / 2, HEIGHT / 2, 0.0], False
    return changed


@pytest.fixture(scope="module")
def scene():
    return make_scene([1.0] * NUM_QUERIES)


@pytest.fixture(scope="module")
def files(tmp_path_factory, write_scene_files, scene):
    return write_scene_files(tmp_path_factory.mktemp("shared"), guessed(scene), geometry=None)


@pytest.fixture(scope="module")
def shared(localize, files):
    return localize(*files.arguments, *OPTION)


def errors_of(run, scene):
    """Returns the error of each query's position."""
    centres = {name: pose.cam_in_world for name, pose in run.poses.items()}
    return np.array([np.linalg.norm(centres[name] - scene.images[name].pose.cam_in_world) for name in centres])


def test_common_camera_makes_poses_more_exact(localize, files, scene, shared):
    alone = localize(*files.arguments)
    shared.assert_localized(scene, scene.query_names, 0.02, 0.2)
    assert {result["intrinsics_source"] for result in shared.results.values()} == {"joint"}
    assert np.median(errors_of(shared, scene)) < 0.6 * np.median(errors_of(alone, scene))
    for name, result in shared.results.items():
        error = shared.poses[name].cam_in_world - scene.images[name].pose.cam_in_world
        assert error @ np.linalg.solve(result["position_covariance"], error) < 25, "within 5 standard deviations"


def test_camera_is_the_true_one_and_is_written_down(shared, scene):
    (line,) = [line for line in shared.stderr.splitlines() if line.startswith("camera of 12 queries")]
    params = [float(text) for text in line.split("camera_params ")[1].split(",")]
    truth = scene.cameras[2].params
    assert params[:2] == pytest.approx([truth[0]] * 2, rel=0.005)
    assert params[2:4] == pytest.approx(truth[1:3], abs=2)
    corner = np.hypot(WIDTH, HEIGHT) / 2 / FOCAL_PX
    displacement = FOCAL_PX * corner * ((params[4] - truth[3]) * corner**2 + params[5] * corner**4)
    assert abs(displacement) < 2, "of the image's corners, in pixels"
    assert f"# {line}" in (shared.output_path / "options.ini").read_text()
    assert {tuple(result["camera"]["params"]) for result in shared.results.values()} == {
        tuple(shared.results[scene.query_names[0]]["camera"]["params"])
    }


def test_options_of_the_line_give_the_same_poses(localize, files, scene, shared, tmp_path):
    (line,) = [line for line in shared.stderr.splitlines() if line.startswith("camera of")]
    params = line.split("camera_params ")[1].replace(",", " ")
    lines = [f"{name} OPENCV {WIDTH} {HEIGHT} {params}\n" for name in scene.query_names]
    (tmp_path / "queries.txt").write_text("".join(lines))
    run = localize(*files.arguments, "--query_list_path", tmp_path / "queries.txt")
    for name, pose in run.poses.items():
        assert np.linalg.norm(pose.cam_in_world - shared.poses[name].cam_in_world) < 1e-4


@pytest.mark.parametrize("num_threads", [1, 3])
def test_any_threads_and_order_give_the_same_bytes(localize, files, scene, shared, tmp_path, num_threads):
    names = np.random.default_rng(1).permutation(scene.query_names)
    (tmp_path / "list.txt").write_text("\n".join(names) + "\n")
    run = localize(
        *files.arguments,
        *OPTION,
        "--LazyLocalizer.num_threads",
        num_threads,
        "--query_list_path",
        tmp_path / "list.txt",
    )
    assert run.poses_bytes == shared.poses_bytes


def test_shards_estimate_the_same_camera(localize, files, shared):
    lines = []
    for shard in ("1/2", "2/2"):
        run = localize(*files.arguments, *OPTION, "--shard", shard)
        lines += [line for line in run.poses_bytes.splitlines() if not line.startswith(b"#")]
    assert sorted(lines) == sorted(line for line in shared.poses_bytes.splitlines() if not line.startswith(b"#"))


def test_queries_of_another_zoom_keep_a_camera_of_their_own(localize, write_scene_files, tmp_path):
    zooms = [1.0] * NUM_QUERIES
    zooms[3] = zooms[8] = 1.5
    scene = make_scene(zooms)
    run = localize(*write_scene_files(tmp_path, guessed(scene), geometry=None).arguments, *OPTION)
    run.assert_localized(scene, scene.query_names, 0.1, 0.8)
    sources = {name: result["intrinsics_source"] for name, result in run.results.items()}
    others = {scene.query_names[3], scene.query_names[8]}
    assert {name for name, source in sources.items() if source != "joint"} == others
    assert "camera of 10 queries" in run.stderr


def test_nothing_to_estimate_is_one_line(localize, noisy):
    run = localize(*noisy.arguments, *OPTION)
    assert run.exit_code == 0
    assert "--ImageReader.single_camera: no camera could be estimated" in run.stderr


def test_queries_of_one_camera_in_the_database_share_it(localize, write_scene_files, tmp_path, scene, shared):
    files = write_scene_files(tmp_path, of_database_cameras(scene, 1), geometry=None)
    run = localize(*files.arguments)
    assert [line for line in run.stderr.splitlines() if line.startswith("camera 2 of 12 queries")]
    assert run.poses_bytes == shared.poses_bytes
    run = localize(*files.arguments, "--ImageReader.single_camera_per_image", 1)
    assert {result["intrinsics_source"] for result in run.results.values()} == {"database"}
    assert "camera 2" not in run.stderr


def test_each_camera_in_the_database_is_estimated(localize, write_scene_files, tmp_path):
    zooms = [1.0, 1.5] * (NUM_QUERIES // 2)
    files = write_scene_files(tmp_path, of_database_cameras(make_scene(zooms), 2), geometry=None)
    run = localize(*files.arguments)
    lines = [line for line in run.stderr.splitlines() if line.startswith("camera ")]
    focals = [float(line.split("camera_params ")[1].split(",")[0]) for line in lines]
    assert [line.split(",")[0] for line in lines] == ["camera 2 of 6 queries", "camera 3 of 6 queries"]
    assert focals == pytest.approx([FOCAL_PX, 1.5 * FOCAL_PX], rel=0.01)
    assert {result["intrinsics_source"] for result in run.results.values()} == {"joint"}


def test_python_shares_cameras_like_the_command(localize, write_scene_files, tmp_path, scene):
    files = write_scene_files(tmp_path, of_database_cameras(scene, 1), geometry=None)
    command = localize(*files.arguments)
    with colmap_lazyloc.Localizer(files.database_path, files.model_path) as localizer:
        one = localizer.localize(scene.query_names[3])
        for result in [one, *localizer.localize_all()]:
            assert np.array_equal(result.covariance, np.array(command.results[result.name]["covariance"]))


def test_both_options_are_refused(localize, files):
    run = localize(*files.arguments, *OPTION, "--ImageReader.single_camera_per_image", 1)
    assert run.exit_code == 1
    assert "single_camera_per_image exclude each other" in run.stderr
