"""Tests that the Python package localizes as the program does: the same bytes of poses, the same content of results."""

import json
import types
import typing

import numpy as np
import pytest

import colmap_lazyloc as ll
from colmap_lazyloc.model import read_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.result_fields import LeaveOneOutFields, ResultFields
from colmap_lazyloc.results import read_results
from colmap_lazyloc.testing import synthetic
from conftest import DATA_PATH
from test_lazy_localizer_real_scenes import arguments_of


def as_options(arguments):
    """Returns the arguments of the program as those of Localizer."""
    names = [name.removeprefix("--") for name in map(str, arguments[::2])]
    options = dict(zip(names, arguments[1::2]))
    return options.pop("database_path"), options.pop("input_path"), options


def open_localizer(arguments):
    database, model, options = as_options(arguments)
    return ll.Localizer(database, model, options=options)


def assert_same_poses(results, run):
    assert {result.name: result.status for result in results} == run.statuses
    localized = {result.name: result.pose.bits() for result in results if result.is_localized}
    assert localized == {name: pose.bits() for name, pose in run.poses.items()}


def without_times(fields):
    return {name: value for name, value in fields.items() if name != "seconds"}


@pytest.fixture
def localizer(noisy):
    return ll.Localizer(noisy.database_path, noisy.model_path)


def test_every_query_has_the_bytes_of_the_program(localize, noisy, localizer):
    run = localize(*noisy.arguments)
    assert localizer.queries == noisy.scene.query_names
    assert_same_poses([localizer.localize(name) for name in localizer.queries], run)


def test_result_has_the_content_of_results_jsonl(localize, noisy, localizer):
    lines = (localize(*noisy.arguments).output_path / "results.jsonl").read_text(encoding="utf-8").splitlines()
    for line in lines:
        fields = json.loads(line)
        result = localizer.localize(fields["name"])
        assert without_times(result.as_dict()) == without_times(fields)
        assert list(result.as_dict()) == list(fields)


ANGLE_FIELDS = [
    f"{angle}_{field}" for angle in ("heading", "pitch", "roll", "top_heading") for field in ("deg", "stddev_deg")
]


def assert_has_type(value, kind, path="result"):
    """Checks a value of JSON against a type: TypedDicts, lists, dicts, unions and plain types."""
    if typing.get_origin(kind) is typing.NotRequired:
        return assert_has_type(value, *typing.get_args(kind), path)
    if isinstance(kind, types.UnionType):
        kinds = [inner for inner in typing.get_args(kind) if inner is not type(None)]
        return None if value is None else assert_has_type(value, *kinds, path)
    if typing.is_typeddict(kind):
        fields = typing.get_type_hints(kind)
        assert kind.__required_keys__ <= value.keys() <= fields.keys(), path
        for name, inner in value.items():
            assert_has_type(inner, fields[name], f"{path}.{name}")
    elif typing.get_origin(kind) in (list, dict):
        assert isinstance(value, typing.get_origin(kind)), path
        for inner in value if isinstance(value, list) else value.values():
            assert_has_type(inner, typing.get_args(kind)[-1], path)
    else:
        assert isinstance(value, (int, float) if kind is float else kind), path


@pytest.mark.parametrize("leave_one_out", [False, True])
def test_fields_have_the_types_of_the_typed_dicts(localize, noisy, leave_one_out):
    run = localize(*noisy.arguments, "--LazyLocalizer.leave_one_out", int(leave_one_out))
    for result in read_results(run.output_path / "results.jsonl").values():
        assert_has_type(result, ResultFields)
    if leave_one_out:
        assert_has_type(json.loads((run.output_path / "leave_one_out.json").read_text()), LeaveOneOutFields)


def test_notebooks_show_a_table(noisy, localizer):
    result = localizer.localize(noisy.scene.query_names[0])
    shown = result._repr_html_()
    assert shown.startswith("<table>") and "LOCALIZED" in shown and f"{result.position[0]:.6g}" in shown
    fields = {**result.as_dict(), "status": "NO_PAIRS", "reason": "a < b", "confidence": None, "position": None}
    lost = ll.Result("<b>", json.dumps(fields), *[np.zeros((0, 3))] * 4)._repr_html_()
    assert "&lt;b&gt;" in lost and "a &lt; b" in lost and "NO_PAIRS" in lost and "position" not in lost


