"""Tests that the demo scene is exact to a fraction of a pixel, is the same for the same seed, and has many features."""

import functools
import json

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc.demo import scene as demo
from colmap_lazyloc.demo.__main__ import main
from colmap_lazyloc.demo.renderer import RayGrid, Rectangle, render
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.poses import Pose, read_poses
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

CAMERAS = {
    "database": demo.DATABASE_CAMERA,
    "query": demo.QUERY_CAMERA,
    "fisheye": Camera("OPENCV_FISHEYE", 640, 480, (300, 305, 318, 243, 0.02, -0.01, 0.003, -0.001)),
}
DOT_TEXELS = np.array([[300 + 400 * column, 260 + 330 * row] for row in range(5) for column in range(6)]) + 0.5


def black_sky(directions):
    return np.zeros((len(directions), 3), np.float32)


def plain(corner, right, down, value):
    return Rectangle(
        np.array(corner, float), np.array(right, float), np.array(down, float), np.full((64, 64, 3), value, np.uint8)
    )


def dotted_wall(sigma_texels=6.0):
    """Makes a wall with Gaussian dots at DOT_TEXELS, seen along +y."""
    texture = np.zeros((1800, 2600, 3), np.uint8)
    profile = np.exp(-0.5 * (np.arange(-40, 41) / sigma_texels) ** 2)
    for column, row in DOT_TEXELS.astype(int):
        texture[row - 40 : row + 41, column - 40 : column + 41] = np.round(220 * np.outer(profile, profile))[..., None]
    return Rectangle(np.array([-4.0, 5.0, 2.5]), np.array([8.0, 0, 0]), np.array([0, 0, -5.5]), texture)


def centroid(image, xy, radius=9):
    """Returns the centroid of the brightness around a pixel position, in COLMAP's convention."""
    column, row = (int(np.floor(value)) for value in xy)
    window = image[row - radius : row + radius + 1, column - radius : column + radius + 1, 0]
    offsets = np.arange(-radius, radius + 1) + 0.5
    weight = window.sum()
    return np.array([column + (window.sum(axis=0) @ offsets) / weight, row + (window.sum(axis=1) @ offsets) / weight])


@pytest.mark.parametrize("name", CAMERAS)
def test_texture_points_appear_where_colmap_projects_them(name):
    camera = to_pycolmap_camera(CAMERAS[name])
    wall = dotted_wall()
    pose = demo.upright_pose(np.array([-1.0, -0.5, 0.6]), np.array([0.0, 5.0, -0.2]), roll_deg=7)
    image = render([wall], RayGrid(CAMERAS[name]), pose, black_sky)
    errors = []
    for texel in DOT_TEXELS:
        xy = camera.img_from_cam(pose(wall.point(*texel)))
        if np.all(xy > 20) and np.all(xy < np.array([camera.width, camera.height]) - 20):
            errors.append(centroid(image, xy) - xy)
    assert len(errors) >= 15
    assert np.abs(errors).max() < 0.05
    assert np.abs(np.mean(errors, axis=0)).max() < 0.01


def test_nearer_rectangle_hides_and_backs_are_not_seen():
    camera = Camera("PINHOLE", 40, 40, (20, 20, 20, 20))
    far = plain([-9, 4, 9], [18, 0, 0], [0, 0, -18], 50)
    near = plain([-0.5, 2, 0.5], [1, 0, 0], [0, 0, -1], 200)
    back = plain([9, 1, 9], [-18, 0, 0], [0, 0, -18], 120)
    pose = demo.upright_pose(np.zeros(3), np.array([0.0, 1, 0]), roll_deg=0)
    for order in ([far, near, back], [back, near, far]):
        image = render(order, RayGrid(camera), pose, black_sky)[..., 0]
        assert image[20, 20] == 200 and image[2, 2] == 50
        assert np.count_nonzero(image > 100) == 100  # 1 m at 2 m through f = 20 px


