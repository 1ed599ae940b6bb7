"""Runs the program where a pose may be wrong, and compares its confidence with the errors of the positions."""

import dataclasses
import pathlib
import tempfile

import numpy as np
from scipy.stats import rankdata

from benchmarks.localization.database_noise import noisy_pose
from benchmarks.uncertainty import localizer, stress_scenes
from colmap_lazyloc.model import read_model, write_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.results import pose_of
from colmap_lazyloc.testing import synthetic

# Count a position as wrong above both errors, as leave_one_out.json does: in standard deviations of its covariance and
# the truth, over the scene's size. An error below some standard deviations of the truth is not known to be wrong. By
# the stricter rule, a position is wrong above either error, with 1 % of the scene.
MAX_ERROR_SIGMA, MAX_ERROR_RATIO, MIN_TRUTH_SIGMA = 5, 0.005, 3
STRICT_ERROR_RATIO = 0.01
COVERAGES = (0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)


def is_off_by(ratio, error, scene_size, truth_stddev) -> bool:
    return error > max(ratio * scene_size, MIN_TRUTH_SIGMA * truth_stddev)


def is_wrong_position(error, error_sigma, scene_size, truth_stddev) -> bool:
    return error_sigma > MAX_ERROR_SIGMA and is_off_by(MAX_ERROR_RATIO, error, scene_size, truth_stddev)


@dataclasses.dataclass
class Outcome:
    """A query. One without a pose is refused: its confidence is 0, and it is neither right nor wrong."""

    kind: str
    group: str  # scene: cross-validation keeps it together
    status: str
    confidence: float
    evidence: dict[str, float | None] | None = None
    error: float = np.nan
    error_sigma: float = np.nan
    scene_size: float = np.nan
    truth_stddev: float = 0.0

    @property
    def has_pose(self) -> bool:
        return self.evidence is not None

    @property
    def is_wrong(self) -> bool:
        return is_wrong_position(self.error, self.error_sigma, self.scene_size, self.truth_stddev)

    @property
    def is_wrong_strictly(self) -> bool:
        is_off = is_off_by(STRICT_ERROR_RATIO, self.error, self.scene_size, self.truth_stddev)
        return self.error_sigma > MAX_ERROR_SIGMA or is_off


def localize(colmap, folder, database_path, model_path, *options) -> dict[str, dict]:
    """Returns the program's results by name, poses of any confidence."""
    options = *localizer.ANY_CONFIDENCE, *options
    return localizer.localize(colmap, database_path, model_path, folder / "output", *options)


def scene_size(database_poses: list[Pose], scene_distance: float) -> float:
    """Returns the diagonal of the box around the centres of images and what they look at, as leave_one_out.json does.

    What an image looks at is the point of its optical axis at the median distance of points from queries.
    """
    centres = np.array([pose.cam_in_world for pose in database_poses])
    axes = np.array([pose.rotation[2] for pose in database_poses])
    return float(np.linalg.norm(np.ptp(np.concatenate([centres, centres + scene_distance * axes]), axis=0)))


def outcomes_of(kind, group, results, true_centres, database_poses, truth_stddev=0.0) -> list[Outcome]:
    posed = [result for result in results.values() if pose_of(result) is not None]
    distances = [result["evidence"]["scene_distance"] for result in posed]
    size = scene_size(database_poses, np.median(distances)) if posed else np.nan
    outcomes = []
    for result in results.values():
        outcome = Outcome(kind, group, result["status"], 0.0)
        pose = pose_of(result)
        if pose is not None:
            error = localizer.position_error(pose, result["covariance"], true_centres[result["name"]], truth_stddev)
            evidence = result["evidence"]
            outcome = Outcome(
                kind, group, result["status"], result["confidence"], evidence, *map(float, error), size, truth_stddev
            )
        outcomes.append(outcome)
    return outcomes


def run_case(colmap, case: stress_scenes.Case, group: str) -> list[Outcome]:
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        query_list_path = folder / "queries.txt"
        query_list_path.write_text(case.query_list())
        results = localize(
            colmap,
            folder,
            synthetic.write_database(folder / "database.db", case.scene, geometry=None),
            synthetic.write_model(folder / "model", case.scene),
            "--query_list_path",
            query_list_path,
        )
    truth = {name: pose.cam_in_world for name, pose in case.truth.items()}
    database = [case.scene.images[name].pose for name in case.scene.database_names]
    return outcomes_of(case.kind, group, results, truth, database)


def run_synthetic(colmap, num_scenes, seed=0, kinds=stress_scenes.KINDS) -> list[Outcome]:
    outcomes = []
    for i, case in enumerate(stress_scenes.stress_cases(num_scenes, seed, kinds)):
        outcomes += run_case(colmap, case, f"{case.kind} {seed} {i}")
    return outcomes


def leave_one_out(colmap, scene_path, model_path, *options) -> dict[str, dict]:
    queries = scene_path / "queries.txt"
    with tempfile.TemporaryDirectory() as folder:
        return localize(
            colmap,
            pathlib.Path(folder),
            scene_path / "database.db",
            model_path,
            "--LazyLocalizer.leave_one_out",
            1,
            "--LazyLocalizer.Advanced.use_rigs",
            0,
            *(("--query_list_path", queries) if queries.exists() else ()),
            *options,
        )


