"""Tests of sessions in `lazyloc serve`: the last photo of a phone helps its next one, and never hides where it is."""

import json

import cv2
import numpy as np
import pytest

import colmap_lazyloc as ll
import photo_scene
from colmap_lazyloc.demo import scene as demo
from colmap_lazyloc.demo.renderer import RayGrid
from colmap_lazyloc.serve import sessions
from colmap_lazyloc.serve.query import Query
from colmap_lazyloc.serve.sessions import Sessions
from test_serve import SIFT, assert_one_line, serving

SOUTH = np.array([-2.0, -6.0, 1.8])  # on the south wall, which one database image alone shows


@pytest.fixture(scope="module")
def two_walls(photos, colmap, tmp_path_factory):
    """Returns the scene with another database image, of the south wall, and a photo of that wall with its pose."""
    scene = type(photos)(tmp_path_factory.mktemp("walls"), dict(photos.poses))
    (scene.image_path / "database").mkdir(parents=True)
    rectangles, rays = photo_scene.build_courtyard(), RayGrid(photo_scene.CAMERA)
    poses = [demo.upright_pose(np.array(centre), SOUTH, 2.0) for centre in ((-2.3, -1.4, 1.6), (-1.3, -1.7, 1.4))]
    pixels = [photo_scene.take_photo(rectangles, rays, pose, seed) for seed, pose in enumerate(poses)]
    cv2.imwrite(str(scene.image_path / "database/south.png"), pixels[0])
    scene.database_path.write_bytes(photos.database_path.read_bytes())
    photo_scene.extract_features(colmap, scene.database_path, scene.image_path, ["database/south.png"])
    names = [*photos.database_names, "database/south.png"]
    scene.poses["database/south.png"] = poses[0]
    views = [demo.View(name, photo_scene.CAMERA, scene.poses[name]) for name in names]
    demo.write_database_model(scene.model_path, views)
    return scene, cv2.imencode(".png", pixels[1])[1].tobytes(), poses[1]


@pytest.fixture(scope="module")
def server(two_walls):
    with serving(two_walls[0]) as server:
        yield server


def localize(server, photo, scene, session=None, **more):
    params = {"camera": scene.camera_words, **({} if session is None else {"session": session}), **more}
    return server.localize(photo, params=params).json()


def test_last_photo_gives_the_distance_from_a_single_image(server, two_walls, jpeg):
    scene, photo, pose = two_walls
    alone = localize(server, photo, scene)
    assert alone["status"] != "LOCALIZED" and alone["bearing"]["from"] == "database/south.png"
    for _ in range(5):  # a busy machine may take longer than a session's place is good for
        assert localize(server, jpeg, scene, "phone")["status"] == "LOCALIZED"
        answer = localize(server, photo, scene, "phone")
        if "priors" in answer:
            break
    assert answer["status"] == "LOCALIZED" and answer["priors"]["position"]["fixes"] == "distance"
    before = scene.poses[scene.query_names[0]].cam_in_world
    error = np.array(answer["position"]) - pose.cam_in_world
    assert error @ np.linalg.solve(answer["position_covariance"], error) < 16
    assert np.linalg.norm(np.array(answer["position"]) - before) > 0.3
    offset = np.cross(error, alone["bearing"]["direction"])  # the bearing is that of the images
    assert np.linalg.norm(offset) < 0.1
    for other in ("another-phone", None):
        assert localize(server, photo, scene, other)["status"] == alone["status"]


def test_well_seen_photo_has_its_own_pose(server, two_walls, jpeg):
    scene = two_walls[0]
    alone = localize(server, jpeg, scene)
    for _ in range(2):
        answer = localize(server, jpeg, scene, "robot")
        stddev = alone["position_stddevs"][0]
        assert np.linalg.norm(np.subtract(answer["position"], alone["position"])) < 0.01 * stddev + 1e-4


