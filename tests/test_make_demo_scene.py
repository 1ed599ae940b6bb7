"""The demo scene: exact to a small part of a pixel, the same for the same seed, and rich in features."""

import functools
import json
import pathlib
import sys

import cv2
import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "scripts"))
import evaluate  # noqa: E402
import make_demo_scene as demo  # noqa: E402
from scene_renderer import RayGrid, Rectangle, render  # noqa: E402

CAMERAS = {
    "database": demo.DATABASE_CAMERA,
    "query": demo.QUERY_CAMERA,
    "fisheye": dict(model="OPENCV_FISHEYE", width=640, height=480,
                    params=[300, 305, 318, 243, 0.02, -0.01, 0.003, -0.001]),
}
DOT_TEXELS = np.array([[300 + 400 * column, 260 + 330 * row] for row in range(5) for column in range(6)]) + 0.5


def black_sky(directions):
    return np.zeros((len(directions), 3), np.float32)


def plain(corner, right, down, value):
    return Rectangle(np.array(corner, float), np.array(right, float), np.array(down, float),
                     np.full((64, 64, 3), value, np.uint8))


def dotted_wall(sigma_texels=6.0):
    """A wall with Gaussian dots round DOT_TEXELS, seen along +y."""
    texture = np.zeros((1800, 2600, 3), np.uint8)
    profile = np.exp(-0.5 * (np.arange(-40, 41) / sigma_texels) ** 2)
    for column, row in DOT_TEXELS.astype(int):
        texture[row - 40 : row + 41, column - 40 : column + 41] = np.round(220 * np.outer(profile, profile))[..., None]
    return Rectangle(np.array([-4.0, 5.0, 2.5]), np.array([8.0, 0, 0]), np.array([0, 0, -5.5]), texture)


def centroid(image, xy, radius=9):
    """Of the brightness round a pixel position, in COLMAP's convention."""
    column, row = (int(np.floor(value)) for value in xy)
    window = image[row - radius : row + radius + 1, column - radius : column + radius + 1, 0]
    offsets = np.arange(-radius, radius + 1) + 0.5
    weight = window.sum()
    return np.array([column + (window.sum(axis=0) @ offsets) / weight, row + (window.sum(axis=1) @ offsets) / weight])


@pytest.mark.parametrize("name", CAMERAS)
def test_texture_points_appear_where_colmap_projects_them(name):
    camera = pycolmap.Camera(**CAMERAS[name])
    wall = dotted_wall()
    rotation, translation = demo.look_at(np.array([-1.0, -0.5, 0.6]), np.array([0.0, 5.0, -0.2]), roll_deg=7)
    image = render([wall], RayGrid(camera), rotation, translation, black_sky)
    errors = []
    for texel in DOT_TEXELS:
        xy = camera.img_from_cam(rotation @ wall.point(*texel) + translation)
        if np.all(xy > 20) and np.all(xy < np.array([camera.width, camera.height]) - 20):
            errors.append(centroid(image, xy) - xy)
    assert len(errors) >= 15
    assert np.abs(errors).max() < 0.05
    assert np.abs(np.mean(errors, axis=0)).max() < 0.01


def test_nearer_rectangle_hides_and_backs_are_not_seen():
    camera = pycolmap.Camera(model="PINHOLE", width=40, height=40, params=[20, 20, 20, 20])
    far = plain([-9, 4, 9], [18, 0, 0], [0, 0, -18], 50)
    near = plain([-0.5, 2, 0.5], [1, 0, 0], [0, 0, -1], 200)
    back = plain([9, 1, 9], [-18, 0, 0], [0, 0, -18], 120)
    rotation, translation = demo.look_at(np.zeros(3), np.array([0.0, 1, 0]), roll_deg=0)
    for order in ([far, near, back], [back, near, far]):
        image = render(order, RayGrid(camera), rotation, translation, black_sky)[..., 0]
        assert image[20, 20] == 200 and image[2, 2] == 50
        assert np.count_nonzero(image > 100) == 100  # 1 m at 2 m through f = 20 px


def test_plane_through_the_camera_is_clipped():
    camera = pycolmap.Camera(model="PINHOLE", width=40, height=40, params=[20, 20, 20, 20])
    floor = plain([-50, 50, -1], [100, 0, 0], [0, -100, 0], 90)
    rotation, translation = demo.look_at(np.zeros(3), np.array([0.0, 1, 0]), roll_deg=0)
    image = render([floor], RayGrid(camera), rotation, translation, black_sky)[..., 0]
    assert np.all(image[22:] == 90) and np.all(image[:20] == 0)


def test_fine_texture_far_away_turns_grey_instead_of_aliasing():
    camera = pycolmap.Camera(model="PINHOLE", width=60, height=60, params=[60, 60, 30, 30])
    checkers = np.indices((1024, 1024)).sum(axis=0) % 2 * 255
    wall = Rectangle(np.array([-6.0, 5, 6]), np.array([12.0, 0, 0]), np.array([0, 0, -12.0]),
                     np.repeat(checkers.astype(np.uint8)[..., None], 3, axis=2))
    rotation, translation = demo.look_at(np.zeros(3), np.array([1.0, 5, 0.3]), roll_deg=4)
    image = render([wall], RayGrid(camera), rotation, translation, black_sky)[5:-5, 5:-5, 0]
    assert image.std() < 3 and abs(image.mean() - 127.5) < 3


