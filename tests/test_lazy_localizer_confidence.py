"""Tests of the confidence: in the results, as a condition of LOCALIZED, and in the summary of leave-one-out."""

import json

import numpy as np
import pytest

from benchmarks.localization.database_noise import noisy_pose
from benchmarks.uncertainty import stress, stress_scenes, stress_worlds
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.testing import synthetic


def read_summary(run):
    return json.loads((run.output_path / "leave_one_out.json").read_text())


def test_good_poses_have_high_confidence(localize, noisy):
    run = localize(*noisy.arguments)
    for result in run.results.values():
        assert result["status"] == "LOCALIZED"
        assert 0.95 <= result["confidence"] <= 1
        assert result["unconfirmed_cam_from_world"] is None
        assert result["evidence"]["explained_ratio"] > 0.9 and result["evidence"]["num_common_tracks"] > 20


def test_minimum_confidence_decides_about_the_status_alone(localize, noisy):
    accepted = localize(*noisy.arguments, "--LazyLocalizer.min_confidence", 0)
    refused = localize(*noisy.arguments, "--LazyLocalizer.min_confidence", 1)
    assert len(accepted.poses) == 3 and refused.poses == {}
    assert set(refused.statuses.values()) == {"LOW_CONFIDENCE"}
    for name, result in refused.results.items():
        assert result["cam_from_world"] is None and name not in refused.model_images
        assert result["unconfirmed_cam_from_world"] == accepted.results[name]["cam_from_world"]
        assert result["covariance"] == accepted.results[name]["covariance"]
        assert result["confidence"] == accepted.results[name]["confidence"]
        assert "1.00 is needed" in result["reason"] and "\n" not in result["reason"]


def test_strict_counts_low_confidence_as_not_localized(localize, noisy):
    assert localize(*noisy.arguments, "--LazyLocalizer.min_confidence", 1, "--strict", 1).exit_code == 2


def test_paper_has_a_confidence_too(localize, noisy):
    run = localize(*noisy.arguments, "--LazyLocalizer.method", "paper")
    for result in run.results.values():
        assert result["status"] == "LOCALIZED" and result["confidence"] > 0.9 and result["evidence"]
        assert result["start"] == "motion_averaging" and result["intrinsics"]["verdict"] == "not_tested"


@pytest.mark.parametrize("value", ["-0.1", "1.5", "nan"])
def test_impossible_minimum(localize, noisy, value):
    run = localize(*noisy.arguments, f"--LazyLocalizer.min_confidence={value}")
    assert run.exit_code == 1 and "--LazyLocalizer.min_confidence" in run.stderr


def test_leave_one_out_ends_with_a_summary(localize, noisy):
    run = localize(*noisy.arguments, "--LazyLocalizer.leave_one_out", 1)
    summary = read_summary(run)
    assert summary["num_queries"] == len(run.results) == 9
    assert summary["num_by_status"] == {"LOCALIZED": 9}
    assert 0 < summary["median_position_error"] < 0.05 and summary["median_position_error_sigma"] < 5
    coverages = [point["coverage"] for point in summary["risk_coverage"]]
    assert coverages == sorted(coverages) and coverages[-1] == 1
    errors = {pose["name"]: pose["position_error"] for pose in summary["poses"]}
    for name, pose in run.poses.items():
        assert errors[name] == pytest.approx(pose.errors(noisy.scene.images[name].pose)[0], abs=1e-9)
    assert "Database images localized against the others" in run.summary
    assert "localized but wrong" in run.summary


def test_leave_one_out_finds_wrong_database_poses(localize, noisy, tmp_path, write_scene_files):
    """A moved image is localized where it really is, far from its pose in the model."""
    scene = noisy.scene.copy()
    image = scene.images["database/004.jpg"]
    image.pose = type(image.pose).from_centre(image.pose.rotation, image.pose.cam_in_world + [0, 2, 0])
    run = localize(*write_scene_files(tmp_path, scene).arguments, "--LazyLocalizer.leave_one_out", 1)
    summary = read_summary(run)
    moved = {pose["name"]: pose for pose in summary["poses"]}["database/004.jpg"]
    assert moved["is_wrong"] and moved["position_error"] == pytest.approx(2, abs=0.1)
    assert summary["num_accepted_and_wrong"] >= 1


def test_no_summary_without_leave_one_out(localize, noisy):
    assert not (localize(*noisy.arguments).output_path / "leave_one_out.json").exists()


