"""Reads keypoints and matches in hloc's HDF5 files, which h5py has opened."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError

if TYPE_CHECKING:
    import h5py


def read_keypoints(features: "h5py.File", name: str) -> NDArray[np.float32]:
    """Returns the keypoints, n x 2, in COLMAP's convention: the centre of the upper-left pixel is at 0.5, 0.5."""
    if name not in features:
        raise InputError(f"{features.filename}: has no image {name}")
    return np.asarray(features[name]["keypoints"], np.float32)[:, :2] + np.float32(0.5)


def find_matches(matches: "h5py.File", name1: str, name2: str) -> NDArray[np.uint32] | None:
    """Returns the matches as keypoint indices, m x 2; None if the pair is stored under none of hloc's names."""
    for first, second, columns in ((name1, name2, (0, 1)), (name2, name1, (1, 0))):
        for separator in ("/", "_"):
            key = separator.join(name.replace("/", "-") for name in (first, second))
            if key in matches:
                matched_points = np.asarray(matches[key]["matches0"])
                indices = np.flatnonzero(matched_points >= 0)
                return np.column_stack([indices, matched_points[indices]])[:, columns].astype(np.uint32)
    return None
