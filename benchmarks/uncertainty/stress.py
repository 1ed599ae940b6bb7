"""Runs the program where a pose may be wrong, and compares its confidence with the errors of the positions."""

import dataclasses
import pathlib
import tempfile

import numpy as np
from scipy.stats import rankdata

from benchmarks.uncertainty import stress_scenes
from colmap_lazyloc.model import read_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.program import run_colmap
from colmap_lazyloc.results import pose_of, read_results
from colmap_lazyloc.testing import synthetic

# Count a position as wrong above these errors, as leave_one_out.json does.
MAX_ERROR_SIGMA, MAX_ERROR_RATIO = 5, 0.01
# Define what the confidence is the probability of, as pipeline/confidence.h does.
CONFIDENCE_SIGMA, CONFIDENCE_FLOOR = 3, 0.01


@dataclasses.dataclass
class Outcome:
    """A query with a pose."""

    kind: str
    group: str  # scene: cross-validation keeps it together
    status: str
    confidence: float
    evidence: dict[str, float | None]
    error: float
    error_sigma: float
    scene_size: float

    @property
    def is_wrong(self) -> bool:
        return self.error_sigma > MAX_ERROR_SIGMA or self.error > MAX_ERROR_RATIO * self.scene_size

    @property
    def is_off(self) -> bool:
        """True if the position is not as right as the confidence promises."""
        beyond = self.error * (1 - CONFIDENCE_SIGMA / max(self.error_sigma, 1e-9))
        return beyond > CONFIDENCE_FLOOR * self.evidence["scene_distance"]


def position_error(pose: Pose, covariance, true_centre) -> tuple[float, float]:
    """Returns the length of the position's error, and that in standard deviations of its covariance."""
    error = pose.cam_in_world - true_centre
    x, y, z = pose.tvec
    # The centre is -R' t. A turn exp(w) R moves it by R' (w x t), because R' becomes R' exp(-w).
    jacobian = -pose.rotation.T @ np.hstack([[[0, -z, y], [z, 0, -x], [-y, x, 0]], np.eye(3)])
    in_position = jacobian @ np.array(covariance) @ jacobian.T
    return np.linalg.norm(error), np.sqrt(max(error @ np.linalg.solve(in_position, error), 0))


def localize(colmap, folder, database_path, model_path, *options) -> dict[str, dict]:
    """Returns the program's results by name, poses of any confidence."""
    run_colmap(
        colmap,
        "lazy_localizer",
        "--database_path",
        database_path,
        "--input_path",
        model_path,
        "--output_path",
        folder / "output",
        "--LazyLocalizer.min_confidence",
        0,
        *options,
    )
    return read_results(folder / "output" / "results.jsonl")


def outcomes_of(kind, group, results, true_centres, database_centres) -> list[Outcome]:
    outcomes = []
    extent = np.linalg.norm(np.ptp(database_centres, axis=0))
    posed = [result for result in results.values() if pose_of(result) is not None]
    if not posed:
        return []
    size = max(extent, np.median([result["evidence"]["scene_distance"] for result in posed]))
    for result in posed:
        error = position_error(pose_of(result), result["covariance"], true_centres[result["name"]])
        outcomes.append(
            Outcome(kind, group, result["status"], result["confidence"], result["evidence"], *map(float, error), size)
        )
    return outcomes


def run_case(colmap, case: stress_scenes.Case, group: str) -> list[Outcome]:
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        results = localize(
            colmap,
            folder,
            synthetic.write_database(folder / "database.db", case.scene, geometry=None),
            synthetic.write_model(folder / "model", case.scene),
        )
    truth = {name: pose.cam_in_world for name, pose in case.truth.items()}
    database = [case.scene.images[name].pose.cam_in_world for name in case.scene.database_names]
    return outcomes_of(case.kind, group, results, truth, database)


def run_synthetic(colmap, num_scenes, seed=0, kinds=stress_scenes.KINDS) -> list[Outcome]:
    outcomes = []
    for i, case in enumerate(stress_scenes.stress_cases(num_scenes, seed, kinds)):
        outcomes += run_case(colmap, case, f"{case.kind} {seed} {i}")
    return outcomes


