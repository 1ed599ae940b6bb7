"""Renders textured rectangles by ray casting through COLMAP's camera models.

The ray of each pixel comes from COLMAP's own undistortion. A texture point therefore appears exactly where COLMAP
projects it, for any camera model. Supersampling and image pyramids avoid aliasing.
"""

import dataclasses
import functools
from collections.abc import Callable

import cv2
import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

NEAR = 0.05  # smallest depth that is rendered, in metres
PYRAMID_LEVELS = 8


@dataclasses.dataclass(frozen=True, eq=False)
class Rectangle:
    """A flat picture in the world. It is visible only from the side from which `down` is clockwise of `right`."""

    corner: Array  # the texture's upper-left corner
    right: Array  # the upper edge: a vector of the edge's length
    down: Array  # the left edge
    texture: Array  # height x width x 3, uint8

    def point(self, column: float, row: float) -> Array:
        """Returns the world point of a texture position; (0.5, 0.5) is the centre of the first texel."""
        height, width = self.texture.shape[:2]
        return self.corner + self.right * (column / width) + self.down * (row / height)

    @functools.cached_property
    def pyramid(self) -> list[Array]:
        levels = [self.texture]
        while len(levels) < PYRAMID_LEVELS and min(levels[-1].shape[:2]) > 2:
            height, width = levels[-1].shape[:2]
            levels.append(cv2.resize(levels[-1], ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA))
        return levels


class RayGrid:
    """The rays (x, y, 1) of a camera's pixels, supersampling x supersampling of them in each pixel."""

    def __init__(self, camera: Camera, supersampling: int = 2):
        colmap_camera = to_pycolmap_camera(camera)
        self.supersampling = supersampling
        # Follow COLMAP's convention: the image spans [0, width] x [0, height], and pixel centres are at halves.
        columns = (np.arange(camera.width * supersampling) + 0.5) / supersampling
        rows = (np.arange(camera.height * supersampling) + 0.5) / supersampling
        grid = np.stack(np.meshgrid(columns, rows), axis=-1)
        rays = colmap_camera.cam_from_img(grid.reshape(-1, 2)).reshape(grid.shape)
        self.x, self.y = (np.ascontiguousarray(rays[..., axis], np.float32) for axis in (0, 1))
        self.area = 1.0 / (colmap_camera.mean_focal_length() * supersampling) ** 2
        self._x_range = self.x.min(axis=0), self.x.max(axis=0)
        self._y_range = self.y.min(axis=1), self.y.max(axis=1)

    def window(self, polygon: Array) -> tuple[slice, ...] | None:
        """Returns slices of the rows and columns that hold all rays inside the polygon's bounding box, or None."""
        slices = []
        for (low, high), values in ((self._y_range, polygon[:, 1]), (self._x_range, polygon[:, 0])):
            inside = np.flatnonzero((high >= values.min()) & (low <= values.max()))
            if inside.size == 0:
                return None
            slices.append(slice(inside[0], inside[-1] + 1))
        return tuple(slices)


def _project_polygon(corners: Array) -> Array:
    """Returns the part of a polygon (n x 3, camera frame) beyond the near plane, as n x 2 normalized image points."""
    kept = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0)):
        if start[2] >= NEAR:
            kept.append(start)
        if (start[2] >= NEAR) != (end[2] >= NEAR):
            kept.append(start + (end - start) * (NEAR - start[2]) / (end[2] - start[2]))
    points = np.array(kept).reshape(-1, 3)
    projected: Array = points[:, :2] / points[:, 2:]
    return projected


def _look_up(texture: Array, u: Array, v: Array) -> Array:
    """Samples the texture bilinearly at positions u, v in [0, 1]."""
    row_length = 4096  # cv2.remap takes a picture of at most 32767 columns
    count = -(-u.size // row_length) * row_length
    columns, rows = np.zeros(count, np.float32), np.zeros(count, np.float32)
    height, width = texture.shape[:2]
    columns[: u.size], rows[: u.size] = u * width - 0.5, v * height - 0.5
    shape = (-1, row_length)
    found = cv2.remap(
        texture, columns.reshape(shape), rows.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return found.reshape(-1, 3)[: u.size]


def _shade(rectangle: Rectangle, u: Array, v: Array, footprint: Array) -> Array:
    """Returns colours at u, v from the two pyramid levels that fit the rays' footprint (in square texels) best."""
    pyramid = rectangle.pyramid
    level = np.clip(0.5 * np.log2(footprint), 0, len(pyramid) - 1)
    colour = np.zeros((u.size, 3), np.float32)
    for index, texture in enumerate(pyramid):
        weight = 1 - np.abs(level - index)
        used = np.flatnonzero(weight > 0)
        if used.size > 0:
            colour[used] += weight[used, None] * _look_up(texture, u[used], v[used])
    return colour


def render(rectangles: list[Rectangle], rays: RayGrid, pose: Pose, sky: Callable[[Array], Array]) -> Array:
    """Renders the picture (height x width x 3, float32) that a camera sees.

    sky: returns the colours of n x 3 directions in the world; used for rays that meet no rectangle.
    """
    rotation, translation = pose.rotation, pose.tvec
    nearest = np.zeros(rays.x.shape, np.float32)  # inverse depth
    owner = np.full(rays.x.shape, -1, np.int32)
    u, v = np.zeros_like(nearest), np.zeros_like(nearest)
    determinants = {}
    for index, rectangle in enumerate(rectangles):
        corner = rotation @ rectangle.corner + translation
        right, down = rotation @ rectangle.right, rotation @ rectangle.down
        if np.cross(right, down) @ corner <= 0:  # the rectangle is seen from behind
            continue
        polygon = _project_polygon(np.array([corner, corner + right, corner + right + down, corner + down]))
        window = rays.window(polygon) if len(polygon) > 0 else None
        if window is None:
            continue
        # A ray meets the plane where depth * (x, y, 1) = u right + v down + corner: a 3x3 solve, linear in x and y,
        # gives (u, v, 1) / depth.
        solve = np.linalg.inv(np.column_stack([right, down, corner]))
        determinants[index] = np.linalg.det(solve)
        x, y = rays.x[window], rays.y[window]
        a, b, c = (np.float32(row[0]) * x + np.float32(row[1]) * y + np.float32(row[2]) for row in solve)
        hit = (c > nearest[window]) & (a >= 0) & (b >= 0) & (a <= c) & (b <= c) & (c < 1 / NEAR)
        nearest[window][hit], owner[window][hit] = c[hit], index
        u[window][hit], v[window][hit] = a[hit] / c[hit], b[hit] / c[hit]

    colours = np.empty((owner.size, 3), np.float32)
    for index, determinant in determinants.items():
        seen = np.flatnonzero(owner == index)
        height, width = rectangles[index].texture.shape[:2]
        # d(u, v) / d(x, y) has the determinant det(solve) * depth^3.
        footprint = abs(determinant) * rays.area * height * width / nearest.flat[seen] ** 3
        colours[seen] = _shade(rectangles[index], u.flat[seen], v.flat[seen], footprint)
    empty = np.flatnonzero(owner < 0)
    directions = np.stack([rays.x.flat[empty], rays.y.flat[empty], np.ones(empty.size, np.float32)], axis=1)
    colours[empty] = sky(directions @ rotation.astype(np.float32))
    height, width = owner.shape
    size = width // rays.supersampling, height // rays.supersampling
    return cv2.resize(colours.reshape(height, width, 3), size, interpolation=cv2.INTER_AREA)
