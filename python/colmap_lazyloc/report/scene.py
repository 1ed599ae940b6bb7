"""Makes the chunk "scene": cameras, points and what joins them, relative to a local origin."""

import itertools

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import centres, rotation_matrices
from colmap_lazyloc.report import geometry
from colmap_lazyloc.report.chunk import Values
from colmap_lazyloc.report.epoch import epoch_arrays
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.report.scene_points import ScenePoints
from colmap_lazyloc.results import Change


def scene_chunk(
    run: Run, cameras: list[Camera | None], points: ScenePoints, frames: list[list[str]]
) -> tuple[Values, dict[str, Array], float]:
    """Returns the values and arrays of the chunk, and the scene's size.

    `cameras`: the queries' intrinsics, as far as they are known; `frames`: names of the database images of each frame.
    """
    images = run.database_images
    database_qvecs, database_tvecs = geometry.stack_poses([image.cam_from_world for image in images])
    database_centres = centres(database_qvecs, database_tvecs)
    origin = np.median(database_centres, axis=0) if len(images) > 0 else np.zeros(3)
    size = _size(database_centres, points.xyz)
    values = {
        "origin": origin.tolist(),
        "size": size,
        "frustumDepth": _frustum_depth(database_centres, size, len(images) + len(run.queries)),
        "up": [0.0, 0.0, 1.0] if run.is_level else _up(database_qvecs),
        "databaseNames": [image.name for image in images],
    }
    epoch_values, epoch = epoch_arrays(run, origin, size)
    values.update(epoch_values)
    extents = {camera_id: geometry.image_extent(camera) for camera_id, camera in run.database.cameras.items()}
    arrays = {
        "databaseCentres": database_centres - origin,
        "databaseRotations": geometry.viewer_quaternions(database_qvecs),
        "databaseExtents": np.array([extents[image.camera_id] for image in images]).reshape(-1, 4),
        **_query_arrays(run, cameras, origin),
        **_true_arrays(run, origin),
        "bearings": _bearings(run, database_centres - origin),
        "points": points.xyz - origin,
        "pointColors": points.colors,
        "pointOffsets": points.offsets,
        "pointDeltas": np.diff(points.indices, prepend=np.uint32(0)).astype(np.uint32),
        "queryConnections": _query_connections(run),
        "databaseConnections": _database_connections(run, frames),
        "changes": _change_lines(run.changes, origin),
        **epoch,
    }
    for name, array in arrays.items():
        if array.dtype == np.float64:  # after the origin is subtracted, because single precision has 7 digits
            arrays[name] = array.astype(np.float32)
    return values, arrays, size


def _query_arrays(run: Run, cameras: list[Camera | None], origin: Array) -> dict[str, Array]:
    qvecs, tvecs = geometry.stack_poses(run.poses)
    covariances = np.full((len(run.queries), 6, 6), np.nan)
    rotations = qvecs.copy()
    for i, result in enumerate(run.queries):
        if result.get("covariance") is not None:
            covariances[i] = result["covariance"]
        if result.get("rotation") is not None:
            rotations[i] = result["rotation"]
    extents = [geometry.image_extent(camera) if camera else (-0.5, -0.375, 0.5, 0.375) for camera in cameras]
    return {
        "queryCentres": centres(qvecs, tvecs) - origin,
        "queryRotations": geometry.viewer_quaternions(rotations),
        "queryExtents": np.array(extents),
        "queryCovariances": geometry.position_covariances(qvecs, tvecs, covariances),
    }


def _true_arrays(run: Run, origin: Array) -> dict[str, Array]:
    if not run.truth:
        return {"trueCentres": np.empty(0), "trueRotations": np.empty(0)}
    qvecs, tvecs = geometry.stack_poses([run.truth.get(name) for name in run.names])
    return {
        "trueCentres": centres(qvecs, tvecs) - origin,
        "trueRotations": geometry.viewer_quaternions(qvecs),
    }


def _bearings(run: Run, database_centres: Array) -> Array:
    lines = np.full((len(run.queries), 6), np.nan)
    for i, result in enumerate(run.queries):
        bearing = result.get("bearing")
        if bearing is not None and bearing["from"] in run.database_index:
            lines[i, :3] = database_centres[run.database_index[bearing["from"]]]
            lines[i, 3:] = bearing["direction"]
    return lines


def _query_connections(run: Run) -> Array:
    """Returns pairs of queries with positions: each with the next of its frame, by name."""
    frames: dict[str, list[tuple[str, int]]] = {}
    for i, result in enumerate(run.queries):
        frame = result.get("frame")
        if frame is not None and run.poses[i] is not None:
            frames.setdefault(frame, []).append((result["name"], i))
    pairs: list[tuple[int, int]] = []
    for members in frames.values():
        indices = [i for _, i in sorted(members)]
        pairs += itertools.pairwise(indices)
    return np.array(pairs, np.uint32).reshape(-1, 2)


def _database_connections(run: Run, frames: list[list[str]]) -> Array:
    index = run.database_index
    pairs = [pair for names in frames for pair in itertools.pairwise([index[name] for name in names if name in index])]
    return np.array(pairs, np.uint32).reshape(-1, 2)


def _change_lines(changes: list[Change], origin: Array) -> Array:
    """Returns lines around things that have changed, n x 6: the edges of a box, and where it has moved to."""
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    edges = [(a, b) for a, b in itertools.combinations(range(8), 2) if np.abs(corners[a] - corners[b]).sum() == 1]
    lines = []
    for change in changes:
        low, high = np.array(change["bounds"]) - origin
        box = low + corners * (high - low)
        lines += [(box[a], box[b]) for a, b in edges]
        if "displacement" in change:
            moved = box + change["displacement"]
            lines += [(moved[a], moved[b]) for a, b in edges]
            lines.append((change["centre"] - origin, change["centre_now"] - origin))
    return np.array(lines, float).reshape(-1, 6)


def _size(centres: Array, points: Array) -> float:
    """Returns the diagonal of the box around cameras and points, without the outermost two in a hundred."""
    boxes = [np.quantile(places, (0.02, 0.98), axis=0) for places in (centres, points) if len(places) > 0]
    if not boxes:
        return 1.0
    extent = np.max([box[1] for box in boxes], axis=0) - np.min([box[0] for box in boxes], axis=0)
    return float(np.linalg.norm(extent)) or 1.0


def _frustum_depth(centres: Array, size: float, num_images: int) -> float:
    """Returns half the typical distance of neighbouring cameras, within reason."""
    sample = centres[:: max(1, len(centres) // 200)]
    nearest = []
    for centre in sample:
        distances = np.linalg.norm(centres - centre, axis=1)
        nearest.append(np.min(distances[distances > 1e-6 * size], initial=np.inf))
    spacing = np.median(nearest) if nearest else 0
    smallest = 0.01 * min(1.0, np.sqrt(100 / num_images))  # many frustums would hide each other
    return float(np.clip(0.5 * spacing, max(smallest, 1e-4) * size, 0.04 * size))


def _up(qvecs: Array) -> list[float]:
    """Returns the direction in the world that is up in most images."""
    if len(qvecs) == 0:
        return [0.0, -1.0, 0.0]
    rotations = rotation_matrices(qvecs)
    right, down = rotations[:, 0], rotations[:, 1]
    # Take the direction to which the images' x axes are most nearly at right angles, because cameras look up and down
    # more often than they lean. If all x axes are parallel, the y axes decide.
    _, vectors = np.linalg.eigh(right.T @ right - 0.1 * down.T @ down)
    up = vectors[:, 0]
    return list(map(float, up * np.copysign(1.0, -up @ np.sum(down, axis=0))))
