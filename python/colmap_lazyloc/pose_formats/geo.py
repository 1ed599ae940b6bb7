"""Geographic coordinates: a local frame of the model, x east, y north, z up, in metres. Needs pyproj."""

import dataclasses
import functools
import json
import math
import pathlib
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc.errors import InputError, logger

FILE_NAME = "geo.json"
MIN_HEIGHT_M, MAX_HEIGHT_M = -5000.0, 50_000.0
AREA_MARGIN_DEG = 1.0  # surveys near the border of a zone are often in its system: Aachen, 5.9 east, in that from 6 on
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
            raise InputError(f"--geo_origin: expected LATITUDE,LONGITUDE,HEIGHT, found '{text}'") from None
        return GeoOrigin(latitude, longitude, height)

    @staticmethod
    def in_the_middle(points: Array) -> "GeoOrigin":
        """Returns the mean of geocentric points, n x 3, with degrees rounded to a millimetre."""
        latitudes, longitudes, heights = to_geodetic(find_crs("EPSG:4978"), points).T
        # Use the mean direction, because longitudes jump at 180 degrees.
        longitude = np.degrees(np.angle(np.exp(1j * np.radians(longitudes)).mean()))
        return GeoOrigin(*(round(float(value), 8) for value in (latitudes.mean(), longitude, heights.mean())))

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

    def _transformer(self, steps: str) -> Any:
        import pyproj

        origin = f"+lat_0={self.latitude_deg!r} +lon_0={self.longitude_deg!r} +h_0={self.height_m!r}"
        return pyproj.Transformer.from_pipeline(f"{steps} +step +proj=topocentric +ellps=WGS84 {origin}")


def local_axes(origin: GeoOrigin) -> Array:
    """Returns the rotation from the geocentric frame to the local one."""
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    east = [-math.sin(longitude), math.cos(longitude), 0.0]
    up = [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    return np.stack([east, np.cross(up, east), up])


@functools.lru_cache
def find_crs(text: str) -> Any:
    """Returns the coordinate reference system of a name, such as EPSG:32632."""
    import pyproj

    try:
        crs = pyproj.CRS.from_user_input(text)
    except pyproj.exceptions.ProjError as error:
        raise InputError(f"--crs {text[:40]}: {str(error).splitlines()[0][:120]}") from None
    axes = crs.axis_info
    if crs.is_projected and len(axes) == 2 and axes[0].unit_conversion_factor != 1:
        raise InputError(
            f"--crs {text[:40]}: is in the unit {axes[0].unit_name}, which leaves that of heights open: name the "
            "system of the heights, too, such as EPSG:2232+6360 (NAVD88 in feet) or EPSG:2232+5703 (in metres)"
        )
    missing = _missing_geoids(crs) if crs.is_compound else []
    if missing:
        logger.warning(
            "--crs %s: heights above the sea are used as heights above the ellipsoid, up to 100 m off, because PROJ "
            "has no grid of the geoid (%s; pyproj sync --file %s fetches it)",
            text[:40],
            missing[0],
            missing[0],
        )
    return crs


def _missing_geoids(crs: Any) -> list[str]:
    """Returns the grids that PROJ needs for heights of a reference system, if it has none of them."""
    import pyproj

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pyproj's own line on these grids
        group = pyproj.transformer.TransformerGroup(crs, WGS84_3D, always_xy=True)
    if group.best_available:
        return []
    grids = [grid for operation in group.unavailable_operations for grid in operation.grids]
    return [grid.short_name for grid in grids if not grid.available]


def to_geodetic(crs: Any, points: Array) -> Array:
    """Returns latitude, longitude and height on WGS 84 of points of a reference system, n x 3. The first coordinate of
    points is the longitude or east. The result is not finite where a point is outside of the system."""
    import pyproj

    try:
        transformer = pyproj.Transformer.from_crs(crs, WGS84_3D, always_xy=True)
        geodetic = _transform(transformer, *points.T)[:, [1, 0, 2]]
    except pyproj.exceptions.ProjError as error:
        raise InputError(f"--crs {str(crs)[:40]}: {str(error).splitlines()[0][:120]}") from None
    outside = (np.abs(geodetic[:, 0]) > 90) | (np.abs(geodetic[:, 1]) > 360) | ~is_height(geodetic[:, 2])
    geodetic[outside] = np.nan
    return geodetic


def is_height(heights_m: ArrayLike) -> NDArray[np.bool_]:
    """True for heights that photos have; others, such as -9999 or 99999, mean that they are not known."""
    heights = np.asarray(heights_m, float)
    return (heights > MIN_HEIGHT_M) & (heights < MAX_HEIGHT_M)


def from_geodetic(crs: Any, geodetic: Array) -> Array:
    """Returns points of a reference system, n x 3: the inverse of to_geodetic."""
    import pyproj

    latitudes, longitudes, heights = geodetic.T
    return _transform(pyproj.Transformer.from_crs(WGS84_3D, crs, always_xy=True), longitudes, latitudes, heights)


def warn_outside(name: str, geodetic: Array) -> None:
    """Warns of positions, n x 3, that are outside of the area of use of a reference system."""
    crs = find_crs(name)
    area = next((part.area_of_use for part in (crs, *crs.sub_crs_list) if part.area_of_use is not None), None)
    if area is None:
        return
    latitudes, longitudes, _ = geodetic.T
    width = (area.east - area.west) % 360 or 360  # across 180 degrees, too
    is_inside = (longitudes - area.west + AREA_MARGIN_DEG) % 360 <= width + 2 * AREA_MARGIN_DEG
    is_inside &= (latitudes >= area.south - AREA_MARGIN_DEG) & (latitudes <= area.north + AREA_MARGIN_DEG)
    if not is_inside.all():
        logger.warning(
            "--crs %s: %d of %d positions are outside of its area of use, longitudes %g to %g and latitudes %g to %g: "
            "use the reference system of this place",
            name[:40],
            np.count_nonzero(~is_inside),
            len(geodetic),
            area.west,
            area.east,
            area.south,
            area.north,
        )


def to_geocentric(geodetic: Array) -> Array:
    """Returns geocentric points of latitudes, longitudes and heights, n x 3."""
    import pyproj

    latitudes, longitudes, heights = geodetic.T
    return _transform(pyproj.Transformer.from_pipeline(_STEP), longitudes, latitudes, heights)


def _transform(transformer: Any, *columns: ArrayLike, **options: Any) -> Array:
    """Returns transformed points, n x 3."""
    # Give lists, because pyproj takes arrays of one element for numbers, which numpy will refuse.
    lists = [np.atleast_1d(column).tolist() for column in columns]
    return np.stack([np.asarray(column, float) for column in transformer.transform(*lists, **options)], axis=1)