def test_arrays_of_a_result(noisy, localizer):
    result = localizer.localize(noisy.scene.query_names[0])
    keypoints = noisy.scene.images[result.name].keypoints[:, :2]
    assert result.is_localized and result.reason == "" and 0.9 < result.confidence <= 1
    assert result.cam_from_world.shape == (3, 4) and result.covariance.shape == (6, 6)
    np.testing.assert_allclose(result.covariance, result.covariance.T, rtol=1e-6)
    np.testing.assert_allclose(result.keypoints, keypoints, atol=1e-3)
    assert result.inlier_mask.shape == (len(keypoints),) and result.inlier_mask.dtype == bool
    assert result.num_inliers == result.inlier_mask.sum() == len(set(result.point_keypoints)) > 50
    assert result.observations.shape[1] == 3 and set(result.observations[:, 0]) == set(range(len(result.points)))
    inverse = np.linalg.inv(np.vstack([result.cam_from_world, [0, 0, 0, 1]]))
    np.testing.assert_allclose(result.world_from_cam, inverse[:3], atol=1e-12)
    np.testing.assert_array_equal(result.world_from_cam[:, 3], result.position)
    assert result.position_covariance.shape == (3, 3) and result.pose_covariance_in_map.shape == (6, 6)
    np.testing.assert_array_equal(result.pose_covariance_in_map[:3, :3], result.position_covariance)
    for point, pair, keypoint in result.observations[::50]:
        other = noisy.scene.images[result.as_dict()["pairs"][pair]["name"]]
        query_keypoint = result.point_keypoints[point]
        true_point = noisy.scene.images[result.name].point_of_keypoint[query_keypoint]
        assert other.point_of_keypoint[keypoint] == true_point
    in_cam = result.points @ result.cam_from_world[:, :3].T + result.cam_from_world[:, 3]
    image = noisy.scene.images[result.name]
    expected = noisy.scene.cameras[image.camera_id].image_from_cam(in_cam)
    errors = np.linalg.norm(expected - result.keypoints[result.point_keypoints], axis=1)
    assert np.median(errors) < 2


def test_geographic_model_gives_the_line_and_the_angles_of_the_program(localize, noisy, tmp_path):
    model = synthetic.write_model(tmp_path / "model", noisy.scene, names=noisy.scene.database_names)
    origin = {"latitude_deg": 45.0, "longitude_deg": 8.0, "height_m": 400.0, "frame": "ENU", "ellipsoid": "WGS84"}
    (model / "geo.json").write_text(json.dumps(origin))
    run = localize("--database_path", noisy.database_path, "--input_path", model)
    localizer = ll.Localizer(noisy.database_path, model)
    for name, fields in run.results.items():
        result = localizer.localize(name)
        assert without_times(result.as_dict()) == without_times(fields)
        assert [getattr(result, field) for field in ANGLE_FIELDS] == [fields[field] for field in ANGLE_FIELDS]
        assert None not in [fields[field] for field in ANGLE_FIELDS]


def test_query_without_a_pose_has_a_status_and_no_arrays(tmp_path):
    scene = synthetic.make_scene(synthetic.arc(9), synthetic.arc(1, radius=5, height=-0.7))
    model = synthetic.write_model(tmp_path / "model", scene, names=scene.database_names[:1])
    localizer = ll.Localizer(synthetic.write_database(tmp_path / "database.db", scene), model)
    result = localizer.localize(scene.query_names[0])
    assert result.status == "SCALE_UNOBSERVABLE" and not result.is_localized and result.reason
    assert result.cam_from_world is None and result.covariance is None and result.as_pycolmap() is None
    assert (
        result.world_from_cam is None and result.pose_covariance_in_map is None and result.position_covariance is None
    )
    assert [getattr(result, field) for field in ANGLE_FIELDS] == [None] * len(ANGLE_FIELDS)
    assert not result.inlier_mask.any() and result.num_inliers == 0


def test_pycolmap_dict_has_the_pose(localizer):
    result = localizer.localize(localizer.queries[0])
    fields = result.as_pycolmap()
    np.testing.assert_allclose(fields["cam_from_world"].matrix(), result.cam_from_world, atol=1e-12)
    assert fields["num_inliers"] == result.num_inliers


@pytest.mark.parametrize("num_threads", [1, 2, 4])
def test_all_queries_on_threads_have_the_bytes_of_the_program(localize, noisy, num_threads):
    arguments = [*noisy.arguments, "--LazyLocalizer.leave_one_out", 1]
    with open_localizer(arguments) as localizer:
        assert_same_poses(list(localizer.localize_all(num_threads=num_threads)), localize(*arguments))


def test_some_queries_in_all(noisy, localizer):
    names = noisy.scene.query_names[1:]
    assert sorted(result.name for result in localizer.localize_all(names)) == names
    assert list(localizer.localize_all([])) == []


def test_closed_generator_begins_no_further_query(noisy):
    localizer = open_localizer([*noisy.arguments, "--LazyLocalizer.leave_one_out", 1])
    results = localizer.localize_all(num_threads=1)
    first = next(results)
    results.close()
    assert first.is_localized and list(results) == []