@pytest.mark.parametrize("seed", range(5))
def test_cameras_are_clear_of_everything_and_inside_the_courtyard(seed):
    for view in demo.database_views(seed, 40) + demo.query_views(seed, 30):
        position = -view.rotation.T @ view.translation
        assert np.all(np.abs(position[:2]) < demo.SIZE[:2] / 2 - 0.5) and 0.5 < position[2] < 4
        assert min(box.distance(position) for box in demo.BOXES) > demo.CLEARANCE
        assert np.linalg.det(view.rotation) == pytest.approx(1)


@pytest.fixture
def small_scene(monkeypatch):
    """Coarse textures and small photos, so that a scene takes less than a second."""
    monkeypatch.setattr(demo, "build_scene", functools.partial(demo.build_scene, texels_per_m=30))
    monkeypatch.setattr(demo, "DATABASE_CAMERA", dict(model="OPENCV", width=160, height=120,
                                                      params=[128.3, 129.1, 80.6, 59.2, -0.11, 0.04, 0.001, -0.0007]))
    monkeypatch.setattr(demo, "QUERY_CAMERA", dict(model="RADIAL", width=168, height=112,
                                                   params=[116.7, 83.2, 57.9, -0.08, 0.02]))
    return lambda path, seed=0, num_database=2: demo.main(
        ["--output_path", str(path), "--seed", str(seed), "--num_database_images", str(num_database),
         "--num_query_images", "1"])


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
    model = pycolmap.Reconstruction(tmp_path / "database_model")
    views = {view.name: view for view in demo.database_views(0, 2) + demo.query_views(0, 1)}
    poses = {**evaluate.read_poses(tmp_path / "database_model"),
             **evaluate.read_poses(tmp_path / "ground_truth" / "poses.txt")}
    assert set(poses) == set(views) and {image.name for image in model.images.values()} < set(views)
    for name, view in views.items():
        np.testing.assert_allclose(poses[name].rotation.as_matrix(), view.rotation, atol=1e-15)
        np.testing.assert_allclose(poses[name].translation, view.translation, rtol=1e-16)
        assert cv2.imread(str(tmp_path / "images" / name)).shape[:2] == (view.camera.height, view.camera.width)
    assert model.cameras[1].params.tolist() == demo.DATABASE_CAMERA["params"]
    name, camera_model, *numbers = (tmp_path / "queries_with_intrinsics.txt").read_text().split()
    assert (name, camera_model) == ("query/00.jpg", "RADIAL")
    assert [float(number) for number in numbers] == [168, 112, *demo.QUERY_CAMERA["params"]]


def test_bad_options_are_refused(tmp_path, capsys):
    for option in (["--num_query_images", "0"], ["--seed", "-1"]):
        with pytest.raises(SystemExit):
            demo.main(["--output_path", str(tmp_path / "scene"), *option])
    (tmp_path / "file").write_text("")
    assert demo.main(["--output_path", str(tmp_path / "file")]) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith("make_demo_scene.py: ")
    assert not (tmp_path / "scene").exists()


def epipolar_errors_px(view1, view2, xy1, xy2):
    """Distance in view2 of each point to its epipolar line, on the undistorted image."""
    rotation = view2.rotation @ view1.rotation.T
    x, y, z = view2.translation - rotation @ view1.translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    rays1, rays2 = (np.column_stack([view.camera.cam_from_img(xy), np.ones(len(xy))])
                    for view, xy in ((view1, xy1), (view2, xy2)))
    lines = rays1 @ essential.T
    distances = np.abs(np.sum(lines * rays2, axis=1)) / np.linalg.norm(lines[:, :2], axis=1)
    return distances * view2.camera.mean_focal_length()


def test_photos_match_and_their_matches_obey_the_true_poses():
    rectangles = demo.build_scene(seed=0, texels_per_m=70)
    database = demo.database_views(0, 40)[0]
    # A query one metre beside the database image: in the scene's own walk neighbours can look away from each other.
    centre = -database.rotation.T @ database.translation + [0.3, 0.9, 0.4]
    rotation = Rotation.from_euler("xyz", [4, -6, 5], degrees=True).as_matrix() @ database.rotation
    query = demo.View("query", pycolmap.Camera(**demo.QUERY_CAMERA), rotation, -rotation @ centre)
    keypoints, descriptors = [], []
    for index, view in enumerate((database, query)):
        photo = demo.photograph(render(rectangles, RayGrid(view.camera), view.rotation, view.translation, demo.sky),
                                np.random.default_rng(index))
        points, descriptor = cv2.SIFT_create(4000).detectAndCompute(cv2.cvtColor(photo, cv2.COLOR_BGR2GRAY), None)
        keypoints.append(np.array([point.pt for point in points]) + 0.5)  # OpenCV's pixel centres are at integers
        descriptors.append(descriptor)
    assert min(len(points) for points in keypoints) > 1500
    pairs = cv2.BFMatcher().knnMatch(*descriptors, k=2)
    matches = [best for best, second in pairs if best.distance < 0.7 * second.distance]
    assert len(matches) > 300
    errors = epipolar_errors_px(database, query, keypoints[0][[match.queryIdx for match in matches]],
                                keypoints[1][[match.trainIdx for match in matches]])
    assert np.median(errors) < 0.3 and np.mean(errors < 1.5) > 0.9
