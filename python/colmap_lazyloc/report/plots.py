"""Draws the plots of a report's head as PNG and SVG files."""

import functools
import io
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.report.facts import METRE
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.result_fields import RiskCoverageFields

FORMATS = ("png", "svg")


def plot_files(run: Run) -> dict[str, bytes]:
    """Returns the files by name: distributions of errors, if the truth is known, of standard deviations, and the
    risk-coverage curve of a leave-one-out run."""
    import matplotlib

    matplotlib.rcParams.update({"svg.hashsalt": "report", "savefig.dpi": 150, "figure.constrained_layout.use": True})
    files: dict[str, bytes] = {}
    position_errors, rotation_errors_deg = run.errors
    unit, of_model = (METRE, "") if run.unit == METRE else ("", f" in {run.unit} of the model")
    distributions = {
        "position_error": ("position error" + of_model, unit, position_errors),
        "rotation_error": ("rotation error", "°", rotation_errors_deg),
        "position_stddev": ("standard deviation of the position" + of_model, unit, run.position_stddevs),
    }
    for name, distribution in distributions.items():
        if np.isfinite(distribution[2]).any():
            files |= _saved(name, functools.partial(_draw_distribution, *distribution))
    risk_coverage = run.leave_one_out.get("risk_coverage") if run.leave_one_out else None
    if risk_coverage:
        files |= _saved("risk_coverage", functools.partial(_draw_risk_coverage, risk_coverage))
    return files


def _draw_distribution(label: str, unit: str, values: Array, axes: "Axes") -> None:
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

    known = np.sort(values[np.isfinite(values)])
    shares = np.arange(len(known) + 1) / len(values)
    axes.step([known[0], *known], shares, where="post", color="#0072b2")
    if known[0] > 0:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter(EngFormatter(unit) if unit == METRE else lambda value, _: f"{value:g}{unit}")
    axes.set(xlabel=label, ylabel=f"share of {len(values)} queries", ylim=(0, 1))


def _draw_risk_coverage(points: list[RiskCoverageFields], axes: "Axes") -> None:
    axes.step(
        *([point[name] for point in points] for name in ("coverage", "risk")),
        where="post",
        color="#d55e00",
        clip_on=False,
    )
    axes.set(xlabel="share of queries that are accepted", ylabel="share of wrong ones among them", xlim=(0, 1))
    axes.set_ylim(bottom=0)


def _saved(name: str, draw: "Callable[[Axes], None]") -> dict[str, bytes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4))
    axes = figure.add_subplot()
    draw(axes)
    axes.grid(alpha=0.3)
    files = {}
    for suffix in FORMATS:
        buffer = io.BytesIO()
        figure.savefig(buffer, format=suffix, metadata={"Date": None} if suffix == "svg" else None)
        files[f"{name}.{suffix}"] = buffer.getvalue()
    return files