@pytest.mark.parametrize(
    "options",
    [
        {"num_retrieved": 4},
        {"LazyLocalizer.num_retrieved": "4"},
        {"LazyLocalizer": {"num_retrieved": np.int64(4)}},
        {"LazyLocalizer": {"method": "paper", "Advanced": {"use_rigs": 0}}},
        {"leave_one_out": True, "LazyLocalizer": {"Advanced.use_rigs": 0}},
    ],
)
def test_options_mean_what_they_mean_to_the_program(localize, noisy, options):
    names = {
        "num_retrieved": "LazyLocalizer.num_retrieved",
        "leave_one_out": "LazyLocalizer.leave_one_out",
    }
    words = []
    for name, value in options.items():
        inner = value.items() if isinstance(value, dict) else [("", value)]
        for inner_name, inner_value in inner:
            while isinstance(inner_value, dict):
                ((more, inner_value),) = inner_value.items()
                inner_name += f".{more}"
            full = f"{names.get(name, name)}{'.' if inner_name else ''}{inner_name}"
            words += [f"--{full}", int(inner_value) if isinstance(inner_value, bool) else inner_value]
    localizer = ll.Localizer(noisy.database_path, noisy.model_path, options=options)
    assert_same_poses(list(localizer.localize_all()), localize(*noisy.arguments, *words))


def test_model_in_memory_has_the_bytes_of_its_files(noisy, localizer):
    model = read_model(noisy.model_path)
    in_memory = ll.Localizer(noisy.database_path, model)
    name = localizer.queries[0]
    assert in_memory.localize(name).pose.bits() == localizer.localize(name).pose.bits()
    as_matrices = {
        image.name: (image.cam_from_world.rotation, image.cam_from_world.tvec, model.cameras[image.camera_id])
        for image in model.images.values()
    }
    errors = ll.Localizer(noisy.database_path, as_matrices).localize(name).pose.errors(localizer.localize(name).pose)
    assert max(errors) < 1e-6


def own_matches(scene, name):
    """Returns the camera, the keypoints and the pairs of a query of a synthetic scene."""
    image, pairs = scene.images[name], {}
    keypoints = {key: value.keypoints[:, :2] for key, value in scene.images.items()}
    for (name1, name2), pair in scene.pairs.items():
        if name in (name1, name2) and {name1, name2} - {name} <= set(scene.database_names):
            other = name2 if name1 == name else name1
            matches = pair.matches if name1 == name else pair.matches[:, ::-1]
            pairs[other] = (keypoints[other], matches)
    return scene.cameras[image.camera_id], keypoints[name], pairs


def test_own_matches_have_the_bytes_of_a_database_with_them(localize, tmp_path):
    scene = synthetic.make_scene(
        synthetic.arc(9), synthetic.arc(2, radius=5, height=-0.7), noise_px=0.5, outlier_ratio=0.3
    )
    database = synthetic.write_database(tmp_path / "database.db", scene, geometry=None)
    model = synthetic.write_model(tmp_path / "model", scene)
    inputs = {name: own_matches(scene, name) for name in scene.query_names}
    words = {name: camera.intrinsics().text() for name, (camera, _, _) in inputs.items()}
    queries = tmp_path / "queries.txt"
    queries.write_text("".join(f"{name} {text}\n" for name, text in words.items()))
    listed = tmp_path / "pairs.txt"
    listed.write_text("".join(f"{name} {other}\n" for name, (_, _, pairs) in inputs.items() for other in pairs))
    arguments = ["--database_path", database, "--input_path", model, "--query_list_path", queries]
    run = localize(*arguments, "--pairs_path", listed)
    without_database, with_database = ll.Localizer(None, model), ll.Localizer(database, model)
    for name, (camera, keypoints, pairs) in inputs.items():
        result = without_database.localize_matches(camera, keypoints, pairs, name=name)
        assert result.pose.bits() == run.poses[name].bits()
        stored_keypoints = {other: matches for other, (_, matches) in pairs.items()}
        result = with_database.localize_matches(words[name], keypoints, stored_keypoints, name=name)
        assert result.pose.bits() == run.poses[name].bits()


def test_photo_has_the_bytes_of_the_program(localize, photos, tmp_path):
    import cv2

    run = localize(*photos.arguments(photos.write_queries(tmp_path / "queries.txt")))
    options = {"image_path": photos.image_path, "SiftExtraction": {"max_num_features": 1500, "first_octave": 0}}
    localizer = ll.Localizer(photos.database_path, photos.model_path, options=options)
    for name in photos.query_names:
        from_file = localizer.localize_photo(name, photos.camera_words)
        assert from_file.pose.bits() == run.poses[name].bits()
        bgr = cv2.imread(str(photos.image_path / name))
        from_array = localizer.localize_photo(bgr[:, :, ::-1], photos.camera_words, name=name)
        assert from_array.pose.bits() == run.poses[name].bits()
    queries = [ll.Photo(name, photos.camera_words) for name in photos.query_names]
    assert_same_poses(list(localizer.localize_all(queries)), run)
    missing = localizer.localize_photo("missing.jpg")
    assert missing.status == "UNREADABLE_IMAGE" and "missing.jpg" in missing.reason


