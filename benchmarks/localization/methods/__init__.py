"""Loads methods by name. Each is a module with `localize(scene, query_names, options) -> {query name: Result}` or, if
it needs only the verified matches of a query, with `estimate_pose(scene, camera, matches, seed) -> Pose | None`.
"""

import dataclasses
import functools
import importlib
import pathlib
import time

import pycolmap

from benchmarks.localization.matches import MatchDatabase
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.poses import Pose

# Presets of the method `ablation`: names of benchmarks/ablation/ablation.cc.
ABLATIONS = (
    "none",
    "l1",
    "quaternion_mean",
    "lud",
    "averaging_alone",
    "lud_alone",
    "sampson",
    "relative_pose_lo",
)
METHODS = (
    "structure_based",
    "lazyloc",
    "ablation",
    "local_triangulation",
    "local_map",
    "colmap_structureless",
    "generalized_relative_pose",
    "poselib_generalized",
    "poselib_hybrid",
    "relative_pose_ransac",
)


class NotApplicable(Exception):
    """Raised if a method cannot run here; the message says why and is printed below the table."""


@dataclasses.dataclass(frozen=True)
class Result:
    pose: Pose | None  # None if the query is lost
    seconds: float
    status: str = "LOCALIZED"

    @staticmethod
    def lost(seconds: float, status: str = "LOST") -> "Result":
        return Result(None, seconds, status)


@dataclasses.dataclass(frozen=True)
class MethodOptions:
    work_path: pathlib.Path  # folder for files of the method, which it may reuse
    colmap_path: pathlib.Path = pathlib.Path("colmap")
    num_retrieved: int = 20
    seed: int = 0
    preset: str = ""  # what is after the colon in the method's name
    preset_path: pathlib.Path | None = None  # .ini file with options of lazy_localizer
    program_options: tuple[tuple[str, str], ...] = ()  # options of lazy_localizer by name; override the preset


def load_method(name: str):
    """Returns the function `localize` of a method; raises NotApplicable if a package is not installed."""
    if name not in METHODS:
        raise ValueError(f"--methods: {name} is not one of {', '.join(METHODS)}")
    try:
        module = importlib.import_module(f"benchmarks.localization.methods.{name}")
    except ImportError as error:
        raise NotApplicable(f"needs a package: {error}") from error
    if hasattr(module, "localize"):
        return module.localize
    return functools.partial(localize_by, module.estimate_pose)


def localize_by(estimate_pose, scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    """Localizes with the verified matches of each query. Only `estimate_pose` is timed, not reading."""
    pycolmap.logging.minloglevel = pycolmap.logging.Level.WARNING.value
    results = {}
    with MatchDatabase(scene.database_path) as database:
        for name in query_names:
            matches = database.query_matches(scene, name, options.num_retrieved)
            start = time.perf_counter()
            pose = estimate_pose(scene, scene.camera(name), matches, options.seed)
            seconds = time.perf_counter() - start
            results[name] = Result(pose, seconds) if pose else Result.lost(seconds)
    return results
