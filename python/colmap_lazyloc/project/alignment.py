"""Gives a model of COLMAP's mapper metres by positions of its photos, such as GPS, or by control points."""

import dataclasses
import functools
import pathlib
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError, first_names, logger
from colmap_lazyloc.model import poses_of, read_model
from colmap_lazyloc.pose_formats.control_points import POINT_STDDEV_M, ControlPoints, MarkedPhotos
from colmap_lazyloc.pose_formats.posed_images import Positions, read_orientation
from colmap_lazyloc.progress import ProgressBar
from colmap_lazyloc.project.alignment_errors import AlignmentErrors, estimate_errors
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import Folder
from colmap_lazyloc.project.level import find_level

MIN_NUM_PHOTOS = 3
MIN_NUM_POINTS = 3
TOLERANCE = 3.0  # of the alignment, in deviations or in median errors
FIRST_TOLERANCE_M, MIN_TOLERANCE_M = 0.5, 0.01
MIN_STDDEV_M = 1.0  # of GPS without a stated accuracy
SIMILAR = 0.8  # ratio of tolerances between which there is no need to align again
MAX_NUM_PASSES = 9  # up to 128 m, or 5 m for RTK
GOOD_ROTATION_STDDEV_DEG, GOOD_SCALE_STDDEV_PERCENT = 5.0, 10.0  # beyond, there is a warning
MAX_ROTATION_STDDEV_DEG = 60.0  # by positions: about a radian, beyond which a deviation has no meaning
MAX_POINTS_ROTATION_STDDEV_DEG = 10.0  # by control points, of which more can be measured


class NotAlignedError(Exception):
    """Says why positions do not give the place, the orientation and the scale of a model."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """How well the photos of an aligned model fit their positions."""

    centres: Array  # aligned, n x 3
    targets: Array
    tolerance: float  # metres

    @staticmethod
    def of(centres: Array, targets: Array) -> "Fit":
        """Returns the fit with the tolerance that the distances give."""
        median = float(np.median(np.linalg.norm(centres - targets, axis=1)))
        return Fit(centres, targets, max(TOLERANCE * median, MIN_TOLERANCE_M))

    @functools.cached_property
    def distances(self) -> Array:
        """The errors in metres."""
        distances: Array = np.linalg.norm(self.centres - self.targets, axis=1)
        return distances

    @property
    def is_within(self) -> Array:
        """Returns which photos agree with their positions."""
        return self.distances <= self.tolerance

    def errors(self, stddev: float, is_series: bool, is_level: bool = False) -> AlignmentErrors:
        """Returns the deviations of the alignment; `stddev`: of a position in space, and more as `estimate_errors`."""
        within = self.is_within
        return estimate_errors(
            self.centres[within], self.targets[within], stddev / np.sqrt(3), is_series=is_series, is_level=is_level
        )

    def text(self, title: str, errors: AlignmentErrors) -> str:
        """Returns what a user wants to know of it; `title`: what the model is aligned to."""
        median, tolerance = (f"{x:.1f}" if x >= 1 else f"{x:.2g}" for x in (np.median(self.distances), self.tolerance))
        num_beyond = int(np.sum(~self.is_within))
        beyond = "none" if num_beyond == 0 else str(num_beyond)
        return (
            f"aligned to the {title}: median error {median} m, {beyond} beyond {tolerance} m, "
            f"orientation to {errors.rotation_deg:.1f} degrees, lengths to {errors.scale_percent:.2g} %"
        )


def _open_orientation(what: str, assumed: str = "") -> NotAlignedError:
    """Returns the error that the orientation follows from errors; `assumed`: how large these are taken to be."""
    return NotAlignedError(
        f"the {what} are almost on a line, or so close together that errors{assumed} leave the orientation open"
    )


def align_to_positions(
    folder: Folder,
    runner: ColmapRunner,
    colmap: pathlib.Path,
    source: pathlib.Path,
    positions: Positions,
) -> list[str]:
    """Writes the model `source` as that of the project, in the coordinates of the positions, with geo.json if these are
    geographic.

    Returns what the alignment has found, and what is inaccurate. Raises NotAlignedError if the positions do not
    determine it.
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
    with ProgressBar(f"aligning to the {title} of {len(used)} photos"):
        fit = _fit(align, targets, stddev, title)
    what = f"photos with {title}"
    assumed = f" of {MIN_STDDEV_M:g} m (assumed)" if stddev is None else ""
    if fit is None:
        raise _open_orientation(what, assumed)
    errors = fit.errors(stddev or MIN_STDDEV_M, is_series=True)
    text = f"{title} of {len(used)} photos"
    level = find_level(
        np.array([pose.rotation for pose in poses.values()]), [read_orientation(folder.images / name) for name in poses]
    )
    name = used[0].name
    up = (poses_of(read_model(folder.model))[name].rotation.T @ poses[name].rotation)[2]
    is_known = stddev is not None or positions.origin is not None  # a survey may be far more accurate than is assumed
    max_angle_deg = TOLERANCE * float(np.hypot(level.stddev_deg, errors.tilt_deg))
    if is_known and level.stddev_deg < errors.tilt_deg and level.agrees(up, max_angle_deg):
        centres = np.array([poses[photo.name].cam_in_world for photo in used])
        scale, pose = level.align(centres[fit.is_within], targets[fit.is_within])
        transform(folder, runner, colmap, source, [scale, *pose.qvec.tolist(), *pose.tvec.tolist()])
        fit = Fit.of(pose(scale * centres), targets)
        errors = fit.errors(stddev or MIN_STDDEV_M, is_series=True, is_level=True).with_tilt(level.stddev_deg)
        text += " and to the vertical of the cameras"
    if errors.rotation_deg > MAX_ROTATION_STDDEV_DEG:
        raise _open_orientation(what, assumed)
    if positions.origin is not None:
        positions.origin.write(folder.model)
    return [fit.text(text, errors), *_inaccurate(fit, errors, what, assumed)]