def test_photos_own_position_comes_first(server, two_walls, jpeg):
    scene, photo, pose = two_walls
    localize(server, jpeg, scene, "drone")
    x, y, z = pose.cam_in_world
    answer = localize(server, photo, scene, "drone", position=f"{x} {y} {z} 0.1")
    assert np.linalg.norm(np.array(answer["position"]) - pose.cam_in_world) < 0.2


@pytest.mark.parametrize("session", ["", " ", "x" * 65, "a\x00b", "a b", "é"])
def test_bad_session_is_one_line(server, jpeg, session):
    assert_one_line(server.localize(jpeg, params={"session": session}), 422, "session: must be a name")


def test_jump_is_answered_as_without_a_session(two_walls, jpeg):
    """The last photo was elsewhere; a photo that needs its place is not given one."""
    scene, photo, _ = two_walls
    with ll.Localizer(scene.database_path, scene.model_path, options=SIFT) as localizer:
        for image in (jpeg, photo):
            plain, jumped = (
                Query(image, {"camera": scene.camera_words}, localizer, prior).localize().as_dict()
                for prior in (None, (np.array([60.0, 40.0, 1.6]), np.eye(3)))
            )
            assert plain.pop("seconds") and jumped.pop("seconds") and plain == jumped


@pytest.fixture(scope="module")
def localized(two_walls, tmp_path_factory, jpeg):
    path = tmp_path_factory.mktemp("photo") / "photo.jpg"
    path.write_bytes(jpeg)
    scene = two_walls[0]
    with ll.Localizer(scene.database_path, scene.model_path, options=SIFT) as localizer:
        return localizer.localize_photo(path, scene.camera_words)


def test_place_is_less_certain_with_time_and_forgotten(localized):
    store = Sessions()
    assert store.prior("a", 0.0) is None
    store.add("a", 100.0, localized)
    stddevs = []
    for seconds in (100.0, 101.0, 103.0):
        position, covariance = store.prior("a", seconds)
        assert np.array_equal(position, localized.position)
        stddevs.append(np.sqrt(np.diag(covariance)))
    distance = localized.as_dict()["evidence"]["scene_distance"]
    assert 3 < distance < 15  # of the wall, in metres
    np.testing.assert_allclose(stddevs, distance * np.array([[0.1], [0.4], [1.0]]) * np.ones(3), rtol=0.01)
    assert store.prior("a", 103.1) is None and store.prior("b", 100.0) is None


def test_older_photo_and_failure_change_nothing(localized):
    store = Sessions()
    store.add("a", 100.0, localized)
    store.add("a", 99.0, localized)
    assert store.prior("a", 103.0) is not None
    fields = {"status": "NO_PAIRS", "evidence": None, "position": None, "position_covariance": None}
    failed = ll.Result("photo", json.dumps(fields), *[None] * 4)
    store.add("a", 102.0, failed)
    assert store.prior("a", 103.1) is None


def test_place_from_a_session_is_not_the_next_ones(two_walls, localized):
    """Else photos that each see one database image would lead anywhere."""
    scene, photo, _ = two_walls
    with ll.Localizer(scene.database_path, scene.model_path, options=SIFT) as localizer:
        store = Sessions()
        store.add("a", 100.0, localized)
        query = Query(photo, {"camera": scene.camera_words}, localizer, store.prior("a", 101.0))
        result = query.localize()
    assert result.is_localized and result.as_dict()["priors"]["position"]["fixes"] == "distance"
    store.add("a", 101.0, result)
    assert np.array_equal(store.prior("a", 102.0)[0], localized.position)


def test_number_of_sessions_is_bounded(localized):
    store = Sessions()
    for number in range(sessions.MAX_NUM_SESSIONS + 10):
        store.add(number, 0.0, localized)
        store.add(0, 0.0, localized)  # in use
    assert len(store) == sessions.MAX_NUM_SESSIONS
    assert store.prior(1, 0.0) is None and store.prior(0, 0.0) is not None