def test_a_symmetric_object_is_not_trusted(colmap):
    """Half of the database images agree on the opposite side of a symmetric object."""
    outcomes = []
    for seed in range(5, 8):
        rng = np.random.default_rng(seed)
        world = stress_worlds.symmetric_object(rng, 2, num_unique=10)
        matching = stress_scenes.Matching(keep_ratio=0.8, likeness=0.98)
        scene = stress_scenes.make_scene(
            world, stress_scenes.around_object(20, rng), stress_scenes.around_object(6, rng), rng, matching
        )
        case = stress_scenes.Case("symmetric", scene, stress_scenes.true_poses(scene))
        outcomes += stress.run_case(colmap, case, "symmetric")
    wrong = [outcome.confidence for outcome in outcomes if outcome.is_wrong]
    assert sum(outcome.has_pose for outcome in outcomes) >= 12 and len(wrong) >= 6
    # One side has up to two thirds of the matches by chance.
    assert np.median(wrong) < 0.9 and max(wrong) < 0.98


def test_noise_of_real_scenes_is_in_the_database_poses_alone(colmap, tmp_path):
    scene = synthetic.make_scene(synthetic.arc(10), [], noise_px=0.5, database_pairs=True)
    (tmp_path / "scene").mkdir()
    synthetic.write_database(tmp_path / "scene" / "database.db", scene)
    synthetic.write_model(tmp_path / "scene" / "model", scene)
    outcomes = stress.run_real(colmap, tmp_path, (20,), noise_levels=((1, 0.01),))
    exact, off = outcomes[:10], outcomes[10:]
    assert [o.kind for o in exact] == 10 * ["real: scene"] and [o.kind for o in off] == 10 * ["real: off by 1° and 1 %"]
    assert {o.group for o in outcomes} == {"real: scene"}
    # Neighbours average the noise out, which is that of a percent of the distance and of 1.7 % in rotation.
    assert all(o.has_pose and o.error < 0.002 * o.scene_size for o in exact)
    assert all(o.has_pose and o.error < 0.02 * o.scene_size for o in off)
    assert np.median([o.error for o in off]) > 3 * np.median([o.error for o in exact])


def test_noisy_pose_is_off_by_exactly_this_much():
    pose = Pose.from_centre(np.eye(3), [1, 2, 3])
    noisy = noisy_pose(pose, 2.0, 0.5, np.random.default_rng(0))
    assert np.degrees(np.arccos((np.trace(noisy.rotation) - 1) / 2)) == pytest.approx(2)
    assert np.linalg.norm(noisy.cam_in_world - [1, 2, 3]) == pytest.approx(0.5)


def test_stress_set_in_small(colmap):
    """Most of what is right is accepted, and little of what is accepted is wrong."""
    kinds = ("plain", "corridor", "facade", "symmetric object", "few database images", "blur")
    outcomes = [o for o in stress.run_synthetic(colmap, num_scenes=2, kinds=kinds) if o.has_pose]
    assert {outcome.kind for outcome in outcomes} == set(kinds)
    is_wrong = [outcome.is_wrong for outcome in outcomes]
    assert stress.auroc([outcome.confidence for outcome in outcomes], is_wrong) >= 0.85
    accepted = [outcome for outcome in outcomes if outcome.confidence >= 0.95]
    assert len(accepted) >= 0.5 * is_wrong.count(False)
    assert sum(outcome.is_wrong for outcome in accepted) <= 0.05 * len(accepted)


def test_a_query_without_a_pose_is_refused_and_not_wrong(colmap):
    outcomes = stress.run_synthetic(colmap, num_scenes=1, kinds=("foreign photos",))
    refused = [outcome for outcome in outcomes if not outcome.has_pose]
    assert len(outcomes) == 4 and len(refused) >= 2
    assert all(outcome.confidence == 0 and not outcome.is_wrong for outcome in refused)


def test_reliability_compares_stated_with_observed():
    """Ten poses of 0.9, one of them wrong, and ten of 0.5, five of them wrong, are two bins that agree."""
    confidences = [0.9] * 10 + [0.5] * 10
    is_wrong = [True] + [False] * 9 + [True, False] * 5
    bins = stress.reliability(confidences, is_wrong, num_bins=2)
    assert [count for count, _, _ in bins] == [10, 10]
    assert np.allclose([values for _, *values in bins], [[0.5, 0.5], [0.9, 0.9]])
