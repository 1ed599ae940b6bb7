"""Makes the chunk "summary": the head of a report."""

import collections

from colmap_lazyloc.report.chunk import Values
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.report.table import status_names
from colmap_lazyloc.report.warnings import ReportWarning


def summary_chunk(run: Run, num_shown: dict[str, int], warnings: list[ReportWarning], notes: list[str]) -> Values:
    """Returns the values of the chunk."""
    counts = collections.Counter(result["status"] for result in run.queries)
    paths = {name: value for name, value in run.options.values.items() if name.endswith("_path")}
    options = {name: value for name, value in run.options.values.items() if name not in paths}
    changed = set(run.options.changed)
    return {
        "title": run.title,
        "folder": run.folder,
        "written": run.written,
        "program": run.options.program,
        "numQueries": len(run.queries),
        "numDatabaseImages": len(run.database_images),
        "numPoints": len(run.points),
        "hasTruth": bool((run.errors[0] >= 0).any()),
        "isLeaveOneOut": run.leave_one_out is not None,
        "unit": run.unit,
        "minConfidence": float(run.options.values.get("LazyLocalizer.min_confidence", 0)),
        "statuses": [{"name": name, "count": counts[name]} for name in status_names(run)],
        "inputs": [{"option": name, "value": value} for name, value in paths.items() if value],
        "options": [
            {"name": name, "value": options[name]} for name in sorted(options, key=lambda name: name not in changed)
        ],
        "warnings": warnings,
        "riskCoverage": _risk_coverage(run),
        "auroc": run.leave_one_out.get("auroc") if run.leave_one_out else None,
        "numShown": num_shown,
        "notes": notes,
    }


def _risk_coverage(run: Run) -> dict[str, list[float]] | None:
    points = run.leave_one_out.get("risk_coverage") if run.leave_one_out else None
    if not points:
        return None
    return {
        "confidence": [point["confidence"] for point in points],
        "coverage": [point["coverage"] for point in points],
        "risk": [point["risk"] for point in points],
    }
