"""Tests positions and gravity of queries in Python: the results of the program with files, and bad values."""

import json

import numpy as np
import pytest

import colmap_lazyloc as ll
from colmap_lazyloc.report.facts import facts
from conftest import write_lines

OPTIONS = {"world_up": "0,-1,0"}


@pytest.fixture(scope="module")
def localizer(noisy):
    return ll.Localizer(noisy.database_path, noisy.model_path, options=OPTIONS)


def without_times(fields):
    return {name: value for name, value in fields.items() if name != "seconds"}


def priors_of(scene, name):
    pose = scene.images[name].pose
    return (pose.cam_in_world, 0.1), (pose.rotation @ [0, 1, 0], 1.0)


def test_localize_has_the_content_of_the_program(localize, noisy, localizer, tmp_path):
    name = noisy.scene.query_names[0]
    position, gravity = priors_of(noisy.scene, name)
    arguments = []
    for kind, (vector, stddev) in (("position", position), ("gravity", gravity)):
        line = f"{name} {' '.join(map(repr, vector.tolist()))} {stddev}"
        arguments += [f"--query_{kind}_path", write_lines(tmp_path / f"{kind}.txt", [line])]
    run = localize(*noisy.arguments, *arguments, "--LazyLocalizer.world_up", OPTIONS["world_up"])
    result = localizer.localize(name, position=position, gravity=gravity)
    lines = (run.output_path / "results.jsonl").read_text(encoding="utf-8").splitlines()
    assert without_times(result.as_dict()) == without_times(json.loads(lines[0]))
    assert result.as_dict()["priors"]["position"]["verdict"] == "used"
    assert "priors" not in localizer.localize(name).as_dict()


def test_three_deviations_and_a_covariance(noisy, localizer):
    name = noisy.scene.query_names[0]
    centre = noisy.scene.images[name].pose.cam_in_world
    results = [
        localizer.localize(name, position=(centre, uncertainty))
        for uncertainty in (0.1, [0.1, 0.1, 0.1], 0.01 * np.eye(3))
    ]
    for result in results[1:]:
        np.testing.assert_allclose(result.cam_from_world, results[0].cam_from_world, atol=1e-9)


def test_contradicted_position_is_reported(noisy, localizer):
    name = noisy.scene.query_names[0]
    wrong = noisy.scene.images[name].pose.cam_in_world + [1, 0, 0]
    result = localizer.localize(name, position=(wrong, 0.1))
    assert result.pose.bits() == localizer.localize(name).pose.bits()
    assert result.as_dict()["priors"]["position"]["verdict"] == "contradicted"
    assert "contradicted by the images" in dict(facts(result.as_dict(), "units"))["Given position"]


def test_matches_take_priors(noisy, localizer):
    scene, name = noisy.scene, noisy.scene.query_names[0]
    pairs = {}
    for (first, second), pair in scene.pairs.items():
        other = second if first == name else first
        if name in (first, second) and other not in scene.query_names:
            pairs[other] = pair.matches if first == name else pair.matches[:, ::-1]
    position, gravity = priors_of(scene, name)
    camera = scene.cameras[scene.images[name].camera_id]
    text = f"{camera.model} {camera.width} {camera.height} {' '.join(map(str, camera.params))}"
    query = ll.Matches(text, scene.images[name].keypoints[:, :2], pairs, name, position, gravity)
    (result,) = localizer.localize_all([query])
    assert {prior["verdict"] for prior in result.as_dict()["priors"].values()} == {"used"}


@pytest.mark.parametrize(
    ("priors", "message"),
    [
        ({"position": (1, 2, 3)}, "position: must be a pair of (x, y, z) and its uncertainty"),
        ({"position": ((1, 2), 1)}, "position: must have 3 numbers, but has 2"),
        ({"position": ((1, 2, np.nan), 1)}, "position: row 2 is not finite"),
        ({"position": ((1, 2, 3), -1)}, "a standard deviation is not positive"),
        ({"position": ((1, 2, 3), (1, 2))}, "position: the uncertainty must be a standard deviation, three of them"),
        ({"position": ((1, 2, 3), np.ones((3, 3)))}, "the covariance is not positive definite"),
        ({"position": ((1, 2, 3), np.triu(np.ones((3, 3))))}, "position: the covariance is not symmetric"),
        ({"gravity": ((0, 0, 0), 1)}, "the direction of gravity is zero"),
        ({"gravity": ((0, 1, 0), (1, 2))}, "gravity: the uncertainty must be one number"),
    ],
)
def test_bad_priors(noisy, localizer, priors, message):
    with pytest.raises(ll.InputError) as error:
        localizer.localize(noisy.scene.query_names[0], **priors)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_gravity_needs_the_direction_of_the_world(noisy):
    localizer = ll.Localizer(noisy.database_path, noisy.model_path)
    with pytest.raises(ll.InputError, match="world_up"):
        localizer.localize(noisy.scene.query_names[0], gravity=((0, 1, 0), 1))