def _inaccurate(fit: Fit, errors: AlignmentErrors, what: str, assumed: str) -> list[str]:
    """Returns a warning if positions determine the orientation or the scale badly; words as of `_open_orientation`."""
    if errors.rotation_deg <= GOOD_ROTATION_STDDEV_DEG and errors.scale_percent <= GOOD_SCALE_STDDEV_PERCENT:
        return []
    extent = np.linalg.norm(np.ptp(fit.centres, axis=0))
    return [
        f"the orientation of the model is only known to {errors.rotation_deg:.0f} degrees, and lengths to "
        f"{errors.scale_percent:.0f} %, because the {what} are within {extent:.2g} m, and errors{assumed} are too "
        "large for this: photos of a larger area help, or --control_points, or, for lengths, --scale"
    ]


def check_marks(control: ControlPoints, photos: Iterable[str], source: pathlib.Path) -> None:
    """Raises an InputError if too few control points have marks in photos of a folder."""
    marked = MarkedPhotos.among(control.marks, photos)
    seen = Counter(mark.point for mark in control.marks if mark.photo in marked.images and mark.point in control.points)
    count = sum(num_photos > 1 for num_photos in seen.values())
    if count < MIN_NUM_POINTS:
        names = sorted([*marked.images, *marked.missing])
        raise InputError(
            f"--control_points: {count} points have marks in two or more photos of {source}; without --poses, at least "
            f"{MIN_NUM_POINTS} points that are not on one line are needed; marked photos: {first_names(names, 3)}"
        )


