"""Rows of a run and what is computed from them."""

import csv
import dataclasses
import math
import pathlib

import numpy as np

from geometry import pose_errors
from methods import Result
from scenes import Scene

NUM_BOOTSTRAP_SAMPLES = 10000
BOOTSTRAP_SEED = 0
MIN_ERROR_CM = 1e-6  # keeps the logarithm of a ratio finite


@dataclasses.dataclass(frozen=True)
class Row:
    """One query of one method; the errors of a lost query are NaN."""

    tag: str
    scene: str
    query: str
    method: str
    position_error_cm: float
    rotation_error_deg: float
    seconds: float
    status: str

    @property
    def is_lost(self) -> bool:
        return math.isnan(self.position_error_cm)


@dataclasses.dataclass(frozen=True)
class Summary:
    """A lost query counts as an infinite error in the medians and is left out of the mean."""

    num_queries: int
    num_lost: int
    median_position_error_cm: float
    median_rotation_error_deg: float
    mean_position_error_cm: float
    median_seconds: float


@dataclasses.dataclass(frozen=True)
class Ratio:
    """Geometric mean over queries of the ratio of position errors, with its 95 % confidence interval."""

    mean: float
    low: float
    high: float
    num_queries: int


def make_row(tag: str, scene: Scene, query_name: str, method: str, result: Result) -> Row:
    """The scenes' unit is the metre."""
    position_error, rotation_error_deg = math.nan, math.nan
    if result.pose is not None:
        position_error, rotation_error_deg = pose_errors(result.pose, scene.pose(query_name))
    return Row(tag, scene.name, query_name, method, 100 * position_error, rotation_error_deg, result.seconds,
               result.status)


def summarize(rows: list[Row]) -> Summary:
    positions = np.array([row.position_error_cm for row in rows])
    rotations = np.array([row.rotation_error_deg for row in rows])
    localized = ~np.isnan(positions)
    return Summary(
        num_queries=len(rows),
        num_lost=int(np.sum(~localized)),
        median_position_error_cm=float(np.median(np.where(localized, positions, np.inf))),
        median_rotation_error_deg=float(np.median(np.where(localized, rotations, np.inf))),
        mean_position_error_cm=float(np.mean(positions[localized])) if localized.any() else math.nan,
        median_seconds=float(np.median([row.seconds for row in rows])))


def paired_ratio(rows: list[Row], baseline_rows: list[Row]) -> Ratio | None:
    """Over the queries that both localized. The bootstrap draws queries within each scene."""
    baseline = {(row.scene, row.query): row for row in baseline_rows if not row.is_lost}
    log_ratios_of_scenes = {}
    for row in rows:
        other = baseline.get((row.scene, row.query))
        if other is not None and not row.is_lost:
            ratio = max(row.position_error_cm, MIN_ERROR_CM) / max(other.position_error_cm, MIN_ERROR_CM)
            log_ratios_of_scenes.setdefault(row.scene, []).append(math.log(ratio))
    if not log_ratios_of_scenes:
        return None
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    sums, num_queries = np.zeros(NUM_BOOTSTRAP_SAMPLES), 0
    for _, log_ratios in sorted(log_ratios_of_scenes.items()):
        n = len(log_ratios)
        sums += np.array(log_ratios)[rng.integers(n, size=(NUM_BOOTSTRAP_SAMPLES, n))].sum(axis=1)
        num_queries += n
    total = sum(sum(log_ratios) for log_ratios in log_ratios_of_scenes.values())
    low, high = np.exp(np.percentile(sums / num_queries, [2.5, 97.5]))
    return Ratio(math.exp(total / num_queries), float(low), float(high), num_queries)


def write_csv(path: pathlib.Path, rows: list[Row]):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in dataclasses.fields(Row)])
        writer.writerows(dataclasses.astuple(row) for row in rows)


def read_csv(path: pathlib.Path) -> list[Row]:
    with path.open(newline="") as file:
        return [Row(**{field.name: field.type(record[field.name]) for field in dataclasses.fields(Row)})
                for record in csv.DictReader(file)]
