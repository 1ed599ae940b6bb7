"""Compares the poses of photos with control points: surveyed points that people have marked in the photos.

    lazyloc control_points RESULTS gcp_list.txt

RESULTS is the output folder of `lazyloc run` or of `colmap lazy_localizer`, or the folder of a COLMAP model. The points
and their marks are in one file (gcp_list.txt of OpenDroneMap, or the XML file of markers from Metashape) or in two
tables. The first table has the columns `point, latitude, longitude, height` or `point, x, y, z`, the second
`photo, point, x, y`, with x and y in pixels from the corner of the photo, as in COLMAP. A point without coordinates is
only compared between the database photos and the new photos.

The command triangulates each point from its marks in the database photos, and again from its marks in the new photos.
It prints the errors of both positions, and the distances in pixels between the projected surveyed points and their
marks. If database photos and new photos show the same points, it also prints the shift of the new photos. It writes the
residuals of a run to control_points.json, for the next report.
"""

import argparse
import csv
import dataclasses
import io
import json
import pathlib
import sys
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.errors import InputError, Parser, command, first_names, logger
from colmap_lazyloc.model import Camera, is_model, read_model
from colmap_lazyloc.pose_formats.control_points import Mark, MarkedPhotos, read_control_points
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.naming import natural_key
from colmap_lazyloc.pose_formats.raw_poses import MAX_NUM_NAMED
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.report.options_file import read_options
from colmap_lazyloc.results import CONTROL_POINTS, MODEL, RESULTS, FoundRun, find_run, pose_of, read_results

MIN_ANGLE_DEG = 1.5  # between the rays of a point, as in COLMAP's mapper
LOSS_PX = 2.0  # errors of marks that are larger have less weight
WRONG_PX, WRONG_RATIO = 10.0, 5.0  # an error that is larger, and larger than that many medians, is named
DATABASE, NEW = "database", "new"
COLUMNS = ("point", "photos", "marks", "dx", "dy", "dz", "error_px")
GEOGRAPHIC_COLUMNS = ("point", "photos", "marks", "east_m", "north_m", "up_m", "error_px")


@dataclasses.dataclass(frozen=True)
class Photo:
    """A photo of one of the two sets; without a pose if it is not localized."""

    set_name: str
    camera: Camera | None = None
    pose: Pose | None = None


@dataclasses.dataclass(frozen=True)
class View:
    """A mark in a photo with a pose."""

    mark: Mark
    camera: Camera
    pose: Pose

    def error_px(self, point: Floats) -> Floats:
        """Returns where the point is projected relative to the mark; far away if it is behind the camera."""
        from colmap_lazyloc.pycolmap_types import image_from_cam  # here, because --help needs no optional package

        pixel = image_from_cam(self.camera, self.pose(point[None]))[0]
        return np.asarray(np.nan_to_num(pixel - self.mark.pixel, nan=float(self.camera.width)))


@dataclasses.dataclass(frozen=True)
class Residual:
    """What one set of photos says of a point.

    `place`: where the rays of its marks meet; `error`: this place minus the surveyed one. They are None where they are
    not known. `errors_px`: how far the surveyed point is from its marks, or else the place.
    """

    point: str
    set_name: str
    place: Floats | None
    error: Floats | None
    errors_px: Floats


def read_photos(folder: pathlib.Path) -> tuple[dict[str, Photo], GeoOrigin | None]:
    """Reads the photos of a run or of a model by name, and the origin of their frame."""
    run = find_run(folder)
    results = {} if run.results is None else read_results(run.results / RESULTS)
    last = folder if run.results is None else run.results / MODEL
    photos = {name: Photo(NEW) for name in results}
    given = None if run.results is None else database_model(run)
    for path in [last] if given is None else [given, last]:
        model = read_model(path)
        for name, image in model.images.items():
            if name not in results or pose_of(results[name]) is not None:
                set_name = NEW if name in results else DATABASE
                photos[name] = Photo(set_name, model.cameras[image.camera_id], image.cam_from_world)
    return photos, GeoOrigin.read(last)


