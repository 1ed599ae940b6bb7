"""Makes the chunks "drawing/QUERY": what is drawn over the photos of a query."""

import importlib.util

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.model import NO_POINTS, Camera, Model
from colmap_lazyloc.report.chunk import Values
from colmap_lazyloc.report.gaps import BAD_RECORD, Gaps
from colmap_lazyloc.report.photos import Photos, useful_images
from colmap_lazyloc.report.run import Run

MAX_NUM_REJECTED = 400  # for each database image; more of them hide the photo
MAX_ERROR_PX = 4.0  # up to which a match of a point that belongs to another query counts as an inlier


def can_project() -> bool:
    """True if pycolmap is installed, which knows COLMAP's camera models."""
    return importlib.util.find_spec("pycolmap") is not None


def drawing_chunk(
    run: Run, query: int, camera: Camera | None, database: DatabaseReader | None, photos: Photos, gaps: Gaps
) -> tuple[Values, dict[str, Array]]:
    """Returns the values and arrays of a chunk; `camera`: the query's intrinsics, if they are known."""
    name = run.names[query]
    images = useful_images(run, query)
    num_inliers = {pair["name"]: pair["num_inliers"] for pair in run.queries[query]["pairs"]}
    values = {
        "size": _size(name, camera, photos),
        "images": [
            {
                "image": image,
                "photo": photos.of_database_image.get(image, -1),
                "size": _size(run.database_images[image].name, _database_camera(run, image), photos),
                "numInliers": num_inliers[run.database_images[image].name],
            }
            for image in images
        ],
    }
    if database is not None and name not in database.image_ids and run.queries[query].get("matching_type"):
        database = None  # because the run has matched a photo, which no database needs to have
    inliers, rejected = _Lines(), _Lines()
    for k, image in enumerate(images):
        found, refused = _matches_with(run, query, image, database, gaps)
        inliers.add(k, *found)
        rejected.add(k, *_thinned(refused, query))
    residual_xy, residuals = _residuals(run, name)
    arrays = {
        **inliers.arrays("inlier"),
        **rejected.arrays("rejected"),
        "residuals": residuals.astype(np.float32),
        "residualXy": residual_xy.astype(np.float32),
    }
    return values, arrays


class _Lines:
    """Collects lines from a query to its database images."""

    def __init__(self) -> None:
        self.images: list[int] = []
        self.xy: list[Array] = [np.empty((0, 2))]
        self.database_xy: list[Array] = [np.empty((0, 2))]

    def add(self, image: int, xy: Array, database_xy: Array) -> None:
        self.images += [image] * len(xy)
        self.xy.append(xy)
        self.database_xy.append(database_xy)

    def arrays(self, prefix: str) -> dict[str, Array]:
        return {
            f"{prefix}Images": np.array(self.images, np.uint8),
            f"{prefix}Xy": np.concatenate(self.xy).astype(np.float32),
            f"{prefix}DatabaseXy": np.concatenate(self.database_xy).astype(np.float32),
        }


def _size(name: str, camera: Camera | None, photos: Photos) -> list[int]:
    """Returns the size of an image in pixels; of keypoints' pixels, if the photo has another size."""
    return [camera.width, camera.height] if camera is not None else list(photos.sizes.get(name, (640, 480)))


def _database_camera(run: Run, image: int) -> Camera:
    return run.database.cameras[run.database_images[image].camera_id]


def _matches_with(
    run: Run, query: int, image: int, database: DatabaseReader | None, gaps: Gaps
) -> tuple[tuple[Array, Array], ...]:
    """Returns the inliers and the rejected matches with a database image, each as (pixels in the query, pixels in the
    database image)."""
    names = run.names[query], run.database_images[image].name
    keypoints = [_keypoints(run, name) for name in names]
    ids = [points["point3d_id"] for points in keypoints]
    own_ids, other_ids = (np.where(i == -1, fill, i) for i, fill in zip(ids, (-1, -2)))
    _, first, second = np.intersect1d(own_ids, other_ids, return_indices=True)
    inliers = np.stack([first, second], axis=1)
    rejected: Array = np.empty((0, 2), np.int64)
    xy = [np.stack([points["x"], points["y"]], axis=1) for points in keypoints]
    # If the pose rests on relative poses alone, all verified matches are inliers.
    has_no_points = run.queries[query]["status"] == "LOCALIZED" and bool(np.all(ids[0] == -1))
    stored = None if database is None else _stored(database, names, xy, has_no_points, gaps)
    if stored is not None:
        xy, matches = stored
        if has_no_points:
            inliers = matches
        is_known = np.isin(_keys(matches), _keys(inliers))
        is_inlier, is_open = _explained(run, names, matches[~is_known], xy)
        inliers = np.concatenate([inliers, matches[~is_known][is_inlier]])
        rejected = matches[~is_known][~is_inlier & ~is_open]
    return tuple((xy[0][chosen[:, 0]], xy[1][chosen[:, 1]]) for chosen in (inliers, rejected))