def test_plane_through_the_camera_is_clipped():
    camera = Camera("PINHOLE", 40, 40, (20, 20, 20, 20))
    floor = plain([-50, 50, -1], [100, 0, 0], [0, -100, 0], 90)
    pose = demo.upright_pose(np.zeros(3), np.array([0.0, 1, 0]), roll_deg=0)
    image = render([floor], RayGrid(camera), pose, black_sky)[..., 0]
    assert np.all(image[22:] == 90) and np.all(image[:20] == 0)


def test_fine_texture_far_away_turns_grey_instead_of_aliasing():
    camera = Camera("PINHOLE", 60, 60, (60, 60, 30, 30))
    checkers = np.indices((1024, 1024)).sum(axis=0) % 2 * 255
    wall = Rectangle(
        np.array([-6.0, 5, 6]),
        np.array([12.0, 0, 0]),
        np.array([0, 0, -12.0]),
        np.repeat(checkers.astype(np.uint8)[..., None], 3, axis=2),
    )
    pose = demo.upright_pose(np.zeros(3), np.array([1.0, 5, 0.3]), roll_deg=4)
    image = render([wall], RayGrid(camera), pose, black_sky)[5:-5, 5:-5, 0]
    assert image.std() < 3 and abs(image.mean() - 127.5) < 3


@pytest.mark.parametrize("seed", range(5))
def test_cameras_are_clear_of_everything_and_inside_the_courtyard(seed):
    for view in demo.database_views(seed, 40) + demo.query_views(seed, 30):
        position = view.pose.cam_in_world
        assert np.all(np.abs(position[:2]) < demo.SIZE[:2] / 2 - 0.5) and 0.5 < position[2] < 4
        assert min(box.distance(position) for box in demo.BOXES) > demo.CLEARANCE
        assert np.linalg.det(view.pose.rotation) == pytest.approx(1)


@pytest.fixture
def small_scene(monkeypatch):
    """Sets coarse textures and small photos, so that rendering a scene takes less than a second."""
    monkeypatch.setattr(demo, "build_scene", functools.partial(demo.build_scene, texels_per_m=30))
    monkeypatch.setattr(
        demo, "DATABASE_CAMERA", Camera("OPENCV", 160, 120, (128.3, 129.1, 80.6, 59.2, -0.11, 0.04, 0.001, -0.0007))
    )
    monkeypatch.setattr(demo, "QUERY_CAMERA", Camera("RADIAL", 168, 112, (116.7, 83.2, 57.9, -0.08, 0.02)))
    return lambda path, seed=0, num_database=2: main(
        [
            "--output_path",
            str(path),
            "--seed",
            str(seed),
            "--num_database_images",
            str(num_database),
            "--num_query_images",
            "1",
        ]
    )


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_same_seed_gives_the_same_files_and_another_seed_does_not(small_scene, tmp_path):
    assert small_scene(tmp_path / "a") == 0 and small_scene(tmp_path / "b") == 0
    assert small_scene(tmp_path / "c", seed=1) == 0
    first, again, other = (contents(tmp_path / name) for name in "abc")
    assert first == again and set(first) == set(other)
    for name in ("images/database/000.jpg", "images/query/00.jpg", "database_model/images.txt"):
        assert first[name] != other[name]


def test_finished_scene_is_left_alone_and_anything_else_is_made_anew(small_scene, tmp_path):
    small_scene(tmp_path)
    before = contents(tmp_path)
    marked = tmp_path / "images" / "database" / "001.jpg"
    marked.write_bytes(b"marked")
    small_scene(tmp_path)
    assert marked.read_bytes() == b"marked"
    (tmp_path / "scene.json").unlink()  # as after an interruption
    small_scene(tmp_path)
    assert contents(tmp_path) == before
    small_scene(tmp_path, num_database=1)
    assert not marked.exists() and json.loads((tmp_path / "scene.json").read_text())["num_database_images"] == 1


