"""Localizes photos against the database after they were made worse: with less light, out of focus, in haze.

    python -m benchmarks photometric_stress --help

Every fourth image of a scene is left out of the database, and is a photo; --num_queries of them are made worse. COLMAP
extracts SIFT features of the database images. Values of --FeatureMatching.type are compared: AUTO takes LightGlue for
what SIFT does not localize.

Prints tables: the share of photos that are LOCALIZED, with the interval of 95 % (Wilson), and how many of these are
wrong; for photos that have not been made worse, their position errors over SIFT's (geometric mean, with its interval of
95 % by Student's t) and core-seconds. A scene is a folder as for benchmarks/localization,
with images/ beside the model; it is only read. Databases, photos and features are kept in --work_path.
"""

import argparse
import pathlib

import cv2
import numpy as np
from scipy.stats import t as student_t

from benchmarks.localization.environment import describe_environment
from benchmarks.photos import degraded_photos, photo_scenes
from benchmarks.photos.retrieval import core_seconds
from benchmarks.uncertainty import stress
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap, run_colmap
from colmap_lazyloc.results import read_results

STRENGTHS = {"darken": (256, 1024), "blur": (4, 8), "haze": (8, 32)}
AS_TAKEN = ("as taken", 1)
METHODS = ("SIFT_BRUTEFORCE", "ALIKED_BRUTEFORCE", "ALIKED_LIGHTGLUE", "AUTO")
NORMAL_QUANTILE = 1.96


