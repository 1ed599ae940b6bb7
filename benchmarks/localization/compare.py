"""Compares runs and fails (exit code 1) if a later one is significantly worse than the first.

    python -m benchmarks compare BEFORE.csv AFTER.csv

A run is the TAG.csv of `python -m benchmarks run`. Instead of the first run, a JSON file of expected figures may be
given, which --write_expected makes from a run.

Runs are compared query by query. A run is worse if, for one scene or for all, the geometric mean of the ratios of
position or rotation errors exceeds 1 + --min_effect and its 99 % bootstrap interval over queries lies above 1. It is
also worse if it loses more queries than chance explains (McNemar's test). Expected figures are compared with the
tolerances in their file. With more than two runs, for example three seeds, the table also shows the scatter of the
medians.
"""

import argparse
import dataclasses
import json
import math
import pathlib
import statistics
import sys

from benchmarks.localization.evaluation import MIN_ERROR, Row, Series, paired_ratio, read_csv, summarize
from benchmarks.localization.tables import in_order, labels
from colmap_lazyloc.errors import command

ALL_SCENES = "all scenes"
CONFIDENCE = 0.99
ERRORS = {"position": "position_error_cm", "rotation": "rotation_error_deg"}
DEFAULT_TOLERANCE = {"position_ratio": 1.1, "rotation_ratio": 1.1, "num_lost": 0}

# The rows of a run by scene and series.
Groups = dict[tuple[str, Series], list[Row]]


@command(name="benchmarks compare")
def main(argv=None) -> int:
    arguments = _parse(argv)
    try:
        first, *others = arguments.runs
        if arguments.write_expected:
            write_expected(arguments.write_expected, _read_groups(first, arguments.methods))
            return 0
        regressions = []
        if first.suffix == ".json":
            expected = json.loads(first.read_text())
            for path in others:
                regressions += compare_with_expected(expected, _read_groups(path))
        else:
            runs = [_read_groups(path, arguments.methods) for path in arguments.runs]
            print(side_by_side([path.stem for path in arguments.runs], runs))
            for path, run in zip(others, runs[1:]):
                found, lines = compare_paired(runs[0], run, arguments.min_effect)
                print(f"{path.stem} / {first.stem}, geometric mean ratio of errors [{100 * CONFIDENCE:g} %]\n")
                print("\n".join(lines) + "\n")
                regressions += [f"{path.stem}: {text}" for text in found]
    except (OSError, ValueError, KeyError) as error:
        print(f"benchmarks compare: {error}", file=sys.stderr)
        return 1
    for text in regressions:
        print(f"REGRESSION: {text}")
    print("worse than noise" if regressions else "no regression")
    return 1 if regressions else 0


def compare_paired(before: Groups, after: Groups, min_effect: float) -> tuple[list[str], list[str]]:
    """Returns the significant regressions, and a line of text for each comparison."""
    common = [key for key in before if key in after]
    if not common:
        raise ValueError("the runs have no scene and method in common")
    missing = sorted({f"{scene} {series.method}" for scene, series in before if (scene, series) not in after})
    regressions, lines = [], [f"not in the later run: {', '.join(missing)}"] if missing else []
    all_series = in_order({series for _, series in common})
    for series, label in labels(all_series).items():
        scenes = sorted(scene for scene, other in common if other == series)
        groups = {scene: [scene] for scene in scenes} | ({ALL_SCENES: scenes} if len(scenes) > 1 else {})
        for name, members in groups.items():
            rows_before, rows_after = (
                [row for scene in members for row in run[scene, series]] for run in (before, after)
            )
            found, text = _compare_rows(rows_before, rows_after, min_effect)
            lines.append(f"{name}, {label}: {text}")
            regressions += [f"{name}, {label}: {reason}" for reason in found]
    return regressions, lines


def _compare_rows(before: list[Row], after: list[Row], min_effect: float) -> tuple[list[str], str]:
    regressions, texts = [], []
    for quantity, error in ERRORS.items():
        ratio = paired_ratio(after, before, error, CONFIDENCE)
        if ratio is None:
            texts.append(f"{quantity} –")
            continue
        text = f"{quantity} {ratio.mean:.3f} [{ratio.low:.3f}, {ratio.high:.3f}]"
        texts.append(text)
        if ratio.low > 1 and ratio.mean > 1 + min_effect:
            regressions.append(text)
    lost_before, lost_after = ({(row.scene, row.query) for row in rows if row.is_lost} for rows in (before, after))
    seen = {(row.scene, row.query) for row in before} & {(row.scene, row.query) for row in after}
    num_worse, num_better = len((lost_after - lost_before) & seen), len((lost_before - lost_after) & seen)
    texts.append(f"lost {len(lost_before)} -> {len(lost_after)}")
    # Apply McNemar's test: if both are equally likely, the sum of the two numbers is the variance of their difference.
    if num_worse - num_better > 2 * math.sqrt(num_worse + num_better):
        regressions.append(f"{num_worse} queries lost that were localized, {num_better} the other way")
    return regressions, ", ".join(texts)


