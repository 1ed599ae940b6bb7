"""Draws plots of a run; the same figures give the same SVG files."""

import dataclasses
import pathlib

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from benchmarks.localization.evaluation import Row, summarize
from benchmarks.localization.tables import in_order, labels

matplotlib.use("svg")
matplotlib.rcParams.update(
    {
        "svg.hashsalt": "localization",
        "svg.fonttype": "none",
        "font.size": 9,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "savefig.bbox": "tight",
    }
)

MAX_NUM_COLUMNS = 3
PANEL_SIZE = (4.2, 3.2)  # inches
MARKERS = "osD^vP*X<>"
MIN_AXIS_RATIO = 5.0  # minimum ratio of the ends of a logarithmic axis


def write_plots(path: pathlib.Path, tag: str, rows: list[Row]) -> list[pathlib.Path]:
    """Draws the plots for which the rows have data; returns the files."""
    rows = [row for row in rows if row.is_measured or row.is_lost]
    if not any(row.is_measured for row in rows):
        return []
    names = labels(in_order({row.series for row in rows}))
    styles = {
        series: {"color": f"C{i % 10}", "label": name, "marker": MARKERS[i % len(MARKERS)]}
        for i, (series, name) in enumerate(names.items())
    }
    plots = {"cumulative_error": _cumulative_error, "time_against_error": _time_against_error}
    if len({row.num_retrieved for row in rows}) > 1:
        plots["error_against_k"] = _error_against_k
    files = []
    for name, draw in plots.items():
        figure = _figure(rows, styles, draw)
        files.append(path / f"{tag}_{name}.svg")
        figure.savefig(files[-1], metadata={"Date": None})
        plt.close(figure)
    return files


def _figure(rows: list[Row], styles: dict, draw):
    """Draws one panel per scene, and one legend."""
    scenes = sorted({row.scene for row in rows})
    columns = min(len(scenes), MAX_NUM_COLUMNS)
    lines = -(-len(scenes) // columns)
    figure, panels = plt.subplots(
        lines, columns, squeeze=False, figsize=(PANEL_SIZE[0] * columns, PANEL_SIZE[1] * lines)
    )
    handles = {}
    for panel, scene in zip(panels.flat, scenes):
        panel.set_title(scene)
        draw(panel, [row for row in rows if row.scene == scene], styles)
        handles |= {name: handle for handle, name in zip(*panel.get_legend_handles_labels())}
    for panel in panels.flat[len(scenes) :]:
        panel.set_visible(False)
    figure.legend(handles.values(), handles.keys(), loc="upper center", bbox_to_anchor=(0.5, 0), ncols=3, frameon=False)
    figure.tight_layout()
    return figure


def _cumulative_error(panel, rows: list[Row], styles: dict):
    """Draws the share of all queries whose error is below x; a lost query never counts."""
    for series, own in _rows_of_series(rows):
        errors = np.sort([row.position_error_cm for row in own if row.is_measured])
        style = {**styles[series], "marker": ""}
        panel.step(errors, 100 * np.arange(1, len(errors) + 1) / len(own), where="post", **style)
    panel.set(ylim=(0, 101), xlabel="position error [cm]", ylabel="queries within [%]")
    _make_logarithmic(panel, "x")


def _time_against_error(panel, rows: list[Row], styles: dict):
    for series, own in _rows_of_series(rows):
        summary = summarize(own)
        panel.plot(summary.median_seconds, summary.median_position_error_cm, linestyle="", **styles[series])
    panel.set(xlabel="median seconds per query", ylabel="median position error [cm]")
    _make_logarithmic(panel, "x")
    _make_logarithmic(panel, "y")


def _error_against_k(panel, rows: list[Row], styles: dict):
    """Draws one line per method, from the first seed without database noise."""
    all_series = in_order({row.series for row in rows})
    for i, method in enumerate(dict.fromkeys(series.method for series in all_series)):
        first = next(series for series in all_series if series.method == method)
        own = [
            series for series in all_series if dataclasses.replace(series, num_retrieved=first.num_retrieved) == first
        ]
        medians = [summarize([row for row in rows if row.series == series]).median_position_error_cm for series in own]
        panel.plot([series.num_retrieved for series in own], medians, "o-", color=f"C{i % 10}", label=method)
    panel.set(xlabel="database images per query, K", ylabel="median position error [cm]")
    _make_logarithmic(panel, "y")


def _rows_of_series(rows: list[Row]) -> list:
    all_series = in_order({row.series for row in rows})
    return [(series, [row for row in rows if row.series == series]) for series in all_series]


def _make_logarithmic(panel, which: str):
    """Labels the axis at 1, 2, 5, ..., and extends it so that small differences do not look large."""
    getattr(panel, f"set_{which}scale")("log")
    low, high = getattr(panel, f"get_{which}lim")()
    if low <= 0:  # nothing is drawn
        low, high = 0.1, 10
    widening = max(1.0, np.sqrt(MIN_AXIS_RATIO * low / high))
    getattr(panel, f"set_{which}lim")(low / widening, high * widening)
    axis = getattr(panel, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
