"""Finds things that have moved: matches across epochs that agree with each other, but not with poses that are fixed."""

import dataclasses

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.changes.tracks import Points

MEDIAN_CHI2 = 2.366  # of three degrees of freedom
MIN_KEYPOINT_VARIANCE = 0.01  # pixels^2
MAX_STATIC_SIGMA, MIN_MOVED_SIGMA = 4.0, 8.0  # between them, a point counts as neither
MIN_NUM_POINTS = 8  # of a thing
NUM_NEAR = 30  # points from which the other two of a minimal sample are drawn
NUM_AROUND = 100  # unmoved points whose mean shift is an error of the poses around a thing
NUM_SAMPLES = 2000
MAX_MISFIT_SIGMA = 4.0  # of a point from the motion of its thing
NUM_NEIGHBORS = 5  # among which most points of a thing have moved
MAX_STATIC_SHARE = 0.5
# Share of the points of a thing that both epochs show at one place, within these deviations: more is a pattern that
# repeats, less is chance in a dense texture.
MAX_REPEATED_SHARE, MAX_REPEATED_SIGMA = 0.1, 2.0


@dataclasses.dataclass(frozen=True)
class Links:
    """Points of both epochs that matches connect; each point has at most one link."""

    old: Array  # index of the point
    new: Array
    num_matches: Array
    shift: Floats  # new place minus old place, n x 3
    covariance: Floats  # n x 3 x 3
    sigma: Floats  # length of the shift in standard deviations

    @property
    def is_static(self) -> Array:
        return self.sigma < MAX_STATIC_SIGMA

    @property
    def is_moved(self) -> Array:
        return self.sigma > MIN_MOVED_SIGMA


@dataclasses.dataclass(frozen=True)
class MovedThing:
    """A thing that was at another place before."""

    links: Array  # indices
    before: Floats  # centre of its points
    now: Floats
    stddevs: Floats  # of the displacement along x, y, z
    angle_deg: float  # by which it has turned

    @property
    def displacement(self) -> Floats:
        return self.now - self.before


