"""Pairs of matched images: what the photos show about their poses."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.posed_images import PosedImage

MAX_NUM_PAIRS = 60
MIN_NUM_MATCHES = 20  # of a pair that is used
MAX_NUM_MATCHES = 100  # of a pair, at most; more add nothing
MAX_NUM_KEPT = 100  # images whose keypoints are kept in memory
SEED = 0  # of the choice of pairs, so that the same input gives the same answer


@dataclasses.dataclass(frozen=True, eq=False)
class MatchedPair:
    """Two images by index, and the viewing rays of matches that a two-view geometry has verified: m x 3 in each camera,
    of unit length. `focal_px`: pixels per radian, the mean of both cameras."""

    first: int
    second: int
    rays1: Array
    rays2: Array
    focal_px: float

    @staticmethod
    def of(indices: tuple[int, int], cameras: tuple[Camera, Camera], points: tuple[Array, Array]) -> "MatchedPair":
        """Makes a pair of matched points in pixels, m x 2 in each image."""
        count = len(points[0])
        chosen = np.linspace(0, count - 1, min(count, MAX_NUM_MATCHES)).astype(int)
        rays1, rays2 = (rays_of(camera, part[chosen]) for camera, part in zip(cameras, points))
        is_usable = np.isfinite(rays1).all(axis=1) & np.isfinite(rays2).all(axis=1)
        focal_px = (focal_length_px(cameras[0]) + focal_length_px(cameras[1])) / 2
        return MatchedPair(*indices, rays1[is_usable], rays2[is_usable], focal_px)

    def with_focal_factor(self, factor: float) -> "MatchedPair":
        """Returns the pair of cameras whose focal lengths are multiplied by a factor."""
        rays1, rays2 = (scale_rays(rays, factor) for rays in (self.rays1, self.rays2))
        return dataclasses.replace(self, rays1=rays1, rays2=rays2, focal_px=self.focal_px * factor)


def scale_rays(rays: Array, factor: float) -> Array:
    """Returns the rays of the same pixels if the focal length is multiplied by a factor."""
    scaled = rays * [1, 1, factor]
    units: Array = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    return units


def rays_of(camera: Camera, points: Array) -> Array:
    """Returns the viewing rays of points in pixels, n x 3, of unit length; NaN where the camera model has none."""
    # Not at the top, because help texts need no extension module.
    from colmap_lazyloc.arrays import to_camera
    from colmap_lazyloc.extension import core

    rays: Array = core.rays(to_camera(camera), np.ascontiguousarray(points, float))
    return rays


@functools.cache  # for each pair of a few cameras
def focal_length_px(camera: Camera) -> float:
    """Returns the mean focal length; that of a camera without one is its pixels per radian in the middle."""
    centre = np.array([camera.width / 2, camera.height / 2])
    rays = rays_of(camera, np.stack([centre, centre + [1.0, 0.0]]))
    angle = float(np.linalg.norm(rays[1] - rays[0]))
    return 1 / angle if np.isfinite(angle) and angle > 0 else float(max(camera.width, camera.height))


def pairs_of_database(
    database: DatabaseReader, images: Sequence[PosedImage], count: int = MAX_NUM_PAIRS
) -> list[MatchedPair]:
    """Returns up to `count` pairs whose matches are in a database: half of neighbours in space, half at random."""
    index = {image.name: position for position, image in enumerate(images)}
    matched = sorted(
        (min(index[first], index[second]), max(index[first], index[second]))
        for first, second in database.verified_pairs(MIN_NUM_MATCHES)
        if first in index and second in index
    )
    centres = np.array([image.cam_from_world.cam_in_world for image in images]).reshape(-1, 3)
    keypoints = functools.lru_cache(maxsize=MAX_NUM_KEPT)(database.keypoints)
    found = (_read_pair(database, images, keypoints, *pair) for pair in choose_pairs(matched, centres))
    return list(itertools.islice((pair for pair in found if len(pair.rays1) >= MIN_NUM_MATCHES), count))


def choose_pairs(matched: Sequence[tuple[int, int]], centres: Array) -> list[tuple[int, int]]:
    """Returns matched pairs, the best to look at first: by turns the pair of an image with its neighbour in space that
    is nearest, and one at random."""
    random = np.random.default_rng(SEED)
    rows = np.array(matched, int).reshape(-1, 2)
    distances = np.linalg.norm(centres[rows[:, 0]] - centres[rows[:, 1]], axis=1)
    order = np.argsort(distances, kind="stable")
    nearest: dict[int, int] = {}
    for row in order.tolist():
        for image in rows[row].tolist():
            nearest.setdefault(image, row)
    near = [nearest[image] for image in random.permutation(sorted(nearest)).tolist()]
    others = random.permutation(len(rows)).tolist()
    chosen = dict.fromkeys(row for both in itertools.zip_longest(near, others) for row in both if row is not None)
    return [(int(rows[row, 0]), int(rows[row, 1])) for row in chosen]


def _read_pair(
    database: DatabaseReader,
    images: Sequence[PosedImage],
    keypoints: Callable[[str], Array],
    first: int,
    second: int,
) -> MatchedPair:
    one, other = images[first], images[second]
    points = keypoints(one.name), keypoints(other.name)
    matches = database.inlier_matches(one.name, other.name)
    matches = matches[(matches[:, 0] < len(points[0])) & (matches[:, 1] < len(points[1]))]
    matched = points[0][matches[:, 0]], points[1][matches[:, 1]]
    return MatchedPair.of((first, second), (one.camera, other.camera), matched)
