"""Compares reported covariances with true errors, in synthetic scenes with Gaussian noise. Prints Markdown tables:

quantiles  quantiles of the squared errors, normalized by the reported covariance; they should equal those of the
           chi-square distribution with 6 degrees of freedom
cases      scenes with unobservable motions: statuses, reasons, reported standard deviations, true errors
priors     the same scenes with positions and gravity of the queries: statuses, what these fix, true errors
scenes     the scenes below --data_path, leave-one-out: errors, and medians of the normalized squared errors
stress     scenes in which a pose may be wrong (repetition, wrong intrinsics, wrong database poses, chance), and the
           scenes below --data_path: confidence against errors
fit        fits the factors of the confidence to the scenes of `stress` and writes
           uncertainty/confidence_factors.h; build the program again after it

  python -m benchmarks uncertainty [quantiles | cases | priors | scenes | stress | fit]... [--data_path DATA]...
  python -m benchmarks uncertainty focal_length --help
"""

import argparse
import collections
import pathlib
import sys
import tempfile

import numpy as np
import scipy.stats
from scipy.spatial.transform import Rotation

from benchmarks.uncertainty import confidence_fit, focal_length, localizer, priors, stress
from colmap_lazyloc.errors import command
from colmap_lazyloc.model import read_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import pose_of
from colmap_lazyloc.testing import synthetic

MIN_CONFIDENCE = 0.9  # the program's default
FIT_SEEDS = 5000, 6000, 7000
# Errors of the database poses that the fit adds to real scenes, so that it does not take noise for a wrong pose.
FIT_NOISE_LEVELS = (0.3, 0), (1, 0), (0, 0.003), (0, 0.01), (1, 0.01)
PERCENTS = 10, 50, 90
EXACT = (
    "--LazyLocalizer.Advanced.database_pose_stddev_deg",
    0,
    "--LazyLocalizer.Advanced.database_pose_stddev_length",
    0,
)


def localize(colmap, scene, *arguments, database_scene=None):
    """Returns the program's results by name. database_scene: scene with the database poses; default: `scene`."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        return localizer.localize(
            colmap,
            synthetic.write_database(folder / "database.db", scene),
            synthetic.write_model(folder / "model", database_scene or scene),
            folder / "output",
            "--LazyLocalizer.Advanced.focal_length_stddev_ratio",
            0,  # the intrinsics of synthetic scenes are exact
            *arguments,
        )


def squared_error(result, truth):
    """Returns the pose's squared error, normalized by its covariance."""
    pose = pose_of(result)
    error = np.concatenate([Rotation.from_matrix(pose.rotation @ truth.rotation.T).as_rotvec(), pose.tvec - truth.tvec])
    return error @ np.linalg.solve(np.array(result["covariance"]), error)


def around(centres, num, spread, rng):
    """Draws points near the mean of `centres`."""
    return np.mean(centres, axis=0) + spread * rng.standard_normal((num, 3))


def line(num, length=4.0):
    return np.stack([np.linspace(-length / 2, length / 2, num), np.zeros(num), np.full(num, -6.0)], axis=1)


def with_disturbed_database(scene, rotation_stddev_deg, position_stddev, rng):
    disturbed = scene.copy()
    for name in scene.database_names:
        pose = disturbed.images[name].pose
        turn = Rotation.from_rotvec(np.radians(rotation_stddev_deg) * rng.standard_normal(3)).as_matrix()
        disturbed.images[name].pose = Pose.from_centre(
            turn @ pose.rotation, pose.cam_in_world + position_stddev * rng.standard_normal(3)
        )
    return disturbed


# Quantiles


def print_quantiles(colmap):
    """Prints one row per 320 queries, from 8 scenes with the same layout of database cameras.

    Poses of any confidence count, because refusing uncertain ones would select small errors.
    """
    expected = scipy.stats.chi2.ppf(np.array(PERCENTS) / 100, 6)
    print("## Synthetic scenes\n")
    print("| database cameras | database poses |", " | ".join(f"{p} % quantile" for p in PERCENTS), "| mean |")
    print("|---" * (3 + len(PERCENTS)) + "|")
    print("| chi-square, 6 degrees | |", " | ".join(f"{q:.2f}" for q in expected), "| 6.00 |")
    layouts = {"9 on an arc": synthetic.arc(9), "4 on an arc": synthetic.arc(4), "6 on a line": line(6)}
    rows = [(layout, "exact, so stated", 0) for layout in layouts]
    rows += [(layout, "exact, estimated", 0) for layout in layouts]
    rows += [("9 on an arc", f"off by {px} px, estimated", px) for px in (1, 3)]
    rows += [(layout, "off by 1 px, estimated", 1) for layout in ("4 on an arc", "6 on a line")]
    for layout, database, database_noise_px in rows:
        errors = []
        for seed in range(8):
            rng = np.random.default_rng(seed)
            scene = synthetic.make_scene(layouts[layout], around(layouts[layout], 40, 0.7, rng), noise_px=1, seed=seed)
            # Convert pixels with the focal length of 520 px and the distance of 6 units.
            noise_rad = database_noise_px / 520
            given = with_disturbed_database(scene, np.degrees(noise_rad), 6 * noise_rad, rng)
            program_options = EXACT if "stated" in database else ()
            options = *localizer.ANY_CONFIDENCE, *program_options
            results = localize(colmap, scene, *options, database_scene=given)
            errors += [
                squared_error(results[name], scene.images[name].pose)
                for name in scene.query_names
                if results[name]["status"] == "LOCALIZED"
            ]
        observed = " | ".join(f"{q:.2f}" for q in np.percentile(errors, PERCENTS))
        print(f"| {layout} | {database} | {observed} | {np.mean(errors):.2f} |", flush=True)


