"""Gives a model of COLMAP's mapper metres: by positions of its photos, such as GPS, or by the distance between two
cameras."""

import dataclasses
import pathlib
from collections.abc import Callable

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import poses_of, read_model
from colmap_lazyloc.pose_formats.posed_images import Positions
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import Folder

MIN_NUM_PHOTOS = 3
NUM_PARAMETERS = 7  # of a similarity
TOLERANCE = 3.0  # of the alignment, in deviations or in median errors
FIRST_TOLERANCE_M, MIN_TOLERANCE_M = 0.5, 0.01
MIN_STDDEV_M = 1.0  # of GPS without a stated accuracy
SIMILAR = 0.8  # ratio of tolerances between which there is no need to align again
MAX_NUM_PASSES = 9  # up to 128 m, or 5 m for RTK
MAX_ROTATION_STDDEV_DEG = 10.0


@dataclasses.dataclass(frozen=True)
class Distance:
    """A known distance between the cameras of two photos: --scale."""

    first: str  # names of images
    second: str
    metres: float


class NotAlignedError(Exception):
    """Says why positions do not give the place, the orientation and the scale of a model."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """How well the photos of an aligned model fit their positions."""

    errors: Array  # distances in metres
    tolerance: float  # metres
    rotation_stddev_deg: float

    @property
    def is_within(self) -> Array:
        """Returns which photos agree with their positions."""
        return self.errors <= self.tolerance

    def text(self, title: str) -> str:
        """Returns what a user wants to know of it; `title`: what the positions are."""
        num_beyond = int(np.sum(~self.is_within))
        beyond = "none" if num_beyond == 0 else str(num_beyond)
        tolerance = f"{self.tolerance:.1f}" if self.tolerance >= 1 else f"{self.tolerance:.2g}"
        return (
            f"aligned to the {title} of {len(self.errors)} photos: median error {np.median(self.errors):.2f} m, "
            f"{beyond} beyond {tolerance} m, orientation to {self.rotation_stddev_deg:.1f} degrees"
        )


def align_to_positions(
    folder: Folder,
    runner: ColmapRunner,
    colmap: pathlib.Path,
    source: pathlib.Path,
    positions: Positions,
) -> str:
    """Writes the model `source` as that of the project, in the coordinates of the positions, with geo.json if these are
    geographic.

    Returns what the alignment has found. Raises NotAlignedError if the positions do not determine it.
    """
    poses, title = poses_of(read_model(source)), positions.title
    used = [photo for photo in positions.photos if photo.name in poses]
    if len(used) < MIN_NUM_PHOTOS:
        raise NotAlignedError(f"only {len(used)} of its photos have {title} with an altitude, and three are needed")
    targets = np.array([photo.centre for photo in used])
    lines = (f"{photo.name} {x!r} {y!r} {z!r}" for photo in used for x, y, z in [photo.centre])
    words: list[object] = [colmap, "model_aligner", "--input_path", source, "--output_path", folder.model]
    words += ["--ref_images_path", folder.write_list("gps", lines), "--ref_is_gps", 0, "--alignment_type", "custom"]

    def align(tolerance: float) -> Array | None:
        """Returns the centres of the aligned photos; None if COLMAP finds no alignment."""
        try:
            runner.run([*words, "--alignment_max_error", tolerance])
        except InputError:
            return None
        aligned = poses_of(read_model(folder.model))
        return np.array([aligned[photo.name].cam_in_world for photo in used])

    folder.model.mkdir(parents=True, exist_ok=True)
    stddevs = [photo.accuracy_m for photo in used if photo.accuracy_m is not None]
    stddev = float(np.median(stddevs)) if len(stddevs) >= len(used) / 2 else None
    fit = _fit(align, targets, stddev, title)
    if fit.rotation_stddev_deg > MAX_ROTATION_STDDEV_DEG:
        assumed = f" of {MIN_STDDEV_M:g} m, which are assumed without a stated accuracy" if stddev is None else ""
        raise NotAlignedError(
            f"the photos with {title} are almost on a line, or too close together for errors{assumed}"
        )
    if positions.origin is not None:
        positions.origin.write(folder.model)
    return fit.text(title)


def _fit(align: Callable[[float], Array | None], targets: Array, stddev: float | None, title: str) -> Fit:
    """Aligns with a small tolerance, which is doubled until half of the photos are within, and then with the one that
    their errors give. A large one would let a wrong position turn and scale a small scene."""
    tolerance, found = min(TOLERANCE * (stddev or np.inf), FIRST_TOLERANCE_M), None
    for _ in range(MAX_NUM_PASSES):
        centres = align(tolerance)
        fit = None if centres is None else _measure(centres, targets, tolerance, stddev)
        if fit is not None and np.sum(fit.is_within) >= max(MIN_NUM_PHOTOS, len(targets) / 2):
            found = fit
            tolerance = max(TOLERANCE * float(np.median(fit.errors)), MIN_TOLERANCE_M)
            if SIMILAR < tolerance / fit.tolerance < 1 / SIMILAR:
                return found
        elif found is not None:
            break
        else:
            tolerance *= 2
    if found is None:
        raise NotAlignedError(f"the {title} of the photos and their poses differ by more than {tolerance / 2:.0f} m")
    align(found.tolerance)
    return found


def _measure(centres: Array, targets: Array, tolerance: float, stddev: float | None) -> Fit:
    """Compares aligned centres with positions, both n x 3; `stddev`: the stated accuracy of positions."""
    residuals = centres - targets
    errors = np.linalg.norm(residuals, axis=1)
    within = errors <= tolerance
    count = int(np.sum(within))
    if count < MIN_NUM_PHOTOS:
        return Fit(errors, tolerance, np.inf)
    least = min(stddev or MIN_STDDEV_M, MIN_STDDEV_M) / np.sqrt(3)  # few photos may fit by chance
    deviation = max(least, float(np.sqrt(np.sum(residuals[within] ** 2) / (3 * count - NUM_PARAMETERS))))
    # The rotation about the line along which the photos lie follows from their distances to it.
    _, second, third = np.linalg.svd(centres[within] - centres[within].mean(axis=0), compute_uv=False)
    with np.errstate(divide="ignore"):
        return Fit(errors, tolerance, float(np.degrees(np.divide(deviation, np.hypot(second, third)))))


def scale_to_distance(
    folder: Folder, runner: ColmapRunner, colmap: pathlib.Path, source: pathlib.Path, distance: Distance
) -> str:
    """Writes the model `source` as that of the project, scaled to metres; returns what was done."""
    poses = poses_of(read_model(source))
    for name in (distance.first, distance.second):
        if name not in poses:
            raise InputError(f"--scale: COLMAP's mapper has found no pose of {name}: choose another photo")
    first, second = (poses[name].cam_in_world for name in (distance.first, distance.second))
    length = float(np.linalg.norm(second - first))
    if length == 0:
        raise InputError(f"--scale: {distance.first} and {distance.second} are at the same place")
    transform = folder.write_list("scale", [f"{distance.metres / length!r} 1 0 0 0 0 0 0"])
    folder.model.mkdir(parents=True, exist_ok=True)
    words: list[object] = [colmap, "model_transformer", "--input_path", source, "--output_path", folder.model]
    runner.run([*words, "--transform_path", transform])
    return f"scaled by the distance between {distance.first} and {distance.second}, {distance.metres:g} m"
