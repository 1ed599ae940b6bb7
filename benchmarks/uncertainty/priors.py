"""The cases with unobservable motions, with positions and gravity of queries and depth maps."""

import collections
import pathlib
import tempfile

import numpy as np

from benchmarks.uncertainty.localizer import position_error
from colmap_lazyloc.results import pose_of
from colmap_lazyloc.testing import synthetic

POSITION_STDDEV = 0.3  # units; the scenes are 3 units wide and 6 away
GRAVITY_STDDEV_DEG = 1.0
DOWN = np.array([0.0, 1.0, 0.0])  # in the world of synthetic scenes
DEPTH_STDDEV_RATIO, DEPTH_SCALE_STDDEV_RATIO = 0.01, 0.02  # of depth maps that are stated to be metric
EVIDENCE = {
    "only images": (),
    "with position": ("position",),
    "with gravity": ("gravity",),
    "with position and gravity": ("position", "gravity"),
    "with depth": ("depth",),
    "with depth and position": ("depth", "position"),
}


def print_priors(colmap, cases, localize):
    """cases: pairs of a name and a scene; localize: runs the program and returns results by name."""
    print("## Degenerate cases with other evidence\n")
    print("| case, 10 queries | " + " | ".join(EVIDENCE) + " |\n|---|" + "---|" * len(EVIDENCE))
    for case, scene in cases:
        cells = []
        for names in EVIDENCE.values():
            with tempfile.TemporaryDirectory() as folder:
                priors = [name for name in names if name != "depth"]
                options = _write_priors(pathlib.Path(folder), scene, priors)
                if "depth" in names:
                    maps = synthetic.write_depth_maps(pathlib.Path(folder) / "maps", scene, _disturb_depths)
                    options += ["--depth_path", maps, "--LazyLocalizer.depth_is_metric", 1]
                cells.append(_describe(localize(colmap, scene, *options), scene))
        print(f"| {case} | {' | '.join(cells)} |", flush=True)


def _disturb_depths(depths, rng):
    scale = np.exp(DEPTH_SCALE_STDDEV_RATIO * rng.standard_normal())
    return depths * scale * np.exp(DEPTH_STDDEV_RATIO * rng.standard_normal(len(depths)))


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
    """Returns the statuses, what these fix, and of poses the median error and that in standard deviations."""
    statuses = collections.Counter(result["status"] for result in results.values())
    text = ", ".join(f"`{status}` {count}" for status, count in sorted(statuses.items()))
    fixed = _names_of_fixed(results)
    if fixed:
        text += "; fixes " + ", ".join(fixed)
    errors = [
        position_error(pose_of(result), result["covariance"], scene.images[name].pose.cam_in_world)
        for name, result in results.items()
        if pose_of(result)
    ]
    if errors:
        text += f"; {np.median([length for length, _ in errors]):.2g}, {np.median([s for _, s in errors]):.1f} σ"
    return text


def _names_of_fixed(results: dict) -> list[str]:
    """Returns what priors and depth maps fix in any of the poses."""
    fixed = set()
    for result in results.values():
        fixed |= {prior["fixes"] for prior in (result.get("priors") or {}).values() if prior}
        depth = result.get("depth")
        if depth and depth["fixes"] != "nothing" and pose_of(result):
            fixed.add(f"{depth['fixes']} by depth")
    return sorted(fixed - {"nothing"})
