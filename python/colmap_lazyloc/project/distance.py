"""Gives a model of COLMAP's mapper metres by a known distance: between cameras, or between points that are marked in
photos."""

import dataclasses
import functools
import pathlib
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.control_points import View, intersect
from colmap_lazyloc.errors import InputError, nearest
from colmap_lazyloc.model import Image, Model, read_model
from colmap_lazyloc.points import Points, read_points
from colmap_lazyloc.pose_formats.control_points import Mark
from colmap_lazyloc.project.alignment import transform
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import Folder
from colmap_lazyloc.project.photos import stored_pixel

MARK = re.compile(r"(.+?):(-?\d+(?:\.\d*)?),(-?\d+(?:\.\d*)?)(?:\+(?=.)|$)")  # PHOTO:x,y at the end or before a `+`
MARK_STDDEV_PX = 2.0
NUM_NEIGHBORS = 12  # points of the model from which a mark in one photo takes its depth
MAX_RADIUS_RATIO = 0.1  # of the circle around the mark in which they are, in the longer side of the photo
MAX_DEVIATION_SIGMA = 3.0  # of a surface from where the marks meet
MIN_STDDEV_RATIO, MAX_STDDEV_RATIO = 1e-4, 0.1  # of a depth, and of a distance


@dataclasses.dataclass(frozen=True)
class End:
    """One end of a known distance: the camera of a photo, or a point that is marked in photos."""

    text: str = dataclasses.field(compare=False)  # as it was typed
    camera: str = ""
    marks: tuple[Mark, ...] = ()

    def renamed(self, names: Mapping[str, str]) -> "End":
        """Returns the end with other names of the photos."""
        marks = tuple(dataclasses.replace(mark, photo=names[mark.photo]) for mark in self.marks)
        return dataclasses.replace(self, camera=self.camera and names[self.camera], marks=marks)


@dataclasses.dataclass(frozen=True)
class Distance:
    """A known distance: --scale."""

    ends: tuple[End, End]
    metres: float

    def renamed(self, names: Mapping[str, str]) -> "Distance":
        """Returns the distance with other names of the photos."""
        first, second = (end.renamed(names) for end in self.ends)
        return dataclasses.replace(self, ends=(first, second))


@dataclasses.dataclass(frozen=True)
class Place:
    """Where an end of a distance is in a model, and the covariance of this place."""

    xyz: Floats
    covariance: Floats


class UnknownDepthError(Exception):
    """Says why the depth of a mark does not follow from the points of the model next to it."""


@dataclasses.dataclass(frozen=True)
class Surface:
    """What is known of the depth at a mark, by the points of the model next to it."""

    view: View
    inverse_depth: float
    stddev: float  # of the inverse depth

    def meet(self) -> Floats:
        """Returns where the ray of the mark meets the surface."""
        from colmap_lazyloc.pycolmap_types import to_pycolmap_camera  # here, because --help needs no optional package

        ((x, y),) = to_pycolmap_camera(self.view.camera).cam_from_img(np.array([self.view.mark.pixel]))
        (xyz,) = self.view.pose.inverse()(np.array([[x, y, 1.0]]) / self.inverse_depth)
        return np.asarray(xyz, float)

    def error(self, xyz: Floats) -> float:
        """Returns how far a point is from the surface, in standard deviations."""
        depth = float(self.view.pose(xyz[None])[0, 2])
        return (1 / depth - self.inverse_depth) / self.stddev


def read_distance(words: Sequence[str], photos: Mapping[str, pathlib.Path]) -> Distance:
    """Reads the three words of --scale; `photos`: the paths of the database images by name."""
    first, second = (_read_end(word, photos) for word in words[:2])
    if first == second:
        raise InputError(f"--scale {words[0]} {words[1]}: expected two different photos or points")
    return Distance((first, second), float(words[2]))


def _read_end(text: str, photos: Mapping[str, pathlib.Path]) -> End:
    if text in photos:
        return End(text, text)
    pixels: dict[str, tuple[float, float]] = {}
    begin = 0
    while match := MARK.match(text, begin):
        name, begin = match[1], match.end()
        if name not in photos:
            raise InputError(f"--scale {name}: is not in --database_images{nearest(name, photos)}")
        if name in pixels:
            raise InputError(f"--scale {text}: marks the point twice in {name}")
        pixels[name] = stored_pixel(
            f"--scale {match[0].removesuffix('+')}", photos[name], float(match[2]), float(match[3])
        )
    if not text or (begin < len(text) and ":" in text):
        raise InputError(
            f"--scale {text}: expected PHOTO, PHOTO:x,y, or a point in several photos, PHOTO:x,y+PHOTO:x,y"
        )
    if begin < len(text):
        raise InputError(f"--scale {text}: is not in --database_images{nearest(text, photos)}")
    return End(text, marks=tuple(Mark(name, "", pixels[name]) for name in sorted(pixels)))


