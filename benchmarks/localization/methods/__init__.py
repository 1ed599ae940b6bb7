"""Methods by name: each is a module with `localize(scene, query_names, options) -> {query name: Result}`."""

import dataclasses
import importlib
import pathlib

from geometry import Pose

METHODS = (
    "structure_based",
    "lazyloc",
    "local_triangulation",
    "local_map",
    "colmap_structureless",
    "generalized_relative_pose",
    "poselib_generalized",
    "poselib_hybrid",
    "relative_pose_ransac",
)


class NotApplicable(Exception):
    """The method cannot be run here; the text says why and goes below the table."""


@dataclasses.dataclass(frozen=True)
class Result:
    pose: Pose | None  # None: lost
    seconds: float
    status: str = "LOCALIZED"

    @staticmethod
    def lost(seconds: float, status: str = "LOST") -> "Result":
        return Result(None, seconds, status)


@dataclasses.dataclass(frozen=True)
class MethodOptions:
    work_path: pathlib.Path  # folder that a method may fill; what it finds there again it may use again
    colmap_path: pathlib.Path = pathlib.Path("colmap")
    num_retrieved: int = 20
    seed: int = 0
    preset_path: pathlib.Path | None = None  # .ini file with options of the program
    program_options: tuple[tuple[str, str], ...] = ()  # of the program, by name; stronger than the preset


def load_method(name: str):
    """The function `localize` of a method. A package that is not installed is a reason, not an error."""
    if name not in METHODS:
        raise ValueError(f"--methods: {name} is not one of {', '.join(METHODS)}")
    try:
        return importlib.import_module(f"methods.{name}").localize
    except ImportError as error:
        raise NotApplicable(f"needs a package: {error}") from error