def database_model(run: FoundRun) -> pathlib.Path | None:
    """Returns the model that the queries of a run were localized in; None if it is not there any more."""
    if run.project is not None:
        model: pathlib.Path = run.project.model
        return model
    options = None if run.results is None else run.results / "options.ini"
    path = "" if options is None or not options.exists() else read_options(options).values.get("input_path", "")
    return pathlib.Path(path) if path and is_model(path) else None


def find_views(marks: Sequence[Mark], photos: dict[str, Photo]) -> tuple[dict[tuple[str, str], list[View]], list[str]]:
    """Returns the marks in photos with poses by point and set of photos, and the names of the other photos.

    Names marks that are outside of their photo, and leaves them out.
    """
    marked = MarkedPhotos.among(marks, photos)
    if marked.ambiguous:
        raise InputError(f"marks: {marked.ambiguous}")
    photo_of = {name: photos[image] for name, image in marked.images.items()}
    views: dict[tuple[str, str], list[View]] = {}
    missing = set()
    for mark in marks:
        photo = photo_of.get(mark.photo)
        if photo is None or photo.camera is None or photo.pose is None:
            missing.add(mark.photo)
        elif not (0 <= mark.pixel[0] <= photo.camera.width and 0 <= mark.pixel[1] <= photo.camera.height):
            size = f"{photo.camera.width} x {photo.camera.height}"
            logger.warning("the mark of '%s' is outside of %s (%s pixels)", mark.point, mark.photo, size)
        else:
            views.setdefault((mark.point, photo.set_name), []).append(View(mark, photo.camera, photo.pose))
    return views, sorted(missing)


def intersect(views: Sequence[View]) -> Floats | None:
    """Returns the point that fits the marks best; None if their rays do not determine it."""
    # Import here, because --help needs none of the optional packages.
    import pycolmap
    import scipy.optimize

    from colmap_lazyloc.pycolmap_types import to_pycolmap_camera, to_rigid3d

    options = pycolmap.EstimateTriangulationOptions(min_tri_angle=np.radians(MIN_ANGLE_DEG))
    options.ransac.random_seed = 0
    found = len(views) > 1 and pycolmap.estimate_triangulation(
        np.array([view.mark.pixel for view in views]),
        [to_rigid3d(view.pose) for view in views],
        [to_pycolmap_camera(view.camera) for view in views],
        options,
    )
    if not found:
        return None

    def errors_px(point: Floats) -> Floats:
        return np.concatenate([view.error_px(point) for view in views])

    place: Floats = scipy.optimize.least_squares(errors_px, found["xyz"], loss="soft_l1", f_scale=LOSS_PX).x
    return place


def compare(views: dict[tuple[str, str], list[View]], surveyed: dict[str, Floats]) -> list[Residual]:
    """Compares the marks of each point with its surveyed place; names marks that are probably wrong."""
    residuals = []
    for (point, set_name), seen in views.items():
        place, known = intersect(seen), surveyed.get(point)
        target = place if known is None else known
        errors = [np.nan if target is None else float(np.linalg.norm(view.error_px(target))) for view in seen]
        error = None if place is None or known is None else place - known
        residuals.append(Residual(point, set_name, place, error, np.array(errors)))
    errors_px = np.concatenate([each.errors_px for each in residuals])
    known_px = errors_px[np.isfinite(errors_px)]
    limit = max(WRONG_PX, WRONG_RATIO * float(np.median(known_px))) if len(known_px) else np.inf
    for residual, seen in zip(residuals, views.values()):
        for view, error_px in zip(seen, residual.errors_px):
            if error_px > limit:
                logger.warning("the mark of '%s' in %s is off by %.0f px", residual.point, view.mark.photo, error_px)
    return residuals


