"""Plots of a run, as SVG files that are the same for the same figures."""

import pathlib

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams.update({"svg.hashsalt": "localization", "svg.fonttype": "none", "font.size": 9,
                            "axes.grid": True, "grid.alpha": 0.3, "savefig.bbox": "tight"})

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

from evaluation import Row, summarize  # noqa: E402
from tables import in_order, labels  # noqa: E402

MAX_NUM_COLUMNS = 3
PANEL_SIZE = (4.2, 3.2)  # inches
MARKERS = "osD^vP*X<>"


def write_plots(path: pathlib.Path, tag: str, rows: list[Row]) -> list[pathlib.Path]:
    """What the rows have figures for; returns the files."""
    rows = [row for row in rows if row.is_measured or row.is_lost]
    plots = {"cumulative_error": _cumulative_error, "time_against_error": _time_against_error}
    if len({row.num_retrieved for row in rows}) > 1:
        plots["error_against_k"] = _error_against_k
    files = []
    for name, draw in plots.items() if any(row.is_measured for row in rows) else ():
        scenes = sorted({row.scene for row in rows})
        figure, panels = _panels(len(scenes))
        for panel, scene in zip(panels, scenes):
            panel.set_title(scene)
            draw(panel, [row for row in rows if row.scene == scene])
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=3, frameon=False)
        figure.tight_layout()
        files.append(path / f"{tag}_{name}.svg")
        figure.savefig(files[-1], metadata={"Date": None})
        plt.close(figure)
    return files


def _panels(count: int):
    columns = min(count, MAX_NUM_COLUMNS)
    lines = -(-count // columns)
    figure, panels = plt.subplots(lines, columns, squeeze=False,
                                  figsize=(PANEL_SIZE[0] * columns, PANEL_SIZE[1] * lines))
    for panel in panels.flat[count:]:
        panel.set_visible(False)
    return figure, panels.flat


def _series(rows: list[Row]) -> list:
    """Label and rows of each."""
    names = labels(in_order({row.series for row in rows}))
    return [(name, [row for row in rows if row.series == series]) for series, name in names.items()]


def _cumulative_error(panel, rows: list[Row]):
    """Share of all queries within an error: a lost one is never within."""
    for name, own in _series(rows):
        errors = np.sort([row.position_error_cm for row in own if row.is_measured])
        panel.step(errors, 100 * np.arange(1, len(errors) + 1) / len(own), where="post", label=name)
    panel.set(xscale="log", ylim=(0, 101), xlabel="position error [cm]", ylabel="queries within [%]")


def _time_against_error(panel, rows: list[Row]):
    for (name, own), marker in zip(_series(rows), MARKERS * 10):
        summary = summarize(own)
        panel.plot(summary.median_seconds, summary.median_position_error_cm, marker, label=name)
    panel.set(xscale="log", yscale="log", xlabel="median seconds per query", ylabel="median position error [cm]")


def _error_against_k(panel, rows: list[Row]):
    """A line per method, the first seed's."""
    seed = min(row.seed for row in rows)
    for method in dict.fromkeys(series.method for series in in_order({row.series for row in rows})):
        own = [row for row in rows if row.method == method and row.seed == seed]
        ks = sorted({row.num_retrieved for row in own})
        medians = [summarize([row for row in own if row.num_retrieved == k]).median_position_error_cm for k in ks]
        panel.plot(ks, medians, "o-", label=method)
    panel.set(yscale="log", xlabel="database images per query, K", ylabel="median position error [cm]")
