"""Formats a run as Markdown: medians of all scenes, one table per scene, and one for all scenes together."""

import dataclasses
import math
import statistics

from benchmarks.localization.evaluation import Row, Series, paired_ratio, summarize
from benchmarks.localization.methods import METHODS
from colmap_lazyloc.evaluate import DEFAULT_THRESHOLDS

BASELINE = "structure_based"
MISSING = "–"
HEADER = (
    "| method | queries | median errors, cm / ° | mean error, cm | without pose | "
    "position error divided by the map's error [95 %] | "
    + " | ".join(f"within {metres:g} m, {degrees:g}°, %" for metres, degrees in DEFAULT_THRESHOLDS)
    + " | median time, s |\n"
    + "|---" * (7 + len(DEFAULT_THRESHOLDS))
    + "|\n"
)
LEGEND = f"""**Columns of the tables**

- *median errors, cm / °*: median position error in cm / median rotation error in degrees. A query without a pose counts
  as an infinite error.
- *mean error, cm*: mean position error of the localized queries.
- *without pose*: number of queries without a pose.
- *position error divided by the map's error [95 %]*: position error of the method divided by the position error of
  `{BASELINE}`, which is localization in a 3D map. The value is the geometric mean over the queries that both methods
  localize. The brackets contain the 95 % bootstrap interval of this mean.
- *within 0.25 m, 2°, %* and similar columns: percentage of all queries whose position error and rotation error are both
  below the two values in the column's header.
- *median time, s*: median time per query.
"""


def markdown(title: str, rows: list[Row], reasons: dict[tuple[str, Series], str], notes: list[str] = ()) -> str:
    """Returns the tables. `reasons`: why a (scene, series) has no rows; `notes`: lines below the title."""
    scenes = sorted({row.scene for row in rows} | {scene for scene, _ in reasons})
    all_series = in_order({row.series for row in rows} | {series for _, series in reasons})
    names = labels(all_series)
    footnotes = []
    parts = [f"# {title}\n", *(f"{note}\n" for note in notes), LEGEND]
    if len(scenes) > 1:
        parts.append(_medians(rows, scenes, names))
        lines = [_pooled_line(names[series], series, rows, scenes, footnotes) for series in all_series]
        parts.append(f"## All {len(scenes)} scenes, queries pooled\n\n{HEADER}{''.join(lines)}")
    for scene in scenes:
        own = [row for row in rows if row.scene == scene]
        lines = [_line(names[series], series, own, reasons.get((scene, series)), footnotes) for series in all_series]
        parts.append(f"## {scene}\n\n{HEADER}{''.join(lines)}")
    if footnotes:
        parts.append("".join(f"[{i}] {text}\n\n" for i, text in enumerate(footnotes, 1)))
    return "\n".join(parts)


def in_order(all_series: set[Series]) -> list[Series]:
    """Sorts series in the order of METHODS, presets after the plain method."""
    names = list(METHODS)
    return sorted(
        all_series,
        key=lambda series: (
            names.index(series.method.partition(":")[0]),
            series.method,
            series.num_retrieved,
            series.seed,
            [float(value) for value in series.database_noise.split(",")],
        ),
    )


def labels(all_series: list[Series]) -> dict[Series, str]:
    """Returns the names of the series: the method, and the settings in which they differ."""
    several = {
        field: len({getattr(series, field) for series in all_series}) > 1
        for field in ("num_retrieved", "seed", "database_noise")
    }
    return {
        series: series.method
        + (f" K={series.num_retrieved}" if several["num_retrieved"] else "")
        + (f" seed={series.seed}" if several["seed"] else "")
        + (f" noise {series.database_noise.replace(',', '°, ')} cm" if several["database_noise"] else "")
        for series in all_series
    }


def _medians(rows: list[Row], scenes: list[str], names: dict[Series, str]) -> str:
    """Returns a table with one column per scene, as in papers; the average is over the scenes."""
    text = f"## Medians, cm / °\n\n| method | {' | '.join(scenes)} | average |\n" + "|---" * (len(scenes) + 2) + "|\n"
    for series, name in names.items():
        summaries = []
        for scene in scenes:
            own = [row for row in rows if row.scene == scene and row.series == series]
            summaries.append(summarize(own) if own else None)
        cells = [
            _median(summary.median_position_error_cm, summary.median_rotation_error_deg) if summary else MISSING
            for summary in summaries
        ]
        average = MISSING
        if all(summaries):
            average = _median(
                statistics.fmean(summary.median_position_error_cm for summary in summaries),
                statistics.fmean(summary.median_rotation_error_deg for summary in summaries),
            )
        text += f"| {name} | {' | '.join(cells)} | {average} |\n"
    return text


def _line(name: str, series: Series, rows: list[Row], reason: str | None, footnotes: list[str]) -> str:
    own = [row for row in rows if row.series == series]
    if not own:
        return f"| {name} {_mark(reason or 'not run', footnotes)} | {_no_figures()} |\n"
    return f"| {name} | {_figures(own, _baseline(series, rows))} |\n"


def _pooled_line(name: str, series: Series, rows: list[Row], scenes: list[str], footnotes: list[str]) -> str:
    own = [row for row in rows if row.series == series]
    missing = sorted(set(scenes) - {row.scene for row in own})
    if not own:
        return f"| {name} | {_no_figures()} |\n"
    name = f"{name} {_mark('without ' + ', '.join(missing), footnotes)}" if missing else name
    return f"| {name} | {_figures(own, _baseline(series, rows))} |\n"


def _baseline(series: Series, rows: list[Row]) -> list[Row]:
    wanted = dataclasses.replace(series, method=BASELINE)
    return [row for row in rows if row.series == wanted]


def _figures(rows: list[Row], baseline_rows: list[Row]) -> str:
    summary, ratio = summarize(rows), paired_ratio(rows, baseline_rows)
    ratio_text = f"{ratio.mean:.3f} [{ratio.low:.3f}, {ratio.high:.3f}]" if ratio else MISSING
    return " | ".join(
        [
            str(summary.num_queries),
            _median(summary.median_position_error_cm, summary.median_rotation_error_deg),
            _number(summary.mean_position_error_cm, 2),
            str(summary.num_lost),
            ratio_text,
            *(_number(100 * share, 1) for share in summary.recall),
            _number(summary.median_seconds, 4),
        ]
    )


def _no_figures() -> str:
    return " | ".join([MISSING] * (6 + len(DEFAULT_THRESHOLDS)))


def _median(position_error_cm: float, rotation_error_deg: float) -> str:
    return f"{_number(position_error_cm, 2)} / {_number(rotation_error_deg, 3)}"


def _number(value: float, num_digits: int) -> str:
    if math.isinf(value):
        return "∞"
    return f"{value:.{num_digits}f}" if not math.isnan(value) else MISSING


def _mark(text: str, footnotes: list[str]) -> str:
    if text not in footnotes:
        footnotes.append(text)
    return f"[{footnotes.index(text) + 1}]"
