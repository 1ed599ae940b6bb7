"""Converts datasets, as their authors distribute them, to scenes: COLMAP model, COLMAP database, queries.

Each module has `scene_names(data_path)`, `read_scene(data_path, name, options) -> SceneSource` and the text BY_HAND,
which says where to get the dataset. If a program may download it, the module also has
`archives(name) -> {URL: folder to unpack it in}`. The datasets `folder` and `scenes` need no conversion: `folder` is
one COLMAP model with its database, `scenes` several of them.
"""

import importlib
import pathlib

from benchmarks.localization.datasets.scene_source import Options
from benchmarks.localization.scenes import Scene, find_scenes, load_scene
from colmap_lazyloc.errors import InputError

MODULES = {
    "7scenes": "seven_scenes",
    "cambridge": "cambridge",
    "aachen": "aachen",
    "strecha": "strecha",
    "kitti": "kitti",
    "demo": "demo",
}
NAMES = ("scenes", "folder", *MODULES)


def scene_names(dataset: str, data_path: pathlib.Path) -> list[str]:
    if dataset == "scenes":
        names = find_scenes(data_path)
        wanted = "no folder with a database.db"
    elif dataset == "folder":
        names = [data_path.resolve().name] if (data_path / "database.db").exists() else []
        wanted = "no database.db"
    else:
        module = _module(dataset)
        names = module.scene_names(data_path)
        wanted = f"no scene of {dataset}: {module.BY_HAND}"
    if not names:
        raise InputError(f"--data_path: {data_path} holds {wanted}")
    return names


def prepare_scene(
    dataset: str, data_path: pathlib.Path, name: str, options: Options, matching, path: pathlib.Path
) -> Scene:
    """Makes the scene's files in `path`, unless they exist and were made from the same input."""
    if dataset == "scenes":
        return load_scene(data_path / name)
    if dataset == "folder":
        from benchmarks.localization.datasets.folder import prepare_folder

        return prepare_folder(data_path, path)
    from benchmarks.localization.datasets.builder import build_scene

    return build_scene(_module(dataset).read_scene(data_path, name, options), path, matching)


def download_scenes(dataset: str, data_path: pathlib.Path, names: list[str] | None):
    from benchmarks.localization.datasets.download import download_archives

    module = _module(dataset) if dataset in MODULES else None
    if not hasattr(module, "archives"):
        reason = module.BY_HAND if module else f"{dataset} is a folder of your own"
        raise InputError(f"--download: {dataset} cannot be fetched by a program: {reason}")
    for name in names or module.SCENES:
        if name not in module.SCENES:
            raise InputError(f"--scenes: {name} is not one of {', '.join(module.SCENES)}")
        if name not in module.scene_names(data_path):
            download_archives(module.archives(name), data_path, module.BY_HAND)


def _module(dataset: str):
    return importlib.import_module(f"benchmarks.localization.datasets.{MODULES[dataset]}")
