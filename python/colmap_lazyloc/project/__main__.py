"""Localizes photos, or the frames of a video, in a folder of photos: from files to the report.

    lazyloc run --database_images photos --poses transforms.json --queries new_photos --output localization

--poses is a COLMAP model, or a file of another program, as for `lazyloc import`. Without it, COLMAP's mapper makes the
poses first. The photos' features and matches are made by COLMAP's commands in database.db in the output folder.
Given again, the command skips the steps that are done. --onnx_path, and further options whose names have a dot, such as
--LazyLocalizer.num_retrieved 40, are those of `colmap lazy_localizer`; those of --SiftExtraction apply to all photos.
"""

import argparse
import dataclasses
import pathlib
import shutil
import sys
from collections.abc import Sequence

from colmap_lazyloc.errors import InputError, command, logger, positive_int
from colmap_lazyloc.extras import install_command, is_installed
from colmap_lazyloc.import_poses import add_source_options, make_source
from colmap_lazyloc.model import Camera
from colmap_lazyloc.panoramas import REFERENCE, face_cameras, read_face_poses
from colmap_lazyloc.pose_formats.posed_images import PosedImages
from colmap_lazyloc.pose_formats.registry import FORMATS, read_posed_images
from colmap_lazyloc.project import steps
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import DATABASE, QUERY, Folder, Steps, fingerprint, link_photos
from colmap_lazyloc.project.frames import is_video, write_frames
from colmap_lazyloc.project.panoramas import cut_panoramas, write_project_rig
from colmap_lazyloc.results import pose_of, read_results

GROUP_SIZE = 5
PANORAMA_ROLES = {DATABASE: [DATABASE], "queries": [QUERY], "all": [DATABASE, QUERY]}
MAX_NUM_LINES = 20  # of queries that are printed