# Cases


def keep_first_pairs(scene):
    first = scene.database_names[0]
    scene.pairs = {names: pair for names, pair in scene.pairs.items() if first in names}


def cases():
    """Yields the name and the scene of each case, with ten queries and half a pixel of noise."""
    rng = np.random.default_rng(0)
    arc, row, place = synthetic.arc(7), line(7), np.array([[0, 0, -6.0]])
    near_arc = around(arc, 10, 0.5, rng)
    near_row = around(row, 10, 0.5, rng)
    on_row = np.stack([rng.uniform(-2, 2, 10), np.zeros(10), np.full(10, -6.0)], axis=1)
    close = place + 0.1 * rng.standard_normal((7, 3))

    def make(database, queries, change=None, **options):
        scene = synthetic.make_scene(database, queries, noise_px=0.5, seed=1, **options)
        if change:
            change(scene)
        return scene

    yield "cameras around the scene", make(arc, near_arc)
    yield "cameras around the scene, all points in one plane", make(arc, near_arc, is_planar=True)
    yield "one database image", make(arc, near_arc, keep_first_pairs)
    yield "one database image, all points in one plane", make(arc, near_arc, keep_first_pairs, is_planar=True)
    yield "database images of one place", make(np.repeat(place, 5, axis=0), near_row)
    yield (
        "panorama: database images and query at one place",
        make(np.repeat(place, 5, axis=0), np.repeat(place, 10, axis=0)),
    )
    yield "query beside a line of database images", make(row, near_row)
    yield "query on the line", make(row, on_row)
    split = make(row, on_row, synthetic.split_tracks, num_points=900)
    yield "query on the line, each point in one database image", split
    yield "database images 0.1 units apart, 6 units away from the scene", make(close, near_row)
    yield "database images 0.05 units apart, 6 units away from the scene", make(place + (close - place) / 2, near_row)


def root_mean_square(values):
    return np.sqrt(np.mean(np.square(values))) if len(values) else None


def pair_of(stddevs, errors, unit):
    """Formats the root mean squares of reported standard deviations and of true errors."""
    if not errors:
        return "–"
    stddev = "?" if None in stddevs else f"{root_mean_square(stddevs):.2g}"
    return f"{stddev} / {root_mean_square(errors):.2g}{unit}"


def print_cases(colmap):
    print("## Degenerate cases\n")
    parts = " | ".join(f"{part}: stated σ / true error" for part in ("position, units", "rotation", "bearing"))
    print(f"| case, 10 queries | status | {parts} |")
    print("|---|---|---|---|---|")
    reasons = collections.OrderedDict()
    for case, scene in cases():
        results = localize(colmap, scene)
        columns = {key: ([], []) for key in ("position", "rotation", "bearing")}
        statuses = collections.Counter()
        for name, result in results.items():
            truth = scene.images[name].pose
            statuses[result["status"]] += 1
            if result["reason"]:
                reasons.setdefault((case, result["status"]), result["reason"])

            def add(column, stddev, error, columns=columns):
                columns[column][0].append(stddev)
                columns[column][1].append(error)

            if result["status"] == "LOCALIZED":
                offset = pose_of(result).cam_in_world - truth.cam_in_world
                add("position", result["position_stddevs"][0], offset @ result["weakest_direction"])
                add("rotation", result["rotation_stddev_deg"], pose_of(result).errors(truth)[1])
            elif result["rotation"]:
                rotation = Pose(np.array(result["rotation"]), truth.tvec)
                add("rotation", result["rotation_stddev_deg"], rotation.errors(truth)[1])
            if result["bearing"]:
                baseline = truth.cam_in_world - scene.images[result["bearing"]["from"]].pose.cam_in_world
                direction = result["bearing"]["direction"]
                angle = np.arctan2(np.linalg.norm(np.cross(direction, baseline)), np.dot(direction, baseline))
                add("bearing", result["bearing"]["stddev_deg"], np.degrees(angle))
        status = ", ".join(f"`{status}` {count}" for status, count in sorted(statuses.items()))
        print(
            f"| {case} | {status} | {pair_of(*columns['position'], '')} | {pair_of(*columns['rotation'], '°')} "
            f"| {pair_of(*columns['bearing'], '°')} |",
            flush=True,
        )
    print("\nReasons (of the first query each):\n")
    for (case, status), reason in reasons.items():
        print(f"- {case}, `{status}`: {reason}")