def link(old: Points, new: Points, across: Array) -> Links:
    """Links points of both epochs by their matches; each with the one that most matches connect it with.

    Errors of keypoints and poses are a part of a shift. Covariances are scaled by what the median shift shows of them,
    because most points have not moved.
    """
    pairs = np.column_stack([old.of_keypoint[across[:, 0]], new.of_keypoint[across[:, 1]]])
    pairs, counts = np.unique(pairs[(pairs >= 0).all(axis=1)], axis=0, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    pairs, counts = pairs[order], counts[order]
    is_best = np.ones(len(pairs), bool)
    for side in (0, 1):
        best = np.zeros(len(pairs), bool)
        best[np.unique(pairs[:, side], return_index=True)[1]] = True
        is_best &= best
    pairs, counts = pairs[is_best], counts[is_best]
    shift = new.places[pairs[:, 1]] - old.places[pairs[:, 0]]
    covariance = old.covariances[pairs[:, 0]] + new.covariances[pairs[:, 1]]
    chi2 = _chi2(shift, covariance)
    if len(chi2):
        covariance = covariance * max(float(np.median(chi2)) / MEDIAN_CHI2, MIN_KEYPOINT_VARIANCE)
    return Links(pairs[:, 0], pairs[:, 1], counts, shift, covariance, np.sqrt(_chi2(shift, covariance)))


def _chi2(shift: Floats, covariance: Floats) -> Floats:
    chi2: Floats = np.einsum("ni,ni->n", shift, np.linalg.solve(covariance, shift[..., None])[..., 0])
    return chi2


def find_moved(old: Points, new: Points, links: Links) -> list[MovedThing]:
    """Returns the things that have moved as rigid bodies, those with most points first."""
    candidates = _away_from_static(old, new, links, np.flatnonzero(links.is_moved))
    things = []
    random = np.random.default_rng(0)
    while len(candidates) >= MIN_NUM_POINTS:
        inliers = _largest_motion(old, new, links, candidates, random)
        if len(inliers) < MIN_NUM_POINTS:
            break
        # Its other points are less exact, and no other thing.
        before = old.places[links.old]
        candidates = candidates[~is_around(before[candidates], before[inliers])]
        thing = None if _is_repeated(old, new, links, inliers) else _fit(old, new, links, inliers)
        if thing is not None:
            things.append(thing)
    return things


def is_around(places: Floats, thing: Floats) -> Array:
    """True for places in the box around the points of a thing, or at most half its extent away."""
    low, high = thing.min(axis=0), thing.max(axis=0)
    margin = float(np.linalg.norm(high - low)) / 2
    is_in: Array = np.all((places > low - margin) & (places < high + margin), axis=1)
    return is_in


def _away_from_static(old: Points, new: Points, links: Links, moved: Array) -> Array:
    """Returns the links whose neighbours have moved, too, before and now.

    Windows that look alike give matches that agree with each other, but unmoved points are among them.
    """
    if len(moved) == 0:
        return moved
    known = np.flatnonzero(links.is_static | links.is_moved)
    is_away = np.ones(len(moved), bool)
    for places in (old.places[links.old], new.places[links.new]):
        count = min(NUM_NEIGHBORS + 1, len(known))
        near = np.atleast_2d(cKDTree(places[known]).query(places[moved], count)[1])[:, 1:]
        is_away &= links.is_static[known][near].mean(axis=1) <= MAX_STATIC_SHARE
    away: Array = moved[is_away]
    return away


def _largest_motion(old: Points, new: Points, links: Links, among: Array, random: np.random.Generator) -> Array:
    """Returns the links that fit one rigid motion, of those that three neighbours determine: the largest number."""
    before, now = old.places[links.old[among]], new.places[links.new[among]]
    inverse = np.asarray(np.linalg.inv(links.covariance[among]), float)
    near = cKDTree(before).query(before, min(NUM_NEAR, len(among)))[1]
    best: Array = np.empty(0, int)
    for seed in random.integers(len(among), size=NUM_SAMPLES):
        sample = np.array([seed, *random.choice(near[seed][1:], 2, replace=False)])
        inliers = _inliers(before, now, inverse, _rigid(before[sample], now[sample]))
        best = inliers if len(inliers) > len(best) else best
    for _ in range(3):
        if len(best) < 3:
            return np.empty(0, int)
        best = _inliers(before, now, inverse, _rigid(before[best], now[best]))
    result: Array = among[best]
    return result


def _is_repeated(old: Points, new: Points, links: Links, chosen: Array) -> bool:
    """True if points of a thing were already where they are now, or are still where they were.

    Two flowers of a wallpaper that look alike also give matches that agree with each other.
    """
    for points, other in ((new.places[links.new[chosen]], old.places), (old.places[links.old[chosen]], new.places)):
        nearest = other[cKDTree(other).query(points)[1]]
        sigma = np.sqrt(_chi2(nearest - points, links.covariance[chosen]))
        if np.mean(sigma < MAX_REPEATED_SIGMA) > MAX_REPEATED_SHARE:
            return True
    return False


def _rigid(before: Floats, now: Floats) -> tuple[Floats, Floats]:
    """Returns the rotation and the translation that fit best."""
    a, b = before.mean(axis=0), now.mean(axis=0)
    u, _, vt = np.linalg.svd((now - b).T @ (before - a))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return rotation, b - rotation @ a


def _inliers(before: Floats, now: Floats, inverse: Floats, motion: tuple[Floats, Floats]) -> Array:
    misfit = now - before @ motion[0].T - motion[1]
    return np.flatnonzero(np.einsum("ni,nij,nj->n", misfit, inverse, misfit) < MAX_MISFIT_SIGMA**2)


def _fit(old: Points, new: Points, links: Links, chosen: Array) -> MovedThing | None:
    """Fits the motion of a thing by the covariances of its points; None if its displacement is not significant.

    The deviation contains the mean shift of unmoved points around the thing: an error that its points share.
    """
    before, now = old.places[links.old[chosen]], new.places[links.new[chosen]]
    centre = before.mean(axis=0)
    whiten = np.linalg.cholesky(np.linalg.inv(links.covariance[chosen])).transpose(0, 2, 1)
    start, translation = _rigid(before - centre, now)
    vector = Rotation.from_matrix(start).as_rotvec()

    def misfits(motion: Floats) -> Floats:
        moved = Rotation.from_rotvec(motion[:3]).apply(before - centre) + motion[3:]
        whitened: Floats = np.einsum("nij,nj->ni", whiten, now - moved)
        return whitened.ravel()

    fit = least_squares(misfits, np.concatenate([vector, translation]), loss="soft_l1")
    factor = max(1.0, 2 * fit.cost / max(3 * len(chosen) - 6, 1))
    covariance = factor * np.linalg.pinv(fit.jac.T @ fit.jac)[3:, 3:]
    static = np.flatnonzero(links.is_static)
    if len(static):
        near = cKDTree(old.places[links.old[static]]).query(centre, min(NUM_AROUND, len(static)))[1]
        around = static[np.atleast_1d(near)]
        weights = np.linalg.inv(links.covariance[around])
        shared = np.linalg.solve(weights.sum(axis=0), np.einsum("nij,nj->i", weights, links.shift[around]))
        covariance += shared @ shared / 3 * np.eye(3)
    angle_deg = float(np.degrees(np.linalg.norm(fit.x[:3])))
    thing = MovedThing(chosen, centre, fit.x[3:], np.sqrt(np.diag(covariance)), angle_deg)
    sigma = np.sqrt(thing.displacement @ np.linalg.solve(covariance, thing.displacement))
    return thing if sigma > MIN_MOVED_SIGMA else None
