"""Writes a report of a finished run: an HTML page that needs neither a server nor a network.

    lazyloc report RUN --image_path photos --database_path database.db --output report.html

RUN is the output folder of `colmap lazy_localizer` or of `lazyloc run`. The page shows where each query was taken, how
certain its pose is, and which matches support it. After `lazyloc run`, all options have defaults.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from colmap_lazyloc.errors import InputError, Parser, command
from colmap_lazyloc.evaluate import read_any_poses
from colmap_lazyloc.extras import is_installed
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages
from colmap_lazyloc.pose_formats.registry import FORMATS
from colmap_lazyloc.pose_formats.trajectories import tum_text
from colmap_lazyloc.pose_formats.writing import raw_poses
from colmap_lazyloc.project.folder import MATCHES, REPORT
from colmap_lazyloc.project.kept import report_settings
from colmap_lazyloc.report.build import Sources, build_page
from colmap_lazyloc.report.facts import METRE, MODEL_UNITS
from colmap_lazyloc.report.output import check_output, write_file, write_folder
from colmap_lazyloc.report.page import PAGE_NAME, page_files, read_links, set_links, single_page
from colmap_lazyloc.report.plots import plot_files
from colmap_lazyloc.report.run import Run, read_run
from colmap_lazyloc.results import find_results, find_run


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="lazyloc report",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("run", type=pathlib.Path, help="output folder of a run")
    parser.add_argument(
        "--output",
        type=pathlib.Path,
        help="page to write; with --split, folder to write. If RUN is the output folder of `lazyloc run`, the default "
        "is RUN/report.html; with --split, the folder RUN/report",
    )
    parser.add_argument(
        "--image_path",
        type=pathlib.Path,
        help="folder with the photos of queries and database images; default: the photos of `lazyloc run`, else the "
        "page shows no photos",
    )
    parser.add_argument(
        "--database_path",
        type=pathlib.Path,
        help="COLMAP database of the run; default: the database of `lazyloc run`, else rejected matches are not drawn",
    )
    parser.add_argument(
        "--ground_truth",
        type=pathlib.Path,
        help="true poses of the queries, in the coordinates of the database poses: a poses file, or the folder of a "
        "COLMAP model; default: none; after a leave-one-out run, the input model",
    )
    parser.add_argument(
        "--split",
        action="store_true",
        help=f"for large runs: write a folder instead of one file. Open {PAGE_NAME} in this folder; the page loads "
        "the other files when they are needed",
    )
    parser.add_argument(
        "--unit",
        choices=(METRE, MODEL_UNITS),
        help="unit of lengths: m (metres), or units (the unknown unit of the model); "
        "default: the unit of `lazyloc run`, else m if the run has geographic coordinates",
    )
    parser.add_argument(
        "--crs",
        help="also show positions in this coordinate reference system, for example EPSG:32632; needs geographic "
        "coordinates and pyproj; default: --crs of `lazyloc run`",
    )
    _add_bounds(parser)
    _add_other_files(parser)
    return parser.parse_args(arguments)


def _add_bounds(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--max_num_images",
        type=_count,
        default=80,
        help="maximum number of queries whose photo and matches are on the page: three quarters are the queries with "
        "the lowest confidence, one quarter is random; default: %(default)s",
    )
    parser.add_argument(
        "--max_num_points",
        type=_count,
        default=1000000,
        help="maximum number of points in the scene, distributed evenly over the queries; default: %(default)s",
    )


def _add_other_files(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--tum",
        type=pathlib.Path,
        metavar="FILE",
        help="also write the poses for evo, in TUM's format (world_from_cam). The time of a query is the last number "
        "in its file name; if these numbers are not unique, the times are 0, 1, 2, ...",
    )
    parser.add_argument(
        "--plots",
        type=pathlib.Path,
        metavar="FOLDER",
        help="also write plots as PNG and SVG files: errors, standard deviations, and the risk-coverage curve",
    )


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number, but is '{text}'")
    return int(text)


@command(name="lazyloc report", extra="report")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    results = _use_defaults(options)
    check_output(options.output, options.split, PAGE_NAME)
    if options.image_path is not None and not options.image_path.is_dir():
        raise InputError(f"--image_path {options.image_path}: is not a folder")
    truth = None if options.ground_truth is None else read_any_poses(options.ground_truth)
    run = read_run(results, truth, options.unit)
    if truth is not None and not run.truth:
        raise InputError(f"--ground_truth {options.ground_truth}: has no pose of any query")
    sources = Sources(
        options.image_path, options.database_path, options.max_num_images, options.max_num_points, options.crs
    )
    chunks, photos = build_page(run, sources)
    _write_others(run, options)
    title = f"{run.title}: {run.folder}"
    if options.split:
        size = write_folder(options.output, page_files(title, chunks, photos))
        path = options.output / PAGE_NAME
    else:
        path, links = options.output, read_links(options.output)
        size = write_file(path, (piece.encode() for piece in single_page(title, chunks, photos)))
        if links:
            set_links(path, links)
    print(f"{path}  ({size / 1e6:.1f} MB)")


def _use_defaults(options: argparse.Namespace) -> pathlib.Path:
    """Sets options that were not given to what `lazyloc run` has used, if RUN has its newest results; returns the
    folder of the results. Photos and databases of earlier results may be gone, or be others by now."""
    results, project = find_results(options.run), find_run(options.run).project
    if project is None or results.resolve().parent != project.path.resolve():
        if options.output is None:
            raise InputError(f"required: --output, because {options.run} has no results of the last `lazyloc run`")
        return results
    options.output = options.output or options.run / ("report" if options.split else REPORT)
    if is_installed("cv2"):
        options.image_path = options.image_path or project.images
    databases = (results / MATCHES, project.query_database, project.database)
    options.database_path = options.database_path or next(filter(pathlib.Path.is_file, databases), None)
    for name, value in report_settings(project).items():
        setattr(options, name, getattr(options, name) or value)
    return results


def _write_others(run: Run, options: argparse.Namespace) -> None:
    """Writes the files next to the page; makes them all before it writes the first."""
    files = {} if options.plots is None else {options.plots / name: data for name, data in plot_files(run).items()}
    if options.tum is not None:
        files[options.tum] = _tum_text(run).encode()
    for path, content in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, [content])


def _tum_text(run: Run) -> str:
    """Returns the localized queries as `lazyloc export` writes them."""
    images = [
        PosedImage(result["name"], run.model.cameras[run.model.images[result["name"]].camera_id], pose)
        for result, pose in zip(run.queries, run.poses)
        if pose is not None and result["status"] == "LOCALIZED"
    ]
    form = FORMATS["tum"]
    assert form.writer is not None
    return tum_text(raw_poses(PosedImages(images), form.convention, form.writer))


if __name__ == "__main__":
    sys.exit(main())