def run_real(colmap, data_path, nums_retrieved, truth_stddevs=None, noise_levels=()) -> list[Outcome]:
    """Localizes the database images of every scene below a folder against the others, with numbers of these.

    truth_stddevs: of the true centres, by name of the scene; 0 for others. noise_levels: errors that are added to the
    database poses in further runs, each with the default number of images: in degrees, and as a share of the median
    distance of points from the queries. Each level is a kind of its own.
    """
    outcomes = []
    for scene_path in sorted(path.parent for path in data_path.glob("*/database.db")):
        model = read_model(scene_path / "model")
        centres = {name: image.cam_from_world.cam_in_world for name, image in model.images.items()}
        poses = [image.cam_from_world for image in model.images.values()]
        truth_stddev = (truth_stddevs or {}).get(scene_path.name, 0.0)
        group = f"real: {scene_path.name}"
        runs = []  # kind and results
        for num_retrieved in nums_retrieved:
            option = "--LazyLocalizer.num_retrieved", num_retrieved
            runs.append((group, leave_one_out(colmap, scene_path, scene_path / "model", *option)))
        distances = [r["evidence"]["scene_distance"] for r in runs[-1][1].values() if pose_of(r) is not None]
        for degrees, ratio in noise_levels if distances else ():
            rng = np.random.default_rng(0)
            length = ratio * np.median(distances)
            images = [
                dataclasses.replace(image, cam_from_world=noisy_pose(image.cam_from_world, degrees, length, rng))
                for image in model.images.values()
            ]
            with tempfile.TemporaryDirectory() as folder:
                model_path = write_model(pathlib.Path(folder) / "model", model.cameras, images)
                results = leave_one_out(colmap, scene_path, model_path)
            runs.append((f"real: off by {degrees}° and {100 * ratio:g} %", results))
        for kind, results in runs:
            outcomes += outcomes_of(kind, group, results, centres, poses, truth_stddev)
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


def reliability(confidences, is_wrong, num_bins=10) -> list[tuple[int, float, float]]:
    """Returns for bins of equally many poses their number, mean confidence and share of right poses."""
    order = np.argsort(confidences, kind="stable")
    bins = [chosen for chosen in np.array_split(order, num_bins) if len(chosen)]
    confidences, is_right = np.asarray(confidences), ~np.asarray(is_wrong, bool)
    return [(len(chosen), float(np.mean(confidences[chosen])), float(np.mean(is_right[chosen]))) for chosen in bins]


def percent(ratio):
    return "–" if np.isnan(ratio) else f"{100 * ratio:.1f} %"


def ratio_of(values) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def report_row(pool, members: list[Outcome], min_confidence) -> str:
    confidence, has_pose, is_wrong, is_wrong_strictly = (
        np.array([getattr(o, name) for o in members])
        for name in ("confidence", "has_pose", "is_wrong", "is_wrong_strictly")
    )
    accepted = confidence >= min_confidence
    area = auroc(confidence[has_pose], is_wrong[has_pose])
    cells = (
        pool,
        len(members),
        percent(np.mean(has_pose)),
        percent(ratio_of(is_wrong[has_pose])),
        "–" if np.isnan(area) else f"{area:.3f}",
        percent(np.mean(accepted)),
        percent(ratio_of(accepted[has_pose & ~is_wrong])),
        f"{np.sum(is_wrong[accepted])} ({percent(ratio_of(is_wrong[accepted]))})",
        f"{np.sum(is_wrong_strictly[accepted])}",
    )
    return f"| {' | '.join(map(str, cells))} |"


def print_report(outcomes: list[Outcome], min_confidence: float):
    """Prints the table per kind, and of all the risk-coverage table and the reliability of the poses' confidences.

    The coverage is that of all queries.
    """
    kinds = list(dict.fromkeys(o.kind for o in outcomes))
    pools = {kind: [o for o in outcomes if o.kind == kind] for kind in kinds}
    for pool, is_real in (("all synthetic", False), ("all real", True)):
        pools[pool] = [o for o in outcomes if o.kind.startswith("real") == is_real]
    pools["all"] = outcomes
    columns = "kind", "queries", "with a pose", "wrong", "AUROC", "accepted", "of the right poses", "accepted and wrong"
    print(f"| {' | '.join(columns)} | by the stricter rule |")
    print("|---" * (len(columns) + 1) + "|")
    for pool, members in pools.items():
        if members:
            print(report_row(pool, members, min_confidence))
    confidences = np.array([o.confidence for o in outcomes])
    max_coverage = np.mean([o.has_pose for o in outcomes])
    coverages = [coverage for coverage in COVERAGES if coverage <= max_coverage]
    print("\n| coverage | confidence of at least | wrong |\n|---|---|---|")
    points = risk_coverage(confidences, [o.is_wrong for o in outcomes], coverages)
    for coverage, (confidence, risk) in zip(coverages, points, strict=True):
        print(f"| {100 * coverage:.0f} % | {confidence:.3f} | {percent(risk)} |")
    print("\n| poses | mean confidence | right |\n|---|---|---|")
    posed = [o for o in outcomes if o.has_pose]
    for count, stated, observed in reliability([o.confidence for o in posed], [o.is_wrong for o in posed]):
        print(f"| {count} | {stated:.3f} | {observed:.3f} |")
