"""Finds things that photos of one epoch show and those of the other one look through."""

import dataclasses

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.changes.tracks import Photos, Points

MAX_VIEW_ANGLE_DEG = 40.0  # from the nearest photo that shows the point; SIFT matches surfaces up to about as much
MAX_SCALE_RATIO = 2.0  # between the sizes of the point in both photos
NUM_NEAR_PIXELS = 3  # points around a pixel that all have to be farther
MAX_NEAR_RATIO = 0.02  # of the image's width: how far these may be
MIN_FARTHER_RATIO, MIN_FARTHER_SIGMA = 0.03, 5.0  # by which they are farther than the point
MIN_NUM_PHOTOS, MIN_NUM_SHOWN = 2, 3  # that look through a point, and that show it
MIN_RATIO = 4.0  # of photos that look through a point, to those that show something there
MIN_NUM_POINTS = 8  # of a thing
NUM_NEIGHBORS = 5  # of a point in its epoch
MIN_SHARE = 0.5  # of a point's neighbours that photos look through, too


@dataclasses.dataclass(frozen=True)
class MissingThing:
    """A thing that photos of one epoch show, and that is not there in the other epoch."""

    points: Array  # indices
    photos: list[int]  # of the other epoch, that look through its place


def find_missing(photos: Photos, shown: Points, other: Points, is_new: bool, is_known: Array) -> list[MissingThing]:
    """Returns things that photos of one epoch show, but not those of the other.

    shown, other: the points of these epochs. is_new: whether `other` is the new one. is_known: by shown point, whether
    it has a match in the other epoch, or is a part of something that has moved.
    """
    views = _Views(photos, shown)
    through, there = _look_through(photos, shown, other, is_new, views)
    num_through, num_there = through.sum(axis=0), there.sum(axis=0)
    is_missing = (num_through >= MIN_NUM_PHOTOS) & (num_through > MIN_RATIO * num_there) & ~is_known
    # Photos of its own epoch must not look through it, as they do through a fence and past wrong points.
    own_through, own_there = (each.sum(axis=0) for each in _look_through(photos, shown, shown, not is_new, views))
    is_shown = views.num_photos >= MIN_NUM_SHOWN
    is_missing &= is_shown & (own_there > own_through)
    # Points that a photo of the other epoch could show: those that it sees the place of. A point that too few photos of
    # its own epoch show is never missing, and says nothing of its neighbours.
    is_compared = is_known | (is_shown & (num_through + num_there > 0))
    if is_missing.sum() < MIN_NUM_POINTS:
        return []
    compared = np.flatnonzero(is_compared)
    tree = cKDTree(shown.places[compared])
    near = tree.query(shown.places[compared], min(NUM_NEIGHBORS + 1, len(compared)))[1]
    share = is_missing[compared][near[:, 1:]].mean(axis=1)
    chosen = np.flatnonzero(is_missing[compared] & (share >= MIN_SHARE))
    # Neighbours belong to one thing.
    index = np.full(len(compared), -1)
    index[chosen] = np.arange(len(chosen))
    pairs = np.array([(index[i], index[j]) for i in chosen for j in near[i, 1:] if index[j] >= 0]).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (len(chosen), len(chosen)))
    label = connected_components(graph, directed=False)[1]
    things = []
    for members in (np.flatnonzero(label == each) for each in np.unique(label)):
        if len(members) >= MIN_NUM_POINTS:
            points = compared[chosen[members]]
            seen = np.flatnonzero(through[:, points].sum(axis=1))
            things.append(MissingThing(points, seen.tolist()))
    return sorted(things, key=lambda thing: -len(thing.points))


class _Views:
    """From where points are seen: the observations, sorted by point."""

    def __init__(self, photos: Photos, points: Points):
        keypoints = np.flatnonzero(points.of_keypoint >= 0)
        point, photo = points.of_keypoint[keypoints], photos.photo[keypoints]
        ray = points.places[point] - photos.centres[photo]
        length = np.linalg.norm(ray, axis=1)
        self._photos, self._places, self._point = photos, points.places, point
        self._direction, self._scale = ray / length[:, None], photos.focal_px[photo] / length
        seen_by = np.unique(np.column_stack([point, photo]), axis=0)[:, 0]
        self.num_photos = np.bincount(seen_by, minlength=len(points.places))

    def similar(self, photo: int) -> Array:
        """Returns by point whether a photo that shows it has a similar direction and scale."""
        ray = self._places - self._photos.centres[photo]
        length = np.linalg.norm(ray, axis=1)
        cosine = np.sum(self._direction * (ray / length[:, None])[self._point], axis=1)
        ratio = self._scale / (self._photos.focal_px[photo] / length)[self._point]
        is_similar = cosine > np.cos(np.radians(MAX_VIEW_ANGLE_DEG))
        is_similar &= (ratio < MAX_SCALE_RATIO) & (ratio > 1 / MAX_SCALE_RATIO)
        result = np.zeros(len(self._places), bool)
        result[self._point[is_similar]] = True
        return result


def _look_through(photos: Photos, shown: Points, other: Points, is_new: bool, views: _Views) -> tuple[Array, Array]:
    """Returns by photo and point whether the photo looks through the point, and whether it shows something there.
    What is in front of the point hides it. is_new: the epoch of these photos, in which `other` was triangulated."""
    through = np.zeros((len(photos.names), len(shown.places)), bool)
    there = np.zeros_like(through)
    for i in np.flatnonzero(photos.is_new == is_new):
        camera, axis = photos.cameras[i], photos.rotations[i][2]
        own = np.arange(photos.first[i], photos.first[i + 1])
        own = own[other.of_keypoint[own] >= 0]
        if len(own) <= NUM_NEAR_PIXELS:
            continue
        pixels, depth = photos.project(i, shown.places)
        is_inside = np.all((pixels >= 0) & (pixels < [camera.width, camera.height]), axis=1)
        seen = np.flatnonzero(is_inside & views.similar(i))
        distance, near = cKDTree(photos.pixels[own]).query(pixels[seen], NUM_NEAR_PIXELS + 1)
        points = other.of_keypoint[own]
        # Leave out the point itself, or else the farthest one.
        is_itself = (points[near] == seen[:, None]) & (other is shown)
        is_itself[:, -1] |= ~is_itself.any(axis=1)
        rest = np.argsort(is_itself, axis=1, kind="stable")[:, :NUM_NEAR_PIXELS]
        distance, near = (np.take_along_axis(each, rest, axis=1) for each in (distance, near))
        own_depth = (other.places[points] - photos.centres[i]) @ axis
        own_variance = np.einsum("i,nij,j->n", axis, other.covariances[points], axis)
        variance = np.einsum("i,nij,j->n", axis, shown.covariances[seen], axis)
        margin = MIN_FARTHER_SIGMA * np.sqrt(own_variance[near] + variance[:, None])
        margin = np.maximum(margin, MIN_FARTHER_RATIO * depth[seen][:, None])
        is_near = distance < MAX_NEAR_RATIO * camera.width
        farther = own_depth[near] - depth[seen][:, None]
        through[i, seen] = np.all(is_near & (farther > margin), axis=1)
        there[i, seen] = np.any(is_near & (np.abs(farther) <= margin), axis=1)
    return through, there
