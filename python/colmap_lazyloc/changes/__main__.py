"""Finds what has changed between two epochs: things that have moved, vanished or are new.

    lazyloc changes RESULTS

RESULTS is the output folder of `lazyloc run --epoch` or of `colmap lazy_epoch`. The command prints a line for each
change, and writes changes.json beside the results. `lazyloc report RESULTS` then shows the changes, too.

A thing has moved if its points have moved as one rigid body. A thing has vanished if at least three database photos
show its points, and at least two new photos from similar viewpoints show what is behind it. A thing is new if at least
three new photos show its points, and at least two database photos show what is behind it. The command cannot find
changes of a surface's colour or texture, nor changes at a place that only photos of one epoch show.
"""

import argparse
import json
import pathlib
import sys
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc import control_points
from colmap_lazyloc.control_points import NEW, database_model
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.errors import InputError, Parser, command
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import MATCHES, Folder
from colmap_lazyloc.project.pairs import pairs_by_viewpoint
from colmap_lazyloc.project.steps import colmap_command, find_program, match_pairs
from colmap_lazyloc.report.options_file import read_options
from colmap_lazyloc.results import CHANGES, Change, FoundRun, find_run

NUM_NEIGHBORS = 10  # database photos with which each is matched
MAX_NUM_LINES = 20  # of changes that are printed


def text_of(change: Change, unit: str) -> str:
    """Returns a line on a change."""
    photos = f"{len(change['database_photos'])} database photos and {len(change['new_photos'])} new ones"
    text = f"{change['kind']}: {_vector(change['centre'])}, {change['num_points']} points, {photos}"
    if change["kind"] == "moved":
        text += f"; by {_vector(change['displacement'])} {unit}, standard deviation "
        text += f"{_vector(change['displacement_stddevs'])} {unit}, turned by {change['rotation_deg']:.1f}°"
    return text


def _vector(values: Sequence[float]) -> str:
    return " ".join(f"{value:.3f}" for value in values)


def _database_path(run: FoundRun, given: pathlib.Path | None) -> pathlib.Path:
    """Returns the database of an epoch."""
    if given is None and run.project is not None:
        given = run.project.epoch / MATCHES
    if given is None and run.results is not None:
        given = pathlib.Path(read_options(run.results / "options.ini").values.get("database_path", ""))
    if given is None or not given.is_file():
        raise InputError(f"--database_path {given}: is not a file")
    return given


def _match_database(run: FoundRun, path: pathlib.Path, posed: dict[str, PosedImage]) -> None:
    """Matches the database photos with each other, unless the database has such matches."""
    with DatabaseReader(path) as database:
        known = [image for name, image in sorted(posed.items()) if name in database.image_ids]
        if any(posed.keys() >= set(pair) for pair in database.matched_pairs()):
            return
    pairs = pairs_by_viewpoint(known, NUM_NEIGHBORS) if len(known) > 1 else []
    if not pairs:
        raise InputError(f"{path}: has fewer than two database photos that look about the same way")
    if run.project is None:
        raise InputError(
            f"{path}: has no matches of database photos with each other: run colmap lazy_exhaustive_matcher"
        )
    colmap = find_program()
    folder = Folder(run.project.path)
    match_pairs(colmap_command(colmap, "matches_importer", False), ColmapRunner(folder.log), folder, path, pairs)


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(prog="lazyloc changes", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("results", metavar="RESULTS", type=pathlib.Path, help="output folder of lazyloc run --epoch or lazy_epoch")
    add(
        "--database_path",
        type=pathlib.Path,
        metavar="FILE",
        help="COLMAP database with the keypoints and matches of all photos, also between photos of the same epoch; "
        "default: the database of RESULTS",
    )
    add(
        "--output",
        type=pathlib.Path,
        metavar="FILE",
        help=f"file for the changes; default: {CHANGES} beside the results",
    )
    return parser.parse_args(arguments)


@command(name="lazyloc changes", extra="changes")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    # Import here, because --help needs none of the optional packages.
    from colmap_lazyloc.changes.find import find_changes
    from colmap_lazyloc.changes.moved import link
    from colmap_lazyloc.changes.tracks import read_matches, read_photos, triangulate

    run = find_run(options.results)
    known, origin = control_points.read_photos(options.results)
    has_epoch = run.project is None or run.project.epoch.is_dir() or options.database_path is not None
    if run.results is None or database_model(run) is None or not has_epoch:
        raise InputError(f"{options.results}: is not the output folder of lazyloc run --epoch or of colmap lazy_epoch")
    path = _database_path(run, options.database_path)
    posed = {
        name: PosedImage(name, photo.camera, photo.pose)
        for name, photo in known.items()
        if photo.camera is not None and photo.pose is not None
    }
    new_names = {name for name in posed if known[name].set_name == NEW}
    _match_database(run, path, {name: image for name, image in posed.items() if name not in new_names})
    with DatabaseReader(path) as database:
        photos = read_photos(database, posed, new_names)
        old_matches, new_matches, across = read_matches(database, photos)
    old, new = triangulate(photos, old_matches), triangulate(photos, new_matches)
    links = link(old, new, across)
    changes = find_changes(photos, old, new, links)
    if origin is not None:
        _add_geodetic(changes, origin)
    output = options.output or run.results / CHANGES
    try:
        output.write_text(json.dumps(changes, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"--output {output}: cannot be written: {error.strerror}") from None
    unit = "units" if origin is None else "m"
    for change in changes[:MAX_NUM_LINES]:
        print(text_of(change, unit))
    print(f"{len(changes)} changes; {links.is_static.sum()} points of both epochs have not moved")


def _add_geodetic(changes: Sequence[Change], origin: GeoOrigin) -> None:
    """Adds latitude and longitude in degrees, and height."""
    for change in changes:
        change["geodetic"] = origin.to_geodetic(np.array([change["centre"]]))[0].tolist()


if __name__ == "__main__":
    sys.exit(main())
