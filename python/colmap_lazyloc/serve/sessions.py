"""What the last photo of a phone or robot says of where its next one may be."""

import dataclasses
from collections import OrderedDict
from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.inputs import PositionPrior
from colmap_lazyloc.result import Result
from colmap_lazyloc.result_fields import PriorFields, ResultFields

MAX_NUM_SESSIONS = 1000
MAX_AGE_SECONDS = 3.0
# How far a camera moves, as standard deviations over its distance from the scene, because models have no known unit.
MOVE_RATIO, MOVE_RATIO_PER_SECOND = 0.1, 0.3


@dataclasses.dataclass(frozen=True)
class _Place:
    seconds: float
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scene_distance: float


class Sessions:
    """The last place of each session; the sessions that were used last stay."""

    def __init__(self) -> None:
        self._places: OrderedDict[Hashable, _Place] = OrderedDict()

    def prior(self, session: Hashable, seconds: float) -> PositionPrior | None:
        """Returns a position and its 3x3 covariance, for a photo that has arrived at a time in seconds; None if nothing
        is known of so short a time before."""
        place = self._places.get(session)
        if place is None or seconds - place.seconds > MAX_AGE_SECONDS:
            return None
        ratio = MOVE_RATIO + MOVE_RATIO_PER_SECOND * abs(seconds - place.seconds)
        return place.position, place.covariance + (ratio * place.scene_distance) ** 2 * np.eye(3)

    def add(self, session: Hashable, seconds: float, result: Result) -> None:
        """Adds where a photo was taken that has arrived at a time in seconds, if its images determine that.

        A place that rests on an earlier one is not added: from photo to photo, its error would grow without end.
        """
        fields = result.as_dict()
        distance = None if fields["evidence"] is None else fields["evidence"]["scene_distance"]
        position, covariance = result.position, result.position_covariance
        before = self._places.get(session)
        if position is None or covariance is None or distance is None or (before and before.seconds > seconds):
            return
        prior = _position_prior(fields)
        if prior is not None and prior["fixes"] != "nothing":
            return
        self._places[session] = _Place(seconds, position, covariance, distance)
        self._places.move_to_end(session)
        if len(self._places) > MAX_NUM_SESSIONS:
            self._places.popitem(last=False)

    def __len__(self) -> int:
        return len(self._places)


def agrees(result: Result) -> bool:
    """True if a pose agrees with the position of a session, and is not that position."""
    prior = _position_prior(result.as_dict())
    is_used = prior is not None and prior["verdict"] == "used" and prior["fixes"] != "position"
    return result.is_localized and is_used


def _position_prior(fields: ResultFields) -> PriorFields | None:
    """Returns what became of a query's position; None if it was given none."""
    priors = fields.get("priors")
    return None if priors is None else priors["position"]
