"""Adjusts the new photos of a project together, in the frame of the database images, which do not move."""

import dataclasses
import json
import pathlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from colmap_lazyloc.cluster.task import command_line
from colmap_lazyloc.database import DatabaseReader, copy_database, set_cameras
from colmap_lazyloc.errors import InputError, first_names, logger
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.pose_formats.control_points import ControlPoints, MarkedPhotos
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.program import has_command
from colmap_lazyloc.progress import ProgressBar
from colmap_lazyloc.project.folder import MATCHES, RUN, fingerprint
from colmap_lazyloc.project.pairs import all_pairs, pairs_by_viewpoint, pairs_in_sequence
from colmap_lazyloc.project.steps import MAX_NUM_EXHAUSTIVE, SEQUENCE_REACH, Project
from colmap_lazyloc.result_fields import ResultFields
from colmap_lazyloc.results import RESULTS, pose_of, read_results

NUM_NEIGHBORS = 10  # new photos with which each is matched
CONTROL_POINTS = "control_points.txt"  # for lazy_epoch, in the folder of the epoch
DONE = "done.txt"  # in the folder of the epoch: what its results were made of


@dataclasses.dataclass(frozen=True)
class Survey:
    """Control points that place the new photos, and the standard deviation of their coordinates."""

    points: ControlPoints
    stddev: float

    def lines(self, images: Iterable[str], model: pathlib.Path) -> list[str]:
        """Returns the file of control points of lazy_epoch, with the marks in these images."""
        places = self.points.in_model(GeoOrigin.read(model))
        marked = MarkedPhotos.among(self.points.marks, images)
        if marked.ambiguous:
            raise InputError(f"--control_points: {marked.ambiguous}")
        if marked.missing:
            logger.warning("--control_points: no photo of this run is %s", first_names(marked.missing, 3))
        lines = []
        for point, place in places.items():
            marks = [mark for mark in self.points.marks if mark.point == point and mark.photo in marked.images]
            if marks:
                lines.append(" ".join(["point", point, *map(repr, place.tolist()), *[repr(self.stddev)] * 3]))
            lines += [f"mark {marked.images[mark.photo]} {mark.pixel[0]!r} {mark.pixel[1]!r}" for mark in marks]
        if not lines:
            raise InputError("--control_points: no point with coordinates has a mark in a photo of this run")
        return lines


def adjust_epoch(
    project: Project, stored: pathlib.Path | None, with_database: bool, survey: Survey | None = None
) -> None:
    """Matches the new photos of a project with each other, and adjusts those that were localized together.

    `stored`: the database of the photos; None if lazy_localizer has written one. `with_database`: the model has the
    database images, too. `survey`: places the photos.
    """
    folder = project.folder
    results = read_results(folder.localized / RESULTS)
    lines = [] if survey is None else survey.lines([*results, *read_model(folder.model).images], folder.model)
    run_key = json.loads((folder.path / RUN).read_text(encoding="utf-8"))["key"]
    key = fingerprint(run_key, with_database, *([lines] if lines else []))
    done, matches = folder.epoch / DONE, folder.epoch / MATCHES
    if done.exists() and done.read_text() == key and (folder.epoch / RESULTS).exists():
        return
    warn_of_rigs(results)
    folder.epoch.mkdir(exist_ok=True)
    done.unlink(missing_ok=True)
    if stored is not None and not matches.exists():
        copy_database(stored, matches)
    with DatabaseReader(matches) as database:
        found = {name: result for name, result in results.items() if name in database.image_ids}
        cameras = common_cameras(found, {name: database.camera(name) for name in found})
    set_cameras(matches, cameras)
    project.match(matches, epoch_pairs(found))
    is_ours = has_command(project.colmap, "lazy_epoch")
    words: list[object] = [*command_line(str(project.colmap) if is_ours else None, "lazy_epoch")]
    words += ["--database_path", matches, "--input_path", folder.model, "--localized_path", folder.localized]
    words += ["--output_path", folder.epoch, "--LazyEpoch.with_database", int(with_database)]
    (folder.epoch / CONTROL_POINTS).unlink(missing_ok=True)
    if lines:
        (folder.epoch / CONTROL_POINTS).write_text("\n".join([*lines, ""]), encoding="utf-8")
        words += ["--control_points_path", folder.epoch / CONTROL_POINTS]
    with ProgressBar(f"adjusting {len(found)} photos together") as bar:
        project.runner.run(words, bar, shown=("control point", "WARNING"))
    done.write_text(key)


def warn_of_rigs(results: Mapping[str, ResultFields]) -> None:
    """Names rigs, whose photos are each adjusted on their own."""
    frames = Counter(frame for result in results.values() if (frame := result.get("frame")) is not None)
    num_photos = sum(frames.values())
    if num_photos > len(frames):
        logger.warning(
            "--epoch adjusts each of %d photos of rigs on its own, because it does not know rigs", num_photos
        )


def epoch_pairs(results: Mapping[str, ResultFields]) -> list[tuple[str, str]]:
    """Returns the pairs of new photos to match: those of near viewpoints. A photo without a pose is matched with all
    others, if these are few, else with those of the nearest names."""
    poses = {name: pose for name, result in results.items() if (pose := pose_of(result)) is not None}
    camera = Camera("SIMPLE_PINHOLE", 1, 1, (1.0, 0.0, 0.0))  # on which the pairs do not depend
    posed = [PosedImage(name, camera, pose) for name, pose in poses.items()]
    pairs = set(pairs_by_viewpoint(posed, NUM_NEIGHBORS)) if len(posed) > 1 else set()
    names = sorted(results)
    others = all_pairs(names) if len(names) <= MAX_NUM_EXHAUSTIVE else pairs_in_sequence(names, SEQUENCE_REACH)
    pairs.update(pair for pair in others if not poses.keys() >= set(pair))
    return sorted({(min(pair), max(pair)) for pair in pairs})


def common_cameras(results: Mapping[str, ResultFields], stored: Mapping[str, Camera | None]) -> dict[str, Camera]:
    """Returns better cameras by photo for photos whose intrinsics were guessed: the median of those that localization
    has found for all photos of the same `stored` camera. Matches are verified with them."""
    refined: dict[Camera, list[Camera]] = {}
    for name, result in results.items():
        own, fields = stored[name], result.get("camera")
        if own is not None and fields is not None and pose_of(result) is not None:
            camera = Camera(fields["model"], fields["width"], fields["height"], tuple(fields["params"]))
            refined.setdefault(own, []).append(camera)
    medians = {own: _median(cameras) for own, cameras in refined.items()}
    return {name: medians[own] for name, own in stored.items() if own is not None and own in medians}


def _median(cameras: Sequence[Camera]) -> Camera:
    """Returns the median of each parameter, of the cameras of the most frequent model."""
    model = Counter(camera.model for camera in cameras).most_common(1)[0][0]
    same = [camera for camera in cameras if camera.model == model]
    params = np.median([camera.params for camera in same], axis=0)
    return Camera(model, same[0].width, same[0].height, tuple(params.tolist()))