# Scenes


def print_scenes(colmap, data_paths):
    """Prints medians of the errors of each scene's localized images, with 20 and with 4 database images."""
    ratios = " ".join(
        f"| {part}: median of squared error / covariance (right: 2.4)" for part in ("position", "rotation")
    )
    print(f"## Leave one out\n\n| scene | K | localized queries | median errors, cm / ° {ratios} |")
    print("|---|---|---|---|---|---|")
    for scene_path in sorted(path.parent for data_path in data_paths for path in data_path.glob("*/database.db")):
        truth = {name: image.cam_from_world for name, image in read_model(scene_path / "model").images.items()}
        for num_retrieved in (20, 4):
            option = "--LazyLocalizer.num_retrieved", num_retrieved
            results = stress.leave_one_out(colmap, scene_path, scene_path / "model", *option)
            rows = []
            for result in results.values():
                if result["status"] != "LOCALIZED":
                    continue
                pose, true_pose = pose_of(result), truth[result["name"]]
                sigma = localizer.position_error(pose, result["covariance"], true_pose.cam_in_world)[1]
                turn = Rotation.from_matrix(pose.rotation @ true_pose.rotation.T).as_rotvec()
                of_rotation = turn @ np.linalg.solve(np.array(result["covariance"])[:3, :3], turn)
                rows.append((*pose.errors(true_pose), sigma**2, of_rotation))
            position, rotation, *squared = np.median(rows, axis=0) if rows else [np.nan] * 4
            print(
                f"| {scene_path.name} | {num_retrieved} | {len(rows)} of {len(results)} "
                f"| {100 * position:.2f} / {rotation:.3f} | {squared[0]:.1f} | {squared[1]:.1f} |",
                flush=True,
            )


@command
def main(arguments=None):
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["focal_length"]:
        return focal_length.main(arguments[1:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    tables = ["quantiles", "cases", "priors", "scenes", "stress", "fit"]
    parser.add_argument("tables", nargs="*", choices=[*tables, []], help="default: quantiles and cases")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument(
        "--data_path",
        type=pathlib.Path,
        action="append",
        default=[],
        help="folder of scenes (SCENE/database.db, SCENE/model, optionally SCENE/queries.txt), for scenes, stress and "
        "fit; may be repeated",
    )
    parser.add_argument(
        "--truth_stddev",
        metavar="SCENE=LENGTH",
        action="append",
        default=[],
        help="standard deviation of the errors of a real scene's true positions along each axis; default: 0; may be "
        "repeated",
    )
    parser.add_argument("--num_scenes", type=int, default=12, help="synthetic scenes of each kind, for stress and fit")
    parser.add_argument("--seed", type=int, default=0, help="of the synthetic scenes of `stress`; fit uses others")
    parser.add_argument(
        "--min_confidence", type=float, default=MIN_CONFIDENCE, help="threshold that `stress` accepts poses above"
    )
    arguments = parser.parse_args(arguments)
    truth_stddevs = {name: float(length) for name, length in (a.split("=") for a in arguments.truth_stddev)}
    for table in arguments.tables or ["quantiles", "cases"]:
        if table in ("quantiles", "cases"):
            {"quantiles": print_quantiles, "cases": print_cases}[table](arguments.colmap)
        elif table == "priors":
            priors.print_priors(arguments.colmap, cases(), localize)
        elif table == "scenes":
            print_scenes(arguments.colmap, arguments.data_path)
        else:
            # Fit other scenes than `stress` shows, because factors do best on what they were fitted to.
            outcomes = []
            for seed in FIT_SEEDS if table == "fit" else [arguments.seed]:
                outcomes += stress.run_synthetic(arguments.colmap, arguments.num_scenes, seed)
            for data_path in arguments.data_path:
                nums_retrieved, noise_levels = ((20, 4), FIT_NOISE_LEVELS) if table == "fit" else ((20,), ())
                outcomes += stress.run_real(arguments.colmap, data_path, nums_retrieved, truth_stddevs, noise_levels)
            if table == "fit":
                confidence_fit.fit_factors(outcomes)
            else:
                stress.print_report(outcomes, arguments.min_confidence)
        print()