def _keypoints(run: Run, name: str) -> Array:
    """Returns an image's keypoints with their points; none if the run's model does not have the image."""
    return run.model.images[name].points2d if name in run.model.images else NO_POINTS


def _stored(
    database: DatabaseReader, names: tuple[str, str], known: list[Array], only_verified: bool, gaps: Gaps
) -> tuple[list[Array], Array] | None:
    """Returns the keypoints of two images, and their verified matches, or the raw ones if none are; None, and a gap, if
    the database does not have what the run had."""
    keypoints = []
    for name, of_run in zip(names, known):
        try:
            stored = database.keypoints(name)
        except KeyError:
            gaps.records[name] = "is not in the database"
            return None
        except BAD_RECORD as error:
            gaps.records[name] = f"its keypoints cannot be read: {error}"
            return None
        if len(of_run) > 0 and not (len(of_run) == len(stored) and np.allclose(of_run, stored)):
            gaps.records[name] = "has other keypoints than in the run" if len(stored) > 0 else "has no keypoints"
            return None
        keypoints.append(stored)
    try:
        matches = database.inlier_matches(*names)
        if len(matches) == 0 and not only_verified:
            matches = database.raw_matches(*names)
    except BAD_RECORD as error:
        gaps.records[names[1]] = f"its matches with '{names[0]}' cannot be read: {error}"
        return None
    for name, stored, indices in zip(names, keypoints, matches.T):
        if len(indices) > 0 and indices.max() >= len(stored):
            gaps.records[name] = "lacks keypoints that its matches name"
            return None
    return keypoints, matches


def _keys(matches: Array) -> Array:
    return matches[:, 0].astype(np.int64) << 32 | matches[:, 1].astype(np.int64)


def _explained(run: Run, names: tuple[str, str], matches: Array, xy: list[Array]) -> tuple[Array, Array]:
    """Returns which matches a point explains, and for which this is unknown.

    In a model, a keypoint belongs to one point, so the points of one query lack keypoints that those of another query
    have. Such a match is an inlier if the point of one of its keypoints is projected to the other one.
    """
    is_inlier, is_open = np.zeros(len(matches), bool), np.zeros(len(matches), bool)
    if not all(name in run.model.images for name in names):
        return is_inlier, is_open
    for side in (0, 1):
        ids = _keypoints(run, names[side])["point3d_id"]
        ids = ids[matches[:, side]] if len(ids) > 0 else np.full(len(matches), -1)
        has_point = ids != -1
        is_open |= has_point
        if can_project() and np.any(has_point):
            # Take the database image as it was given, because a leave-one-out run has another pose for it.
            model = run.model if side == 1 else run.database
            projected = _project(model, names[1 - side], run.points.xyz[run.points.find(ids[has_point])])
            errors = np.linalg.norm(projected - xy[1 - side][matches[has_point, 1 - side]], axis=1)
            is_inlier[has_point] |= errors < MAX_ERROR_PX
    return is_inlier, is_open & ~is_inlier & (not can_project())


def _project(model: Model, name: str, xyz: Array) -> Array:
    from colmap_lazyloc.pycolmap_types import image_from_cam

    image = model.images[name]
    return image_from_cam(model.cameras[image.camera_id], image.pose(xyz))


def _residuals(run: Run, name: str) -> tuple[Array, Array]:
    """Returns the pixels of a query's own observations, and observed minus projected pixels; empty if unknown."""
    keypoints = _keypoints(run, name)
    keypoints = keypoints[keypoints["point3d_id"] != -1]
    if len(keypoints) == 0 or not can_project():
        return np.empty((0, 2)), np.empty((0, 2))
    observed = np.stack([keypoints["x"], keypoints["y"]], axis=1)
    projected = _project(run.model, name, run.points.xyz[run.points.find(keypoints["point3d_id"])])
    is_seen = np.isfinite(projected).all(axis=1)
    return observed[is_seen], (observed - projected)[is_seen]


def _thinned(lines: tuple[Array, Array], seed: int) -> tuple[Array, Array]:
    """Returns at most MAX_NUM_REJECTED of the lines, drawn at random."""
    if len(lines[0]) <= MAX_NUM_REJECTED:
        return lines
    chosen = np.sort(np.random.default_rng(seed).choice(len(lines[0]), MAX_NUM_REJECTED, replace=False))
    return lines[0][chosen], lines[1][chosen]
