"""Which images take the second of two poses, for a reading that leaves it open for each."""

import numpy as np

from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px, medians_by_pair
from colmap_lazyloc.array_types import Floats

MIN_PX, MAX_PX = 0.5, 1000.0  # errors below and above which are as good, and as bad
MAX_NUM_ROUNDS = 10


def _costs(matches: Matches, first: Poses, second: Poses) -> Floats:
    """Returns the log error of each pair, by which of two poses its first and its second image have."""
    variants = first, second
    px = np.array([[medians_by_pair(matches, errors_px(matches, a, b)) for b in variants] for a in variants])
    costs: Floats = np.log(np.clip(np.nan_to_num(px, nan=MAX_PX), MIN_PX, MAX_PX))
    return costs


def images_behind(matches: Matches, first: Poses, second: Poses, places: Floats) -> list[int]:
    """Returns the images, by index, from the place on from which the second poses fit better."""
    costs, pairs = _costs(matches, first, second), np.arange(len(matches.first))
    images = np.unique([matches.first, matches.second])

    def cost(start: float) -> float:
        is_second = (places >= start).astype(int)
        return round(float(costs[is_second[matches.first], is_second[matches.second], pairs].sum()), 6)

    # Of equal ones, takes the last, because the first image behind a gap may have the same pose twice.
    start = min(np.unique(places[images])[:0:-1].tolist(), key=cost)
    return [image for image in images.tolist() if places[image] >= start]


def images_of_second_poses(matches: Matches, first: Poses, second: Poses) -> list[int]:
    """Returns the images, by index, whose matches fit the second poses better."""
    costs = _costs(matches, first, second)
    images = np.unique([matches.first, matches.second]).tolist()
    rows = {
        image: (np.flatnonzero(matches.first == image), np.flatnonzero(matches.second == image)) for image in images
    }

    def costs_of(image: int, takes_second: dict[int, int] | None) -> list[float]:
        """Returns the cost of both poses of an image; the others have given ones, or those that suit a pair best."""
        as_first, as_second = rows[image]
        if takes_second is None:
            return [float(costs[own, :, as_first].min(axis=1).sum() + costs[:, own, as_second].min(axis=0).sum())
                    for own in (0, 1)]  # fmt: skip
        others1 = [takes_second[int(other)] for other in matches.second[as_first]]
        others2 = [takes_second[int(other)] for other in matches.first[as_second]]
        return [float(costs[own, others1, as_first].sum() + costs[others2, own, as_second].sum()) for own in (0, 1)]

    chosen = {image: int(np.argmin(costs_of(image, None))) for image in images}
    for _ in range(MAX_NUM_ROUNDS):
        before = dict(chosen)
        for image in images:
            chosen[image] = int(np.argmin(costs_of(image, chosen)))
        if chosen == before:
            break
    return [image for image in images if chosen[image]]
