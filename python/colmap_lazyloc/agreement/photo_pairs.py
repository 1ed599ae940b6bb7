"""Matches some of the photos of posed images, coarsely and without their poses. Needs OpenCV."""

import concurrent.futures
import dataclasses
import itertools
import math
import pathlib
from collections.abc import Iterable, Sequence

import numpy as np

from colmap_lazyloc.agreement.pairs import (
    MAX_NUM_PAIRS,
    MIN_NUM_MATCHES,
    SEED,
    MatchedPair,
    focal_length_px,
    rays_of,
)
from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px
from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.naming import natural_order
from colmap_lazyloc.pose_formats.posed_images import PosedImage, decode_as_stored

NUM_THREADS = 2
NUM_PLACES = 10  # in the order of the names, at which neighbours are matched
NUM_FOLLOWING = 2  # photos after one that are its neighbours by name
NUM_NEAREST = 2  # photos that are its neighbours by the given poses
NUM_RANDOM = 120  # further pairs that are tried
NUM_AT_ONCE = 10  # of these
# How many pixels larger photos are reduced to, and features: first, and if too few pairs match so.
COARSE, FINE = (100_000, 400), (300_000, 800)
NUM_ENOUGH = 40  # pairs
UNIT_NUM_PX = 300_000  # of a photo in whose pixels errors are, however many were seen
MIN_DISPLACEMENT_PX = 2.0  # of a match in the reduced photo: what does not move is a bonnet, a time stamp, a watermark
MAX_RATIO = 0.8  # of distances to the best and the second-best match
MAX_NUM_TRIALS, CONFIDENCE = 500, 0.999  # of RANSAC
MAX_SHAPE = 0.02  # by which the aspect ratio of a photo may differ from that of its camera
MAX_ERROR_PX = 3.0  # from epipolar lines; of a fundamental matrix, in the reduced photo
CERTAIN_PX = 0.6  # median error of unverified matches below which the given poses are right for them


@dataclasses.dataclass(frozen=True, eq=False)
class Features:
    """Keypoints in pixels of the camera, and SIFT descriptors; `scale`: pixels of the camera per one that was seen."""

    points: Floats
    descriptors: Array
    scale: float


def pairs_of_photos(
    folder: pathlib.Path, images: Sequence[PosedImage], masks: pathlib.Path | None = None
) -> list[MatchedPair]:
    """Returns pairs of photos that match, half of neighbours, half at random; leaves out photos that cannot be read.

    `masks`: folder of masks, NAME.png for the photo NAME, black where features are not wanted.
    """
    near = _neighbours(images)
    seen = sorted({index for pair in near for index in pair})
    coarse = _find_pairs(folder, images, masks, near, seen, COARSE)
    is_enough = len(coarse) >= min(NUM_ENOUGH, math.comb(len(seen), 2) / 2)
    return coarse if is_enough else _find_pairs(folder, images, masks, near, seen, FINE)


