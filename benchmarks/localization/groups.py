"""Localizes queries individually, jointly, as frames of a camera rig, and as parts of a known trajectory.

    python -m benchmarks groups --data_path DATA --output_path OUT.md [-- OPTIONS OF LAZY_LOCALIZER]

DATA is a folder of scenes as for `python -m benchmarks run --dataset scenes`. In the order of names, every third or
fourth image of a scene (for a rig: frame) is in the database; the others are queries. A group has L consecutive
queries. A trajectory consists of the true relative poses. The scene "stereo" is made by `synthetic_stereo`, with one
table for each way in which its stated poses are wrong.
"""

import argparse
import collections
import dataclasses
import json
import pathlib
import tempfile

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.localization import synthetic_stereo
from benchmarks.localization.environment import describe_environment
from benchmarks.localization.evaluation import Row, Series, make_row, paired_ratio, summarize
from benchmarks.localization.methods.lazyloc import read_method_results
from benchmarks.localization.scenes import Scene, load_scene
from colmap_lazyloc.errors import command
from colmap_lazyloc.model import write_model
from colmap_lazyloc.program import find_colmap, run_colmap
from colmap_lazyloc.results import read_results


@dataclasses.dataclass(frozen=True)
class Setup:
    """Selects the database images of a scene; errors are measured for images with the first prefix."""

    database_step: int
    prefixes: tuple[str, ...] = ("",)  # names of a rig's images start with the prefix of their camera


SETUPS = {"kitti1": Setup(3, ("left/", "right/")), "kitchen": Setup(4)}
STEREO = "stereo"  # the synthetic scenes
STEREO_SETUP = Setup(3, synthetic_stereo.PREFIXES)


@dataclasses.dataclass(frozen=True)
class Variant:
    options: list
    is_rig: bool = False  # all cameras of the rig are queries


def stereo_variants(scene: Scene, folder: pathlib.Path) -> dict[str, Variant]:
    """Returns the variants of a synthetic scene. The program knows the rigs of its database from the configuration."""
    rig = ["--rig_config_path", scene.path / "rig_config.json"]
    truth_path = write_model(folder / "truth", scene.cameras, list(scene.true_images.values()))
    trajectory = ["--query_trajectory_path", truth_path, "--LazyLocalizer.group_size", 5]
    return {
        "alone": Variant(rig),
        "alone, database without rigs": Variant([]),
        "rig": Variant(rig, is_rig=True),
        "trajectory, L = 5": Variant(trajectory),
    }


def variants(scene: Scene, setup: Setup, queries: list[str], folder: pathlib.Path) -> dict[str, Variant]:
    """Returns the variants by name; the others are compared with the first."""
    if scene.true_images:
        return stereo_variants(scene, folder)

    def size(length):
        return ["--LazyLocalizer.group_size", length]

    chosen = {"alone": Variant([])} | {f"joint, L = {length}": Variant(size(length)) for length in (3, 5)}
    trajectory = ["--query_trajectory_path", scene.model_path]
    chosen |= {f"trajectory, L = {length}": Variant([*trajectory, *size(length)]) for length in (3, 5)}
    chosen["trajectory without scale, L = 5"] = Variant(
        [*trajectory, *size(5), "--LazyLocalizer.Advanced.trajectory_has_scale", 0]
    )
    if len(setup.prefixes) == 1:
        return chosen
    config_path = scene.path / "rig_config.json"
    chosen["rig"] = Variant(["--rig_config_path", config_path], is_rig=True)
    pairs = ["--pairs_path", write_pairs_with_one_image(scene, setup, queries, folder / "pairs.txt")]
    chosen["alone, one database image"] = Variant(pairs)
    chosen["rig, one database image"] = Variant([*chosen["rig"].options, *pairs], is_rig=True)
    for error_deg in (0.3, 1, 3, 10):
        wrong_path = write_wrong_config(config_path, error_deg, folder / f"rig_{error_deg}.json")
        chosen[f"rig, camera turned by {error_deg}°"] = Variant(["--rig_config_path", wrong_path], is_rig=True)
    return chosen


def write_pairs_with_one_image(scene: Scene, setup: Setup, queries: list[str], path: pathlib.Path) -> pathlib.Path:
    """Pairs all images of a frame with the preceding database image of the first camera."""
    lines, last = [], None
    for name in sorted(name for name in scene.images if name.startswith(setup.prefixes[0])):
        if name not in queries:
            last = name
            continue
        moment = name.removeprefix(setup.prefixes[0])
        lines += [f"{prefix}{moment} {last}\n" for prefix in setup.prefixes]
    path.write_text("".join(lines))
    return path


def write_wrong_config(config_path: pathlib.Path, error_deg: float, path: pathlib.Path) -> pathlib.Path:
    """Writes a rig configuration in which the last camera of the first rig is turned about its vertical axis."""
    config = json.loads(config_path.read_text())
    camera = config[0]["cameras"][-1]
    turn = Rotation.from_euler("y", error_deg, degrees=True)
    rotation = turn * Rotation.from_quat(camera["cam_from_rig_rotation"], scalar_first=True)
    camera["cam_from_rig_rotation"] = rotation.as_quat(scalar_first=True).tolist()
    camera["cam_from_rig_translation"] = turn.apply(camera["cam_from_rig_translation"]).tolist()
    path.write_text(json.dumps(config))
    return path


