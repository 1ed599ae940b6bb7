"""Finds where new photos or video frames were taken, and writes a report.

    lazyloc run --database_images photos --poses transforms.json --queries new_photos --output localization

--poses is a COLMAP model, or a file that `lazyloc import` can read. Without --poses, COLMAP's mapper reconstructs the
database images; the results are in metres if the photos have GPS, or if you pass --scale.
Features and matches are written to database.db in the output folder. With --poses and more than 50 database images,
only the features that the queries need are extracted, unless you pass --complete 1.
If you change photos, poses or options and run the command again, it repeats only the affected steps.
You can also pass options of `colmap lazy_localizer`: --onnx_path, and options with a dot in their names, for example
--LazyLocalizer.num_retrieved 40. --SiftExtraction... applies to all photos.
"""

import argparse
import dataclasses
import pathlib
import shlex
import sys
from collections.abc import Mapping, Sequence

from colmap_lazyloc import __version__
from colmap_lazyloc.agreement.check import check_photos
from colmap_lazyloc.errors import InputError, command, logger
from colmap_lazyloc.extras import install_command, is_installed
from colmap_lazyloc.import_poses import make_source
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.panoramas import REFERENCE, face_cameras, read_face_poses
from colmap_lazyloc.pose_formats.control_points import ControlPoints
from colmap_lazyloc.pose_formats.exif_gps import read_photos
from colmap_lazyloc.pose_formats.posed_images import Photos, PosedImages, Positions, Source, photo_size
from colmap_lazyloc.pose_formats.positions import read_positions
from colmap_lazyloc.pose_formats.registry import read_posed_images
from colmap_lazyloc.project import steps
from colmap_lazyloc.project.alignment import MIN_NUM_PHOTOS, check_marks
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.distance import Distance, read_distance
from colmap_lazyloc.project.epoch import Survey, adjust_epoch
from colmap_lazyloc.project.folder import DATABASE, QUERY, RECORD, Folder, Steps, content, fingerprint
from colmap_lazyloc.project.frames import is_video, write_frames
from colmap_lazyloc.project.kept import KeptResults
from colmap_lazyloc.project.options import (
    FRAMES_PER_SECOND,
    NUM_NEIGHBORS,
    can_extract_on_demand,
    check,
    has_stored_queries,
    matches_neighbors,
    panorama_roles,
    parse_arguments,
    split,
)
from colmap_lazyloc.project.panoramas import cut_panoramas, write_project_rig
from colmap_lazyloc.project.photos import (
    check_size,
    contents,
    convert_photos,
    find_photos,
    has_one_camera,
    link_masks,
    link_photos,
)
from colmap_lazyloc.project.positions import position_lines, write_reference_system
from colmap_lazyloc.report.facts import METRE
from colmap_lazyloc.report.run import unit_of
from colmap_lazyloc.results import RESULTS, pose_of, read_geodetic, read_results

MAX_NUM_LINES = 20  # of queries that are printed
EXIT_NOT_LOCALIZED = 2  # as of lazy_localizer --strict 1
SINGLE_CAMERA = "--ImageReader.single_camera"
POSITIONS = "--LazyLocalizer.Advanced.photo_position_path"


@dataclasses.dataclass(frozen=True)
class Images:
    """The images of a project that were made of photos: of a panorama, its faces."""

    linked: dict[str, str]  # their names by those of the photos
    widths: dict[str, int]  # of the panoramas by name

    def cameras(self, default: Camera | None = None) -> dict[str, Camera | None]:
        """Returns the cameras by image name, as far as they are known."""
        faces = face_cameras(self.widths)
        return {image: faces.get(name, default) for name, image in self.linked.items()}

    def shown(self) -> dict[str, str]:
        """Returns what the images are called, by name: a panorama by the name of its first face."""
        if not self.widths:
            return {image: image for image in sorted(self.linked.values())}
        faces = sorted(self.linked[f"{REFERENCE}/{name}"] for name in self.widths)
        return {face: face.replace(f"/{REFERENCE}/", "/", 1) for face in faces}


@command(name="lazyloc run", extra="run")
def main(arguments: Sequence[str] | None = None) -> int:
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("to continue, run the same command again") from None


