"""The world of a file: the one transform of its positions and rotations into the frame of a model."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.geo import (
    GeoOrigin,
    find_crs,
    from_geodetic,
    local_axes,
    to_geocentric,
    to_geodetic,
    warn_outside,
)
from colmap_lazyloc.poses import Pose

GEOGRAPHIC = "EPSG:4979"  # longitude, latitude in degrees, height above the ellipsoid
GEOCENTRIC = "EPSG:4978"
STEP_M = 10.0  # over which the axes of a grid are measured

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Similarity:
    """A transform x -> matrix x + offset; the matrix is a rotation times a scale, or nearly so."""

    matrix: Array
    offset: Array

    def inverse(self) -> "Similarity":
        matrix = np.asarray(np.linalg.inv(self.matrix), float)
        return Similarity(matrix, -matrix @ self.offset)


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """The world of a file's poses.

    Its coordinates are those of a reference system, x east, y north, z up, or of the local frame (east, north, up) at
    an origin; if it has neither, they belong to no known place. In a reference system, rotations are relative to the
    axes of its grid at each camera: to east, north, up in a geographic one, and to the system's axes in a geocentric
    one. With `true_north`, they are relative to one frame (east, north, up) for all, that in their middle.
    """

    crs: str | None = None
    origin: GeoOrigin | None = None
    true_north: bool = False

    @property
    def is_geographic(self) -> bool:
        return self.crs is not None or self.origin is not None

    @property
    def is_in_degrees(self) -> bool:
        """True if coordinates are longitudes and latitudes, which are those of a centre: no rotation turns them."""
        return self.crs is not None and bool(find_crs(self.crs).is_geographic)

    @property
    def is_geocentric(self) -> bool:
        return self.crs is not None and bool(find_crs(self.crs).is_geocentric)

    def to_local(self, poses: Sequence[Pose], origin: GeoOrigin | None) -> tuple[list[Pose | None], GeoOrigin | None]:
        """Returns the poses in the local frame at `origin`, by default in their middle, and the origin of the frame.

        A pose is None if its position is not on the Earth. Poses of no known place, and of the right local frame, are
        returned as they are.
        """
        if self.crs is None and (self.origin is None or origin in (None, self.origin)):
            return list(poses), self.origin
        centres = np.array([pose.cam_in_world for pose in poses]).reshape(-1, 3)
        points, axes = self._on_earth(centres)
        known = np.all(np.isfinite(points), axis=1)
        if not known.any():
            raise InputError("no position is on the Earth, or in the reference system")
        middle = GeoOrigin.in_the_middle(points[known])
        origin = origin or middle
        turns = np.broadcast_to(local_axes(middle).T, (len(points), 3, 3)) if self.true_north else axes
        moved: list[Pose | None] = [None] * len(poses)
        for index, centre in zip(np.flatnonzero(known), origin.from_geocentric(points[known])):
            world_from_cam = local_axes(origin) @ turns[index] @ poses[index].rotation.T
            moved[index] = Pose.from_centre(world_from_cam.T, centre)
        return moved, origin

    def from_local(self, poses: Sequence[Pose], origin: GeoOrigin | None) -> list[Pose]:
        """Returns poses of the local frame at `origin` in this one: the inverse of `to_local`."""
        if self.crs is None or not poses:
            return list(poses)
        if origin is None:
            raise InputError(f"--crs {self.crs}: the model has no place on the Earth")
        crs = find_crs(self.crs)
        geodetic = origin.to_geodetic(np.array([pose.cam_in_world for pose in poses]).reshape(-1, 3))
        warn_outside(self.crs, geodetic)
        centres = from_geodetic(crs, geodetic)
        if not np.all(np.isfinite(centres)):
            raise InputError(f"--crs {self.crs}: a photo is outside of the reference system")
        axes = self._axes(crs, centres, geodetic)
        if self.true_north:
            middle = GeoOrigin.in_the_middle(to_geocentric(geodetic))
            axes = np.broadcast_to(local_axes(middle).T, (len(poses), 3, 3))
        turns = (local_axes(origin) @ turn for turn in axes)
        return [Pose.from_centre(pose.rotation @ turn, centre) for pose, turn, centre in zip(poses, turns, centres)]

    def _on_earth(self, centres: Array) -> tuple[Array, Array]:
        """Returns geocentric points, and for each the rotation from the frame's axes to the geocentric ones."""
        if self.origin is not None:
            points = to_geocentric(self.origin.to_geodetic(centres))
            return points, np.broadcast_to(local_axes(self.origin).T, (len(points), 3, 3))
        assert self.crs is not None
        crs = find_crs(self.crs)
        if crs.is_geocentric:
            return centres, self._axes(crs, centres, centres)
        geodetic = to_geodetic(crs, centres)
        # Without a fix, receivers write 0, 0.
        geodetic[(centres[:, 0] == 0) & (centres[:, 1] == 0)] = np.nan
        return to_geocentric(geodetic), self._axes(crs, centres, geodetic)

    @staticmethod
    def _axes(crs: Any, centres: Array, geodetic: Array) -> Array:
        """Returns the rotations from the axes of a reference system to the geocentric ones at n points."""
        if crs.is_geocentric:
            return np.broadcast_to(np.eye(3), (len(centres), 3, 3))
        if crs.is_geographic:
            known = np.all(np.isfinite(geodetic), axis=1)
            return np.array(
                [local_axes(GeoOrigin(*row)).T if ok else np.eye(3) for row, ok in zip(geodetic.tolist(), known)]
            )
        return _grid_axes(crs, centres)


NO_FRAME = Frame()


def _grid_axes(crs: object, centres: Array) -> Array:
    """Returns the rotations from the axes of a grid to the geocentric ones at n points."""
    steps = STEP_M * np.concatenate([np.eye(3), -np.eye(3)])
    points = to_geocentric(to_geodetic(crs, (centres[:, None] + steps).reshape(-1, 3))).reshape(-1, 6, 3)
    columns = np.swapaxes(points[:, :3] - points[:, 3:], 1, 2)
    u, _, vt = np.linalg.svd(np.where(np.isfinite(columns), columns, 0))
    axes: Array = u @ vt
    return axes


def apply(similarity: Similarity, pose: Pose) -> Pose:
    """Returns a pose whose world was transformed."""
    u, _, vt = np.linalg.svd(similarity.matrix)
    return Pose.from_centre(pose.rotation @ (u @ vt).T, similarity.matrix @ pose.cam_in_world + similarity.offset)
