"""Runs the program on sparse scenes, with and without priors of the queries, and compares the poses with the truth."""

import dataclasses
import pathlib

import numpy as np

from benchmarks.localization.evaluation import Row, Series, make_row
from benchmarks.localization.methods import MethodOptions, Result, load_method
from benchmarks.localization.methods.lazyloc import read_method_results
from benchmarks.localization.scenes import Scene
from benchmarks.localization.sparse_scenes import SparseScene
from benchmarks.uncertainty.localizer import position_error
from benchmarks.uncertainty.stress import is_wrong_position, scene_size
from colmap_lazyloc.model import write_model
from colmap_lazyloc.program import run_colmap
from colmap_lazyloc.results import read_results, unconfirmed_pose_of

# Our methods: the priors that the queries get, and options of the program.
PROGRAM_METHODS = {
    "lazyloc": ((), ()),
    "with a position": (("position",), ()),
    "with a position and gravity": (("position", "gravity"), ()),
}
MOTION_AVERAGING = "motion averaging"  # alone, which the others are compared with (benchmarks/ablation)
POSITION_STDDEV_RATIO = 0.05  # of a position that a query gets, over the extent of the scene's cameras
GRAVITY_STDDEV_DEG = 1.0


@dataclasses.dataclass
class Record:
    """The result of one query, and the error of its pose in its own standard deviations, also if it is refused."""

    is_star: bool
    num_images: int
    row: Row
    reason: str = ""
    confidence: float | None = None
    evidence: dict | None = None
    error: float = np.nan  # of the position, in units of the database
    error_sigma: float = np.nan
    size: float = np.nan  # of the scene (stress.scene_size)
    truth_stddev: float = 0.0

    @property
    def has_covariance(self) -> bool:
        return not np.isnan(self.error_sigma)

    @property
    def is_right(self) -> bool:
        """Returns what the confidence promises."""
        return not is_wrong_position(self.error, self.error_sigma, self.size, self.truth_stddev)


def run_program(scene: SparseScene, folder: pathlib.Path, arguments, method: str) -> dict[str, dict]:
    """Returns the records of results.jsonl."""
    priors, options = PROGRAM_METHODS[method]
    database_images = [image for name, image in scene.images.items() if name not in scene.chosen]
    model_path = write_model(folder / "model", scene.cameras, database_images)
    list_path, output_path = folder / "queries.txt", folder / "output"
    list_path.write_text("".join(f"{query} {scene.camera(query).text()}\n" for query in scene.query_names))
    paths = {"database": scene.database_path, "input": model_path, "output": output_path, "query_list": list_path}
    path_options = [text for name, path in paths.items() for text in (f"--{name}_path", path)]
    path_options += _write_priors(scene, folder, priors)
    run_colmap(arguments.colmap, "lazy_localizer", *path_options, *options, *arguments.options)
    return read_results(output_path / "results.jsonl")


def _write_priors(scene: SparseScene, folder: pathlib.Path, priors) -> list:
    """Writes positions and gravity with errors of the stated size, and returns the program's options."""
    rng = np.random.default_rng(0)
    centres = np.array([image.cam_from_world.cam_in_world for image in scene.images.values() if image.cam_from_world])
    stddev = POSITION_STDDEV_RATIO * np.linalg.norm(np.ptp(centres, axis=0))
    positions, gravity = [], []
    for query in scene.query_names:
        pose = scene.true_pose(query)
        position = pose.cam_in_world + stddev * rng.standard_normal(3)
        down = pose.rotation @ [0, 0, -1]
        down = down + np.cross(np.radians(GRAVITY_STDDEV_DEG) * rng.standard_normal(3), down)
        positions.append(f"{query} {' '.join(map(repr, position.tolist()))} {float(stddev)!r}\n")
        gravity.append(f"{query} {' '.join(map(repr, down.tolist()))} {GRAVITY_STDDEV_DEG}\n")
    options = []
    for name, lines in (("position", positions), ("gravity", gravity)):
        if name in priors:
            (folder / f"{name}.txt").write_text("".join(lines))
            options += [f"--query_{name}_path", folder / f"{name}.txt"]
    return options + (["--LazyLocalizer.world_up", "0,0,1"] if "gravity" in priors else [])


def _size(scene: SparseScene, records: dict[str, dict]) -> float:
    distances = [record["evidence"]["scene_distance"] for record in records.values() if record["evidence"]]
    known = [distance for distance in distances if distance is not None]
    poses = [image.cam_from_world for image in scene.images.values() if image.cam_from_world]
    return scene_size(poses, np.median(known)) if known else np.nan


def run_method(method, scene: SparseScene, folder, arguments, num_images: int, is_star: bool) -> list[Record]:
    """Returns the records of all queries. Throws NotApplicable if another method cannot run here."""
    if method not in PROGRAM_METHODS:
        name, preset = ("ablation", "averaging_alone") if method == MOTION_AVERAGING else (method, "")
        options = MethodOptions(folder / "method", arguments.colmap, num_retrieved=num_images, preset=preset)
        results = load_method(name)(scene, scene.query_names, options)
        return [Record(is_star, num_images, _row(scene, method, name, result)) for name, result in results.items()]
    results = run_program(scene, folder, arguments, method)
    size = _size(scene, results)
    records = []
    for name, result in read_method_results(folder / "output" / "results.jsonl", scene.query_names).items():
        known = results[name]
        record = Record(is_star, num_images, _row(scene, method, name, result), known["reason"] or "")
        if known["covariance"]:
            record.truth_stddev = arguments.truth_stddevs.get(scene.name, 0.0)
            record.error, record.error_sigma = _error(scene, name, known, record.truth_stddev)
            record.confidence, record.evidence, record.size = known["confidence"], known["evidence"], size
        records.append(record)
    return records


def _error(scene: SparseScene, name: str, known: dict, truth_stddev: float) -> tuple[float, float]:
    """Returns the error of a position, and that in standard deviations: infinite if a covariance is singular."""
    centre = scene.true_pose(name).cam_in_world
    try:
        error, sigma = position_error(unconfirmed_pose_of(known), known["covariance"], centre, truth_stddev)
    except np.linalg.LinAlgError:
        return float(np.linalg.norm(unconfirmed_pose_of(known).cam_in_world - centre)), np.inf
    return float(error), float(sigma)


def _row(scene: Scene, method: str, name: str, result: Result) -> Row:
    return make_row("sparse", scene, name, Series(method), result)
