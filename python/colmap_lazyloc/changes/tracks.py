"""Points that photos of one epoch see, and which of them photos of the other epoch have matches with."""

import dataclasses

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.control_points import MIN_ANGLE_DEG
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

MAX_ERROR_PX = 4.0  # of a match and of an observation, as in COLMAP's mapper
NUM_ROUNDS = 3  # of triangulation; each leaves out observations with large errors
NUM_STEPS = 5  # of Gauss and Newton in each


@dataclasses.dataclass(frozen=True)
class Photos:
    """The photos of both epochs, and their keypoints in one list."""

    names: list[str]
    is_new: Array
    cameras: list[Camera]
    rotations: Floats  # cam_from_world, n x 3 x 3
    centres: Floats  # n x 3
    focal_px: Floats
    first: Array  # index of the first keypoint by photo, and of the end
    photo: Array  # by keypoint
    pixels: Floats  # by keypoint, m x 2
    rays: Floats  # by keypoint: x / z and y / z; NaN if the camera model gives no ray

    def project(self, photo: int, points: Floats) -> tuple[Floats, Floats]:
        """Returns pixels, n x 2, and depths; a pixel is NaN if its point is behind the camera."""
        in_cam = (points - self.centres[photo]) @ self.rotations[photo].T
        pixels = np.full((len(points), 2), np.nan)
        is_front = in_cam[:, 2] > 0
        camera = to_pycolmap_camera(self.cameras[photo])
        pixels[is_front] = np.asarray(camera.img_from_cam(in_cam[is_front]), float).reshape(-1, 2)
        return pixels, in_cam[:, 2]


@dataclasses.dataclass(frozen=True)
class Points:
    """Points that were triangulated from photos of one epoch."""

    places: Floats  # n x 3
    covariances: Floats  # n x 3 x 3, of keypoints with a standard deviation of 1 pixel
    of_keypoint: Array  # index of the point by keypoint; -1: none

    def take(self, places: Array) -> "Points":
        """Returns some of the points."""
        new_index = np.full(len(self.places) + 1, -1)
        new_index[places] = np.arange(len(places))
        return Points(self.places[places], self.covariances[places], new_index[self.of_keypoint])


def read_photos(database: DatabaseReader, posed: dict[str, PosedImage], new_names: set[str]) -> Photos:
    """Reads the keypoints of the photos with poses that the database knows."""
    names = [name for name in sorted(posed) if name in database.image_ids]
    cameras, poses = ([posed[name].camera for name in names], [posed[name].cam_from_world for name in names])
    pixels = [database.keypoints(name) for name in names]
    rays = [
        np.asarray(to_pycolmap_camera(camera).cam_from_img(points), float).reshape(-1, 2) if len(points) else points
        for camera, points in zip(cameras, pixels)
    ]
    sizes = [len(points) for points in pixels]
    return Photos(
        names,
        np.array([name in new_names for name in names]),
        cameras,
        np.array([pose.rotation for pose in poses]),
        np.array([pose.cam_in_world for pose in poses]),
        np.array([to_pycolmap_camera(camera).mean_focal_length() for camera in cameras]),
        np.concatenate([[0], np.cumsum(sizes)]).astype(int),
        np.repeat(np.arange(len(names)), sizes),
        np.concatenate(pixels),
        np.concatenate(rays),
    )


def read_matches(database: DatabaseReader, photos: Photos) -> tuple[Array, Array, Array]:
    """Returns pairs of keypoints, n x 2: of two old photos, of two new ones, and of an old and a new one.

    The last ones need not fit the poses, the others do.
    """
    index = {name: i for i, name in enumerate(photos.names)}
    found: tuple[list[Array], list[Array], list[Array]] = ([], [], [])
    for name1, name2 in database.matched_pairs():
        if name1 not in index or name2 not in index:
            continue
        first, second = index[name1], index[name2]
        matches = database.raw_matches(name1, name2) + [photos.first[first], photos.first[second]]
        if photos.is_new[first] != photos.is_new[second]:
            found[2].append(matches[:, ::-1] if photos.is_new[first] else matches)
        else:
            errors_px = epipolar_errors_px(photos, matches)
            found[int(photos.is_new[first])].append(matches[errors_px < MAX_ERROR_PX])
    old, new, across = (np.concatenate([*each, np.empty((0, 2), int)]) for each in found)
    return old, new, across


def directions(photos: Photos, keypoints: Array) -> Floats:
    """Returns the viewing rays of keypoints in the world, n x 3, with a depth of 1."""
    rays = np.column_stack([photos.rays[keypoints], np.ones(len(keypoints))])
    in_world: Floats = np.einsum("nji,nj->ni", photos.rotations[photos.photo[keypoints]], rays)
    return in_world


def epipolar_errors_px(photos: Photos, matches: Array) -> Floats:
    """Returns the distances of matches from their epipolar lines, by Sampson's approximation."""
    first, second = photos.photo[matches[:, 0]], photos.photo[matches[:, 1]]
    relative = np.einsum("nij,nkj->nik", photos.rotations[second], photos.rotations[first])
    shift = np.einsum("nij,nj->ni", photos.rotations[second], photos.centres[first] - photos.centres[second])
    x1, x2 = (np.column_stack([photos.rays[matches[:, side]], np.ones(len(matches))]) for side in (0, 1))
    line2 = np.cross(shift, np.einsum("nij,nj->ni", relative, x1))  # essential matrix times x1
    line1 = np.einsum("nji,nj->ni", relative, np.cross(x2, shift))
    value = np.sum(x2 * line2, axis=1)
    f1, f2 = photos.focal_px[first], photos.focal_px[second]
    gradient = np.sum(line1[:, :2] ** 2, axis=1) / f1**2 + np.sum(line2[:, :2] ** 2, axis=1) / f2**2
    errors: Floats = np.abs(value) / np.sqrt(np.maximum(gradient, np.finfo(float).tiny))
    return errors


