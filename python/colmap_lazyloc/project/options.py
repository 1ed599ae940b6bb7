"""The options of `lazyloc run`: what they are, and whether each can have its effect."""

import argparse
import functools
import importlib
import itertools
import math
import os
import pathlib
from collections.abc import Sequence

from colmap_lazyloc.agreement.check import add_accept_option
from colmap_lazyloc.errors import InputError, Parser, logger, positive_int
from colmap_lazyloc.import_poses import CONVENTION_OPTIONS, add_source_options, join_values, make_source
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats import positions
from colmap_lazyloc.pose_formats.control_points import POINT_STDDEV_M, read_control_points
from colmap_lazyloc.pose_formats.geo import find_crs
from colmap_lazyloc.pose_formats.registry import FORMATS
from colmap_lazyloc.project.folder import DATABASE, QUERY, Folder
from colmap_lazyloc.project.frames import is_video, open_video
from colmap_lazyloc.report.facts import METRE, MODEL_UNITS

GROUP_SIZE = 5
PANORAMA_ROLES = {DATABASE: [DATABASE], "queries": [QUERY], "all": [DATABASE, QUERY]}
FRAMES_PER_SECOND = 2.0
NUM_NEIGHBORS = 10


def parse_arguments(description: str | None, arguments: Sequence[str] | None) -> tuple[argparse.Namespace, list[str]]:
    """Returns our options, and the words for lazy_localizer."""
    parser = Parser(
        prog="lazyloc run",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        is_foreign=_is_of_localizer,
    )
    add = parser.add_argument
    add(
        "--database_images",
        type=pathlib.Path,
        required=True,
        metavar="PATH",
        help="folder of the database images, or a video of the place",
    )
    add(
        "--queries",
        type=pathlib.Path,
        required=True,
        metavar="PATH",
        help="photos to localize: a folder, a photo, or a video",
    )
    add(
        "--output",
        dest="output_path",
        type=pathlib.Path,
        required=True,
        metavar="DIR",
        help="folder for the results; created if it does not exist",
    )
    add(
        "--poses",
        type=pathlib.Path,
        metavar="PATH",
        help="poses of the database images; default: COLMAP's mapper computes the poses. A table of positions without "
        "rotations (name, latitude, longitude, altitude) places and scales the mapper's model",
    )
    add(
        "--poses_format",
        choices=[*FORMATS, *positions.FORMATS],
        help="format of --poses; default: recognized from the content. exif: a folder of photos with GPS; positions: "
        "a table of positions without rotations",
    )
    of_poses = parser.add_argument_group("poses").add_argument
    add_source_options(of_poses)
    add_accept_option(of_poses)
    of_poses(
        "--unit",
        choices=(METRE, MODEL_UNITS),
        help="unit of lengths in --poses: metres or unknown units; default: m for geographic poses, else units",
    )
    of_poses(
        "--scale",
        nargs=3,
        metavar=("A", "B", "METRES"),
        help="known distance in metres, for photos without GPS and without --poses. A and B are points in database "
        "images (PHOTO:x,y in pixels, for example --scale a.jpg:310,250 a.jpg:1480,262 1.6), or the cameras of "
        "database images (--scale a.jpg b.jpg 4.2). A point that is marked in several photos is more accurate: "
        "a.jpg:310,250+b.jpg:420,248",
    )
    of_poses(
        "--control_points",
        nargs="+",
        type=pathlib.Path,
        metavar="FILE",
        help="surveyed points and their marks in photos: the files for `lazyloc control_points`. Without --poses, they "
        "place the model in the coordinates of the points; this needs at least three points that are not on one line, "
        "each marked in two or more database images",
    )
    of_poses(
        "--use_control_points",
        nargs="?",
        type=_positive,
        const=POINT_STDDEV_M,
        metavar="STDDEV",
        help="with --epoch: place the new photos in the coordinates of --control_points. STDDEV is the standard "
        f"deviation of the points' coordinates, in the unit of the model (default: {POINT_STDDEV_M:g}). Without "
        "--poses, --control_points must first place the model",
    )
    _add_more(parser)
    given = join_values(arguments)
    options, words = parser.parse_known_args(given)
    is_value = False  # of an option
    for word in words:
        is_option = word.startswith("--")
        if not is_option and not is_value:
            raise InputError(_unexpected(word, given))
        is_value = is_option and "=" not in word
    return options, words