def scale_to_distance(
    folder: Folder, runner: ColmapRunner, colmap: pathlib.Path, source: pathlib.Path, distance: Distance
) -> str:
    """Writes the model `source` as that of the project, scaled to metres; returns what was done."""
    model, points = read_model(source), read_points(source)
    names = " and ".join(end.text for end in distance.ends)
    first, second = (locate(end, model, points) for end in distance.ends)
    vector = second.xyz - first.xyz
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise InputError(f"--scale: {names} are at the same place")
    stddev_ratio = float(np.sqrt(vector @ (first.covariance + second.covariance) @ vector)) / length**2
    if stddev_ratio > MAX_STDDEV_RATIO:
        raise InputError(
            f"--scale: the distance between {names} is uncertain by {100 * stddev_ratio:.0f} %: mark the points in "
            "more photos, or choose points that are further apart"
        )
    transform(folder, runner, colmap, source, [distance.metres / length, 1, 0, 0, 0, 0, 0, 0])
    text = f"scaled by the distance between {names}, {distance.metres:g} m"
    if stddev_ratio > 0:
        text += (
            f", standard deviation {stddev_ratio * distance.metres:.2g} m ({100 * stddev_ratio:.2g} %) from the marks"
        )
    return text


def locate(end: End, model: Model, points: Points) -> Place:
    """Returns where an end of a distance is in a model; raises InputError if that is unknown."""
    for name in [end.camera] if end.camera else [mark.photo for mark in end.marks]:
        if name not in model.images:
            raise InputError(f"--scale {end.text}: COLMAP's mapper has found no pose of {name}: choose another photo")
    if end.camera:
        return Place(model.images[end.camera].pose.cam_in_world, np.zeros((3, 3)))
    images = [model.images[mark.photo] for mark in end.marks]
    views = [View(mark, model.cameras[image.camera_id], image.pose) for mark, image in zip(end.marks, images)]
    surfaces: list[Surface] = []
    reason = "the rays of these marks do not meet or are almost parallel, and no depth is known: check the marks"
    for view, image in zip(views, images):
        try:
            surfaces.append(_find_surface(view, image, points))
        except UnknownDepthError as error:
            reason = str(error) if len(views) == 1 else reason
    start = intersect(views)
    if start is None and not surfaces:
        raise InputError(f"--scale {end.text}: {reason}")

    def errors(xyz: Floats) -> Floats:
        return np.concatenate([view.error_px(xyz) / MARK_STDDEV_PX for view in views])

    if start is not None:
        return functools.reduce(_combine, surfaces, _intersection(errors, start))

    def all_errors(xyz: Floats) -> Floats:
        return np.append(errors(xyz), [surface.error(xyz) for surface in surfaces])

    import scipy.optimize

    fit = scipy.optimize.least_squares(all_errors, surfaces[0].meet(), loss="soft_l1", x_scale="jac")
    return _intersection(all_errors, fit.x)


def _intersection(errors: Callable[[Floats], Floats], xyz: Floats) -> Place:
    """Returns a place that fits `errors`, in standard deviations, with its covariance. If the errors are larger than
    these, the covariance grows with their squares, once."""
    import scipy.optimize

    jacobian, found = scipy.optimize.approx_fprime(xyz, errors), errors(xyz)
    variance_factor = max(1.0, float(found @ found) / max(1, len(found) - 3))
    return Place(xyz, variance_factor * np.linalg.inv(jacobian.T @ jacobian))


def _combine(place: Place, surface: Surface) -> Place:
    """Returns the mean of a place and a surface, weighted by their variances. A surface that contradicts the place does
    not count: the points next to the mark of a table's corner may be on the floor."""
    row = surface.view.pose.rotation[2]
    depth = float(surface.view.pose(place.xyz[None])[0, 2])
    gradient = -row / depth**2
    variance = float(gradient @ place.covariance @ gradient) + surface.stddev**2
    deviation = surface.inverse_depth - 1 / depth
    if deviation**2 > MAX_DEVIATION_SIGMA**2 * variance:
        return place
    gain = place.covariance @ gradient / variance
    return Place(place.xyz + gain * deviation, place.covariance - variance * np.outer(gain, gain))


def _find_surface(view: View, image: Image, points: Points) -> Surface:
    """Returns the plane through the points of the model that a photo sees next to a mark."""
    index = points.find(image.points2d["point3d_id"])
    seen, index = image.points2d[index >= 0], index[index >= 0]
    offsets = np.column_stack([seen["x"], seen["y"]]) - view.mark.pixel
    distances_px = np.linalg.norm(offsets, axis=1)
    near = np.argsort(distances_px, kind="stable")[:NUM_NEIGHBORS]
    radius_px = MAX_RADIUS_RATIO * max(view.camera.width, view.camera.height)
    num_near = int(np.sum(distances_px[near] <= radius_px))
    remedy = "mark the point in a second photo, too (PHOTO:x,y+PHOTO:x,y)"
    if num_near < NUM_NEIGHBORS:
        raise UnknownDepthError(
            f"the depth is unknown, because the model has {num_near} points within {radius_px:.0f} pixels of the mark, "
            f"and {NUM_NEIGHBORS} are needed: {remedy}"
        )
    # In an image, the inverse depth of a plane is a linear function.
    inverse_depths = 1 / view.pose(points.xyz[index[near]])[:, 2]
    design = np.column_stack([np.ones(NUM_NEIGHBORS), offsets[near]])
    solution = np.linalg.lstsq(design, inverse_depths)[0]
    residuals = inverse_depths - design @ solution
    variance = residuals @ residuals / (NUM_NEIGHBORS - 3) * (1 + np.linalg.pinv(design.T @ design)[0, 0])
    surface = Surface(view, float(solution[0]), max(float(np.sqrt(variance)), MIN_STDDEV_RATIO * float(solution[0])))
    if surface.inverse_depth <= 0 or surface.stddev > MAX_STDDEV_RATIO * surface.inverse_depth:
        raise UnknownDepthError(
            f"the depth is unknown, because the points of the model next to the mark are at different depths: {remedy}"
        )
    return surface
