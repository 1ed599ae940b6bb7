"""Makes the chunk "queries": what the table of a report shows."""

from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.report.chunk import Values
from colmap_lazyloc.report.coordinates import System
from colmap_lazyloc.report.run import Run, numbers, used_pairs


def status_names(run: Run) -> list[str]:
    """Returns the statuses that occur, LOCALIZED first."""
    return sorted({result["status"] for result in run.queries}, key=lambda name: (name != "LOCALIZED", name))


def frame_names(run: Run) -> list[str]:
    """Returns the names of the rigs' frames."""
    return sorted({frame for result in run.queries if (frame := result.get("frame")) is not None})


def query_chunk(run: Run, systems: Sequence[System], photos: Array, is_drawn: Array) -> tuple[Values, dict[str, Array]]:
    """Returns the values and arrays of the chunk; `photos`: the index of each query's photo, or -1."""
    statuses = {name: i for i, name in enumerate(status_names(run))}
    frames = frame_names(run)
    frame_index = {name: i for i, name in enumerate(frames)}
    position_errors, rotation_errors_deg = run.errors
    queries = run.queries
    arrays = {
        "status": np.array([statuses[result["status"]] for result in queries], np.uint8),
        "confidence": numbers(queries, "confidence"),
        "positionStddev": run.position_stddevs,
        "rotationStddevDeg": numbers(queries, "rotation_stddev_deg"),
        "numTracks": np.array([result.get("num_tracks", -1) for result in queries], np.int32),
        "reprojectionErrorPx": numbers(queries, "mean_reprojection_error_px"),
        "numImages": np.array([sum(used_pairs(result)) for result in queries], np.uint16),
        "seconds": np.array([result["seconds"].get("total", np.nan) for result in queries], float),
        "positionError": position_errors,
        "rotationErrorDeg": rotation_errors_deg,
        "photo": photos.astype(np.int32),
        "isDrawn": is_drawn.astype(np.uint8),
        "frame": np.array([frame_index.get(result.get("frame") or "", -1) for result in queries], np.int32),
    }
    for name, array in arrays.items():
        if array.dtype == np.float64:
            arrays[name] = array.astype(np.float32)
    arrays["coordinates"] = np.stack([system.xyz for system in systems], axis=1)
    values = {
        "names": run.names,
        "reasons": [result["reason"] for result in queries],
        "frames": frames,
        "systems": [
            {name: getattr(system, name) for name in ("name", "axes", "units", "digits")} for system in systems
        ],
    }
    return values, arrays