def summary(residuals: Sequence[Residual], unit: str) -> list[str]:
    """Returns a line for each set of photos, and one for the shift between them."""
    lines = []
    for set_name in (DATABASE, NEW):
        own = [residual for residual in residuals if residual.set_name == set_name]
        if not own:
            continue
        errors = np.array([residual.error for residual in own if residual.error is not None]).reshape(-1, 3)
        text = f"{set_name} photos: {len(own)} points"
        if len(errors):
            count = "1 point" if len(errors) == 1 else f"{len(errors)} points"
            of_some = "" if len(errors) == len(own) else f" of {count}"
            mean, rms = _vector(errors.mean(axis=0)), _vector(_rms(errors))
            text += f", mean error{of_some} {mean} {unit}, root mean square {rms} {unit}"
        pixels = _rms(np.concatenate([residual.errors_px for residual in own]))
        lines.append(text + (f", {pixels:.2f} px" if np.isfinite(pixels) else ""))
    places = {(residual.point, residual.set_name): residual.place for residual in residuals}
    pairs = [(places.get((point, DATABASE)), place) for (point, set_name), place in places.items() if set_name == NEW]
    shifts = np.array([new - old for old, new in pairs if old is not None and new is not None])
    if len(shifts) > 1:
        deviation = shifts.std(axis=0, ddof=1) / np.sqrt(len(shifts))
        lines.append(
            f"shift of the new photos, by {len(shifts)} points: {_vector(shifts.mean(axis=0))} {unit}, standard "
            f"deviation {_vector(deviation)} {unit}"
        )
    return lines


def _rms(errors: Floats) -> Floats:
    """Returns the root mean square of known values, by column."""
    known = errors[np.isfinite(errors).reshape(len(errors), -1).all(axis=1)]
    return np.sqrt(np.mean(np.square(known), axis=0)) if len(known) else np.full(errors.shape[1:], np.nan)


def _vector(values: Floats) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def table(residuals: Sequence[Residual], columns: Sequence[str]) -> str:
    """Returns the residuals as CSV; unknown values are empty."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    for residual in residuals:
        error = ["", "", ""] if residual.error is None else [f"{value:.4f}" for value in residual.error]
        pixels = _rms(residual.errors_px)
        count = len(residual.errors_px)
        writer.writerow(
            [residual.point, residual.set_name, count, *error, f"{pixels:.2f}" if np.isfinite(pixels) else ""]
        )
    return file.getvalue()


def write_residuals(folder: pathlib.Path, residuals: Sequence[Residual], surveyed: dict[str, Floats]) -> None:
    """Writes the residuals at points with coordinates, for the report: in the coordinates of the model."""
    entries = [
        {
            "point": residual.point,
            "photos": residual.set_name,
            "surveyed": surveyed[residual.point].tolist(),
            "error": None if residual.error is None else residual.error.tolist(),
        }
        for residual in residuals
        if residual.point in surveyed
    ]
    try:
        (folder / CONTROL_POINTS).write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        logger.warning("%s: cannot be written: %s", folder / CONTROL_POINTS, error.strerror)


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="lazyloc control_points", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("results", metavar="RESULTS", type=pathlib.Path, help="output folder of a run, or folder of a model")
    add("files", metavar="FILE", nargs="+", type=pathlib.Path, help="points and marks, in one file or in two")
    add(
        "--crs",
        help="coordinate reference system of x, y, z in a table, for example EPSG:32632; default: x, y, z are "
        "coordinates of the model",
    )
    add(
        "--output",
        type=pathlib.Path,
        metavar="FILE",
        help="CSV file for the errors of each point; default: the command prints these errors",
    )
    return parser.parse_args(arguments)


@command(name="lazyloc control_points", extra="control_points")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    control = read_control_points(options.files, options.crs)
    photos, origin = read_photos(options.results)
    views, missing = find_views(control.marks, photos)
    if not views:
        raise InputError(f"{options.files[-1]}: no mark is in a photo of {options.results} that has a pose")
    if missing:
        logger.warning("%d photos with marks have no pose: %s", len(missing), first_names(missing, MAX_NUM_NAMED))
    surveyed = control.in_model(origin)
    residuals = compare(views, surveyed)
    residuals.sort(key=lambda residual: (natural_key(residual.point), residual.set_name))
    results = find_run(options.results).results
    if results is not None:
        write_residuals(results, residuals, surveyed)
    text = table(residuals, COLUMNS if origin is None else GEOGRAPHIC_COLUMNS)
    if options.output is None:
        print(text)
    else:
        try:
            options.output.write_text(text)
        except OSError as error:
            raise InputError(f"--output {options.output}: cannot be written: {error.strerror}") from None
    print("\n".join(summary(residuals, "units" if origin is None else "m")))


if __name__ == "__main__":
    sys.exit(main())