def parse_arguments(arguments: Sequence[str] | None) -> tuple[argparse.Namespace, list[str]]:
    """Returns our options, and the words for lazy_localizer."""
    parser = argparse.ArgumentParser(
        prog="lazyloc run",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("--database_images", type=pathlib.Path, required=True, metavar="DIR", help="folder of the database images")
    add("--queries", type=pathlib.Path, required=True, metavar="PATH", help="folder of photos, a photo, or a video")
    add("--output", "--output_path", dest="output_path", type=pathlib.Path, required=True, metavar="DIR")
    add("--poses", type=pathlib.Path, metavar="PATH", help="poses of the database images; default: COLMAP's mapper")
    add("--poses_format", choices=list(FORMATS), help="format of --poses; default: by its content")
    add_source_options(parser.add_argument_group("poses").add_argument)
    _add_more(parser)
    options, words = parser.parse_known_args(arguments)
    for word in words:
        name = word.removeprefix("--").split("=")[0]
        if word.startswith("--") and "." not in name and name != "onnx_path":
            raise InputError(f"unknown option {word}")
    return options, words


def _add_more(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("photos").add_argument
    add(
        "--query_camera",
        metavar="'MODEL W H PARAMS...'",
        help="intrinsics of the queries; default: those of a database image of the same size, EXIF, or a guess, "
        "corrected by the images",
    )
    add(
        "--masks",
        type=pathlib.Path,
        metavar="DIR",
        help="folder of masks: NAME.png for the photo NAME, black where features are not wanted; those of database "
        "images and queries may be in folders `database` and `query`",
    )
    add(
        "--panoramas",
        choices=(*PANORAMA_ROLES,),
        help="which photos are equirectangular panoramas; they are cut into perspective faces",
    )
    add("--frames_per_second", type=_positive, default=2.0, help="of a video; default: %(default)s")
    add(
        "--sequence",
        type=positive_int,
        nargs="?",
        const=GROUP_SIZE,
        metavar="N",
        help="localize N consecutive queries together, matched with each other; without a number "
        f"{GROUP_SIZE}; default: each alone",
    )
    add = parser.add_argument_group("steps").add_argument
    add("--num_neighbors", type=positive_int, default=10, help="database images that each is matched with; default: 10")
    add("--use_gpu", type=int, choices=(0, 1), default=0, help="use COLMAP's GPU features and matching; default: 0")
    add("--overwrite", action="store_true", help="remove what an earlier run with other photos or options has left")


def _positive(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"must be positive, but is '{text}'")
    return value


@command(name="lazyloc run", extra="run")
def main(arguments: Sequence[str] | None = None) -> None:
    options, words = parse_arguments(arguments)
    _check(options)
    sift_options, localizer_options = _split(words)
    colmap = steps.find_program()
    steps.check_localizer_options(colmap, localizer_options)
    folder = Folder(options.output_path)
    if options.overwrite:
        _remove(folder)
    folder.path.mkdir(parents=True, exist_ok=True)
    project = steps.Project(
        folder,
        Steps(folder.steps),
        ColmapRunner(folder.log),
        colmap,
        bool(options.use_gpu),
        options.masks is not None,
        sift_options,
    )
    photos, posed = options.database_images, None
    widths: dict[str, int] = {}
    if DATABASE in _panorama_roles(options):
        photos, widths = cut_panoramas(project, DATABASE, photos)
    if options.poses is not None:
        source = make_source(options.poses, options.database_images, options)
        posed = (
            read_face_poses(source, widths, options.poses_format)
            if widths
            else read_posed_images(source, options.poses_format)
        )
    names = link_photos(folder, DATABASE, photos, options.masks)
    if posed is not None:
        posed = _rename(posed, names)
        num_left = len(names) - len(posed.images)
        if num_left > 0:
            logger.warning("%d of %d photos have no pose and are not used", num_left, len(names))
    cameras = face_cameras(widths)
    steps.make_database(project, {names[name]: cameras.get(name) for name in names}, posed, options.num_neighbors)
    steps.make_model(project, posed, refines_cameras=not widths)
    queries = _add_queries(project, options, localizer_options, posed)
    _write_report(folder)
    _print_results(folder, queries)


def _panorama_roles(options: argparse.Namespace) -> list[str]:
    return PANORAMA_ROLES.get(options.panoramas, [])


def _check(options: argparse.Namespace) -> None:
    """Checks what costs no time."""
    if not options.database_images.is_dir():
        raise InputError(f"--database_images {options.database_images}: is not a folder")
    if not options.queries.exists():
        raise InputError(f"--queries {options.queries}: does not exist")
    if options.masks is not None and not options.masks.is_dir():
        raise InputError(f"--masks {options.masks}: is not a folder")
    if options.query_camera is not None:
        Camera.parse("--query_camera", options.query_camera)
    if options.panoramas is not None and (options.masks is not None or options.sequence is not None):
        raise InputError("--panoramas excludes --masks and --sequence")
    if QUERY in _panorama_roles(options) and options.query_camera is not None:
        raise InputError(
            "--query_camera is that of perspective photos, but --panoramas says that queries are panoramas"
        )
    for path in (options.database_images, options.queries):
        if options.output_path.resolve() == path.resolve():
            raise InputError(f"--output {options.output_path}: is a folder of photos")
    if is_video(options.queries):
        import cv2  # noqa: F401


def _split(words: list[str]) -> tuple[list[str], list[str]]:
    """Returns the options of feature extraction, and the others."""
    sift: list[str] = []
    other: list[str] = []
    current = other
    for word in words:
        if word.startswith("--"):
            current = sift if word.startswith("--SiftExtraction.") else other
        current.append(word)
    return sift, other


def _remove(folder: Folder) -> None:
    """Removes the files of an earlier run, and no others."""
    for path in (folder.images, folder.masks, folder.frames, folder.faces, folder.model, folder.sparse, folder.lists):
        shutil.rmtree(path, ignore_errors=True)
    for path in (folder.steps, folder.index, folder.vocab_tree, folder.report, folder.log):
        path.unlink(missing_ok=True)
    for suffix in ("", "-wal", "-shm"):
        folder.database.with_name(folder.database.name + suffix).unlink(missing_ok=True)


def _rename(posed: PosedImages, names: dict[str, str]) -> PosedImages:
    """Returns the images with the names of the links, relative to the folder of database images."""
    images = [
        dataclasses.replace(image, name=names[image.name].removeprefix(f"{DATABASE}/"))
        for image in posed.images
        if image.name in names
    ]
    return PosedImages(images, posed.origin)


def _add_queries(
    project: steps.Project, options: argparse.Namespace, words: list[str], posed: PosedImages | None
) -> dict[str, str]:
    """Localizes the queries; returns what they are called, by name: a panorama by the name of its first face."""
    folder, source = project.folder, options.queries
    if is_video(source):
        key = fingerprint(options.frames_per_second, files=[source])
        if not project.steps.is_done("frames", key):
            shutil.rmtree(folder.frames, ignore_errors=True)
            count = write_frames(source, folder.frames, options.frames_per_second)
            logger.info("%d frames of %s", count, source)
            project.steps.finish("frames", key)
        source = folder.frames
    widths: dict[str, int] = {}
    if QUERY in _panorama_roles(options):
        source, widths = cut_panoramas(project, QUERY, source)
        rigs = [QUERY, *([DATABASE] if posed is not None and DATABASE in _panorama_roles(options) else [])]
        words = [*words, "--rig_config_path", str(write_project_rig(project, rigs))]
    names = link_photos(folder, QUERY, source, options.masks)
    queries = sorted(names.values())
    camera = None if options.query_camera is None else Camera.parse("--query_camera", options.query_camera)
    if options.sequence is not None:
        camera = camera or _camera_of_size(folder, queries[0], posed)
        words = [*words, "--LazyLocalizer.group_size", str(options.sequence)]
    if options.sequence is not None or options.masks is not None:
        database = [f"{DATABASE}/{image.name}" for image in posed.images] if posed else []
        steps.add_queries(
            project, queries, database or steps.database_names(folder), camera, options.sequence is not None
        )
    cameras = dict.fromkeys(queries, camera) | {names[name]: face for name, face in face_cameras(widths).items()}
    lines = [f"{name} {own.text()}" if (own := cameras[name]) else name for name in queries]
    steps.localize(project, lines, queries, words)
    if not widths:
        return {name: name for name in queries}
    faces = sorted(names[f"{REFERENCE}/{name}"] for name in widths)
    return {face: face.replace(f"/{REFERENCE}/", "/", 1) for face in faces}


def _camera_of_size(folder: Folder, name: str, posed: PosedImages | None) -> Camera:
    """Returns the camera of the database images that has the size of a query."""
    import PIL.Image

    with PIL.Image.open(folder.images / name) as photo:
        size = photo.size
    cameras = {image.camera for image in posed.images} if posed else set()
    cameras = {camera for camera in cameras if (camera.width, camera.height) == size}
    if len(cameras) != 1:
        raise InputError("--sequence needs --query_camera, because frames with unknown intrinsics are localized alone")
    return cameras.pop()


def _write_report(folder: Folder) -> None:
    from colmap_lazyloc.report.__main__ import main as write_report

    words = [str(folder.localized), "--database_path", str(folder.database), "--output", str(folder.report)]
    if is_installed("cv2"):
        words += ["--image_path", str(folder.images)]
    else:
        logger.warning("no photos in the report: %s", install_command("run", ["cv2"]))
    logger.info("writing the report")
    if write_report(words) != 0:
        raise InputError(f"{folder.report}: the report was not written; the results are in {folder.localized}")


def _print_results(folder: Folder, shown: dict[str, str]) -> None:
    """Prints where the queries are, in the coordinates of the model; `shown`: what they are called, by name."""
    results = {
        shown.get(name, name): result for name, result in read_results(folder.localized / "results.jsonl").items()
    }
    queries = list(shown.values())
    poses = {name: pose for name in queries if name in results and (pose := pose_of(results[name])) is not None}
    width = max(map(len, queries))
    for name in queries[:MAX_NUM_LINES]:
        if name in poses:
            x, y, z = poses[name].cam_in_world
            print(f"{name:<{width}}  {x:12.3f} {y:12.3f} {z:12.3f}")
        elif name in results:
            print(f"{name:<{width}}  {results[name]['status']}: {results[name]['reason']}")
    if len(queries) > MAX_NUM_LINES:
        print(f"... and {len(queries) - MAX_NUM_LINES} others")
    print(f"{len(poses)} of {len(queries)} queries localized: {folder.localized}")


if __name__ == "__main__":
    sys.exit(main())