def run_scene(scene: Scene, setup: Setup, arguments: argparse.Namespace) -> tuple[dict, dict]:
    """Returns the rows and the median rig_error_px of the images, by variant."""
    moments = sorted(
        name.removeprefix(setup.prefixes[0]) for name in scene.images if name.startswith(setup.prefixes[0])
    )
    query_moments = [moment for i, moment in enumerate(moments) if i % setup.database_step != 0]
    queries = [prefix + moment for moment in query_moments for prefix in setup.prefixes]
    evaluated = [setup.prefixes[0] + moment for moment in query_moments]
    rows, rig_errors_px = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        database_images = [image for name, image in scene.images.items() if name not in queries]
        model_path = write_model(pathlib.Path(folder) / "model", scene.cameras, database_images)
        for name, variant in variants(scene, setup, queries, pathlib.Path(folder)).items():
            listed = queries if variant.is_rig else evaluated
            list_path, output_path = pathlib.Path(folder) / "queries.txt", pathlib.Path(folder) / "output"
            list_path.write_text("".join(f"{query} {scene.camera(query).text()}\n" for query in listed))
            run_colmap(
                arguments.colmap,
                "lazy_localizer",
                "--database_path",
                scene.database_path,
                "--input_path",
                model_path,
                "--output_path",
                output_path,
                "--query_list_path",
                list_path,
                *variant.options,
                *arguments.options,
            )
            results = read_method_results(output_path / "results.jsonl", evaluated)
            rows[name] = [make_row("groups", scene, query, Series(name), results[query]) for query in evaluated]
            records = read_results(output_path / "results.jsonl").values()
            errors = [record["rig_error_px"] for record in records if record["rig_error_px"] is not None]
            rig_errors_px[name] = f"{np.median(errors):.1f}" if errors else "–"
    return rows, rig_errors_px


def run_stereo(errors: synthetic_stereo.Errors, arguments: argparse.Namespace) -> tuple[dict, dict]:
    """Returns the rows of several synthetic scenes, and no rig_error_px, by variant."""
    all_rows = {}
    for seed in range(arguments.num_seeds):
        with tempfile.TemporaryDirectory() as folder:
            scene = synthetic_stereo.make_scene(pathlib.Path(folder) / f"{STEREO} {seed}", errors, seed)
            for name, rows in run_scene(scene, STEREO_SETUP, arguments)[0].items():
                all_rows.setdefault(name, []).extend(rows)
    return all_rows, dict.fromkeys(all_rows, "–")


def table(rows: dict[str, list[Row]], rig_errors_px: dict[str, str]) -> str:
    baseline_rows = next(iter(rows.values()))
    lines = [
        "| localized | queries | without pose | median errors, mm / ° | mean error, mm "
        "| position error divided by *alone* [95 %] | rotation error divided by *alone* [95 %] | `rig_error_px` |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, own_rows in rows.items():
        summary = summarize(own_rows)
        ratios = [paired_ratio(own_rows, baseline_rows, e) for e in ("position_error_cm", "rotation_error_deg")]
        statuses = collections.Counter(row.status for row in own_rows if row.is_lost)
        lost = ", ".join(f"{count} {status}" for status, count in statuses.items()) or "0"
        median, mean = summary.median_position_error_cm, summary.mean_position_error_cm
        figures = "– | – | – | –"
        if ratios[0] is not None:
            position, rotation = (f"{ratio.mean:.2f} [{ratio.low:.2f}, {ratio.high:.2f}]" for ratio in ratios)
            medians = f"{10 * median:.2f} / {summary.median_rotation_error_deg:.4f}"
            figures = f"{medians} | {10 * mean:.2f} | {position} | {rotation}"
        lines.append(f"| {name} | {summary.num_queries} | {lost} | {figures} | {rig_errors_px[name]} |")
    return "\n".join(lines)


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data_path", type=pathlib.Path, default=pathlib.Path(), help="folder of scenes")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="Markdown file to write")
    parser.add_argument("--scenes", nargs="+", choices=[*SETUPS, STEREO], default=[*SETUPS, STEREO])
    parser.add_argument("--num_seeds", type=int, default=3, help="number of synthetic scenes per table")
    parser.add_argument("options", nargs="*", help="further options of lazy_localizer")
    arguments = parser.parse_args(arguments)
    command_line = " ".join(["python -m benchmarks groups --data_path DATA", *arguments.options])
    parts = ["# groups", "\n\n".join(describe_environment()), f"`{command_line}`"]
    runs = [
        (name, lambda name=name: run_scene(load_scene(arguments.data_path / name), SETUPS[name], arguments))
        for name in arguments.scenes
        if name != STEREO
    ]
    if STEREO in arguments.scenes:
        runs += [
            (f"{STEREO}: {case}", lambda errors=errors: run_stereo(errors, arguments))
            for case, errors in synthetic_stereo.CASES.items()
        ]
    for title, run in runs:
        parts += [f"## {title}", table(*run())]
        print("\n\n".join(parts[-2:]), flush=True)
    arguments.output_path.write_text("\n\n".join(parts) + "\n")
