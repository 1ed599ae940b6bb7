"""The steps of a project: each does nothing if its work is done."""

import dataclasses
import pathlib
import re
import shutil
import subprocess
import tempfile
import time
import zlib
from collections.abc import Mapping, Sequence

from colmap_lazyloc.cluster.task import command_line
from colmap_lazyloc.database import (
    DatabaseReader,
    add_images,
    copy_database,
    remove_features,
    remove_matches,
    tidy_images,
)
from colmap_lazyloc.errors import InputError, first_names, logger, nearest
from colmap_lazyloc.extras import install_command, is_installed
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.pose_formats.colmap import write_posed_images
from colmap_lazyloc.pose_formats.control_points import ControlPoints
from colmap_lazyloc.pose_formats.exif_gps import in_local_frame, read_photos, write_positions
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImages, Positions, photo_size
from colmap_lazyloc.program import find_colmap, find_option, gpu_option, has_command, option_names
from colmap_lazyloc.progress import POSES, ProgressBar
from colmap_lazyloc.project.alignment import NotAlignedError, align_to_points, align_to_positions
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.distance import Distance, scale_to_distance
from colmap_lazyloc.project.folder import (
    ALIGNMENT,
    ARBITRARY_AXES,
    MATCHES,
    WITHOUT_POSES,
    Folder,
    Steps,
    content,
    fingerprint,
    remove,
)
from colmap_lazyloc.project.kept import KeptResults
from colmap_lazyloc.project.pairs import all_pairs, pairs_by_viewpoint, pairs_in_sequence
from colmap_lazyloc.project.photos import contents, has_bad_mask, warn_left_out

Known = Distance | ControlPoints | Positions  # what gives the mapper's model metres
MAX_NUM_EXHAUSTIVE = 50  # images; more are retrieved by a vocabulary tree
NUM_RETRIEVED = 30
MAX_NUM_WORDS = 16384  # of the vocabulary tree
MIN_FEATURES_PER_WORD = 10
SEQUENCE_REACH = 5  # frames before and after one with which it is matched
MIN_MODEL_SIZE = 3
# How many pairs are matched at once: first, and then as many as take one in 20 of the whole time, within bounds.
FIRST_NUM_PAIRS, NUM_PARTS = 4, 20
MIN_SECONDS_PER_PART, MAX_SECONDS_PER_PART = 1.0, 5.0


