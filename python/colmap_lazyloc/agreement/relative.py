"""Relative poses of pairs, which matches give without any given pose."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.agreement.pairs import MatchedPair
from colmap_lazyloc.agreement.poses import Poses
from colmap_lazyloc.array_types import Array, Floats

MAX_ERROR_PX = 2.0
MIN_NUM_DIRECTIONS = 6
MIN_SINGULAR_RATIO = 1e-3  # directions along one line do not determine a turn about it
NUM_REWEIGHTINGS = 20
ROBUST_RAD = 0.005  # of directions, below which all are as good
MIN_NUM_IN_FRONT = 8  # rays that meet in front of both cameras
MAX_DEPTH = 50.0  # in distances of the two cameras
MIN_FORWARD = 0.1  # of a ray's z: rays far to the side have no place on a plane


@dataclasses.dataclass(frozen=True, eq=False)
class RelativePoses:
    """Of each pair: `rotations`, cam2_from_cam1, n x 3 x 3; `directions`, of the second camera in the first, n x 3, of
    unit length; NaN where the matches determine none."""

    first: Array
    second: Array
    rotations: Floats
    directions: Floats

    @staticmethod
    def of(pairs: Sequence[MatchedPair], is_wanted: Array | None = None) -> "RelativePoses":
        """Estimates those of the pairs, or of some of them: the others are NaN."""
        wanted = np.ones(len(pairs), bool) if is_wanted is None else is_wanted
        found = [_estimate(pair) if is_one else _nothing() for pair, is_one in zip(pairs, wanted)]
        return RelativePoses(
            np.array([pair.first for pair in pairs], int),
            np.array([pair.second for pair in pairs], int),
            np.array([rotation for rotation, _ in found]),
            np.array([direction for _, direction in found]),
        )

    def rotation_errors_deg(self, first: Poses, second: Poses) -> Floats:
        """Returns the angles between the measured rotations and those of the poses of first and second images."""
        turns = np.einsum("nij,nkj,nik->n", second.rotations[self.second], first.rotations[self.first], self.rotations)
        angles: Floats = np.degrees(np.arccos(np.clip((turns - 1) / 2, -1, 1)))
        return angles

    def lengths(self, first: Poses, second: Poses) -> Floats:
        """Returns the distances of the centres of first and second images."""
        lengths: Floats = np.linalg.norm(second.centres[self.second] - first.centres[self.first], axis=1)
        return lengths

    def direction_errors_deg(self, first: Poses, second: Poses) -> Floats:
        """Returns the angles between the measured directions and those of the poses, seen by the first images."""
        between = second.centres[self.second] - first.centres[self.first]
        given = np.einsum("nij,nj->ni", first.rotations[self.first], between)
        sines = np.linalg.norm(np.cross(given, self.directions), axis=1)
        angles: Floats = np.degrees(np.arctan2(sines, np.sum(given * self.directions, axis=1)))
        return angles

    def position_error(self, poses: Poses) -> float:
        """Returns the distance of a second camera from the measured line through the first one, in the median of the
        pairs; NaN if no line is known."""
        lengths, angles = self.lengths(poses, poses), self.direction_errors_deg(poses, poses)
        # A camera that lies behind is as far off as its distance.
        distances = lengths * np.sin(np.radians(np.minimum(angles, 90)))
        known = distances[np.isfinite(distances)]
        return float(np.median(known)) if len(known) else np.nan

    def turn_of_world(self, poses: Poses) -> Floats | None:
        """Returns the rotation that turns the measured directions, in the world of the poses' rotations, onto those
        between the poses' centres; None if they do not determine one."""
        is_known = np.isfinite(self.directions).all(axis=1)
        first, second = poses.take(self.first[is_known]), poses.take(self.second[is_known])
        measured = np.einsum("nji,nj->ni", first.rotations, self.directions[is_known])
        given = second.centres - first.centres
        lengths = np.linalg.norm(given, axis=1)
        has_both = lengths > 0
        measured, given = measured[has_both], given[has_both] / lengths[has_both, None]
        if len(given) < MIN_NUM_DIRECTIONS:
            return None
        weights, turn = np.ones(len(given)), np.eye(3)
        for _ in range(NUM_REWEIGHTINGS):
            u, singular, vt = np.linalg.svd((given * weights[:, None]).T @ measured)
            if singular[1] < MIN_SINGULAR_RATIO * singular[0]:
                return None
            turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
            weights = 1 / (np.linalg.norm(given - measured @ turn.T, axis=1) + ROBUST_RAD)
        return turn


def _nothing() -> tuple[Floats, Floats]:
    return np.full((3, 3), np.nan), np.full(3, np.nan)


def _estimate(pair: MatchedPair) -> tuple[Floats, Floats]:
    import cv2

    is_forward = (pair.rays1[:, 2] > MIN_FORWARD) & (pair.rays2[:, 2] > MIN_FORWARD)
    points1, points2 = (rays[is_forward, :2] / rays[is_forward, 2:] for rays in (pair.rays1, pair.rays2))
    if len(points1) < 8:
        return _nothing()
    cv2.setRNGSeed(0)
    essential, mask = cv2.findEssentialMat(points1, points2, np.eye(3), cv2.RANSAC, 0.999, MAX_ERROR_PX / pair.focal_px)
    if essential is None or essential.shape != (3, 3):
        return _nothing()
    is_inlier = mask.ravel() > 0
    rays1, rays2 = pair.rays1[is_forward][is_inlier], pair.rays2[is_forward][is_inlier]
    first, second, translation = (np.array(part, float) for part in cv2.decomposeEssentialMat(essential))
    shifts = translation[:, 0], -translation[:, 0]
    candidates = [(turn, -turn.T @ shift) for turn in (first, second) for shift in shifts]
    counts = [_count_in_front(*candidate, rays1, rays2) for candidate in candidates]
    return candidates[int(np.argmax(counts))] if max(counts) >= MIN_NUM_IN_FRONT else _nothing()


def _count_in_front(rotation: Floats, direction: Floats, rays1: Floats, rays2: Floats) -> int:
    """Returns how many rays meet in front of both cameras, and not too far off. OpenCV's recoverPose takes 50 times as
    long to find the same."""
    turned = rays2 @ rotation
    across = np.cross(rays1, turned)
    squares = np.maximum(np.sum(across**2, axis=1), np.finfo(float).tiny)
    depths = np.stack([np.sum(np.cross(direction, rays) * across, axis=1) / squares for rays in (turned, rays1)])
    return int(np.count_nonzero(np.all((depths > 0) & (depths < MAX_DEPTH), axis=0)))