def run_real(colmap, data_path, nums_retrieved) -> list[Outcome]:
    """Localizes the database images of every scene below a folder against the others, with numbers of these."""
    outcomes = []
    for scene_path in sorted(path.parent for path in data_path.glob("*/database.db")):
        images = read_model(scene_path / "model").images
        centres = {name: image.cam_from_world.cam_in_world for name, image in images.items()}
        queries = scene_path / "queries.txt"
        for num_retrieved in nums_retrieved:
            with tempfile.TemporaryDirectory() as folder:
                results = localize(
                    colmap,
                    pathlib.Path(folder),
                    scene_path / "database.db",
                    scene_path / "model",
                    "--LazyLocalizer.leave_one_out",
                    1,
                    "--LazyLocalizer.Advanced.use_rigs",
                    0,
                    "--LazyLocalizer.num_retrieved",
                    num_retrieved,
                    *(("--query_list_path", queries) if queries.exists() else ()),
                )
            kind = f"real: {scene_path.name}"
            outcomes += outcomes_of(kind, kind, results, centres, list(centres.values()))
    return outcomes


def auroc(scores, is_wrong) -> float:
    """Returns the probability that a right one has a higher score than a wrong one; ties count half."""
    is_wrong = np.asarray(is_wrong, bool)
    num_right, num_wrong = np.sum(~is_wrong), np.sum(is_wrong)
    if num_right == 0 or num_wrong == 0:
        return np.nan
    return (np.sum(rankdata(scores)[~is_wrong]) - num_right * (num_right + 1) / 2) / (num_right * num_wrong)


def risk_coverage(confidences, is_wrong, coverages) -> list[tuple[float, float]]:
    """Returns the confidence of the last accepted pose, and the share of wrong ones, at each coverage."""
    order = np.argsort(-np.asarray(confidences), kind="stable")
    counts = [max(1, round(coverage * len(order))) for coverage in coverages]
    return [(confidences[order[n - 1]], float(np.mean(np.asarray(is_wrong)[order[:n]]))) for n in counts]


def percent(ratio):
    return "–" if np.isnan(ratio) else f"{100 * ratio:.1f} %"


def ratio_of(values) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def print_report(outcomes: list[Outcome], min_confidence: float):
    """Prints the table per kind, and the risk-coverage table of all.

    wrong: by standard deviations or by the scene's size; off: not as right as the confidence promises.
    """
    pools = {}
    for outcome in outcomes:
        for pool in (outcome.kind, "real" if outcome.kind.startswith("real") else "synthetic", "all"):
            pools.setdefault(pool, []).append(outcome)
    print("| kind | poses | wrong | AUROC | off | AUROC | accepted | of those not off | accepted: wrong | off |")
    print("|---" * 10 + "|")
    for pool, members in pools.items():
        confidence = np.array([o.confidence for o in members])
        is_wrong = np.array([o.is_wrong for o in members])
        is_off = np.array([o.is_off for o in members])
        accepted = confidence >= min_confidence
        cells = [pool, len(members)]
        for errors in (is_wrong, is_off):
            area = auroc(confidence, errors)
            cells += [percent(np.mean(errors)), "–" if np.isnan(area) else f"{area:.3f}"]
        ratios = (
            np.mean(accepted),
            ratio_of(accepted[~is_off]),
            ratio_of(is_wrong[accepted]),
            ratio_of(is_off[accepted]),
        )
        print("|", " | ".join(map(str, [*cells, *map(percent, ratios)])), "|")
    coverages = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1)
    confidences = np.array([o.confidence for o in outcomes])
    print("\n| coverage | confidence of at least | wrong | off (the confidence's own definition) |\n|---|---|---|---|")
    wrong = risk_coverage(confidences, [o.is_wrong for o in outcomes], coverages)
    off = risk_coverage(confidences, [o.is_off for o in outcomes], coverages)
    for coverage, (confidence, risk), (_, off_risk) in zip(coverages, wrong, off, strict=True):
        print(f"| {100 * coverage:.0f} % | {confidence:.3f} | {percent(risk)} | {percent(off_risk)} |")