def _find_pairs(
    folder: pathlib.Path,
    images: Sequence[PosedImage],
    masks: pathlib.Path | None,
    near: Sequence[tuple[int, int]],
    seen: Sequence[int],
    detail: tuple[int, int],
) -> list[MatchedPair]:
    """Matches the near pairs and others of the seen photos; `detail`: the numbers of pixels and of features."""
    poses = Poses.of(images)

    def extract(index: int) -> Features | None:
        name = images[index].name
        return _extract(folder / name, images[index], None if masks is None else masks / f"{name}.png", *detail)

    with concurrent.futures.ThreadPoolExecutor(NUM_THREADS) as pool:
        features = dict(zip(seen, pool.map(extract, seen)))
        others = sorted(set(itertools.combinations(seen, 2)).difference(near))
        order = np.random.default_rng(SEED).permutation(len(others))[:NUM_RANDOM]

        def match(tried: Iterable[tuple[int, int]]) -> list[MatchedPair]:
            found = pool.map(lambda pair: _match(images, poses, features, *pair), tried)
            return [pair for pair in found if pair is not None]

        neighbours, distant = match(near), list[MatchedPair]()
        for start in range(0, len(order), NUM_AT_ONCE):
            if len(distant) >= max(MAX_NUM_PAIRS // 2, MAX_NUM_PAIRS - len(neighbours)):
                break  # further ones would not be used
            distant += match(others[index] for index in order[start : start + NUM_AT_ONCE])
    return [*neighbours[: MAX_NUM_PAIRS - min(len(distant), MAX_NUM_PAIRS // 2)], *distant][:MAX_NUM_PAIRS]


def _neighbours(images: Sequence[PosedImage]) -> list[tuple[int, int]]:
    """Returns pairs of photos that follow each other by name, and of those that are near by their poses."""
    order = natural_order([image.name for image in images])
    centres = np.array([image.cam_from_world.cam_in_world for image in images])
    axes = np.array([image.cam_from_world.rotation[2] for image in images])
    pairs: dict[tuple[int, int], None] = {}
    for place in np.unique(np.linspace(0, len(order) - 1, NUM_PLACES).astype(int)).tolist():
        index = order[place]
        distances = np.linalg.norm(centres - centres[index], axis=1)
        # Photos in other directions come last: they see something else.
        distances += (axes @ axes[index] < 0.5) * (distances.max() + 1)
        distances[index] = np.inf
        nearest = np.argsort(distances, kind="stable")[: min(NUM_NEAREST, len(images) - 1)].tolist()
        for other in [*order[place + 1 : place + 1 + NUM_FOLLOWING], *nearest]:
            pairs[min(index, other), max(index, other)] = None
    return list(pairs)


def _extract(
    path: pathlib.Path, image: PosedImage, mask_path: pathlib.Path | None, max_num_px: int, max_num_features: int
) -> Features | None:
    """Returns the features of a photo; None if it cannot be read or is not of its camera's shape."""
    import cv2

    camera = image.camera
    photo = _read(path, camera.width * camera.height / max_num_px)
    if photo is None or abs(photo.shape[1] * camera.height - photo.shape[0] * camera.width) > MAX_SHAPE * photo.size:
        return None
    factor = min(1.0, (max_num_px / photo.size) ** 0.5)
    if factor < 1:
        photo = cv2.resize(photo, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    keypoints, descriptors = cv2.SIFT.create(max_num_features).detectAndCompute(photo, np.empty(0, np.uint8))
    if descriptors is None:
        return None
    xy = np.array(cv2.KeyPoint.convert(keypoints), float)
    mask = None if mask_path is None else _read(mask_path, 0)
    if mask is not None:
        columns, rows = (xy * [mask.shape[1] / photo.shape[1], mask.shape[0] / photo.shape[0]]).astype(int).T
        is_wanted = mask[rows, columns] > 0
        xy, descriptors = xy[is_wanted], descriptors[is_wanted]
    if len(xy) < MIN_NUM_MATCHES:
        return None
    # In COLMAP's pixels, centres are at 0.5, in OpenCV's at 0.
    scales = [camera.width / photo.shape[1], camera.height / photo.shape[0]]
    # Of square roots, the product measures how alike two descriptors are; it is 1 of the same ones.
    roots = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1))
    return Features((xy + 0.5) * scales, roots, scales[0])


def _read(path: pathlib.Path, ratio: float) -> Array | None:
    """Returns a grey picture, reduced if it is large; None if it cannot be read. `ratio`: pixels over those needed."""
    import cv2

    flag = next((flag for factor, flag in _REDUCED if ratio >= factor**2), "IMREAD_GRAYSCALE")
    try:
        return decode_as_stored(np.fromfile(path, np.uint8), getattr(cv2, flag))
    except (OSError, cv2.error):
        return None


_REDUCED = ((8, "IMREAD_REDUCED_GRAYSCALE_8"), (4, "IMREAD_REDUCED_GRAYSCALE_4"), (2, "IMREAD_REDUCED_GRAYSCALE_2"))


def _match(
    images: Sequence[PosedImage], poses: Poses, features: dict[int, Features | None], first: int, second: int
) -> MatchedPair | None:
    """Returns the matches of two photos that fit the given poses or a fundamental matrix; None if they are too few."""
    one, other = features[first], features[second]
    if one is None or other is None:
        return None
    good = _match_descriptors(one.descriptors, other.descriptors)
    moved = np.linalg.norm(one.points[good[:, 0]] / one.scale - other.points[good[:, 1]] / other.scale, axis=1)
    good = good[moved >= MIN_DISPLACEMENT_PX]
    if len(good) < MIN_NUM_MATCHES:
        return None
    cameras = images[first].camera, images[second].camera
    points, scale = (one.points[good[:, 0]], other.points[good[:, 1]]), max(one.scale, other.scale)

    def pair_of(chosen: Array) -> MatchedPair:
        pair = MatchedPair.of((first, second), cameras, (points[0][chosen], points[1][chosen]))
        ratio = max(camera.width * camera.height for camera in cameras) / UNIT_NUM_PX
        return dataclasses.replace(pair, focal_px=pair.focal_px / max(1.0, ratio**0.5))

    fitting = _fitting(pair_of(np.arange(len(good))), poses)
    if len(fitting.rays1) >= MIN_NUM_MATCHES:
        return fitting
    inliers = _inliers(cameras, points, MAX_ERROR_PX * scale)
    return pair_of(inliers) if len(inliers) >= MIN_NUM_MATCHES else None


def _fitting(pair: MatchedPair, poses: Poses) -> MatchedPair:
    """Returns the matches that fit the given poses if most do to a fraction of a pixel, which right poses alone make
    possible; none if they do not."""
    px = errors_px(Matches.of([pair]), poses, poses)
    chosen = (px <= MAX_ERROR_PX) & (len(px) > 0 and np.median(px) <= CERTAIN_PX)
    return dataclasses.replace(pair, rays1=pair.rays1[chosen], rays2=pair.rays2[chosen])


def _inliers(cameras: tuple[Camera, Camera], points: tuple[Array, Array], max_error_px: float) -> Array:
    """Returns the indices of the matches that fit a fundamental matrix."""
    import cv2

    focal_px = min(map(focal_length_px, cameras))
    flat = [focal_px * _without_distortion(rays_of(camera, part)) for camera, part in zip(cameras, points)]
    known: Array = np.flatnonzero(np.isfinite(flat[0]).all(axis=1) & np.isfinite(flat[1]).all(axis=1))
    if len(known) < MIN_NUM_MATCHES:
        return known
    cv2.setRNGSeed(SEED)
    # A fundamental matrix needs no focal length, which may be what is wrong.
    _, mask = cv2.findFundamentalMat(
        flat[0][known], flat[1][known], cv2.FM_RANSAC, max_error_px, CONFIDENCE, _num_trials(len(known))
    )
    return known[mask.ravel() > 0] if mask is not None else known[:0]


def _num_trials(num_matches: int) -> int:
    """Returns how many trials of seven matches find a fundamental matrix that enough of these fit, if there is one."""
    share = (MIN_NUM_MATCHES / (num_matches + 1)) ** 7  # of trials that find it, at least
    return min(MAX_NUM_TRIALS, math.ceil(math.log(1 - CONFIDENCE) / math.log1p(-share)))


def _match_descriptors(one: Array, other: Array) -> Array:
    """Returns mutual nearest neighbours that are clearly nearer than the second nearest, m x 2."""
    import cv2

    # numpy's threads would wait for each other ten times as long as they compute.
    products = cv2.gemm(one, other, 1, np.empty(0), 0, flags=cv2.GEMM_2_T)
    best = products.argmax(axis=1)
    rows = np.arange(len(one))
    nearest = np.arccos(np.minimum(products[rows, best], 1))
    is_mutual = products.argmax(axis=0)[best] == rows
    products[rows, best] = -1
    second = np.arccos(np.minimum(products.max(axis=1), 1))
    is_good = is_mutual & (nearest < MAX_RATIO * second)
    matches: Array = np.stack([rows, best], axis=1)[is_good]
    return matches


def _without_distortion(rays: Floats) -> Floats:
    """Returns where rays meet the plane at distance 1; NaN if they do not, or far outside."""
    forward: Floats = np.where(rays[:, 2:] > 0.1, rays[:, 2:], np.nan)
    points: Floats = rays[:, :2] / forward
    return points
