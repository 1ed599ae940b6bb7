"""Geographic coordinates: a local frame of the model, x east, y north, z up, in metres. Needs pyproj."""

import dataclasses
import json
import math
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc.errors import InputError

FILE_NAME = "geo.json"
WGS84_3D = "EPSG:4979"
_STEP = "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84"

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class GeoOrigin:
    """The origin of a local frame on the ellipsoid WGS 84."""

    latitude_deg: float
    longitude_deg: float
    height_m: float  # above the ellipsoid

    def __post_init__(self) -> None:
        values = dataclasses.astuple(self)
        if not (all(map(math.isfinite, values)) and abs(values[0]) <= 90 and abs(values[1]) <= 360):
            raise InputError(f"{values[0]:g}, {values[1]:g}, {values[2]:g} is not a latitude, longitude and height")

    @staticmethod
    def parse(text: str) -> "GeoOrigin":
        """Parses `latitude,longitude,height`."""
        try:
            latitude, longitude, height = (float(word) for word in text.split(","))
        except ValueError:
            raise InputError(f"expected LATITUDE,LONGITUDE,HEIGHT, found '{text}'") from None
        return GeoOrigin(latitude, longitude, height)

    def write(self, folder: pathlib.Path) -> None:
        """Writes geo.json beside a model."""
        content = {**dataclasses.asdict(self), "frame": "ENU", "ellipsoid": "WGS84"}
        (folder / FILE_NAME).write_text(json.dumps(content) + "\n")

    @staticmethod
    def read(folder: pathlib.Path) -> "GeoOrigin | None":
        """Reads geo.json beside a model; None if there is none."""
        path = folder / FILE_NAME
        if not path.exists():
            return None
        try:
            content = json.loads(path.read_text())
            if (content["frame"], content["ellipsoid"]) != ("ENU", "WGS84"):
                raise ValueError
            return GeoOrigin(*(float(content[name]) for name in ("latitude_deg", "longitude_deg", "height_m")))
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{path}: is not a file that lazyloc import has written") from None

    def from_geodetic(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike) -> Array:
        """Returns points in the local frame, n x 3."""
        return _transform(self._transformer(_STEP), longitude_deg, latitude_deg, height_m)

    def to_geodetic(self, points: Array) -> Array:
        """Returns latitudes and longitudes in degrees, and heights, n x 3."""
        return _transform(self._transformer(_STEP), *points.T, direction="INVERSE")[:, [1, 0, 2]]

    def from_geocentric(self, points: Array) -> Array:
        """Returns geocentric points (ECEF) in the local frame, n x 3."""
        return _transform(self._transformer("+proj=pipeline"), *points.T)

    def axes(self) -> Array:
        """Returns the rotation from the geocentric frame to the local one."""
        return local_axes(self.latitude_deg, self.longitude_deg)

    def _transformer(self, steps: str) -> Any:
        import pyproj

        origin = f"+lat_0={self.latitude_deg!r} +lon_0={self.longitude_deg!r} +h_0={self.height_m!r}"
        return pyproj.Transformer.from_pipeline(f"{steps} +step +proj=topocentric +ellps=WGS84 {origin}")


def local_axes(latitude_deg: float, longitude_deg: float) -> Array:
    """Returns the rotation from the geocentric frame to the frame east, north, up at a point."""
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    east = [-math.sin(longitude), math.cos(longitude), 0.0]
    up = [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    return np.stack([east, np.cross(up, east), up])


def to_geodetic(crs: str, points: Array) -> Array:
    """Returns points of a coordinate reference system as latitude, longitude and height on WGS 84, n x 3."""
    import pyproj

    try:
        transformer = pyproj.Transformer.from_crs(pyproj.CRS.from_user_input(crs), WGS84_3D, always_xy=True)
        return _transform(transformer, *points.T, errcheck=True)[:, [1, 0, 2]]
    except pyproj.exceptions.ProjError as error:
        raise InputError(f"--crs {crs[:40]}: {str(error).splitlines()[0][:120]}") from None


def _transform(transformer: Any, *columns: ArrayLike, **options: Any) -> Array:
    """Returns transformed points, n x 3."""
    # Give lists, because pyproj takes arrays of one element for numbers, which numpy will refuse.
    lists = [np.atleast_1d(column).tolist() for column in columns]
    return np.stack([np.asarray(column, float) for column in transformer.transform(*lists, **options)], axis=1)


class Georeference:
    """Turns positions and axes of a file into a local frame: those of a coordinate reference system, or geographic
    ones if `crs` is None."""

    def __init__(self, positions: Array, crs: str | None, origin: GeoOrigin | None):
        """`positions`: x, y, z in the reference system, or latitude, longitude, height; one row for each image."""
        self._crs, self._positions = crs, positions
        self._geodetic = positions if crs is None else to_geodetic(crs, positions)
        for row in self._geodetic:
            GeoOrigin(*row.tolist())  # checks the ranges
        self.origin = origin or GeoOrigin(*(round(value, 8) for value in self._mean().tolist()))
        self.positions = self.origin.from_geodetic(*self._geodetic.T)

    def axes(self, index: int) -> Array:
        """Returns the rotation from the file's axes at an image to the local frame: east, north and up there, or the
        axes of the grid, which may be turned against north by some degrees."""
        if self._crs is None:
            latitude, longitude, _ = self._geodetic[index].tolist()
            return self.origin.axes() @ local_axes(latitude, longitude).T
        steps = self._positions[index] + np.concatenate([np.eye(3), -np.eye(3)])
        points = self.origin.from_geodetic(*to_geodetic(self._crs, steps).T)
        u, _, vt = np.linalg.svd((points[:3] - points[3:]).T)
        return np.asarray(u @ vt)

    def _mean(self) -> Array:
        longitudes = np.radians(self._geodetic[:, 1])
        # Use the mean direction, because longitudes jump at 180 degrees.
        longitude = math.degrees(math.atan2(np.sin(longitudes).mean(), np.cos(longitudes).mean()))
        return np.array([self._geodetic[:, 0].mean(), longitude, self._geodetic[:, 2].mean()])
