"""A run as Markdown: one table per scene and one over all of them."""

import math

from evaluation import Row, paired_ratio, summarize
from methods import METHODS

BASELINE = "structure_based"
MISSING = "–"
HEADER = ("| method | queries | median cm / ° | mean cm | lost | ratio to the map [95 %] | median s |\n"
          "|---|---|---|---|---|---|---|\n")


def markdown(title: str, rows: list[Row], reasons: dict[tuple[str, str], str]) -> str:
    """`reasons` says of (scene, method) why there are no rows."""
    scenes = sorted({row.scene for row in rows} | {scene for scene, _ in reasons})
    methods = _in_order({row.method for row in rows} | {method for _, method in reasons})
    footnotes = []
    parts = [f"# {title}\n"]
    for scene in scenes:
        lines = [_line(method, [row for row in rows if row.scene == scene], reasons.get((scene, method)), footnotes)
                 for method in methods]
        parts.append(f"## {scene}\n\n{HEADER}{''.join(lines)}")
    if len(scenes) > 1:
        lines = [_pooled_line(method, rows, scenes, footnotes) for method in methods]
        parts.append(f"## All {len(scenes)} scenes, queries pooled\n\n{HEADER}{''.join(lines)}")
    parts.append("Median: a lost query counts as an infinite error. Mean: of the localized ones. Ratio: geometric mean "
                 f"of position error / that of `{BASELINE}` on the queries that both localized, with its bootstrap "
                 "interval over queries.\n")
    if footnotes:
        parts.append("".join(f"[{i}] {text}\n\n" for i, text in enumerate(footnotes, 1)))
    return "\n".join(parts)


def _line(method: str, rows: list[Row], reason: str | None, footnotes: list[str]) -> str:
    own = [row for row in rows if row.method == method]
    if not own:
        return f"| {method} {_mark(reason or 'not run', footnotes)} | {' | '.join([MISSING] * 6)} |\n"
    return f"| {method} | {_figures(own, [row for row in rows if row.method == BASELINE])} |\n"


def _pooled_line(method: str, rows: list[Row], scenes: list[str], footnotes: list[str]) -> str:
    own = [row for row in rows if row.method == method]
    missing = sorted(set(scenes) - {row.scene for row in own})
    if not own:
        return f"| {method} | {' | '.join([MISSING] * 6)} |\n"
    name = f"{method} {_mark('without ' + ', '.join(missing), footnotes)}" if missing else method
    return f"| {name} | {_figures(own, [row for row in rows if row.method == BASELINE])} |\n"


def _figures(rows: list[Row], baseline_rows: list[Row]) -> str:
    summary, ratio = summarize(rows), paired_ratio(rows, baseline_rows)
    median = f"{_number(summary.median_position_error_cm, 2)} / {_number(summary.median_rotation_error_deg, 3)}"
    ratio_text = f"{ratio.mean:.3f} [{ratio.low:.3f}, {ratio.high:.3f}]" if ratio else MISSING
    return " | ".join([str(summary.num_queries), median, _number(summary.mean_position_error_cm, 2),
                       str(summary.num_lost), ratio_text, _number(summary.median_seconds, 4)])


def _number(value: float, num_digits: int) -> str:
    return f"{value:.{num_digits}f}" if math.isfinite(value) else MISSING


def _mark(text: str, footnotes: list[str]) -> str:
    if text not in footnotes:
        footnotes.append(text)
    return f"[{footnotes.index(text) + 1}]"


def _in_order(methods: set[str]) -> list[str]:
    """As the methods are registered, presets after the plain method."""
    names = list(METHODS)
    return sorted(methods, key=lambda method: (names.index(method.partition(":")[0]), method))
