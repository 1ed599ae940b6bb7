"""Chooses pairs of images by their poses, in a sequence, or all of two lists."""

import itertools
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.pose_formats.posed_images import PosedImage

MAX_ANGLE_DEG = 90.0  # between viewing directions
SAME_PLACE = 1e-9  # of the extent of all
BLOCK = 512  # images whose distances to all others are computed at once


def pairs_by_viewpoint(images: Sequence[PosedImage], num_neighbors: int) -> list[tuple[str, str]]:
    """Returns pairs of each image with those from the nearest viewpoints that look about the same way.

    The viewpoint distance is the root of (2 sin(angle / 2))^2 + (displacement / d)^2. How far the scene is, is not
    known: d is the distance to the camera that is `num_neighbors` places away, so that a walk is treated as a room is.
    """
    centres = np.array([image.cam_from_world.cam_in_world for image in images])
    axes = np.array([image.cam_from_world.rotation[2] for image in images])
    extent = float(np.linalg.norm(np.ptp(centres, axis=0)))
    near = min(num_neighbors, len(images) - 1)
    pairs = set()
    for begin in range(0, len(images), BLOCK):
        rows = np.arange(begin, min(begin + BLOCK, len(images)))
        displacement = np.linalg.norm(centres[rows, None] - centres, axis=2)
        # Leave out the image itself, and faces of the same panorama, because they see no point apart.
        displacement[displacement <= SAME_PLACE * extent] = np.inf
        scale = np.minimum(np.partition(displacement, near - 1, axis=1)[:, near - 1 : near], extent)
        cosine = np.clip(axes[rows] @ axes.T, -1, 1)
        distance = 2 - 2 * cosine + (displacement / np.maximum(scale, np.finfo(float).tiny)) ** 2
        distance[cosine < np.cos(np.radians(MAX_ANGLE_DEG))] = np.inf
        for row, order in zip(rows, np.argsort(distance, axis=1, kind="stable")[:, :near]):
            pairs |= {
                (min(row, other), max(row, other)) for other in order if np.isfinite(distance[row - begin, other])
            }
    return [(images[first].name, images[second].name) for first, second in sorted(pairs)]


def pairs_in_sequence(names: Sequence[str], reach: int) -> list[tuple[str, str]]:
    """Returns the pairs of names that are at most `reach` places apart."""
    return [(name, other) for index, name in enumerate(names) for other in names[index + 1 : index + 1 + reach]]


def all_pairs(names: Sequence[str], others: Sequence[str] | None = None) -> list[tuple[str, str]]:
    """Returns the pairs of each name with each other one, or with each of a second list."""
    return list(itertools.combinations(names, 2) if others is None else itertools.product(names, others))