def test_files_agree_with_the_views(small_scene, tmp_path):
    small_scene(tmp_path)
    model = read_model(tmp_path / "database_model")
    views = {view.name: view for view in demo.database_views(0, 2) + demo.query_views(0, 1)}
    poses = {name: image.cam_from_world for name, image in model.images.items()}
    assert set(poses) < set(views)
    poses |= read_poses(tmp_path / "ground_truth" / "poses.txt")
    assert set(poses) == set(views)
    for name, view in views.items():
        assert poses[name].bits() == view.pose.bits()
        assert cv2.imread(str(tmp_path / "images" / name)).shape[:2] == (view.camera.height, view.camera.width)
    assert model.cameras == {1: demo.DATABASE_CAMERA}
    name, camera_model, *numbers = (tmp_path / "queries_with_intrinsics.txt").read_text().split()
    assert (name, camera_model) == ("query/00.jpg", "RADIAL")
    assert [float(number) for number in numbers] == [168, 112, *demo.QUERY_CAMERA.params]


def test_bad_options_are_refused(tmp_path, capsys):
    for option in (["--num_query_images", "0"], ["--seed", "-1"]):
        assert main(["--output_path", str(tmp_path / "scene"), *option]) == 1
    (tmp_path / "file").write_text("")
    assert main(["--output_path", str(tmp_path / "file")]) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith("lazyloc demo: ")
    assert not (tmp_path / "scene").exists()


def epipolar_errors_px(view1, view2, xy1, xy2):
    """Returns the distance in view2 of each point to its epipolar line, on the undistorted image."""
    rotation = view2.pose.rotation @ view1.pose.rotation.T
    x, y, z = view2.pose.tvec - rotation @ view1.pose.tvec
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    camera1, camera2 = (to_pycolmap_camera(view.camera) for view in (view1, view2))
    rays1, rays2 = (
        np.column_stack([camera.cam_from_img(xy), np.ones(len(xy))]) for camera, xy in ((camera1, xy1), (camera2, xy2))
    )
    lines = rays1 @ essential.T
    distances = np.abs(np.sum(lines * rays2, axis=1)) / np.linalg.norm(lines[:, :2], axis=1)
    return distances * camera2.mean_focal_length()


def test_photos_match_and_their_matches_obey_the_true_poses():
    rectangles = demo.build_scene(seed=0, texels_per_m=70)
    database = demo.database_views(0, 40)[0]
    # Place the query one metre beside the database image, because neighbours on the walk may look away from each other.
    centre = database.pose.cam_in_world + [0.3, 0.9, 0.4]
    rotation = Rotation.from_euler("xyz", [4, -6, 5], degrees=True).as_matrix() @ database.pose.rotation
    query = demo.View("query", demo.QUERY_CAMERA, Pose.from_centre(rotation, centre))
    keypoints, descriptors = [], []
    for index, view in enumerate((database, query)):
        photo = demo.photograph(
            render(rectangles, RayGrid(view.camera), view.pose, demo.sky), np.random.default_rng(index)
        )
        points, descriptor = cv2.SIFT_create(4000).detectAndCompute(cv2.cvtColor(photo, cv2.COLOR_BGR2GRAY), None)
        keypoints.append(np.array([point.pt for point in points]) + 0.5)  # OpenCV's pixel centres are at integers
        descriptors.append(descriptor)
    assert min(len(points) for points in keypoints) > 1500
    pairs = cv2.BFMatcher().knnMatch(*descriptors, k=2)
    matches = [best for best, second in pairs if best.distance < 0.7 * second.distance]
    assert len(matches) > 300
    errors = epipolar_errors_px(
        database,
        query,
        keypoints[0][[match.queryIdx for match in matches]],
        keypoints[1][[match.trainIdx for match in matches]],
    )
    assert np.median(errors) < 0.3 and np.mean(errors < 1.5) > 0.9
