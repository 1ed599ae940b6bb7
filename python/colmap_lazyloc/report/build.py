"""Makes everything that a page holds."""

import dataclasses
import pathlib

import numpy as np

from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.progress import progress
from colmap_lazyloc.queries import read_queries, read_query_lines
from colmap_lazyloc.report import photos
from colmap_lazyloc.report.chunk import pack
from colmap_lazyloc.report.coordinates import find_systems
from colmap_lazyloc.report.details import DETAILS_PER_BLOCK, detail_chunk
from colmap_lazyloc.report.drawing import can_project, drawing_chunk
from colmap_lazyloc.report.gaps import BAD_RECORD, Gaps
from colmap_lazyloc.report.repeat import RepeatCommands
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.report.scene import scene_chunk
from colmap_lazyloc.report.scene_points import choose_points
from colmap_lazyloc.report.summary import summary_chunk
from colmap_lazyloc.report.table import query_chunk
from colmap_lazyloc.report.warnings import find_warnings


@dataclasses.dataclass(frozen=True)
class Sources:
    """What a report reads besides the run, and how much of it."""

    image_path: pathlib.Path | None
    database_path: pathlib.Path | None
    max_num_images: int
    max_num_points: int
    crs: str | None  # in which positions are wanted


def build_page(run: Run, sources: Sources) -> tuple[dict[str, bytes], list[bytes]]:
    """Returns the chunks by name, and the photos."""
    if sources.database_path is None:
        return _build(run, sources, None)
    path = sources.database_path
    if not path.is_file():
        raise InputError(f"--database_path {path}: is not a file")
    try:
        database = DatabaseReader(path)
    except BAD_RECORD as error:
        raise InputError(f"--database_path {path}: is not a readable COLMAP database: {error}") from None
    with database:
        return _build(run, sources, database)


def _build(run: Run, sources: Sources, database: DatabaseReader | None) -> tuple[dict[str, bytes], list[bytes]]:
    chosen = photos.choose_queries(len(run.queries), sources.max_num_images)
    lines, listed = _query_list(run)
    gaps = Gaps()
    cameras = _query_cameras(run, listed, database, gaps)
    points = choose_points(run, sources.max_num_points)
    shown = photos.no_photos(run)
    if sources.image_path is not None:
        shown = photos.read_photos(run, sources.image_path, chosen, gaps)
        points = dataclasses.replace(points, colors=photos.point_colors(run, sources.image_path, points))
    drawings = {
        query: pack(*drawing_chunk(run, query, cameras[query], database, shown, gaps))
        for query in progress(chosen, "drawings")
        if run.queries[query]["pairs"]
    }
    is_drawn = np.zeros(len(run.queries), bool)
    is_drawn[list(drawings)] = True
    scene, scene_arrays, size = scene_chunk(run, cameras, points, _frames(database, gaps))
    gaps.log()
    num_shown = {"points": len(points.xyz), "photos": len(shown.files)}
    notes = _notes(run, sources, num_shown, bool(lines))
    chunks = {
        "summary": pack(summary_chunk(run, num_shown, find_warnings(run, size, database, gaps), notes), {}),
        "queries": pack(*query_chunk(run, find_systems(run, sources.crs), shown.of_query, is_drawn)),
        "scene": pack(scene, scene_arrays),
    }
    repeat = RepeatCommands(run, lines)
    for block in progress(range((len(run.queries) - 1) // DETAILS_PER_BLOCK + 1), "details"):
        chunks[f"details/{block}"] = pack(*detail_chunk(run, block, repeat))
    return chunks | {f"drawing/{query}": drawing for query, drawing in drawings.items()}, shown.files


def _query_list(run: Run) -> tuple[dict[str, str], dict[str, Camera | None]]:
    """Returns the lines and the cameras of the query list by name; empty if the run had none or it is not there."""
    path = run.query_list
    try:
        return (read_query_lines(path), read_queries(path)) if path else ({}, {})
    except InputError:
        return {}, {}


def _query_cameras(
    run: Run, listed: dict[str, Camera | None], database: DatabaseReader | None, gaps: Gaps
) -> list[Camera | None]:
    """Returns the queries' intrinsics, as far as they are known: those of the model, because they may have been
    estimated, or else those that the run was given."""
    cameras = []
    for name in run.names:
        camera = listed.get(name)
        if name in run.model.images:
            camera = run.model.cameras[run.model.images[name].camera_id]
        elif camera is None and name in run.database.images:
            camera = run.database.cameras[run.database.images[name].camera_id]
        elif camera is None and database is not None and name in database.image_ids:
            try:
                camera = database.camera(name)
            except BAD_RECORD as error:
                gaps.records[name] = f"its camera cannot be read: {error}"
        cameras.append(camera)
    return cameras


def _frames(database: DatabaseReader | None, gaps: Gaps) -> list[list[str]]:
    """Returns the names of the database images of each frame."""
    try:
        return [] if database is None else database.frames()
    except BAD_RECORD as error:
        gaps.records["table frame_data"] = f"cannot be read: {error}"
        return []


def _notes(run: Run, sources: Sources, num_shown: dict[str, int], has_list: bool) -> list[str]:
    """Returns where metres come from, and what is missing in the page and why."""
    notes = []
    if run.alignment:
        notes.append(f"The coordinates of the database images are {run.alignment[0]}.")
    if sources.image_path is None:
        notes.append("There are no photos, because --image_path was not given to the report.")
    elif len(run.queries) > sources.max_num_images:
        worst = round(photos.WORST_SHARE * sources.max_num_images)
        notes.append(
            f"Photos and matches are shown for {sources.max_num_images} of {len(run.queries)} queries: the {worst} "
            "least certain, and others drawn at random (--max_num_images)."
        )
    if sources.database_path is None:
        notes.append("Rejected matches are not shown, because --database_path was not given to the report.")
    if not can_project():
        notes.append("Reprojection errors are not drawn, because pycolmap is not installed.")
    if num_shown["points"] < len(run.points):
        notes.append(f"{num_shown['points']} of {len(run.points)} points are shown (--max_num_points).")
    if run.leave_one_out is not None:
        notes.append(
            "A position counts as wrong if it is off by more than 5 standard deviations of its covariance, and by "
            "more than 0.5 % of the scene's size."
        )
    if run.leave_one_out is not None and run.database is run.model:
        path = run.options.values.get("input_path")
        notes.append(f"Database images are where the run has put them, because its input model {path} was not found.")
    if run.query_list is not None and not has_list:
        path = run.options.values["query_list_path"]
        notes.append(f"The commands that repeat a query may lack intrinsics, because {path} was not found.")
    if not run.options.program:
        notes.append("The run does not record which version of the program made it.")
    return notes
