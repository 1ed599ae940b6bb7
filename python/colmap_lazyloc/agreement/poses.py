"""Poses of many images as arrays, and how far matches are from them."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.agreement.pairs import MatchedPair, scale_rays
from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.pose_formats.posed_images import PosedImage


@dataclasses.dataclass(frozen=True, eq=False)
class Poses:
    """Poses of n images. `rotations`: cam_from_world, n x 3 x 3; `centres`: in the world, n x 3; NaN where there is
    none. `focal_factor`: by which the given focal lengths are multiplied."""

    rotations: Floats
    centres: Floats
    focal_factor: float = 1.0

    @staticmethod
    def of(images: Sequence[PosedImage]) -> "Poses":
        poses = [image.cam_from_world for image in images]
        rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
        return Poses(rotations, np.array([pose.cam_in_world for pose in poses]).reshape(-1, 3))

    def take(self, indices: Array) -> "Poses":
        """Returns the poses of some images."""
        return dataclasses.replace(self, rotations=self.rotations[indices], centres=self.centres[indices])


@dataclasses.dataclass(frozen=True, eq=False)
class Matches:
    """The matches of all pairs, one after the other: rays of unit length in both cameras, and the pair of each."""

    pairs: Sequence[MatchedPair]
    first: Array  # indices of images, a pair each
    second: Array
    pair: Array  # index of the pair, a match each
    rays1: Floats
    rays2: Floats
    focal_px: Floats  # a match each

    @staticmethod
    def of(pairs: Sequence[MatchedPair], max_num_matches: int | None = None) -> "Matches":
        """Takes up to a number of matches of each pair."""
        parts = [slice(None, None, -(-len(pair.rays1) // (max_num_matches or len(pair.rays1)))) for pair in pairs]
        rays1 = [pair.rays1[part] for pair, part in zip(pairs, parts)]
        rays2 = [pair.rays2[part] for pair, part in zip(pairs, parts)]
        index = np.repeat(np.arange(len(pairs)), [len(rays) for rays in rays1])
        return Matches(
            pairs,
            np.array([pair.first for pair in pairs], int),
            np.array([pair.second for pair in pairs], int),
            index,
            np.concatenate(rays1),
            np.concatenate(rays2),
            np.array([pair.focal_px for pair in pairs])[index],
        )


def errors_px(matches: Matches, poses: Poses, second_poses: Poses) -> Floats:
    """Returns how far each match is from fitting the poses of the first and the second images of pairs, in pixels; NaN
    where an image has no pose.

    The error is the angle between a ray and the epipolar plane of the other, in pixels, the mean of both images. If the
    rays meet behind a camera, the nearest rays that fit are parallel, so that the angle between them counts as well.
    """
    rays1, rays2 = (scale_rays(rays, poses.focal_factor) for rays in (matches.rays1, matches.rays2))
    rotations1, rotations2 = poses.rotations[matches.first], second_poses.rotations[matches.second]
    baselines = _unit(second_poses.centres[matches.second] - poses.centres[matches.first])[matches.pair]
    world1 = np.einsum("mji,mj->mi", rotations1[matches.pair], rays1)
    world2 = np.einsum("mji,mj->mi", rotations2[matches.pair], rays2)
    normals1, normals2 = np.cross(baselines, world1), np.cross(baselines, world2)
    mixed = np.abs(np.sum(normals1 * world2, axis=1))
    sines1, sines2 = np.linalg.norm(normals1, axis=1), np.linalg.norm(normals2, axis=1)
    tiny = np.finfo(float).tiny
    epipolar1, epipolar2 = (np.arcsin(np.minimum(mixed / np.maximum(sines, tiny), 1)) for sines in (sines1, sines2))
    epipolar = (epipolar1 + epipolar2) / 2
    across = np.cross(world1, world2)
    parallax = np.arctan2(np.linalg.norm(across, axis=1), np.sum(world1 * world2, axis=1))
    # The depths along both rays have the signs of these products.
    is_behind = (np.sum(normals2 * across, axis=1) < 0) | (np.sum(normals1 * across, axis=1) < 0)
    # Images from one place have no epipolar planes: their rays must be parallel.
    has_none = ~np.any(baselines, axis=1)
    angles = np.where(has_none | is_behind, np.hypot(np.where(has_none, 0, epipolar), parallax), epipolar)
    return angles * matches.focal_px * max(poses.focal_factor, 1.0)


def medians_by_pair(matches: Matches, values: Floats) -> Floats:
    """Returns the median of the values of each pair."""
    order = np.lexsort((values, matches.pair))
    counts = np.bincount(matches.pair, minlength=len(matches.pairs))
    starts = np.cumsum(counts) - counts
    medians: Floats = values[order][starts + (counts - 1) // 2]
    return medians


def _unit(vectors: Floats) -> Floats:
    """Returns vectors of unit length; zero for those that have none."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    units: Floats = vectors / np.where(lengths > 0, lengths, 1)
    return units
