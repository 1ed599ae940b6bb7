"""Finds where the localized queries are, in each system of coordinates in which that is known."""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.geo import find_crs, from_geodetic, warn_outside
from colmap_lazyloc.report.facts import METRE
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.results import pose_of, read_geodetic

METRE_DIGITS = 3  # after the point: a millimetre
DEGREE_DIGITS = 8  # a millimetre on the Earth
MAX_DIGITS = 9


@dataclasses.dataclass(frozen=True, eq=False)
class System:
    """Positions of the queries in one system of coordinates."""

    name: str
    axes: tuple[str, str, str]
    units: tuple[str, str, str]
    digits: tuple[int, int, int]  # after the point
    xyz: Array  # n x 3, in the order of the run's queries; NaN if there is no position


def find_systems(run: Run, crs: str | None = None) -> list[System]:
    """Returns the systems, the one of the model first. `crs`: the name of a reference system, such as EPSG:32632, in
    which geographic positions are wanted, too."""
    poses = [pose_of(result) for result in run.queries]
    xyz = np.array([[np.nan] * 3 if pose is None else pose.cam_in_world for pose in poses], float).reshape(-1, 3)
    digits = length_digits(run.unit, run.position_stddevs)
    systems = [System("Position", ("x", "y", "z"), (run.unit,) * 3, (digits,) * 3, xyz)]
    places = read_geodetic(run.path)
    if places:
        geodetic = np.array([places.get(name, [np.nan] * 3) for name in run.names], float)
        axes, units = ("latitude", "longitude", "height"), ("\u00b0", "\u00b0", METRE)
        systems.append(System("On the Earth", axes, units, (DEGREE_DIGITS, DEGREE_DIGITS, METRE_DIGITS), geodetic))
    if crs is not None:
        if not places:
            raise InputError(f"--crs {crs}: {run.path} has no geographic coordinates")
        system = in_reference_system(crs, systems[-1].xyz)
        if system is not None:
            warn_outside(crs, systems[-1].xyz[np.isfinite(systems[-1].xyz).all(axis=1)])
            systems.append(system)
    return systems


def in_reference_system(crs: str, geodetic: Array) -> System | None:
    """Returns latitudes, longitudes and heights, n x 3, in a projected or geocentric system; None for a system of
    latitudes and longitudes."""
    system = find_crs(crs)
    if system.is_geographic:
        return None
    axes = ("X", "Y", "Z") if system.is_geocentric else ("E", "N", "H")
    units = [METRE if axis.unit_conversion_factor == 1 else str(axis.unit_name) for axis in system.axis_info]
    if len(units) == 2:
        units.append(METRE)  # heights above the ellipsoid
    xyz = np.full(geodetic.shape, np.nan)
    is_known = np.isfinite(geodetic).all(axis=1)
    xyz[is_known] = from_geodetic(system, geodetic[is_known])
    xyz[~np.isfinite(xyz)] = np.nan
    return System(crs, axes, (units[0], units[1], units[2]), (METRE_DIGITS,) * 3, xyz)


def length_digits(unit: str, stddevs: Iterable[float]) -> int:
    """Returns how many digits after the point a position needs: in metres millimetres, else two of the smallest of its
    standard deviations."""
    known = [stddev for stddev in stddevs if 0 < stddev < math.inf]
    if unit == METRE or not known:
        return METRE_DIGITS
    return min(MAX_DIGITS, max(METRE_DIGITS, 1 - math.floor(math.log10(min(known)))))
