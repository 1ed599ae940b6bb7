"""Writes the table with which `lazyloc run` ends: where each query is, or why that is not known."""

from collections.abc import Mapping, Sequence

from colmap_lazyloc.report.coordinates import DEGREE_DIGITS, METRE_DIGITS, length_digits
from colmap_lazyloc.report.facts import METRE
from colmap_lazyloc.result_fields import ResultFields
from colmap_lazyloc.results import pose_of

Rows = list[list[str]]


def position_lines(
    results: Mapping[str, ResultFields],
    names: Mapping[str, str],
    places: Mapping[str, Sequence[float]],
    unit: str,
) -> list[str]:
    """Returns a header and a line for each query, in the order of `names`: what each is called, by its name.

    `places`: latitude, longitude and height by name, as far as they are known. The standard deviation is that along the
    least certain direction.
    """
    stddevs = {name: stddevs[0] for name in names if (stddevs := results[name]["position_stddevs"])}
    digits = length_digits(unit, stddevs.values())
    suffix = f" ({METRE})" if unit == METRE else ""
    header = ["query", *(f"{axis}{suffix}" for axis in "xyz"), f"std. dev.{suffix}"]
    if places:
        header += ["latitude", "longitude", f"height ({METRE})"]
    rows: Rows = []
    for name, text in names.items():
        pose = pose_of(results[name])
        if pose is None:
            rows.append([text, f"{results[name]['status']}: {results[name]['reason']}"])
            continue
        row = [text, *(f"{value:.{digits}f}" for value in pose.cam_in_world)]
        row.append(f"{stddevs[name]:.{digits}f}" if name in stddevs else "")
        if name in places:
            latitude, longitude, height = places[name]
            row += [f"{latitude:.{DEGREE_DIGITS}f}", f"{longitude:.{DEGREE_DIGITS}f}", f"{height:.{METRE_DIGITS}f}"]
        rows.append(row)
    return _aligned([header, *rows])


def _aligned(rows: Rows) -> list[str]:
    """Returns the rows as lines: names to the left, numbers to the right; a reason may be as long as it is."""
    num_columns = len(rows[0])
    is_full = [len(row) > 2 for row in rows]  # without a reason
    widths = [
        max(len(row[i]) for row, full in zip(rows, is_full, strict=True) if i < len(row) and (full or i == 0))
        for i in range(num_columns)
    ]
    return [
        "  ".join([row[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(row[1:], widths[1:]))]).rstrip()
        for row in rows
    ]