def triangulate(photos: Photos, matches: Array) -> Points:
    """Joins the matches of one epoch to tracks, and triangulates those that two or more photos see."""
    num = len(photos.photo)
    graph = coo_matrix((np.ones(len(matches)), (matches[:, 0], matches[:, 1])), (num, num))
    track = connected_components(graph, directed=False)[1]
    used = np.unique(matches)
    used = used[np.isfinite(photos.rays[used]).all(axis=1)]
    of_keypoint = np.full(num, -1)
    for round_index in range(NUM_ROUNDS):
        used, point = _seen_twice(photos, used, track[used])
        if len(used) == 0:
            return Points(np.empty((0, 3)), np.empty((0, 3, 3)), of_keypoint)
        places, errors_px, covariances = _intersect(photos, used, point)
        if round_index < NUM_ROUNDS - 1:
            used = used[errors_px < MAX_ERROR_PX]
    is_good = _largest_angles_deg(photos, used, point, places) >= MIN_ANGLE_DEG
    is_good &= np.isfinite(places).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    np.logical_and.at(is_good, point, errors_px < MAX_ERROR_PX)
    of_keypoint[used] = point
    return Points(places, covariances, of_keypoint).take(np.flatnonzero(is_good))


def _seen_twice(photos: Photos, keypoints: Array, track: Array) -> tuple[Array, Array]:
    """Returns the keypoints of tracks that have them in two or more photos, sorted by track, and the tracks, numbered
    from 0."""
    pairs = np.unique(np.column_stack([track, photos.photo[keypoints]]), axis=0)
    counts = np.bincount(pairs[:, 0], minlength=int(track.max(initial=0)) + 1)
    keypoints, track = keypoints[counts[track] > 1], track[counts[track] > 1]
    order = np.argsort(track, kind="stable")
    return keypoints[order], np.unique(track[order], return_inverse=True)[1]


def _intersect(photos: Photos, keypoints: Array, point: Array) -> tuple[Floats, Floats, Floats]:
    """Returns the places where the rays of points meet, the errors in pixels by keypoint, and covariances.

    point: of each keypoint, sorted.
    """
    ray, photo = directions(photos, keypoints), photos.photo[keypoints]
    unit = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    across = np.eye(3) - unit[:, :, None] * unit[:, None]  # projects onto the plane across the ray
    normal = _sums(point, across)
    places = _solve(normal, _sums(point, np.einsum("nij,nj->ni", across, photos.centres[photo])))
    focal = photos.focal_px[photo][:, None]
    for step in range(NUM_STEPS + 1):
        in_cam = np.einsum("nij,nj->ni", photos.rotations[photo], places[point] - photos.centres[photo])
        depth = np.where(in_cam[:, 2:] > 0, in_cam[:, 2:], np.nan)
        residual = focal * (in_cam[:, :2] / depth - photos.rays[keypoints])
        errors_px = np.where(np.isnan(depth[:, 0]), np.inf, np.linalg.norm(residual, axis=1))
        if step == NUM_STEPS:
            break
        rows = photos.rotations[photo]
        jacobian = (focal / depth)[:, :, None] * (rows[:, :2] - (in_cam[:, :2] / depth)[:, :, None] * rows[:, 2:])
        weight = 1 / (1 + (errors_px / MAX_ERROR_PX) ** 2)
        jacobian, residual = np.nan_to_num(jacobian), np.nan_to_num(residual)
        normal = _sums(point, weight[:, None, None] * np.einsum("nki,nkj->nij", jacobian, jacobian))
        places -= _solve(normal, _sums(point, weight[:, None] * np.einsum("nki,nk->ni", jacobian, residual)))
    return places, errors_px, np.asarray(np.linalg.pinv(normal, hermitian=True), float)


def _sums(point: Array, values: Floats) -> Floats:
    """Returns the sums of values by point; `point` is sorted and has no gaps."""
    return np.add.reduceat(values, np.unique(point, return_index=True)[1])


def _solve(matrices: Floats, values: Floats) -> Floats:
    """Solves 3 x 3 equations; those that have no unique solution almost, too."""
    trace = np.trace(matrices, axis1=1, axis2=2)[:, None, None]
    regular = matrices + (1e-12 * trace + np.finfo(float).tiny) * np.eye(3)
    return np.linalg.solve(regular, values[..., None])[..., 0]


def _largest_angles_deg(photos: Photos, keypoints: Array, point: Array, places: Floats) -> Floats:
    """Returns by point the largest angle between the ray of its first keypoint and the others."""
    ray = photos.centres[photos.photo[keypoints]] - places[point]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    first = np.unique(point, return_index=True)[1]
    angle = np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(ray - ray[first[point]], axis=1) / 2, 0, 1)))
    largest = np.zeros(len(places))
    np.maximum.at(largest, point, np.nan_to_num(angle))
    return largest


def photos_of(photos: Photos, points: Points, chosen: Array) -> list[int]:
    """Returns the photos that show some of the points, those that show most first."""
    is_chosen = np.zeros(len(points.places) + 1, bool)
    is_chosen[chosen] = True
    counts = np.bincount(photos.photo[is_chosen[points.of_keypoint]], minlength=len(photos.names))
    return [int(i) for i in np.argsort(-counts, kind="stable") if counts[i] > 0]
