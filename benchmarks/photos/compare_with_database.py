"""Compares queries that are only photos with queries whose features and matches are in the database.

    python -m benchmarks photos --help

Every fourth image of a scene is a query. COLMAP extracts the features of all images, matches each query with all other
images and verifies the matches. "database" localizes the queries from this database. "photo" localizes the same queries
from the database without them, given only their image files and intrinsics: it retrieves the 20 most similar images and
matches them itself. To show how much of the difference is chance, further runs verify the raw matches of both again
with other seeds.

Prints tables. A scene is a folder as for benchmarks/localization, with images/ beside the model; it is only read.
Features and matches are kept in --work_path.
"""

import argparse
import pathlib

import numpy as np

from benchmarks.localization.environment import describe_environment
from benchmarks.photos import photo_scenes
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap

STAGES = ["extraction", "retrieval", "load", "matching", "verification"]


@command
def main(arguments=None):
    options = parse(arguments)
    folds = [
        [photo_scenes.make_fold(path, first, options.work_path, options.colmap) for first in options.first]
        for path in options.scene_path
    ]
    print(*describe_environment(), "", sep="\n")
    runs = [SceneRuns(scene_folds, options.num_seeds) for scene_folds in folds]
    print(accuracy_table(runs), "\n")
    print(noise_table(runs), "\n")
    print(time_table(runs))


class SceneRuns:
    """Position and rotation errors, one row per query; for several seeds the first axis is the seed."""

    def __init__(self, folds: list[photo_scenes.Fold], num_seeds: int):
        self.name = folds[0].scene.name
        self.num_database_images = len(folds[0].database_names)
        self.database = errors([fold.localize(fold.matched_path, "database") for fold in folds], folds)
        photo_runs = [localize_photos(fold) for fold in folds]
        self.photo = errors(photo_runs, folds)
        self.seconds = [record["seconds"] for run in photo_runs for record in run.values()]
        self.database_seeds = self._other_seeds(folds, "matched.db", num_seeds)
        self.photo_seeds = self._other_seeds(folds, "kept.db", num_seeds)

    @staticmethod
    def _other_seeds(folds, database_name: str, num_seeds: int) -> np.ndarray:
        paths = [photo_scenes.copy_without_verification(fold.work_path / database_name) for fold in folds]
        return np.array(
            [
                errors(
                    [
                        fold.localize(path, f"{database_name}_{seed}", "--LazyLocalizer.seed", seed)
                        for fold, path in zip(folds, paths)
                    ],
                    folds,
                )
                for seed in range(num_seeds)
            ]
        )


def localize_photos(fold: photo_scenes.Fold) -> dict[str, dict]:
    """Localizes with one thread, so that the stages' seconds are measured on one core."""
    kept_path = fold.work_path / "kept.db"
    kept_path.unlink(missing_ok=True)
    before = photo_scenes.sha256(fold.photo_path)
    run = fold.localize_photos(
        "photo", "--LazyLocalizer.num_threads", 1, "--LazyLocalizer.Advanced.matches_output_path", kept_path
    )
    after = photo_scenes.sha256(fold.photo_path)
    print(f"{fold.scene.name}: SHA-256 of the database before {before[:16]}..., after {after[:16]}...")
    if before != after:
        raise RuntimeError(f"{fold.photo_path} was changed")
    return run


def errors(runs: list[dict[str, dict]], folds: list[photo_scenes.Fold]) -> np.ndarray:
    return np.array([error for run, fold in zip(runs, folds) for error in fold.errors(run)])


def median_text(scene_errors: np.ndarray) -> str:
    position, rotation_deg = np.median(scene_errors, axis=0)
    return f"{100 * position:.2f} / {rotation_deg:.3f}"


def accuracy_table(runs: list[SceneRuns]) -> str:
    lines = [
        "| scene | queries, database images | database, cm / ° | photo, cm / ° | ratio of medians | paired ratio: "
        "geometric mean, quartiles | lost |",
        "|---|---|---|---|---|---|---|",
    ]
    for run in runs:
        medians = np.median(run.photo, axis=0) / np.median(run.database, axis=0)
        is_found = np.isfinite(run.photo[:, 0]) & np.isfinite(run.database[:, 0])
        logarithms = np.log(run.photo[is_found, 0] / run.database[is_found, 0])
        mean, quartiles = np.exp(logarithms.mean()), np.exp(np.quantile(logarithms, [0.25, 0.75]))
        lost = [np.sum(~np.isfinite(some[:, 0])) for some in (run.database, run.photo)]
        lines.append(
            f"| {run.name} | {len(run.photo)}, {run.num_database_images} | {median_text(run.database)} | "
            f"{median_text(run.photo)} | {medians[0]:.3f} / {medians[1]:.3f} | {mean:.3f}, {quartiles[0]:.2f}–"
            f"{quartiles[1]:.2f} | {lost[0]}, {lost[1]} |"
        )
    return "\n".join(lines)


def noise_table(runs: list[SceneRuns]) -> str:
    lines = [
        "| scene | database, medians of each seed | photo, medians of each seed | ratio of their means |",
        "|---|---|---|---|",
    ]
    for run in runs:
        for column, (unit, scale) in enumerate((("cm", 100), ("°", 1))):
            medians = [scale * np.median(seeds, axis=1)[:, column] for seeds in (run.database_seeds, run.photo_seeds)]
            texts = [" ".join(f"{median:.3g}" for median in some) for some in medians]
            lines.append(f"| {run.name}, {unit} | {' | '.join(texts)} | {medians[1].mean() / medians[0].mean():.3f} |")
    return "\n".join(lines)


def time_table(runs: list[SceneRuns]) -> str:
    """Returns a table of median seconds over the queries."""
    lines = ["| scene | " + " | ".join(STAGES) + " | pose |", "|---|" + "---|" * (len(STAGES) + 1)]
    for run in runs:
        columns = [[seconds[stage] for seconds in run.seconds] for stage in STAGES]
        others = [*STAGES, "matches_output"]
        columns.append([seconds["total"] - sum(seconds[stage] for stage in others) for seconds in run.seconds])
        lines.append(f"| {run.name} | " + " | ".join(f"{np.median(column):.3f}" for column in columns) + " |")
    return "\n".join(lines)


def parse(arguments) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene_path", type=pathlib.Path, nargs="+", help="folder with images/ and model/ (text)")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--work_path", type=pathlib.Path, required=True, help="folder for databases and results")
    parser.add_argument(
        "--first",
        type=int,
        nargs="+",
        default=[0],
        choices=range(photo_scenes.QUERY_STEP),
        help="index of the first query; 0 1 2 3 makes every image a query once",
    )
    parser.add_argument("--num_seeds", type=int, default=5, help="number of runs that verify the raw matches again")
    return parser.parse_args(arguments)
