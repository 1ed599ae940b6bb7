"""The rows of a run, and the figures that are computed from them."""

import csv
import dataclasses
import math
import pathlib

import numpy as np

from benchmarks.localization.methods import Result
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.evaluate import DEFAULT_THRESHOLDS

NUM_BOOTSTRAP_SAMPLES = 10000
BOOTSTRAP_SEED = 0
MIN_ERROR = 1e-6  # in cm or degrees; keeps the logarithm of a ratio finite


@dataclasses.dataclass(frozen=True)
class Row:
    """One query of one method; the errors are NaN if the query is lost or its true pose is unknown."""

    tag: str
    scene: str
    query: str
    method: str
    num_retrieved: int
    seed: int
    database_noise: str
    position_error_cm: float
    rotation_error_deg: float
    seconds: float
    status: str

    @property
    def is_lost(self) -> bool:
        return self.status != "LOCALIZED"

    @property
    def is_measured(self) -> bool:
        return not math.isnan(self.position_error_cm)

    @property
    def series(self) -> "Series":
        return Series(self.method, self.num_retrieved, self.seed, self.database_noise)


@dataclasses.dataclass(frozen=True)
class Series:
    """The settings with which a method is run on the queries of a scene."""

    method: str
    num_retrieved: int = 20
    seed: int = 0
    database_noise: str = "0,0"  # degrees, cm


@dataclasses.dataclass(frozen=True)
class Summary:
    """The figures of several rows. A lost query counts as an infinite error in medians and recall, and is left out of
    the mean. Without true poses the errors are NaN.
    """

    num_queries: int
    num_lost: int
    median_position_error_cm: float
    median_rotation_error_deg: float
    mean_position_error_cm: float
    median_seconds: float
    recall: tuple[float, ...]  # shares of the queries within DEFAULT_THRESHOLDS


@dataclasses.dataclass(frozen=True)
class Ratio:
    """The geometric mean over queries of the ratios of errors, with its confidence interval."""

    mean: float
    low: float
    high: float
    num_queries: int


def make_row(tag: str, scene: Scene, query_name: str, series: Series, result: Result) -> Row:
    """Makes the row of a result; the unit of scenes is the metre."""
    position_error, rotation_error_deg = math.nan, math.nan
    true_pose = scene.true_pose(query_name)
    if result.pose is not None and true_pose is not None:
        position_error, rotation_error_deg = result.pose.errors(true_pose)
    return Row(
        tag,
        scene.name,
        query_name,
        *dataclasses.astuple(series),
        100 * position_error,
        rotation_error_deg,
        result.seconds,
        result.status,
    )


def summarize(rows: list[Row]) -> Summary:
    lost = np.array([row.is_lost for row in rows])
    positions = np.where(lost, np.inf, [row.position_error_cm for row in rows])
    rotations = np.where(lost, np.inf, [row.rotation_error_deg for row in rows])
    measured = np.array([row.is_measured for row in rows])
    recall = [
        float(np.mean((positions <= 100 * metres) & (rotations <= degrees)))
        if not np.isnan(positions).any()
        else math.nan
        for metres, degrees in DEFAULT_THRESHOLDS
    ]
    return Summary(
        num_queries=len(rows),
        num_lost=int(lost.sum()),
        median_position_error_cm=float(np.median(positions)),
        median_rotation_error_deg=float(np.median(rotations)),
        mean_position_error_cm=float(np.mean(positions[measured])) if measured.any() else math.nan,
        median_seconds=float(np.median([row.seconds for row in rows])),
        recall=tuple(recall),
    )


def paired_ratio(
    rows: list[Row], baseline_rows: list[Row], error: str = "position_error_cm", confidence: float = 0.95
) -> Ratio | None:
    """Compares the queries that both localized; None if there are none. The bootstrap resamples within each scene."""
    baseline = {(row.scene, row.query): row for row in baseline_rows if row.is_measured}
    log_ratios_of_scenes = {}
    for row in rows:
        other = baseline.get((row.scene, row.query))
        if other is not None and row.is_measured:
            ratio = max(getattr(row, error), MIN_ERROR) / max(getattr(other, error), MIN_ERROR)
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
    low, high = np.exp(np.percentile(sums / num_queries, [50 - 50 * confidence, 50 + 50 * confidence]))
    return Ratio(math.exp(total / num_queries), float(low), float(high), num_queries)


def write_csv(path: pathlib.Path, rows: list[Row]):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in dataclasses.fields(Row)])
        writer.writerows(dataclasses.astuple(row) for row in rows)


def read_csv(path: pathlib.Path) -> list[Row]:
    with path.open(newline="") as file:
        return [
            Row(**{field.name: field.type(record[field.name]) for field in dataclasses.fields(Row)})
            for record in csv.DictReader(file)
        ]