def test_photo_with_an_index_has_the_bytes_of_the_program(localize, photos, tmp_path):
    queries = photos.write_queries(tmp_path / "queries.txt", with_camera=False)
    index = tmp_path / "database.index"
    more = ["--retrieval_index_path", index, "--LazyLocalizer.num_retrieved", 4]
    run = localize(*photos.arguments(queries, *more))
    options = {"SiftExtraction.max_num_features": 1500, "first_octave": 0, "num_retrieved": 4}
    localizer = ll.Localizer(photos.database_path, photos.model_path, index=index, options=options)
    for name in photos.query_names:
        result = localizer.localize_photo(photos.image_path / name, name=name)
        assert len(result.as_dict()["pairs"]) == 4
        assert (result.status, result.pose and result.pose.bits()) == (
            run.statuses[name],
            run.poses[name].bits() if name in run.poses else None,
        )


def relative_poses(scene, names):
    """Returns cam_from_rig of images, whose rig has the axes of the first."""
    first = scene.images[names[0]].pose
    poses = {}
    for name in names:
        pose = scene.images[name].pose
        rotation = pose.rotation @ first.rotation.T
        poses[name] = rotation, pose.tvec - rotation @ first.tvec
    return poses


def test_rig_of_stored_queries(exact):
    localizer = ll.Localizer(exact.database_path, exact.model_path)
    results = localizer.localize_rig(relative_poses(exact.scene, exact.scene.query_names))
    assert list(results) == exact.scene.query_names
    for name, result in results.items():
        assert result.is_localized and result.as_dict()["frame"] == "rig"
        assert max(result.pose.errors(exact.scene.images[name].pose)) < 1e-5


def test_rig_has_the_bytes_of_the_program(localize, noisy, localizer, tmp_path):
    rig = {name: Pose.from_matrix(*pose) for name, pose in relative_poses(noisy.scene, noisy.scene.query_names).items()}
    cameras = [
        {
            "image_prefix": name.removesuffix(".jpg"),
            "cam_from_rig_rotation": list(pose.qvec),
            "cam_from_rig_translation": list(pose.tvec),
        }
        for name, pose in rig.items()
    ]
    cameras[0] = {"image_prefix": cameras[0]["image_prefix"], "ref_sensor": True}
    rig[noisy.scene.query_names[0]] = Pose(np.array([1.0, 0, 0, 0]), np.zeros(3))
    (tmp_path / "rig.json").write_text(json.dumps([{"cameras": cameras}]))
    run = localize(*noisy.arguments, "--rig_config_path", tmp_path / "rig.json")
    results = localizer.localize_rig(rig, name="query/.jpg")
    assert_same_poses(list(results.values()), run)
    for name, result in results.items():
        assert without_times(result.as_dict()) == without_times(run.results[name])


def test_rig_of_own_matches_without_a_database(exact):
    poses = relative_poses(exact.scene, exact.scene.query_names)
    images = {ll.Matches(*own_matches(exact.scene, name), name=name): pose for name, pose in poses.items()}
    for query, pose in ll.Localizer(None, exact.model_path).localize_rig(images).items():
        assert pose.is_localized and max(pose.pose.errors(exact.scene.images[query].pose)) < 1e-4


@pytest.mark.parametrize("has_scale", [True, False])
def test_trajectory_has_the_bytes_of_the_program(localize, noisy, localizer, tmp_path, has_scale):
    names = noisy.scene.query_names
    poses = {name: noisy.scene.images[name].pose for name in names}
    path = tmp_path / "trajectory.txt"
    path.write_text("".join(f"{name} {pose.text()}\n" for name, pose in poses.items()))
    scale_option = ["--LazyLocalizer.Advanced.trajectory_has_scale", int(has_scale)]
    run = localize(*noisy.arguments, "--query_trajectory_path", path, *scale_option)
    assert_same_poses(list(localizer.localize_trajectory(poses, has_scale=has_scale).values()), run)


@pytest.mark.parametrize("scene", ["fountain", "herzjesu", "office", "kitchen", "kitti1"])
def test_real_scenes_have_the_bytes_of_the_program(localize, scene):
    if not (DATA_PATH / scene / "database.db").exists():
        pytest.skip(f"{DATA_PATH / scene} is missing; LAZYLOC_SHARED_DATA names the folder of the real scenes")
    arguments = arguments_of(scene)
    assert_same_poses(list(open_localizer(arguments).localize_all()), localize(*arguments))