def _run(arguments: Sequence[str] | None) -> int:
    options, words = parse_arguments(__doc__, arguments)
    check(options, words)
    colmap = steps.find_program()
    steps.check_localizer_options(colmap, words)
    sift_options, localizer_options = split(words)
    photos = None if is_video(options.database_images) else _find_database(options, options.database_images)
    query_photos = None if is_video(options.queries) else _find_queries(options)
    _check_crs(options, photos)
    # The poses of panoramas are read when their faces are cut, and those of a video when it has frames.
    is_early = photos is not None and options.poses is not None and not panorama_roles(options)
    posed = read_posed_images(*_pose_source(options)) if is_early else None
    positions = None if photos is None else _read_positions(options)
    given = shlex.join(["lazyloc", "run", *(sys.argv[1:] if arguments is None else arguments)])
    project = _open_project(options, colmap, sift_options, given)
    if photos is None:
        options.database_images = _video_frames(project, options, DATABASE)
        photos, positions = _find_database(options, options.database_images), _read_positions(options)
    database = _make_images(project, options, DATABASE, photos)
    if options.poses is not None:
        posed = _use_poses(project, options, database, posed)
    if query_photos is None:
        query_photos = find_photos(_video_frames(project, options, QUERY), [])
    queries = _make_images(project, options, QUERY, query_photos)
    _link_masks(project, options, database, queries)
    camera = _query_camera(project, options, queries, posed)
    cameras = database.cameras(database_camera := _database_camera(project, options, database))
    if posed is not None:
        cameras = {image.name: image.camera for image in posed.images}
        _check_poses(project, options, posed)
    # Every query needs all images, if they are few.
    lazy = posed if can_extract_on_demand(options) and len(cameras) > steps.MAX_NUM_EXHAUSTIVE else None
    used = steps.make_features(project, cameras) if lazy is None else steps.add_database(project, lazy)
    if posed is not None:
        posed = _select(posed, {name: name for name in used})
    num_neighbors = (options.num_neighbors or NUM_NEIGHBORS) if matches_neighbors(options) else 0
    if lazy is None:
        steps.match_database(project, used, posed, num_neighbors)
    known = _known_lengths(options, database, positions)
    steps.make_model(project, used, posed, not database.widths and database_camera is None, known)
    survey = _survey(project, options, [*used, *queries.linked.values()])
    _localize(project, options, localizer_options, used, queries.cameras(camera), on_demand=lazy is not None)
    results = project.folder.localized
    if options.epoch is not None and _has_pose(results):
        stored = project.folder.query_database if has_stored_queries(options) else None
        adjust_epoch(project, stored, options.epoch == "both", survey)
        results = project.folder.epoch
    options.unit = METRE if known is not None else options.unit
    write_reference_system(results, options.crs)
    _write_report(project, results, options)
    num_lost = _print_results(results, project.folder.report, queries.shown(), options)
    if lazy is not None:
        steps.complete_database(project, _select(lazy, {name: name for name in used}), num_neighbors)
    return 1 if not project.folder.report.exists() else EXIT_NOT_LOCALIZED if options.strict and num_lost else 0


def _find_database(options: argparse.Namespace, folder: pathlib.Path) -> dict[str, pathlib.Path]:
    """Returns the paths of the database images by name; reads --scale as `options.distance`, and checks that
    --control_points has enough marks in them."""
    photos = find_photos(folder, _excluded(options))
    if options.surveyed is not None and options.poses is None and options.positions is None:
        check_marks(options.surveyed, photos, folder)
    options.distance = None if options.scale is None else read_distance(options.scale, photos)
    return photos


def _check_crs(options: argparse.Namespace, photos: Mapping[str, pathlib.Path] | None) -> None:
    """Raises InputError if the results cannot have geographic coordinates, which --crs needs. `photos`: the database
    images, None for a video."""
    is_given = any(given is not None for given in (options.poses, options.positions, options.surveyed))
    if options.crs is None or is_given:  # what is given is geographic, because --crs says where it is
        return
    # The frames of a video and the faces of panoramas have no EXIF.
    found = read_photos({} if photos is None or DATABASE in panorama_roles(options) else photos)
    count = sum(photo.altitude_m is not None for photo in found)
    if count < MIN_NUM_PHOTOS:
        raise InputError(
            f"--crs {options.crs} needs --poses, --control_points, or {MIN_NUM_PHOTOS} database images with GPS and an "
            f"altitude in EXIF; here, {count} have them"
        )