class StressScene:
    """A scene with its degraded photos, and how each method localizes them."""

    def __init__(self, scene_path: pathlib.Path, options: argparse.Namespace):
        self.fold = photo_scenes.make_fold(scene_path, 0, options.work_path, options.colmap, is_matched=False)
        self._options = options
        self._image_path = self.fold.work_path / "photos"
        step = max(1, len(self.fold.query_names) // options.num_queries)
        names_made_worse = self.fold.query_names[::step][: options.num_queries]
        # The program finds the images of the database below the folder of the photos.
        for name in self.fold.database_names:
            path = self._image_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                path.symlink_to((self.fold.scene.path / "images" / name).resolve())
        # The index is made before anything is measured.
        index_options = ("--database_path", self.fold.photo_path, "--index_path", self.fold.index_path)
        run_colmap(options.colmap, "lazy_indexer", *index_options)
        kinds = [(kind, strength) for kind in STRENGTHS for strength in STRENGTHS[kind]]
        self._taken = self._write_photos([AS_TAKEN], self.fold.query_names)
        self._worse = self._write_photos(kinds, names_made_worse)

    def _write_photos(self, kinds, names) -> dict[str, tuple[str, tuple[str, int]]]:
        """Writes photos; returns the original and the kind of each by name."""
        photos = {}
        for kind in kinds:
            for index, name in enumerate(names):
                photo_name = f"{kind[0]} {kind[1]}/{name}.png".replace(" ", "_")
                photos[photo_name] = (name, kind)
                path = self._image_path / photo_name
                path.parent.mkdir(parents=True, exist_ok=True)
                photo = cv2.imread(str(self.fold.scene.path / "images" / name))
                if kind != AS_TAKEN:
                    degrade = getattr(degraded_photos, kind[0])
                    photo = degrade(photo, kind[1], np.random.default_rng(index))
                cv2.imwrite(str(path), photo)
        return photos

    def localize(self, method: str, is_worse: bool) -> tuple[list[stress.Outcome], float]:
        """Returns what became of the photos, and core-seconds per photo."""
        photos = self._worse if is_worse else self._taken
        scene = self.fold.scene
        query_list_path = self.fold.work_path / "photos.txt"
        query_list_path.write_text("".join(f"{name} {scene.camera(of).text()}\n" for name, (of, _) in photos.items()))
        output_path = self.fold.work_path / f"{method}_{is_worse}"
        before = core_seconds()
        run_colmap(
            self._options.colmap,
            "lazy_localizer",
            "--database_path",
            self.fold.photo_path,
            "--input_path",
            scene.model_path,
            "--output_path",
            output_path,
            "--image_path",
            self._image_path,
            "--query_list_path",
            query_list_path,
            "--retrieval_index_path",
            self.fold.index_path,
            "--onnx_path",
            self._options.onnx_path,
            "--FeatureMatching.type",
            method,
        )
        seconds = (core_seconds() - before) / len(photos)
        results = read_results(output_path / "results.jsonl")
        truth = {name: scene.true_pose(of).cam_in_world for name, (of, _) in photos.items()}
        database = [scene.true_pose(name) for name in self.fold.database_names]
        outcomes = []
        for kind in dict.fromkeys(kind for _, kind in photos.values()):
            of_kind = {name: results[name] for name, (_, other) in photos.items() if other == kind}
            outcomes += stress.outcomes_of(kind, scene.name, of_kind, truth, database)
        return outcomes, seconds


def share_text(outcomes: list[stress.Outcome]) -> str:
    """Returns share, interval, and the number of wrong ones."""
    localized = [outcome for outcome in outcomes if outcome.status == "LOCALIZED"]
    count, found = len(outcomes), len(localized)
    squared = NORMAL_QUANTILE**2
    centre = (found + squared / 2) / (count + squared)
    half = NORMAL_QUANTILE * np.sqrt(found * (count - found) / count + squared / 4) / (count + squared)
    low, high = (100 * min(max(bound, 0), 1) for bound in (centre - half, centre + half))
    wrong = sum(outcome.is_wrong for outcome in localized)
    return f"{100 * found / count:.0f} % [{low:.0f}, {high:.0f}], {wrong}"


def error_text(outcomes: list[stress.Outcome], sift_outcomes: list[stress.Outcome]) -> str:
    """Returns the geometric mean of errors over SIFT's, its interval, and the number of photos that both localize."""
    pairs = zip(outcomes, sift_outcomes, strict=True)
    logs = [np.log(a.error / b.error) for a, b in pairs if a.status == b.status == "LOCALIZED"]
    if len(logs) < 2:
        return f"-, {len(logs)}"
    half = student_t.ppf(0.975, len(logs) - 1) * np.std(logs, ddof=1) / np.sqrt(len(logs))
    mean, low, high = np.exp(np.mean(logs) + half * np.array([0, -1, 1]))
    return f"{mean:.2f} [{low:.2f}, {high:.2f}], {len(logs)}"


@command
def main(arguments=None):
    options = parse(arguments)
    print(*describe_environment(), "", sep="\n")
    outcomes: dict[str, list[stress.Outcome]] = {method: [] for method in METHODS}
    taken: dict[str, dict[str, list[stress.Outcome]]] = {}
    time_rows = []
    for path in options.scene_path:
        scene = StressScene(path, options)
        name, seconds = scene.fold.scene.name, {}
        taken[name] = {}
        for method in METHODS:
            taken[name][method], seconds[method] = scene.localize(method, is_worse=False)
            worse, _ = scene.localize(method, is_worse=True)
            outcomes[method] += taken[name][method] + worse
        time_rows.append(f"| {name} | " + " | ".join(f"{seconds[m]:.2f}" for m in METHODS) + " |")
    taken["all"] = {method: [o for of in taken.values() for o in of[method]] for method in METHODS}
    head = " | ".join(f"{method}: localized [95 %], wrong" for method in METHODS)
    print("## Stress\n", f"| condition, N | photos | {head} |", "|---|---|" + "---|" * len(METHODS), sep="\n")
    for kind in dict.fromkeys(outcome.kind for outcome in outcomes["AUTO"]):
        of_kind = {method: [o for o in outcomes[method] if o.kind == kind] for method in METHODS}
        label = kind[0] if kind == AS_TAKEN else f"{kind[0]}, {kind[1]}"
        print(f"| {label} | {len(of_kind['AUTO'])} | {' | '.join(map(share_text, of_kind.values()))} |")
    head = " | ".join(f"{method}: error divided by SIFT's [95 %], photos" for method in METHODS[1:])
    print("\n## Stress errors\n", f"| scene | {head} |", "|---|" + "---|" * len(METHODS[1:]), sep="\n")
    for name, of in taken.items():
        print(f"| {name} | {' | '.join(error_text(of[m], of[METHODS[0]]) for m in METHODS[1:])} |")
    head = " | ".join(f"{method}, core-s" for method in METHODS)
    print("\n## Stress time\n", f"| scene | {head} |", "|---|" + "---|" * len(METHODS), *time_rows, sep="\n")


def parse(arguments) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene_path", type=pathlib.Path, nargs="+", help="folder with images/ and model/ (text)")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--onnx_path", type=pathlib.Path, required=True, help="folder of COLMAP 4's ONNX models")
    parser.add_argument("--work_path", type=pathlib.Path, required=True, help="folder for databases and results")
    parser.add_argument("--num_queries", type=int, default=2, help="photos of a scene that are made worse")
    return parser.parse_args(arguments)