def _unexpected(word: str, given: Sequence[str]) -> str:
    """Returns what is wrong with a word that is no option and no value: often one of several photos."""
    before = [other.partition("=")[0] for other in given[: given.index(word)] if other.startswith("--")]
    if not before:
        return f"unexpected word {word}"
    is_of_photos = before[-1] in ("--database_images", "--queries")
    advice = "; to pass several photos, pass their folder" if is_of_photos else ""
    return f"unexpected word {word}: {before[-1]} takes one value{advice}"


def _add_more(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("photos").add_argument
    add(
        "--query_camera",
        metavar="'MODEL W H PARAMS...'",
        help="intrinsics of the queries; default: from a database image of the same size, else estimated",
    )
    add(
        "--one_camera",
        action="store_true",
        help="assume that one camera at one zoom took all queries that have the same size and no given intrinsics; the "
        "intrinsics are estimated from these queries together. Default: only for --epoch, for frames of a video, or if "
        "EXIF shows that one camera took them",
    )
    add(
        "--masks",
        type=pathlib.Path,
        metavar="DIR",
        help="folder of masks: NAME.png for the photo NAME, also in the subfolders `database` and `query`. No features "
        "are extracted where a mask is black",
    )
    add(
        "--panoramas",
        choices=(*PANORAMA_ROLES,),
        help="which photos are equirectangular panoramas, which are cut into perspective images",
    )
    add(
        "--frames_per_second",
        type=_positive,
        help=f"number of frames to extract per second of a video; default: {FRAMES_PER_SECOND}",
    )
    add(
        "--sequence",
        type=positive_int,
        nargs="?",
        const=GROUP_SIZE,
        metavar="N",
        help=f"match N consecutive queries with each other and localize them together (N is {GROUP_SIZE} if you omit "
        "it); default: localize each query individually",
    )
    add(
        "--epoch",
        nargs="?",
        choices=("new", "both"),
        const="new",
        help="adjust the poses of all new photos together, with unchanged poses of the database images. The model of "
        "the results contains the new photos; with `--epoch both`, also the database images",
    )
    add = parser.add_argument_group("steps").add_argument
    add(
        "--complete",
        type=int,
        choices=(0, 1),
        default=0,
        help="with --poses: extract and match the features of all database images, for other programs that read "
        "database.db; localization does not need this. Default: 0",
    )
    add(
        "--num_neighbors",
        type=positive_int,
        help="with --complete, --masks or --sequence: number of nearby database images with which each database "
        f"image is matched; default: {NUM_NEIGHBORS}",
    )
    add("--use_gpu", type=int, choices=(0, 1), default=0, help="extract and match features on the GPU; default: 0")
    add_flag = functools.partial(add, nargs="?", type=int, choices=(0, 1), const=1, default=0)
    add_flag("--overwrite", help="delete the results of earlier runs in the output folder, and start anew; default: 0")
    add_flag("--strict", help="exit with code 2 if any query was not localized; default: 0")


def _is_of_localizer(name: str) -> bool:
    return "." in name or name == "onnx_path"


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be positive, but is '{text}'")
    return value


def panorama_roles(options: argparse.Namespace) -> list[str]:
    """Returns which photos are panoramas: database images, queries, both or none."""
    return PANORAMA_ROLES.get(options.panoramas, [])


def has_stored_queries(options: argparse.Namespace) -> bool:
    """True if the queries are in the database, which masks and sequences need; else they are photos in memory."""
    return options.masks is not None or options.sequence is not None


def matches_neighbors(options: argparse.Namespace) -> bool:
    """True if database images with poses are matched with their neighbours. Photos in memory do not need it."""
    return options.poses is not None and (bool(options.complete) or has_stored_queries(options))


def can_extract_on_demand(options: argparse.Namespace) -> bool:
    """True if features of database images may be extracted when a query needs them. The mapper, queries in the database
    and COLMAP's GPU features need all before."""
    return options.poses is not None and not has_stored_queries(options) and not options.use_gpu


def split(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Returns the options of feature extraction, and the others."""
    sift: list[str] = []
    other: list[str] = []
    current = other
    for word in words:
        if word.startswith("--"):
            current = sift if word.startswith("--SiftExtraction.") else other
        current.append(word)
    return sift, other


def check(options: argparse.Namespace, words: Sequence[str]) -> None:
    """Checks what costs no time: paths, values, and that no option is without effect."""
    _check_paths(options)
    for name in ("camera", "query_camera"):
        if getattr(options, name) is not None:
            Camera.parse(f"--{name}", getattr(options, name))
    _separate_positions(options)
    if options.poses is not None:
        make_source(options.poses, options.database_images, options)
    roles = panorama_roles(options)
    if roles and (options.masks is not None or options.sequence is not None):
        raise InputError("--panoramas excludes --masks and --sequence")
    if options.one_camera and (options.query_camera is not None or options.sequence is not None or QUERY in roles):
        raise InputError("--one_camera excludes --query_camera, --sequence and panoramas as queries")
    if options.epoch is not None and QUERY in roles:
        raise InputError("--epoch needs perspective photos, but --panoramas says that queries are panoramas")
    if QUERY in roles and options.query_camera is not None:
        raise InputError(
            "--query_camera is that of perspective photos, but --panoramas says that queries are panoramas"
        )
    if DATABASE in roles and options.camera is not None:
        raise InputError(
            "--camera is that of perspective photos, but --panoramas says that database images are panoramas"
        )
    _check_metres(options)
    used = {"camera", "crs"} if options.positions is None else {"camera", "crs", "geo_origin", "poses_format"}
    for name in ("poses_format", "geo_origin", "unit", "accept_poses", *CONVENTION_OPTIONS):
        if options.poses is None and getattr(options, name) and name not in used:
            missing = "without --poses" if options.positions is None else "on positions, which have no rotations"
            raise InputError(f"--{name} has no effect {missing}")
    if options.num_neighbors is not None and not matches_neighbors(options):
        logger.warning("--num_neighbors has no effect without --poses and one of --complete 1, --masks and --sequence")
    videos = [path for path in (options.database_images, options.queries) if is_video(path)]
    if options.frames_per_second is not None and not videos:
        raise InputError(f"--frames_per_second has no effect, because --queries {options.queries} is not a video")
    names = {word.partition("=")[0] for word in words}
    if has_stored_queries(options) and "--onnx_path" in names:
        raise InputError("--onnx_path has no effect with --masks and --sequence")
    if options.sequence is not None and options.query_camera is None and options.poses is None:
        raise InputError("--sequence needs --query_camera, because frames with unknown intrinsics are localized alone")
    if options.sequence is not None and "--LazyLocalizer.group_size" in names:
        raise InputError("--LazyLocalizer.group_size: is given by --sequence")
    for video in videos:
        open_video(video).release()
    for word, value in itertools.pairwise([*words, ""]):
        name, has_value, joined = word.partition("=")
        path = pathlib.Path(joined if has_value else value)
        if name == "--onnx_path" and not path.is_dir():
            raise InputError(f"--onnx_path {path}: is not a folder")


def _separate_positions(options: argparse.Namespace) -> None:
    """Makes --poses the option `positions` if it has no rotations: the poses are then those of COLMAP's mapper."""
    options.positions = None
    if options.poses is None:
        return
    form = options.poses_format or positions.find_format(options.poses)
    if form in positions.FORMATS:
        if DATABASE in panorama_roles(options):
            raise InputError(f"--poses {options.poses}: panoramas need rotations, too")
        options.positions, options.poses, options.poses_format = options.poses, None, form


def _check_metres(options: argparse.Namespace) -> None:
    """Checks --scale, --control_points and --crs, which act on a model of COLMAP's mapper, too; reads the points as
    `options.surveyed`."""
    options.surveyed = None
    for name in ("control_points", "epoch"):
        if options.use_control_points is not None and getattr(options, name) is None:
            raise InputError(f"--use_control_points needs --{name}")
    if options.control_points is not None or (
        options.scale is not None and any(":" in end for end in options.scale[:2])
    ):
        for module in ("pycolmap", "scipy"):
            importlib.import_module(module)  # so that it is missed before any work
    if options.control_points is not None:
        given = next((name for name in ("poses", "positions", "scale") if getattr(options, name) is not None), None)
        if given is not None and (options.use_control_points is None or given == "scale"):
            name = "poses" if given == "positions" else given
            raise InputError(
                f"--control_points has no effect with --{name}: compare with the points after the run (lazyloc "
                "control_points)"
                + ("" if given == "scale" else ", or place new photos by them (--epoch --use_control_points)")
            )
        if DATABASE in panorama_roles(options):
            raise InputError("--control_points has no effect on panoramas")
        has_poses = options.poses is not None or options.positions is not None
        options.surveyed = read_control_points(options.control_points, options.crs, not has_poses)
        if not options.surveyed.points:
            raise InputError(f"--control_points {options.control_points[0]}: no point has coordinates")
    if options.scale is not None:
        if options.poses is not None or options.positions is not None:
            raise InputError("--scale has no effect with --poses: their coordinates are used as they are")
        if DATABASE in panorama_roles(options):
            raise InputError("--scale has no effect on panoramas")
        try:
            distance = options.scale[2].removesuffix("m")
            is_positive = 0 < float(distance) < math.inf
        except ValueError:
            is_positive = False
        if not is_positive:
            raise InputError(f"--scale: expected a distance in metres, found '{options.scale[2]}'")
        options.scale[2] = distance
    if options.crs is not None:
        if options.scale is not None:
            raise InputError("--crs has no effect with --scale, which gives no geographic coordinates")
        find_crs(options.crs)


def _check_output(path: pathlib.Path) -> None:
    """Checks that a folder is there or can be made, and can be written."""
    place = next(place for place in (path, *path.absolute().parents) if os.path.lexists(place))
    if not place.is_dir():
        raise InputError(f"--output {path}: {place} is not a folder")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"--output {path}: you have no right to write in {place}")


def _check_paths(options: argparse.Namespace) -> None:
    if not options.database_images.is_dir() and not is_video(options.database_images):
        raise InputError(f"--database_images {options.database_images}: is neither a folder nor a video")
    if options.masks is not None and not options.masks.is_dir():
        raise InputError(f"--masks {options.masks}: is not a folder")
    if options.masks is not None and next(options.masks.rglob("*.png"), None) is None:
        raise InputError(f"--masks {options.masks}: has no mask, NAME.png for the photo NAME")
    for name in ("queries", "poses", "calibration"):
        path = getattr(options, name)
        if path is not None and not path.exists():
            raise InputError(f"--{name} {path}: does not exist")
    for name in ("database_images", "queries", "masks", "poses"):
        path = getattr(options, name)
        if path is not None and not os.access(path, os.R_OK | (os.X_OK if path.is_dir() else 0)):
            raise InputError(f"--{name} {path}: you have no right to read it")
    _check_output(options.output_path)
    output = options.output_path.resolve()
    reserved = [path.resolve() for path in Folder(output).reserved]
    for name in ("database_images", "queries", "masks", "poses"):
        path = getattr(options, name)
        if path is None:
            continue
        if path.resolve() == output:
            raise InputError(f"--output {options.output_path}: is also --{name}")
        if any(path.resolve().is_relative_to(folder) for folder in reserved):
            raise InputError(f"--{name} {path}: is in the output folder, among the files that a run replaces")
