"""Makes scene points of which some look like others: walls of equal tiles, windows or bays, symmetric objects."""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from colmap_lazyloc.poses import Pose

FAR = 1e9  # distance of two viewpoints from which nothing looks the same


@dataclasses.dataclass
class World:
    """Scene points, some of which look alike: `base` points repeat in `num_copies` copies, the others are unique."""

    points: np.ndarray  # n x 3; copy c of base point b is at index c * num_base + b, unique points follow
    num_base: int
    num_copies: int
    is_cyclic: bool  # the last copy is followed by the first one
    normals: np.ndarray | None  # n x 3: a point is visible from the side that its normal points to
    # Returns how far apart two viewpoints are, in units of a viewpoint change that halves the matches, if the second
    # camera is taken for one that stands `shift` copies farther on.
    view_distance: Callable[[Pose, Pose, int], float]

    def counterpart(self, points: np.ndarray, shift: int) -> np.ndarray:
        """Returns the points that look like `points` in the copies `shift` farther on; -1 beyond the last copy."""
        copies = points // self.num_base + shift
        if self.is_cyclic:
            copies %= self.num_copies
        shifted = np.where(
            (copies >= 0) & (copies < self.num_copies), copies * self.num_base + points % self.num_base, -1
        )
        return np.where(points < self.num_base * self.num_copies, shifted, points)


def corridor(rng, period=1.0, num_base=40, num_copies=24, num_unique=60) -> World:
    """Makes a corridor of 2.4 x 2.4 units along x, of identical tiles."""
    length = period * num_copies

    def on_walls(num, depth):
        x, angle = rng.uniform(0, depth, num), rng.uniform(-1.2, 1.2, num)
        side = rng.integers(0, 4, num)
        y = np.choose(side, [np.full(num, -1.2), np.full(num, 1.2), angle, angle])
        z = np.choose(side, [angle, angle, np.full(num, -1.2), np.full(num, 1.2)])
        return np.stack([x, y, z], axis=1)

    base = on_walls(num_base, period)
    copies = [base + [c * period, 0, 0] for c in range(num_copies)]
    points = np.concatenate([*copies, on_walls(num_unique, length)])

    def distance(pose1, pose2, shift):
        offset = pose2.cam_in_world + [shift * period, 0, 0] - pose1.cam_in_world
        turn = np.degrees(np.arccos(np.clip(pose1.rotation[2] @ pose2.rotation[2], -1, 1)))
        return np.linalg.norm(offset) / 1.5 + turn / 30

    return World(points, num_base, num_copies, False, None, distance)


def facade(rng, period=2.0, num_base=50, num_copies=20, num_unique=300) -> World:
    """Makes a facade of identical windows along x, in the plane z = 0."""
    window = rng.uniform([0, -3, 0], [period, 3, 0.3], (num_base, 3))
    shifts = (np.arange(num_copies) - num_copies / 2) * period
    half = num_copies * period / 2
    unique = rng.uniform([-half, -3, -1.5], [half, 3, 0.3], (num_unique, 3))
    points = np.concatenate([*(window + [shift, 0, 0] for shift in shifts), unique])

    def distance(pose1, pose2, shift):
        return np.linalg.norm(pose2.cam_in_world + [shift * period, 0, 0] - pose1.cam_in_world) / 4

    return World(points, num_base, num_copies, False, None, distance)


def turned(angle):
    return Rotation.from_euler("y", angle).as_matrix()


def symmetric_object(rng, num_copies=2, num_base=150, num_unique=40) -> World:
    """Makes a turntable object of radius 1 that looks the same after a turn by 360 / num_copies degrees."""
    step = 2 * np.pi / num_copies
    angle, height = rng.uniform(0, step, num_base), rng.uniform(-0.8, 0.8, num_base)
    radius = 1 + 0.15 * np.cos(7 * angle) + rng.uniform(-0.1, 0.1, num_base)
    base = np.stack([radius * np.sin(angle), height, radius * np.cos(angle)], axis=1)
    angle, height = rng.uniform(0, 2 * np.pi, num_unique), rng.uniform(-0.8, 0.8, num_unique)
    unique = np.stack([np.sin(angle), height, np.cos(angle)], axis=1)
    points = np.concatenate([*(base @ turned(c * step).T for c in range(num_copies)), unique])

    def distance(pose1, pose2, shift):
        moved = turned(shift * step) @ pose2.cam_in_world
        cosine = moved @ pose1.cam_in_world / np.linalg.norm(moved) / np.linalg.norm(pose1.cam_in_world)
        return np.degrees(np.arccos(np.clip(cosine, -1, 1))) / 25

    return World(points, num_base, num_copies, True, points * [1, 0, 1], distance)


def mirrored_room(rng, num_base=120, num_unique=40) -> World:
    """Makes two walls that mirror each other in the plane x = 0, of details that look the same in a mirror."""
    base = np.stack([rng.uniform(2.8, 3.2, num_base), rng.uniform(-2, 2, num_base), rng.uniform(-3, 3, num_base)], 1)
    unique = rng.uniform([-3, -2, -3], [3, 2, 3], (num_unique, 3))
    unique[:, 0] = np.where(unique[:, 0] > 0, 3, -3)
    points = np.concatenate([base, base * [-1, 1, 1], unique])
    mirror = np.array([-1, 1, 1])

    def distance(pose1, pose2, shift):
        centre, axis = pose2.cam_in_world, pose2.rotation[2]
        if shift % 2:
            centre, axis = centre * mirror, axis * mirror
        turn = np.degrees(np.arccos(np.clip(pose1.rotation[2] @ axis, -1, 1)))
        return np.linalg.norm(centre - pose1.cam_in_world) / 3 + turn / 40

    return World(points, num_base, 2, True, points * [-1, 0, 0], distance)


def cloud(rng, num_points=300) -> World:
    """Makes points in a cube of 3 units around the origin; none looks like another."""
    points = rng.uniform(-1.5, 1.5, (num_points, 3))

    def distance(pose1, pose2, shift):
        cosine = pose1.rotation[2] @ pose2.rotation[2]
        return FAR if shift else np.degrees(np.arccos(np.clip(cosine, -1, 1))) / 60

    return World(points, 1, 0, False, None, distance)