@dataclasses.dataclass(frozen=True)
class Project:
    """A project folder, the program, and the options of its steps."""

    folder: Folder
    steps: Steps
    runner: ColmapRunner
    colmap: pathlib.Path
    use_gpu: bool
    has_masks: bool
    sift_options: Sequence[str]  # for extraction in the database, and of photos
    results: KeptResults
    queries: str  # as they were given
    command: str  # that was given
    is_film: bool  # the database images are the frames of a video
    has_epoch: bool  # the queries are adjusted together

    def add(self, database: pathlib.Path, cameras: Mapping[str, Camera | None]) -> None:
        """Adds images by name without features, as far as their cameras are known."""
        if not database.exists():
            self.runner.run([self.colmap, "database_creator", "--database_path", database])
        add_images(database, {name: camera for name, camera in cameras.items() if camera is not None})

    def extract(
        self, database: pathlib.Path, cameras: Mapping[str, Camera | None], has_one_camera: bool = False
    ) -> None:
        """Extracts the features of images by name; without a camera, COLMAP guesses it or takes EXIF's focal length:
        one for all with `has_one_camera`."""
        self.add(database, cameras)
        words = [*self._command("feature_extractor"), "--database_path", database]
        words += ["--image_path", self.folder.images, "--image_list_path", self.folder.write_list("images", cameras)]
        words += [*self.sift_options, *(["--ImageReader.single_camera", 1] if has_one_camera else [])]
        if self.has_masks:
            words += ["--ImageReader.mask_path", self.folder.masks]
        with ProgressBar(f"features of {len(cameras)} images", len(cameras), "photos") as bar:
            self.runner.run(words, bar)
        tidy_images(database)

    def match(self, database: pathlib.Path, pairs: Sequence[tuple[str, str]]) -> None:
        """Matches pairs and verifies the matches; those in the database are kept."""
        match_pairs(self._command("matches_importer"), self.runner, self.folder, database, pairs)

    def match_retrieved(self, database: pathlib.Path, names: Sequence[str]) -> None:
        """Matches images with those that look alike, by a vocabulary tree of the database images."""
        words = [*self._command("vocab_tree_matcher"), "--database_path", database]
        words += ["--VocabTreeMatching.vocab_tree_path", self._vocabulary_tree()]
        words += ["--VocabTreeMatching.num_images", NUM_RETRIEVED]
        words += ["--VocabTreeMatching.match_list_path", self.folder.write_list("retrieved", names)]
        with ProgressBar(f"matching {len(names)} images with those that look alike", len(names), "photos") as bar:
            self.runner.run(words, bar)

    def _command(self, name: str) -> list[object]:
        return colmap_command(self.colmap, name, self.use_gpu)

    def _vocabulary_tree(self) -> pathlib.Path:
        """Returns the file of the tree, which goes with the features that it is made of."""
        tree: pathlib.Path = self.folder.vocab_tree
        if not tree.exists():
            with DatabaseReader(self.folder.database) as database:
                num_words = min(MAX_NUM_WORDS, database.num_descriptors() // MIN_FEATURES_PER_WORD)
            staged = tree.with_suffix(".tmp")
            words = [self.colmap, "vocab_tree_builder", "--database_path", self.folder.database]
            words += ["--vocab_tree_path", staged, "--num_visual_words", max(1, num_words)]
            with ProgressBar("vocabulary tree for retrieval") as bar:
                self.runner.run(words, bar)
            staged.replace(tree)
        return tree


def colmap_command(colmap: pathlib.Path, name: str, use_gpu: bool) -> list[object]:
    """Returns the words that run a command of COLMAP, with our SIFT unless the colmap is not ours."""
    ours = f"lazy_{name}"
    command_name = ours if has_command(colmap, ours) else name
    return [colmap, command_name, gpu_option(colmap, command_name), int(use_gpu)]


def match_pairs(
    command: Sequence[object],
    runner: ColmapRunner,
    folder: Folder,
    database: pathlib.Path,
    pairs: Sequence[tuple[str, str]],
) -> None:
    """Matches pairs by `command`, a matches_importer.

    COLMAP writes matches, and says how far it is, only after each thousand pairs, which can take an hour: until then,
    not even another reader of the database sees a match. So COLMAP gets a few pairs first, and then as many at once as
    take some seconds.
    """
    words = [*command, "--database_path", database, "--match_type", "pairs"]
    done, count = 0, FIRST_NUM_PAIRS
    with ProgressBar(f"matching {len(pairs)} pairs", len(pairs), "pairs") as bar:
        while done < len(pairs):
            some = pairs[done : done + count]
            path = folder.write_list("pairs", (f"{first} {second}" for first, second in some))
            begin = time.monotonic()
            runner.run([*words, "--match_list_path", path])
            rate = len(some) / max(time.monotonic() - begin, 1e-3)
            seconds = min(max(len(pairs) / rate / NUM_PARTS, MIN_SECONDS_PER_PART), MAX_SECONDS_PER_PART)
            count = max(FIRST_NUM_PAIRS, round(rate * seconds))
            done += len(some)
            bar.show(done, len(pairs), "pairs")


def make_features(project: Project, cameras: Mapping[str, Camera | None]) -> list[str]:
    """Makes the database with the features of the database images; returns their names.

    `cameras`: by image name, as far as they are known. Images that COLMAP cannot use are left out.
    """
    folder, steps = project.folder, project.steps
    names = sorted(cameras)
    has_one_camera = project.is_film and None in cameras.values()
    key = fingerprint(_extraction(project, cameras), has_one_camera)
    # COLMAP gives photos of the same camera one camera, if it has to guess it, but only those of the same run.
    if steps.begin("features", key, resumes=None not in cameras.values()):
        project.extract(folder.database, cameras, has_one_camera)
        steps.finish("features", key)
    used = _with_features(folder.database, names)
    warn_left_out(folder, cameras, sorted(set(names).difference(used)))
    return used


def add_database(project: Project, posed: PosedImages) -> list[str]:
    """Makes the database with the database images, whose features are extracted when a query needs them; returns their
    names, without those of photos that cannot be used."""
    folder, steps = project.folder, project.steps
    cameras = {image.name: image.camera for image in posed.images}
    used = [name for name in sorted(cameras) if photo_size(folder.images / name) == _size(cameras[name])]
    key = fingerprint("on demand", _extraction(project, cameras))
    if steps.begin("features", key):
        steps.forget("complete")
        project.add(folder.database, {name: cameras[name] for name in used})
        steps.finish("features", key)
    warn_left_out(folder, cameras, sorted(set(cameras).difference(used)))
    return used


def complete_database(project: Project, posed: PosedImages, num_neighbors: int) -> None:
    """Adds features and matches to the database of `add_database`, for other programs, or removes those of an earlier
    run. `num_neighbors`: as in `match_database`."""
    folder, steps = project.folder, project.steps
    if num_neighbors == 0:
        if steps.is_begun("complete"):
            remove_features(folder.database)
            steps.forget("complete")
        return
    cameras = {image.name: image.camera for image in posed.images}
    pairs = pairs_by_viewpoint(posed.images, num_neighbors)
    key = fingerprint(_extraction(project, cameras), pairs)
    if steps.begin("complete", key):
        remove_matches(folder.database)
        project.extract(folder.database, cameras)
        project.match(folder.database, pairs)
        steps.finish("complete", key)


def _size(camera: Camera) -> tuple[int, int]:
    return camera.width, camera.height


def match_database(project: Project, used: Sequence[str], posed: PosedImages | None, num_neighbors: int) -> None:
    """Matches the database images with each other, always all of them, because COLMAP keeps earlier matches.

    `num_neighbors`: that each is matched with if there are poses; 0: none.
    """
    folder, steps = project.folder, project.steps
    if posed is not None:
        pairs = pairs_by_viewpoint(posed.images, num_neighbors) if num_neighbors and len(posed.images) > 1 else []
    elif len(used) <= MAX_NUM_EXHAUSTIVE:
        pairs = all_pairs(used)
    else:
        pairs = pairs_in_sequence(used, SEQUENCE_REACH) if project.is_film else []
    is_retrieved = posed is None and len(used) > MAX_NUM_EXHAUSTIVE
    key = fingerprint(pairs, project.use_gpu, NUM_RETRIEVED if is_retrieved else None)
    if steps.begin("matches", key):
        remove_matches(folder.database)
        if pairs:
            project.match(folder.database, pairs)
        if is_retrieved:
            project.match_retrieved(folder.database, used)
        steps.finish("matches", key)


def _extraction(project: Project, cameras: Mapping[str, Camera | None]) -> list[object]:
    """Returns all that the features of images follow from."""
    held = contents(project.folder, cameras)
    return [sorted((name, str(cameras[name]), held[name]) for name in cameras), project.sift_options, project.use_gpu]


def _with_features(path: pathlib.Path, names: Sequence[str]) -> list[str]:
    with DatabaseReader(path) as database:
        return [name for name in names if database.has_keypoints(name)]


def make_model(
    project: Project,
    used: Sequence[str],
    posed: PosedImages | None,
    refines_cameras: bool,
    known: Known | None = None,
) -> None:
    """Writes the model of the poses, or lets COLMAP's mapper make it. `used`: the images in the database; `known`: what
    gives the mapper's model metres, by default the GPS of the photos."""
    if posed is None:
        _map(project, used, refines_cameras)
    poses = [(image.name, str(image.camera), image.cam_from_world.text()) for image in posed.images] if posed else []
    key = fingerprint(poses, posed.origin if posed else ["mapper", known, _missing_for_gps()])
    if project.steps.is_done("model", key):
        return
    folder, staged = project.folder, project.folder.staged
    remove(staged.path)
    try:
        if posed is not None:
            write_posed_images(staged.model, posed)
        else:
            _write_mapped(project, used, known, staged)
        # The model of an earlier run stays until there is another one, because positions may not fit.
        project.steps.begin("model", key)
        staged.model.replace(folder.model)
    finally:
        remove(staged.path)
    project.steps.finish("model", key)


def _map(project: Project, used: Sequence[str], refines_cameras: bool) -> None:
    """Lets COLMAP's mapper make models."""
    folder, key = project.folder, fingerprint(refines_cameras)
    if not project.steps.begin("sparse", key):
        return
    folder.sparse.mkdir()
    words = [project.colmap, "mapper", "--database_path", folder.database, "--image_path", folder.images]
    list_option = find_option(project.colmap, "mapper", r"(Mapper\.)?image_list_path", "that lists the images")
    words += [list_option, folder.write_list("mapped", used)]
    words += ["--output_path", folder.sparse, "--Mapper.min_model_size", MIN_MODEL_SIZE]
    if not refines_cameras:
        words += ["--Mapper.ba_refine_focal_length", 0, "--Mapper.ba_refine_extra_params", 0]
    with ProgressBar("mapping, because there are no poses", len(used), POSES) as bar:
        project.runner.run(words, bar)
    if not any(path.is_dir() for path in folder.sparse.iterdir()):
        raise InputError(f"{folder.path}: COLMAP's mapper found no poses: the photos overlap too little")
    project.steps.finish("sparse", key)


def _write_mapped(project: Project, used: Sequence[str], known: Known | None, folder: Folder) -> None:
    """Writes the largest model of the mapper to `folder`, in metres if a distance or positions give them."""
    models = {path: set(read_model(path).images) for path in project.folder.sparse.iterdir() if path.is_dir()}
    largest = max(sorted(models), key=lambda path: len(models[path]))
    lost = sorted(set(used) - models[largest])
    if lost:
        count = f"{len(lost)} of {len(used)} photos"
        logger.warning("COLMAP's mapper found no pose of %s, which are not used: %s", count, first_names(lost, 5))
    if 2 * len(lost) > len(used):
        logger.warning(
            "so few photos may make a wrong model: take more photos, or pass --camera if you know the camera"
        )
    is_level = not isinstance(known, Distance)
    try:
        if isinstance(known, Distance):
            lines = [scale_to_distance(folder, project.runner, project.colmap, largest, known)]
        elif isinstance(known, ControlPoints):
            lines = align_to_points(folder, project.runner, project.colmap, largest, known)
        else:
            positions = known or _gps_of_photos(project.folder, used)
            lines = align_to_positions(folder, project.runner, project.colmap, largest, positions)
    except NotAlignedError as error:
        if known is not None:
            option = "control_points" if isinstance(known, ControlPoints) else "poses"
            raise InputError(f"--{option}: {error}") from None
        is_level = False
        remove(folder.model)
        shutil.copytree(largest, folder.model)
        logger.warning("lengths are in units of the model, because %s; --scale gives metres", error)
    else:
        logger.info(lines[0])
        for line in lines[1:]:
            logger.warning(line)
        (folder.model / ALIGNMENT).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    if lost:
        (folder.model / WITHOUT_POSES).write_text("".join(f"{name}\n" for name in lost), encoding="utf-8")
    if not is_level:
        text = "No axis of this model is known to point up, so results have no heading, pitch and roll."
        (folder.model / ARBITRARY_AXES).write_text(f"{text}\n", encoding="utf-8")


def _gps_of_photos(folder: Folder, names: Sequence[str]) -> Positions:
    """Returns the positions that images have in EXIF; raises NotAlignedError if there is none."""
    if missing := _missing_for_gps():
        raise NotAlignedError(f"GPS of photos cannot be read ({install_command('run', missing)})")
    found = read_photos({name: folder.images / name for name in names})
    if not found:
        raise NotAlignedError("no photo has GPS")
    return in_local_frame(found)


def write_gps(folder: Folder, names: Sequence[str]) -> pathlib.Path | None:
    """Writes the positions that queries have in EXIF, in the coordinates of the model; returns the file, None if there
    is no position or the model is not geographic."""
    origin = None if _missing_for_gps() else GeoOrigin.read(folder.model)
    found = read_photos({name: folder.images / name for name in names}) if origin else []
    if not found:
        return None
    path = folder.write_list("gps", ())
    write_positions(path, found, origin)
    return path


def _missing_for_gps() -> list[str]:
    return [module for module in ("PIL", "pyproj") if not is_installed(module)]


def add_queries(
    project: Project, queries: Sequence[str], used: Sequence[str], camera: Camera | None, is_sequence: bool
) -> list[str]:
    """Makes a database that has the queries, too, which is needed for masks and for sequences; returns the queries.

    It is a copy of the database of database images, so that it follows from these queries alone: earlier ones leave
    neither features nor ids. Queries whose masks cannot be read are left out.
    """
    folder, steps = project.folder, project.steps
    cameras = dict.fromkeys(queries, camera)
    key = fingerprint(used, _extraction(project, cameras), is_sequence)
    if steps.begin("queries", key):
        copy_database(folder.database, folder.query_database)
        project.extract(folder.query_database, cameras)
        found = _with_features(folder.query_database, queries)
        pairs = pairs_in_sequence(found, SEQUENCE_REACH) if is_sequence else []
        if len(used) <= MAX_NUM_EXHAUSTIVE:
            pairs += all_pairs(found, used)
        elif found:
            project.match_retrieved(folder.query_database, found)
        if pairs:
            project.match(folder.query_database, pairs)
        steps.finish("queries", key)
    missing = set(queries).difference(_with_features(folder.query_database, queries))
    left_out = sorted(name for name in missing if has_bad_mask(folder, name))
    warn_left_out(folder, cameras, left_out)
    return [name for name in queries if name not in left_out]


def localize(
    project: Project,
    query_lines: Mapping[str, str],
    num_database_images: int,
    options: Sequence[str],
    is_stored: bool,
    on_demand: bool,
) -> None:
    """Localizes queries with `colmap lazy_localizer`, as photos, or as they are stored in the database.

    `query_lines`: what the list of queries has of each, by name. `on_demand`: for the database of `add_database`.
    """
    folder, steps = project.folder, project.steps
    values = [word.rpartition("=")[2] for word in options]
    held = [content(pathlib.Path(value)) for value in values if value and pathlib.Path(value).exists()]
    # Photos in memory do not depend on the matches of the database.
    made = [steps.keys("features", *(("matches", "queries") if is_stored else ())), content(folder.model)]
    key = fingerprint(
        project.has_epoch,
        made,
        query_lines,
        contents(folder, query_lines),
        options,
        held,
        project.sift_options,
        is_stored,
        on_demand,
    )
    keeps_matches = project.has_epoch and not is_stored
    database = folder.query_database if is_stored else folder.database
    state = database.stat()
    if not project.results.begin(key, fingerprint(state.st_mtime_ns, state.st_size), project.queries, project.command):
        return
    has_localizer = has_command(project.colmap, "lazy_localizer")
    words: list[object] = [*command_line(str(project.colmap) if has_localizer else None, "lazy_localizer")]
    words += ["--database_path", database, "--input_path", folder.model, "--image_path", folder.images]
    is_retrieved = num_database_images > MAX_NUM_EXHAUSTIVE and not is_stored
    if is_retrieved:
        # The index follows from the features, with which it is forgotten, and from the seed.
        index_key = fingerprint(re.findall(r"--LazyLocalizer\.seed[= ](\S+)", " ".join(options)))
        if folder.index.exists() and not _is_intact(folder.index):
            logger.warning("%s: is damaged and is made again", folder.index)
            folder.index.unlink()
        if steps.begin("index", index_key):
            steps.finish("index", index_key)
        words += ["--retrieval_index_path", folder.index]
    if on_demand:
        words += ["--LazyLocalizer.Advanced.on_demand", 1]
    words += ["--query_list_path", folder.write_list("queries", query_lines.values())]
    # Goes on with an unfinished run of the same queries.
    if keeps_matches:
        remove(folder.epoch)
        folder.epoch.mkdir()
        words += ["--LazyLocalizer.Advanced.matches_output_path", folder.epoch / MATCHES]
    resumes = folder.localized.exists() and not keeps_matches
    words += ["--output_path", folder.localized, "--resume" if resumes else "--overwrite", 1]
    words += [*project.sift_options, *options]
    count = len(query_lines)
    with ProgressBar("localizing 1 query" if count == 1 else f"localizing {count} queries", count, "queries") as bar:
        if is_retrieved and not folder.index.exists():
            bar.show(0, 0, f"indexing {num_database_images} database images")  # until the first result
        project.runner.run(words, bar)
    project.results.finish()


def _is_intact(index: pathlib.Path) -> bool:
    """True if a retrieval index is as it was written: at its end is the CRC-32 of all before."""
    checksum, last = 0, b""
    with index.open("rb") as file:
        while block := file.read(1 << 20):
            checksum = zlib.crc32((last + block)[:-4], checksum)
            last = (last + block)[-4:]
    return last == checksum.to_bytes(4, "little")


def check_localizer_options(colmap: pathlib.Path, words: Sequence[str]) -> None:
    """Checks names and values of options early, because lazy_localizer runs last: it runs on files that are not there,
    and checks options before files. The installed package checks names itself."""
    names = [word.partition("=")[0] for word in words if word.startswith("--")]
    if not names:
        return
    has_localizer = has_command(colmap, "lazy_localizer")
    known = [f"--{name}" for name in option_names(colmap, "lazy_localizer", "--help-all")] if has_localizer else []
    for name in names:
        if known and name not in known:
            raise InputError(f"unknown option {name}{nearest(name, known)}")
    command = command_line(str(colmap) if has_localizer else None, "lazy_localizer")
    with tempfile.TemporaryDirectory() as folder:
        for option in ("database_path", "input_path", "image_path", "output_path"):
            command += [f"--{option}", f"{folder}/missing"]
        done = subprocess.run([*command, *words], capture_output=True, text=True, errors="replace", check=False)
    line = (done.stderr.strip().splitlines() or [""])[-1]
    if any(re.search(rf"{re.escape(name)}\b", line) for name in names):
        raise InputError(line.removeprefix("ERROR: ").removeprefix("colmap lazy_localizer: "))


def find_program() -> pathlib.Path:
    """Returns the colmap program; raises InputError if there is none."""
    path = shutil.which(find_colmap())
    if path is None:
        raise InputError(
            "COLMAP is missing: install the package colmap-lazyloc or COLMAP, or name the program in the environment "
            "variable COLMAP"
        )
    return pathlib.Path(path)
