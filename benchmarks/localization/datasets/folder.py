"""A COLMAP model and its database, as they are:

    DATA/database.db                 keypoints and two-view geometries of all images; left as it is
    DATA/model, sparse/0 or sparse   COLMAP model, text or binary, with the poses of all images, in metres
    DATA/queries.txt                 names of the queries; without it every image is localized against all others
    DATA/images                      only for colmap_structureless

With queries.txt the queries are localized against the images that it does not list.
"""

import pathlib

from datasets.builder import link, write_scene_files
from datasets.formats import lines_of, read_model
from datasets.scene_source import InputError, SceneSource
from scenes import Scene, load_scene

MODEL_FOLDERS = ("model", "sparse/0", "sparse")


def prepare_folder(data_path: pathlib.Path, path: pathlib.Path) -> Scene:
    """In `path` are a text copy of the model and a link to the database."""
    found = [data_path / folder for folder in MODEL_FOLDERS
             if any((data_path / folder / f"images.{suffix}").exists() for suffix in ("bin", "txt"))]
    if not found:
        raise InputError(f"{data_path} holds no COLMAP model: looked for images.bin or images.txt in "
                         f"{', '.join(MODEL_FOLDERS)}")
    images = read_model(found[0])
    queries_path = data_path / "queries.txt"
    query_names = [line.split()[0] for line in lines_of(queries_path)] if queries_path.exists() else sorted(images)
    unposed = [name for name in query_names if name not in images]
    if unposed:
        raise InputError(f"{queries_path}: {unposed[0]} has no pose in {found[0]}")
    source = SceneSource(data_path.resolve().name, data_path / "images", images, tuple(query_names),
                         leave_one_out=not queries_path.exists())
    write_scene_files(source, path)
    link(data_path / "database.db", path / "database.db")
    return load_scene(path)
