"""Images whose poses contradict those of most others."""

from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.array_types import Floats

MIN_SHARE = 0.6  # of an image's pairs that contradict it
# Errors of a pair that disagrees: in pixels, and over the lower quartile, because wrong poses may move the median.
MIN_PX, QUARTILE_RATIO = 1.5, 12.5


def contradicted_images(pairs: Sequence[tuple[int, int]], px: Floats) -> list[int]:
    """Returns the images, by index, whose own poses explain why pairs disagree, the worst first.

    `px`: the errors of the pairs in pixels.
    """
    rows = np.array(pairs, int).reshape(-1, 2)
    disagrees = px > max(MIN_PX, QUARTILE_RATIO * float(np.percentile(px, 25)) if len(px) else 0.0)
    found: list[int] = []
    is_left = np.ones(len(rows), bool)
    # The image with the most pairs that disagree comes first; without its pairs, its neighbours are no longer suspect.
    while np.any(is_left & disagrees):
        all_of = np.bincount(rows[is_left].ravel())
        bad_of = np.bincount(rows[is_left & disagrees].ravel(), minlength=len(all_of))
        is_suspect = (bad_of > 0) & (bad_of >= MIN_SHARE * all_of)
        if not is_suspect.any():
            break
        worst = int(np.argmax(np.where(is_suspect, bad_of + bad_of / np.maximum(all_of, 1), 0)))
        found.append(worst)
        is_left &= ~np.any(rows == worst, axis=1)
    return found
