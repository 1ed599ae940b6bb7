"""Makes the chunks "details/BLOCK": what the page of a query shows in words and bars."""

from collections.abc import Iterable

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.model import Camera
from colmap_lazyloc.report.chunk import Values
from colmap_lazyloc.report.facts import facts
from colmap_lazyloc.report.repeat import RepeatCommands
from colmap_lazyloc.report.run import Run, used_pairs
from colmap_lazyloc.result_fields import PairFields, ResultFields

DETAILS_PER_BLOCK = 1000


def detail_chunk(run: Run, block: int, repeat: RepeatCommands) -> tuple[Values, dict[str, Array]]:
    """Returns the values and arrays of a chunk."""
    queries = run.queries[block * DETAILS_PER_BLOCK : (block + 1) * DETAILS_PER_BLOCK]
    stages = stage_names(queries)
    known = [_known_pairs(run, result) for result in queries]
    pairs = [pair for of_query in known for pair, _ in of_query]
    values = {
        "stages": stages,
        "facts": [facts(result, run.unit, _camera(run, result)) for result in queries],
        "commands": [repeat.command(result) for result in queries],
    }
    arrays: dict[str, Array] = {
        "seconds": np.array(
            [[result["seconds"].get(stage, np.nan) for stage in stages] for result in queries], np.float32
        ),
        "pairOffsets": np.cumsum([0, *map(len, known)]).astype(np.uint32),
        "pairImages": np.array([run.database_index[pair["name"]] for pair in pairs], np.uint32),
        "pairNumInliers": np.array([pair["num_inliers"] for pair in pairs], np.uint32),
        "pairIsUsed": np.array([used for of_query in known for _, used in of_query], np.uint8),
        "pairRotationErrorsDeg": _floats([pair["rotation_error_deg"] for pair in pairs]),
        "pairDirectionErrorsDeg": _floats([pair["direction_error_deg"] for pair in pairs]),
    }
    return values, arrays


def stage_names(queries: list[ResultFields]) -> list[str]:
    """Returns the stages that ran for any query, in the order in which they ran."""
    names: dict[str, None] = {}
    for result in sorted(queries, key=lambda result: -len(result["seconds"])):
        names.update(dict.fromkeys(result["seconds"]))
    names.pop("total", None)
    return list(names)


def _camera(run: Run, result: ResultFields) -> Camera | None:
    """Returns the intrinsics with which the query was localized; None if it was not."""
    image = run.model.images.get(result["name"])
    return None if image is None else run.model.cameras[image.camera_id]


def _known_pairs(run: Run, result: ResultFields) -> list[tuple[PairFields, bool]]:
    """Returns the pairs with images of the database, and whether the pose rests on each."""
    return [
        (pair, used)
        for pair, used in zip(result["pairs"], used_pairs(result), strict=True)
        if pair["name"] in run.database_index
    ]


def _floats(values: Iterable[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], np.float32)
