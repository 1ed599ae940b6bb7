"""The cases with unobservable motions, with positions and gravity of the queries as further evidence."""

import collections
import pathlib
import tempfile

import numpy as np

from benchmarks.uncertainty.localizer import position_error
from colmap_lazyloc.results import pose_of

POSITION_STDDEV = 0.3  # units; the scenes are 3 units wide and 6 away
GRAVITY_STDDEV_DEG = 1.0
DOWN = np.array([0.0, 1.0, 0.0])  # in the world of synthetic scenes
EVIDENCE = {"none": (), "position": ("position",), "gravity": ("gravity",), "both": ("position", "gravity")}


def print_priors(colmap, cases, localize):
    """cases: pairs of a name and a scene; localize: runs the program and returns results by name."""
    print("| case, 10 queries | " + " | ".join(EVIDENCE) + " |\n|---|" + "---|" * len(EVIDENCE))
    for case, scene in cases:
        cells = []
        for names in EVIDENCE.values():
            with tempfile.TemporaryDirectory() as folder:
                options = _write_priors(pathlib.Path(folder), scene, names)
                cells.append(_describe(localize(colmap, scene, *options), scene))
        print(f"| {case} | {' | '.join(cells)} |", flush=True)


def _write_priors(folder: pathlib.Path, scene, names) -> list:
    rng = np.random.default_rng(0)
    positions, gravity = [], []
    for query in scene.query_names:
        pose = scene.images[query].pose
        position = pose.cam_in_world + POSITION_STDDEV * rng.standard_normal(3)
        down = pose.rotation @ DOWN
        turn = np.radians(GRAVITY_STDDEV_DEG) * rng.standard_normal(3)
        down = down + np.cross(turn, down)
        positions.append(f"{query} {' '.join(map(repr, position.tolist()))} {POSITION_STDDEV}\n")
        gravity.append(f"{query} {' '.join(map(repr, down.tolist()))} {GRAVITY_STDDEV_DEG}\n")
    (folder / "position.txt").write_text("".join(positions))
    (folder / "gravity.txt").write_text("".join(gravity))
    options = [option for name in names for option in (f"--query_{name}_path", folder / f"{name}.txt")]
    return [*options, "--LazyLocalizer.world_up", ",".join(map(str, -DOWN))]


def _describe(results: dict, scene) -> str:
    """Returns the statuses, what the priors fix, and of poses the median error and that in standard deviations."""
    statuses = collections.Counter(result["status"] for result in results.values())
    text = ", ".join(f"`{status}` {count}" for status, count in sorted(statuses.items()))
    fixed = collections.Counter(
        prior["fixes"]
        for result in results.values()
        for prior in (result.get("priors") or {}).values()
        if prior and prior["fixes"] != "nothing"
    )
    if fixed:
        text += "; fixes " + ", ".join(sorted(fixed))
    errors = [
        position_error(pose_of(result), result["covariance"], scene.images[name].pose.cam_in_world)
        for name, result in results.items()
        if pose_of(result)
    ]
    if errors:
        text += f"; {np.median([length for length, _ in errors]):.2g}, {np.median([s for _, s in errors]):.1f} σ"
    return text