def align_to_points(
    folder: Folder, runner: ColmapRunner, colmap: pathlib.Path, source: pathlib.Path, control: ControlPoints
) -> list[str]:
    """Writes the model `source` as that of the project, in the coordinates of control points that are marked in its
    photos, with geo.json if these are geographic; otherwise as `align_to_positions`."""
    import pycolmap

    from colmap_lazyloc.control_points import DATABASE, Photo, find_views, intersect

    model = read_model(source)
    photos = {name: Photo(DATABASE, model.cameras[image.camera_id], image.pose) for name, image in model.images.items()}
    surveyed, origin = control.in_local_frame()
    views, _ = find_views([mark for mark in control.marks if mark.point in surveyed], photos)
    places = {point: place for (point, _), seen in views.items() if (place := intersect(seen)) is not None}
    if len(places) < MIN_NUM_POINTS:
        raise NotAlignedError(
            f"only {len(places)} points have marks in two or more of its photos, and {MIN_NUM_POINTS} that are not on "
            "one line are needed"
        )
    found, targets = np.array([*places.values()]), np.array([surveyed[point] for point in places])

    similarity = pycolmap.Sim3d()

    def align(tolerance: float) -> Array | None:
        """Returns the places of the aligned points; None if COLMAP finds no alignment."""
        nonlocal similarity
        options = pycolmap.RANSACOptions(max_error=tolerance, random_seed=0)
        estimated: Any = pycolmap.estimate_sim3d_robust(found, targets, options)
        if estimated is None:
            return None
        similarity = estimated["tgt_from_src"]
        return np.array([similarity * place for place in found])

    fit = _fit(align, targets, POINT_STDDEV_M, "control points")
    if fit is None:
        raise _open_orientation("control points")
    errors = fit.errors(POINT_STDDEV_M, is_series=False)
    if errors.rotation_deg > MAX_POINTS_ROTATION_STDDEV_DEG:
        raise _open_orientation("control points")
    for point, error, is_within in zip(places, fit.distances, fit.is_within):
        if not is_within:
            logger.warning("control point '%s' is left out, because it is off by %.2g m", point, error)
    quaternion = np.roll(similarity.rotation.quat, 1)
    numbers = np.concatenate([[similarity.scale], quaternion, similarity.translation])
    transform(folder, runner, colmap, source, numbers.tolist())
    if origin is not None:
        origin.write(folder.model)
    return [fit.text(f"{len(places)} control points", errors)]


def _fit(align: Callable[[float], Array | None], targets: Array, stddev: float | None, title: str) -> Fit | None:
    """Aligns with a small tolerance, which is doubled until half of the photos are within, and then with the one that
    their errors give. A large one would let a wrong position turn and scale a small scene.

    None if all are on a line.
    """
    tolerance, found = min(TOLERANCE * (stddev or np.inf), FIRST_TOLERANCE_M), None
    for _ in range(MAX_NUM_PASSES):
        centres = align(tolerance)
        fit = None if centres is None else Fit(centres, targets, tolerance)
        if fit is not None and np.sum(fit.is_within) >= max(MIN_NUM_PHOTOS, len(targets) / 2):
            found = fit
            tolerance = Fit.of(fit.centres, targets).tolerance
            if SIMILAR < tolerance / fit.tolerance < 1 / SIMILAR:
                return found
        elif found is not None:
            break
        else:
            tolerance *= 2
    if found is None:
        # COLMAP finds no similarity if all are on one line.
        _, width, _ = np.linalg.svd(targets - targets.mean(axis=0), compute_uv=False)
        if width < (stddev or MIN_STDDEV_M):
            return None
        raise NotAlignedError(f"the {title} of the photos and their poses differ by more than {tolerance / 2:.0f} m")
    align(found.tolerance)
    return found


def transform(
    folder: Folder, runner: ColmapRunner, colmap: pathlib.Path, source: pathlib.Path, similarity: Iterable[float]
) -> None:
    """Writes the model `source` as that of the project, transformed: scale, quaternion w x y z, translation."""
    path = folder.write_list("transform", [" ".join(map(repr, similarity))])
    folder.model.mkdir(parents=True, exist_ok=True)
    words: list[object] = [colmap, "model_transformer", "--input_path", source, "--output_path", folder.model]
    runner.run([*words, "--transform_path", path])
