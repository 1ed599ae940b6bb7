"""The steps of a project: each does nothing if its work is done."""

import dataclasses
import difflib
import pathlib
import shutil
from collections.abc import Mapping, Sequence

from colmap_lazyloc.cluster.task import command_line
from colmap_lazyloc.database import DatabaseReader, add_images
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.import_poses import write_posed_images
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages
from colmap_lazyloc.program import find_colmap, find_option, gpu_option, has_command, option_names
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import DATABASE, Folder, Steps, fingerprint
from colmap_lazyloc.project.pairs import all_pairs, pairs_by_viewpoint, pairs_in_sequence

MAX_NUM_EXHAUSTIVE = 50  # images; more are retrieved by a vocabulary tree
NUM_RETRIEVED = 30
MAX_NUM_WORDS = 16384  # of the vocabulary tree
MIN_FEATURES_PER_WORD = 10
SEQUENCE_REACH = 5  # frames before and after one with which it is matched
MIN_MODEL_SIZE = 3


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

    def extract(self, cameras: Mapping[str, Camera | None], one_camera: bool = False) -> None:
        """Extracts the features of images by name; without a camera, COLMAP guesses it or takes EXIF's focal length."""
        if not self.folder.database.exists():
            words = [self.colmap, "database_creator", "--database_path", self.folder.database]
            self.runner.run(words)
        add_images(self.folder.database, {name: camera for name, camera in cameras.items() if camera is not None})
        words = [self.colmap, "feature_extractor", "--database_path", self.folder.database]
        words += ["--image_path", self.folder.images, "--image_list_path", self.folder.write_list("images", cameras)]
        words += [gpu_option(self.colmap, "feature_extractor"), int(self.use_gpu), *self.sift_options]
        if self.has_masks:
            words += ["--ImageReader.mask_path", self.folder.masks]
        if one_camera:
            words += ["--ImageReader.single_camera_per_folder", 1]
        self.runner.run(words, f"features of {len(cameras)} images")
        self._check_features(list(cameras))

    def match(self, pairs: Sequence[tuple[str, str]]) -> None:
        """Matches pairs and verifies the matches; those in the database are kept."""
        path = self.folder.write_list("pairs", (f"{first} {second}" for first, second in pairs))
        words = [self.colmap, "matches_importer", "--database_path", self.folder.database, "--match_type", "pairs"]
        words += ["--match_list_path", path, gpu_option(self.colmap, "matches_importer"), int(self.use_gpu)]
        self.runner.run(words, f"matching {len(pairs)} pairs")

    def match_retrieved(self, names: Sequence[str]) -> None:
        """Matches images with those that look alike, by a vocabulary tree of this database."""
        tree = self.folder.vocab_tree
        if not tree.exists():
            with DatabaseReader(self.folder.database) as database:
                num_words = min(MAX_NUM_WORDS, database.num_descriptors() // MIN_FEATURES_PER_WORD)
            words = [self.colmap, "vocab_tree_builder", "--database_path", self.folder.database]
            words += ["--vocab_tree_path", tree, "--num_visual_words", max(1, num_words)]
            self.runner.run(words, "vocabulary tree for retrieval")
        words = [self.colmap, "vocab_tree_matcher", "--database_path", self.folder.database]
        words += ["--VocabTreeMatching.vocab_tree_path", tree, "--VocabTreeMatching.num_images", NUM_RETRIEVED]
        words += ["--VocabTreeMatching.match_list_path", self.folder.write_list("retrieved", names)]
        words += [gpu_option(self.colmap, "vocab_tree_matcher"), int(self.use_gpu)]
        self.runner.run(words, f"matching {len(names)} images with those that look alike")

    def _check_features(self, names: Sequence[str]) -> None:
        """Checks that COLMAP has taken all images, because it only logs why it leaves one out."""
        with DatabaseReader(self.folder.database) as database:
            missing = [name for name in names if not database.has_keypoints(name)]
        if missing:
            raise InputError(
                f"{self.folder.images / missing[0]}: COLMAP could not use the photo, nor {len(missing) - 1} others: "
                f"it cannot be read, or its size is not that of its camera (log: {self.folder.log})"
            )


def make_database(
    project: Project, cameras: Mapping[str, Camera | None], posed: PosedImages | None, num_neighbors: int
) -> None:
    """Makes the database with the features of the database images and the matches among them.

    `cameras`: those that are known without poses, by image name.
    """
    folder = project.folder
    if posed is not None:
        cameras = {f"{DATABASE}/{image.name}": image.camera for image in posed.images}
    used = sorted(cameras)
    files = [folder.images / name for name in used]
    key = fingerprint([str(cameras[name]) for name in used], project.sift_options, project.has_masks, files=files)
    if project.steps.differs("features", key):
        raise InputError(
            f"{folder.path}: its database was made of other photos, cameras, masks or features; take another folder, "
            "or --overwrite"
        )
    if not project.steps.is_done("features", key):
        project.steps.begin("features", key)
        project.extract(cameras)
        project.steps.finish("features", key)
    if posed is not None:
        images = [PosedImage(f"{DATABASE}/{image.name}", image.camera, image.cam_from_world) for image in posed.images]
        pairs = pairs_by_viewpoint(images, num_neighbors) if len(images) > 1 else []
    else:
        pairs = all_pairs(used) if len(used) <= MAX_NUM_EXHAUSTIVE else []
    key = fingerprint(key, pairs)
    if not project.steps.is_done("matches", key):
        if pairs:
            project.match(pairs)
        elif posed is None:
            project.match_retrieved(used)
        project.steps.finish("matches", key)


def make_model(project: Project, posed: PosedImages | None, refines_cameras: bool) -> None:
    """Writes the model of the poses, or lets COLMAP's mapper make it."""
    folder = project.folder
    if posed is not None:
        write_posed_images(folder.model, posed, prefix=f"{DATABASE}/")
        return
    if (folder.model / "images.bin").exists() and project.steps.is_done("mapper", "mapper"):
        return
    shutil.rmtree(folder.sparse, ignore_errors=True)
    folder.sparse.mkdir()
    words = [project.colmap, "mapper", "--database_path", folder.database, "--image_path", folder.images]
    list_option = find_option(project.colmap, "mapper", r"(Mapper\.)?image_list_path", "that lists the images")
    words += [list_option, folder.write_list("mapped", database_names(folder))]
    words += ["--output_path", folder.sparse, "--Mapper.min_model_size", MIN_MODEL_SIZE]
    if not refines_cameras:
        words += ["--Mapper.ba_refine_focal_length", 0]
    project.runner.run(words, "mapping, because there are no poses")
    models = {path: len(read_model(path).images) for path in folder.sparse.iterdir() if path.is_dir()}
    if not models:
        raise InputError(f"{folder.path}: COLMAP's mapper found no poses: the photos overlap too little")
    best = max(sorted(models), key=lambda path: models[path])
    shutil.rmtree(folder.model, ignore_errors=True)
    shutil.copytree(best, folder.model)
    project.steps.finish("mapper", "mapper")


def add_queries(
    project: Project, queries: Sequence[str], database: Sequence[str], camera: Camera | None, is_sequence: bool
) -> None:
    """Adds queries with features and matches to the database, which is needed for masks and for sequences."""
    files = [project.folder.images / name for name in queries]
    key = fingerprint(database, queries, str(camera), is_sequence, project.has_masks, files=files)
    if project.steps.is_done("queries", key):
        return
    project.extract(dict.fromkeys(queries, camera), one_camera=is_sequence)
    pairs = pairs_in_sequence(queries, SEQUENCE_REACH) if is_sequence else []
    if len(database) <= MAX_NUM_EXHAUSTIVE:
        pairs += all_pairs(queries, database)
    else:
        project.match_retrieved(queries)
    if pairs:
        project.match(pairs)
    project.steps.finish("queries", key)


def localize(project: Project, query_lines: Sequence[str], queries: Sequence[str], options: Sequence[str]) -> None:
    """Localizes the queries with `colmap lazy_localizer`; as photos, if the database does not have them."""
    folder = project.folder
    files = [folder.images / name for name in queries]
    files += sorted(path for path in folder.model.iterdir() if path.is_file())
    # Leave out the model's times, because it is written anew each time.
    model = [path.read_bytes().hex() for path in files if path.parent == folder.model]
    key = fingerprint(query_lines, options, project.sift_options, model, files=files[: len(queries)])
    if project.steps.is_done("localized", key) and (folder.localized / "results.jsonl").exists():
        return
    has_localizer = has_command(project.colmap, "lazy_localizer")
    words: list[object] = [*command_line(str(project.colmap) if has_localizer else None, "lazy_localizer")]
    words += ["--database_path", folder.database, "--input_path", folder.model, "--image_path", folder.images]
    words += ["--query_list_path", folder.write_list("queries", query_lines), "--output_path", folder.localized]
    if len(database_names(folder)) > MAX_NUM_EXHAUSTIVE:
        words += ["--retrieval_index_path", folder.index]
    # Go on with an unfinished run of the same queries, but not with one of others.
    words += ["--resume" if project.steps.is_done("localizing", key) else "--overwrite", 1]
    project.steps.finish("localizing", key)
    words += [*project.sift_options, *options]
    project.runner.run(words, f"localizing {len(queries)} queries")
    project.steps.finish("localized", key)


def database_names(folder: Folder) -> list[str]:
    """Returns the names of the database images in the database."""
    with DatabaseReader(folder.database) as database:
        return sorted(name for name in database.image_ids if name.startswith(f"{DATABASE}/"))


def check_localizer_options(colmap: pathlib.Path, words: Sequence[str]) -> None:
    """Checks the names of options early, because lazy_localizer runs last. The installed package checks them itself."""
    known = option_names(colmap, "lazy_localizer", "--help-all") if has_command(colmap, "lazy_localizer") else []
    for name in [word.removeprefix("--").partition("=")[0] for word in words if word.startswith("--") and known]:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            raise InputError(f"unknown option --{name}" + (f"; the nearest is --{near[0]}" if near else ""))


def find_program() -> pathlib.Path:
    """Returns the colmap program; raises InputError if there is none."""
    path = shutil.which(find_colmap())
    if path is None:
        raise InputError(
            "COLMAP is missing: install the package colmap-lazyloc or COLMAP, or name the program in the environment "
            "variable COLMAP"
        )
    return pathlib.Path(path)