def _open_project(
    options: argparse.Namespace, colmap: pathlib.Path, sift_options: Sequence[str], given: str
) -> steps.Project:
    """Opens the output folder; `given`: the command."""
    folder = Folder(options.output_path)
    try:
        folder.path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--output {folder.path}: cannot be made: {error.strerror}") from None
    record = Steps(folder, fingerprint(__version__, content(colmap)))
    if options.overwrite:
        record.forget_all()
    return steps.Project(
        folder,
        record,
        ColmapRunner(folder.log),
        colmap,
        bool(options.use_gpu),
        options.masks is not None,
        sift_options,
        KeptResults(folder),
        str(options.queries),
        given,
        is_video(options.database_images),
        options.epoch is not None,
    )


def _excluded(options: argparse.Namespace) -> list[pathlib.Path]:
    """Returns folders of images that are not photos, which may be in a folder of photos: masks, and links of runs."""
    records = [record for root in (options.database_images, options.queries) for record in root.rglob(RECORD)]
    links = [path for record in records for path in Folder(record.parent).reserved]
    return [*links, options.output_path, *([] if options.masks is None else [options.masks])]


def _find_queries(options: argparse.Namespace) -> dict[str, pathlib.Path]:
    """Returns the paths of the query photos by name; raises InputError if a single one cannot be read."""
    paths = find_photos(options.queries, _excluded(options))
    if options.queries.is_file() and is_installed("PIL") and photo_size(options.queries) is None:
        raise InputError(f"--queries {options.queries}: is not a photo that can be read")
    return paths


def _make_images(
    project: steps.Project, options: argparse.Namespace, role: str, photos: Mapping[str, pathlib.Path]
) -> Images:
    """Links photos, given by name, or the faces of panoramas, into the project."""
    paths = convert_photos(project.folder, role, photos)
    source = options.database_images if role == DATABASE else options.queries
    if options.masks is not None and options.masks.resolve() == source.resolve():
        masks = {f"{name}.png" for name in paths}
        paths = {name: path for name, path in paths.items() if name not in masks}
    widths: dict[str, int] = {}
    if role in panorama_roles(options):
        faces, widths = cut_panoramas(project, role, paths)
        paths = {face: faces / face for face in face_cameras(widths)}
    return Images(link_photos(project.folder, role, paths), widths)


def _pose_source(options: argparse.Namespace) -> tuple[Source, str | None]:
    """Returns the file of poses, and its format if it is given."""
    source = make_source(options.poses or options.positions, options.database_images, options)
    photos = Photos(options.database_images, excluded=_excluded(options))
    return dataclasses.replace(source, photos=photos, shows_crs=True), options.poses_format


def _read_positions(options: argparse.Namespace) -> Positions | None:
    """Returns the positions that the user has given instead of poses."""
    return None if options.positions is None else read_positions(*_pose_source(options))


def _use_poses(
    project: steps.Project, options: argparse.Namespace, database: Images, posed: PosedImages | None
) -> PosedImages:
    """Returns the poses of the database images, under the names of the links; reads them if `posed` is None."""
    if posed is None:
        source, form = _pose_source(options)
        posed = read_face_poses(source, database.widths, form) if database.widths else read_posed_images(source, form)
    posed = _select(posed, database.linked)
    num_photos, num_left_out = len(database.linked), len(database.linked) - len(posed.images)
    if not posed.images:
        raise InputError(f"--poses {options.poses}: has no pose of a photo that can be used")
    given = [name for name in ("camera", "calibration") if getattr(options, name) is not None]
    label = f"--{given[0]}" if given else f"--poses {options.poses}"
    check_size(project.folder, label, {image.name: image.camera for image in posed.images})
    if num_left_out > 0:
        logger.warning("%d of %d photos have no pose and are not used", num_left_out, num_photos)
    return posed


def _known_lengths(options: argparse.Namespace, database: Images, positions: Positions | None) -> steps.Known | None:
    """Returns what gives the mapper's model metres: --scale, control points, or positions by the names of the links."""
    if options.distance is not None:
        distance: Distance = options.distance
        return distance.renamed(database.linked)
    if options.surveyed is not None and options.poses is None and positions is None:
        surveyed: ControlPoints = options.surveyed
        return surveyed
    if positions is None:
        return None
    linked = database.linked
    photos = (dataclasses.replace(photo, name=linked[photo.name]) for photo in positions.photos if photo.name in linked)
    return dataclasses.replace(positions, photos=tuple(photos))


