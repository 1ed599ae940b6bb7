"""Makes the chunk "queries": what the table of a report shows."""

import numpy as np

from colmap_lazyloc.report.geometry import pose_errors, stack_poses
from colmap_lazyloc.report.run import Run


def status_names(run: Run) -> list[str]:
    """Returns the statuses that occur, LOCALIZED first."""
    return sorted({result["status"] for result in run.queries}, key=lambda name: (name != "LOCALIZED", name))


def frame_names(run: Run) -> list[str]:
    """Returns the names of the rigs' frames."""
    return sorted({result["frame"] for result in run.queries if result.get("frame") is not None})


def errors(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Returns the queries' errors of position, and of rotation in degrees; NaN if unknown."""
    if run.truth:
        return pose_errors(*stack_poses(run.poses), *stack_poses([run.truth.get(name) for name in run.names]))
    listed = {pose["name"]: pose for pose in (run.leave_one_out or {"poses": []})["poses"]}
    poses = [listed.get(name, {}) for name in run.names]
    return _numbers(poses, "position_error"), _numbers(poses, "rotation_error_deg")


def query_chunk(run: Run, photos: np.ndarray, is_drawn: np.ndarray) -> tuple[dict, dict[str, np.ndarray]]:
    """Returns the values and arrays of the chunk; `photos`: the index of each query's photo, or -1."""
    statuses = {name: i for i, name in enumerate(status_names(run))}
    frames = frame_names(run)
    frame_index = {name: i for i, name in enumerate(frames)}
    position_errors, rotation_errors_deg = errors(run)
    queries = run.queries
    arrays = {
        "status": np.array([statuses[result["status"]] for result in queries], np.uint8),
        "confidence": _numbers(queries, "confidence"),
        "positionStddev": np.array([(result.get("position_stddevs") or [np.nan])[0] for result in queries], float),
        "rotationStddevDeg": _numbers(queries, "rotation_stddev_deg"),
        "numTracks": np.array([result.get("num_tracks", -1) for result in queries], np.int32),
        "reprojectionErrorPx": _numbers(queries, "mean_reprojection_error_px"),
        "numImages": np.array([_num_used_images(result) for result in queries], np.uint16),
        "seconds": np.array([result["seconds"].get("total", np.nan) for result in queries], float),
        "positionError": position_errors,
        "rotationErrorDeg": rotation_errors_deg,
        "photo": photos.astype(np.int32),
        "isDrawn": is_drawn.astype(np.uint8),
        "frame": np.array([frame_index.get(result.get("frame"), -1) for result in queries], np.int32),
    }
    for name, array in arrays.items():
        if array.dtype == np.float64:
            arrays[name] = array.astype(np.float32)
    return {"names": run.names, "reasons": [result["reason"] for result in queries], "frames": frames}, arrays


def _num_used_images(result: dict) -> int:
    return sum(pair["rotation_error_deg"] is not None for pair in result["pairs"])


def _numbers(items: list[dict], field: str) -> np.ndarray:
    return np.array([np.nan if item.get(field) is None else item[field] for item in items], float)
