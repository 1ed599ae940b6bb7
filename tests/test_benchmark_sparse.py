"""The tables of `benchmarks sparse`: statuses, and the confidence beside the share of right poses."""

import numpy as np

from benchmarks.localization import sparse
from benchmarks.localization.evaluation import Row
from benchmarks.localization.matches import PairMatches
from benchmarks.localization.sparse_runs import Record
from benchmarks.localization.sparse_scenes import split_keypoints


def record(name, status, confidence=None, error=0.0, error_sigma=1.0, is_star=False):
    row = Row("sparse", "scene", name, "lazyloc", 2, 0, "0,0", 100 * error, 0.1, 0.01, status)
    if confidence is None:
        return Record(is_star, 2, row)
    return Record(is_star, 2, row, "", confidence, {}, error, error_sigma, size=10.0)


def test_a_pose_is_right_by_its_covariance_and_by_the_size_of_the_scene():
    assert record("a", "LOCALIZED", 0.99, error=0.09, error_sigma=4.9).is_right, "as uncertain as it says"
    assert record("a", "LOCALIZED", 0.99, error=0.04, error_sigma=5.1).is_right, "off by little"
    assert not record("a", "LOCALIZED", 0.99, error=0.09, error_sigma=5.1).is_right
    uncertain_truth = record("a", "LOCALIZED", 0.99, error=0.09, error_sigma=5.1)
    uncertain_truth.truth_stddev = 0.05
    assert uncertain_truth.is_right


def test_tables_count_refused_poses_that_are_right():
    records = [
        record("a", "LOCALIZED", 0.96),
        record("b", "LOCALIZED", 0.97, error=1.0, error_sigma=9.0),
        record("c", "LOW_CONFIDENCE", 0.85),
        record("d", "LOW_CONFIDENCE", 0.85, error=1.0, error_sigma=9.0),
        record("e", "SCALE_UNOBSERVABLE"),
    ]
    cells = {(False, 2, "lazyloc"): records}
    statuses = sparse.status_table(cells, ["lazyloc"])
    assert "`LOCALIZED` 2, `LOW_CONFIDENCE` (1 right) 2, `SCALE_UNOBSERVABLE` 1" in statuses
    reliability = sparse.reliability_table(cells).splitlines()
    assert "| 0.8 to 0.9 | 2, 0.85, 0.50 | – |" in reliability
    assert "| 0.95 to 0.98 | 2, 0.96, 0.50 | – |" in reliability


def test_keypoints_of_a_star_have_one_match():
    keypoints = np.arange(10)
    pairs = split_keypoints([PairMatches("a", keypoints, keypoints), PairMatches("b", keypoints, keypoints)])
    assert sorted(np.concatenate([pair.query_idxs for pair in pairs])) == list(range(10))
    assert [len(pair.query_idxs) for pair in pairs] == [5, 5]