def _survey(project: steps.Project, options: argparse.Namespace, images: Sequence[str]) -> Survey | None:
    """Returns the control points that place the new photos, if they do; says early what is wrong with them."""
    if options.use_control_points is None:
        return None
    survey = Survey(options.surveyed, options.use_control_points)
    survey.lines(images, project.folder.model)
    return survey


def _check_poses(project: steps.Project, options: argparse.Namespace, posed: PosedImages) -> None:
    """Compares the poses with the photos, once for the same ones."""
    photos = contents(project.folder, [image.name for image in posed.images])
    poses = [(image.name, image.camera.text(), image.cam_from_world.text()) for image in posed.images]
    key = fingerprint(photos, poses, options.accept_poses)
    if project.steps.begin("check", key):
        folder, label = project.folder, f"--poses {options.poses}"
        check_photos(posed, folder.images, label, options.accept_poses, folder.masks)
        project.steps.finish("check", key)


def _select(posed: PosedImages, names: Mapping[str, str]) -> PosedImages:
    """Returns the images that have a name among `names`, which has their new ones."""
    images = [dataclasses.replace(image, name=names[image.name]) for image in posed.images if image.name in names]
    return dataclasses.replace(posed, images=images)


def _video_frames(project: steps.Project, options: argparse.Namespace, role: str) -> pathlib.Path:
    """Returns the folder of the frames of a video."""
    source: pathlib.Path = options.database_images if role == DATABASE else options.queries
    frames: pathlib.Path = project.folder.frames / role
    rate = options.frames_per_second or FRAMES_PER_SECOND
    step, key = f"{role} frames", fingerprint(content(source), rate)
    if project.steps.begin(step, key):
        count = write_frames(source, frames, rate)
        logger.info("%d frames of %s", count, source)
        project.steps.finish(step, key)
    return frames


def _link_masks(project: steps.Project, options: argparse.Namespace, database: Images, queries: Images) -> None:
    linked = {DATABASE: database.linked, QUERY: queries.linked}
    count = sum(link_masks(project.folder, role, names, options.masks) for role, names in linked.items())
    if options.masks is not None and count == 0:
        raise InputError(f"--masks {options.masks}: has no mask of any photo, NAME.png for the photo NAME")


def _given_camera(project: steps.Project, option: str, text: str, images: Images) -> Camera:
    camera = Camera.parse(option, text)
    check_size(project.folder, option, dict.fromkeys(sorted(images.linked.values()), camera))
    return camera


def _database_camera(project: steps.Project, options: argparse.Namespace, database: Images) -> Camera | None:
    """Returns the camera that is given for database images whose poses COLMAP's mapper computes."""
    if options.poses is not None or options.camera is None:
        return None
    return _given_camera(project, "--camera", options.camera, database)


def _query_camera(
    project: steps.Project, options: argparse.Namespace, queries: Images, posed: PosedImages | None
) -> Camera | None:
    """Returns the camera that is given for the queries; of a sequence, else that of database images of its size."""
    if options.query_camera is not None:
        return _given_camera(project, "--query_camera", options.query_camera, queries)
    if options.sequence is None:
        return None
    sizes = (photo_size(project.folder.images / name) for name in sorted(queries.linked.values()))
    size = next((size for size in sizes if size is not None), None)
    cameras = {image.camera for image in posed.images} if posed else set()
    cameras = {camera for camera in cameras if (camera.width, camera.height) == size}
    if len(cameras) != 1:
        raise InputError("--sequence needs --query_camera, because frames with unknown intrinsics are localized alone")
    return cameras.pop()


def _have_one_camera(project: steps.Project, options: argparse.Namespace, cameras: Mapping[str, Camera | None]) -> bool:
    """True if one camera, whose intrinsics nobody knows, took the queries: by an option, a video, or EXIF."""
    if options.one_camera or len(cameras) < 2 or any(cameras.values()) or not is_installed("PIL"):
        return bool(options.one_camera)
    paths = [project.folder.images / name for name in cameras]
    known = {frozenset((camera.width, camera.height)) for camera in read_model(project.folder.model).cameras.values()}
    if not known.isdisjoint(frozenset(photo_size(path) or ()) for path in paths):
        return False  # intrinsics come from database images of this size
    return options.epoch is not None or is_video(options.queries) or has_one_camera(paths)


