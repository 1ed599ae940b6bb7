"""Runs the program, and compares positions with their covariances."""

import numpy as np

from colmap_lazyloc.poses import Pose
from colmap_lazyloc.program import run_colmap
from colmap_lazyloc.results import read_results

ANY_CONFIDENCE = "--LazyLocalizer.min_confidence", 0


def localize(colmap, database_path, model_path, output_path, *options) -> dict[str, dict]:
    """Returns the program's results by name."""
    files = "--database_path", database_path, "--input_path", model_path, "--output_path", output_path
    run_colmap(colmap, "lazy_localizer", *files, *options)
    return read_results(output_path / "results.jsonl")


def position_covariance(pose: Pose, covariance) -> np.ndarray:
    x, y, z = pose.tvec
    # The centre is -R' t. A turn exp(w) R moves it by R' (w x t), because R' becomes R' exp(-w).
    jacobian = -pose.rotation.T @ np.hstack([[[0, -z, y], [z, 0, -x], [-y, x, 0]], np.eye(3)])
    return jacobian @ np.array(covariance) @ jacobian.T


def position_error(pose: Pose, covariance, true_centre, truth_stddev=0.0) -> tuple[float, float]:
    """Returns the length of the position's error, and that in standard deviations of its covariance.

    truth_stddev: standard deviation of the true centre along each axis.
    """
    error = pose.cam_in_world - true_centre
    in_position = position_covariance(pose, covariance) + truth_stddev**2 * np.eye(3)
    return np.linalg.norm(error), np.sqrt(max(error @ np.linalg.solve(in_position, error), 0))
