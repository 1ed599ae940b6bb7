"""A COLMAP model and its database, used without conversion:

    DATA/database.db                 keypoints and two-view geometries of all images; only read
    DATA/model, sparse/0 or sparse   COLMAP model, text or binary, with the poses of all images, in metres
    DATA/queries.txt                 names of the queries; without it, every image is localized against all others
    DATA/images                      only for colmap_structureless

With queries.txt, the queries are localized against the images that it does not list.
"""

import pathlib

from benchmarks.localization.datasets.builder import link, write_scene_files
from benchmarks.localization.datasets.formats import read_source_images
from benchmarks.localization.datasets.scene_source import SceneSource
from benchmarks.localization.scenes import Scene, load_scene
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import is_model
from colmap_lazyloc.queries import read_queries

MODEL_FOLDERS = ("model", "sparse/0", "sparse")


def prepare_folder(data_path: pathlib.Path, path: pathlib.Path) -> Scene:
    """Makes a text copy of the model and a link to the database in `path`."""
    found = [data_path / folder for folder in MODEL_FOLDERS if is_model(data_path / folder)]
    if not found:
        raise InputError(
            f"{data_path} holds no COLMAP model: looked for images.bin or images.txt in {', '.join(MODEL_FOLDERS)}"
        )
    images = read_source_images(found[0])
    queries_path = data_path / "queries.txt"
    query_names = list(read_queries(queries_path)) if queries_path.exists() else sorted(images)
    unposed = [name for name in query_names if name not in images]
    if unposed:
        raise InputError(f"{queries_path}: {unposed[0]} has no pose in {found[0]}")
    source = SceneSource(
        data_path.resolve().name,
        data_path / "images",
        images,
        tuple(query_names),
        leave_one_out=not queries_path.exists(),
    )
    write_scene_files(source, path)
    link(data_path / "database.db", path / "database.db")
    return load_scene(path)