def _localize(
    project: steps.Project,
    options: argparse.Namespace,
    words: list[str],
    used: Sequence[str],
    cameras: Mapping[str, Camera | None],
    on_demand: bool,
) -> None:
    """Localizes the queries, whose cameras are given by name, as far as they are known. `used`: the database images.
    `on_demand`: their features are extracted when a query needs them."""
    queries, roles = sorted(cameras), panorama_roles(options)
    if QUERY in roles:
        rigs = [role for role in (QUERY, DATABASE) if role == QUERY or (role in roles and options.poses is not None)]
        words = [*words, "--rig_config_path", str(write_project_rig(project, rigs))]
    if options.sequence is not None:
        words = [*words, "--LazyLocalizer.group_size", str(options.sequence)]
    elif not any(word.startswith(SINGLE_CAMERA) for word in words) and _have_one_camera(project, options, cameras):
        words = [*words, SINGLE_CAMERA, "1"]
    is_retrieved = len(used) > steps.MAX_NUM_EXHAUSTIVE and not has_stored_queries(options)
    if is_retrieved and not any(word.startswith(POSITIONS) for word in words):
        path = steps.write_gps(project.folder, queries)
        words = words if path is None else [*words, POSITIONS, str(path)]
    if has_stored_queries(options):
        queries = steps.add_queries(project, queries, used, cameras[queries[0]], options.sequence is not None)
    elif project.folder.query_database.exists():
        project.steps.forget("queries")
    lines = {name: f"{name} {own.text()}" if (own := cameras[name]) else name for name in queries}
    steps.localize(project, lines, len(used), words, has_stored_queries(options), on_demand)


def _has_pose(results: pathlib.Path) -> bool:
    return any(pose_of(result) is not None for result in read_results(results / RESULTS).values())


def _write_report(project: steps.Project, results: pathlib.Path, options: argparse.Namespace) -> None:
    """Writes the report, with links to those of earlier runs. If it fails, it warns, because the results are there."""
    from colmap_lazyloc.report.__main__ import main as write_report

    report: pathlib.Path = project.folder.report
    report.unlink(missing_ok=True)
    settings = {} if options.unit is None else {"unit": options.unit}
    if options.crs is not None and read_geodetic(results):
        settings["crs"] = options.crs
    elif options.crs is not None and options.poses is None:
        logger.warning("--crs %s has no effect, because the coordinates are not geographic", options.crs)
    project.results.note_report(settings)
    if not is_installed("cv2"):
        logger.warning("no photos in the report: %s", install_command("run", ["cv2"]))
    logger.info("writing the report")
    cause = "the line above says why"
    try:
        write_report([str(results), "--output", str(report)])
    except Exception as error:
        cause = f"{type(error).__name__}: {error}"
    if not report.exists():
        logger.warning("%s: the report was not written (%s); the results are in %s", report, cause, results)
    project.results.link()


def _print_results(
    folder: pathlib.Path, report: pathlib.Path, shown: dict[str, str], options: argparse.Namespace
) -> int:
    """Prints where the queries of a folder of results are; `shown`: what they are called, by name.

    Returns how many were not localized.
    """
    results = read_results(folder / RESULTS)
    names = {name: text for name, text in shown.items() if name in results}
    lines = position_lines(results, names, read_geodetic(folder), unit_of(folder, options.unit), options.crs)
    for line in lines[: MAX_NUM_LINES + 1]:
        print(line)
    if len(lines) > MAX_NUM_LINES + 1:
        print(f"... and {len(lines) - MAX_NUM_LINES - 1} more: {folder / 'positions.csv'}")
    count = sum(pose_of(results[name]) is not None for name in names)
    print(f"{count} of {len(shown)} queries localized: {folder}".encode(errors="replace").decode())
    if count == 0:
        logger.warning(
            "no query was localized: look at the reasons above and at the warnings of %s, and check that the queries "
            "show the place of the database images",
            report,
        )
    return len(shown) - count


if __name__ == "__main__":
    sys.exit(main())