def compare_with_expected(expected: dict, run: Groups) -> list[str]:
    """Compares lost queries and geometric means with a file's figures; medians of few queries would scatter more."""
    tolerance = expected["tolerance"]
    regressions = []
    for figure in expected["figures"]:
        series = Series(figure["method"], figure["num_retrieved"])
        name = f"{figure['scene']}, {series.method}"
        rows = run.get((figure["scene"], series))
        if rows is None:
            regressions.append(f"{name}: not in the run")
            continue
        summary = summarize(rows)
        if summary.num_queries != figure["num_queries"]:
            regressions.append(f"{name}: {summary.num_queries} queries instead of {figure['num_queries']}")
        if summary.num_lost > figure["num_lost"] + tolerance["num_lost"]:
            regressions.append(f"{name}: {summary.num_lost} lost instead of {figure['num_lost']}")
        for quantity, error in ERRORS.items():
            mean, expected_mean = _geometric_mean(rows, error), figure[f"geometric_mean_{error}"]
            ratio = mean / expected_mean
            text = (
                f"{name}: geometric mean of {quantity} errors {mean:.4g}, expected {expected_mean:.4g}, "
                f"ratio {ratio:.3f}"
            )
            print(text)
            if not ratio <= tolerance[f"{quantity}_ratio"]:
                regressions.append(text)
    return regressions


def _geometric_mean(rows: list[Row], error: str) -> float:
    """Returns the geometric mean over the localized queries; infinite if there are none."""
    errors = [max(getattr(row, error), MIN_ERROR) for row in rows if row.is_measured]
    return statistics.geometric_mean(errors) if errors else math.inf


def write_expected(path: pathlib.Path, run: Groups):
    """Writes a run's figures; keeps the tolerances of an existing file."""
    old = json.loads(path.read_text()) if path.exists() else {}
    figures = []
    for (scene, series), rows in sorted(run.items(), key=str):
        summary = summarize(rows)
        figures.append(
            {
                "scene": scene,
                "method": series.method,
                "num_retrieved": series.num_retrieved,
                "num_queries": summary.num_queries,
                "num_lost": summary.num_lost,
                **{f"geometric_mean_{error}": round(_geometric_mean(rows, error), 5) for error in ERRORS.values()},
            }
        )
    # Write one figure per line, so that a diff is easy to read.
    lines = ",\n".join(f"    {json.dumps(figure)}" for figure in figures)
    tolerance = json.dumps(old.get("tolerance", DEFAULT_TOLERANCE))
    path.write_text(f'{{\n  "tolerance": {tolerance},\n  "figures": [\n{lines}\n  ]\n}}\n')


def side_by_side(names: list[str], runs: list[Groups]) -> str:
    """Returns a table of medians; with more than two runs also their scatter, (maximum - minimum) / mean."""
    keys = sorted({key for run in runs for key in run}, key=str)
    has_scatter = len(runs) > 2
    text = f"| scene | method | {' | '.join(names)} |{' scatter |' if has_scatter else ''}\n"
    text += "|---" * (2 + len(names) + has_scatter) + "|\n"
    label = labels(in_order({series for _, series in keys}))
    for scene, series in keys:
        summaries = [summarize(run[scene, series]) if (scene, series) in run else None for run in runs]
        cells = [
            f"{s.median_position_error_cm:.3f} / {s.median_rotation_error_deg:.4f}" if s else "–" for s in summaries
        ]
        if has_scatter:
            medians = [s.median_position_error_cm for s in summaries if s]
            mean = sum(medians) / len(medians)
            cells.append(f"{100 * (max(medians) - min(medians)) / mean:.1f} %" if mean > 0 else "–")
        text += f"| {scene} | {label[series]} | {' | '.join(cells)} |\n"
    return "Median cm / °\n\n" + text


def _read_groups(path: pathlib.Path, methods: list[str] | None = None) -> Groups:
    """Reads the rows of these methods. A run's only seed counts as 0, to compare runs of different seeds."""
    rows = [row for row in read_csv(path) if methods is None or row.method in methods]
    has_one_seed = len({row.seed for row in rows}) == 1
    groups = {}
    for row in rows:
        series = dataclasses.replace(row.series, seed=0) if has_one_seed else row.series
        groups.setdefault((row.scene, series), []).append(row)
    if not groups:
        raise ValueError(f"{path} holds no rows")
    return groups


def _parse(argv) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "runs", type=pathlib.Path, nargs="+", metavar="RUN", help="TAG.csv; the first may be a JSON file"
    )
    parser.add_argument("--methods", nargs="+", help="methods to compare or to write; default: all")
    parser.add_argument("--min_effect", type=float, default=0.02, help="effect that is too small to fail")
    parser.add_argument(
        "--write_expected", type=pathlib.Path, metavar="JSON", help="write the expected figures of one run"
    )
    arguments = parser.parse_args(argv)
    if arguments.write_expected and len(arguments.runs) != 1:
        parser.error("--write_expected: name one run")
    if not arguments.write_expected and len(arguments.runs) < 2:
        parser.error("name two runs at least")
    return arguments
