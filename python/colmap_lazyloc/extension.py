"""Loads the extension module: `from colmap_lazyloc.extension import core`.

An installed package contains it. In a checkout it is in the folder `python` of the build folder, which the environment
variable BUILD_DIR names (default: `build` in the checkout).
"""

import importlib
import os
import pathlib
from types import ModuleType
from typing import TYPE_CHECKING

import colmap_lazyloc
from colmap_lazyloc.onnx import offer_onnxruntime

EXTENSION = "colmap_lazyloc._core"
CHECKOUT_PATH = pathlib.Path(__file__).resolve().parents[2]


def _load() -> ModuleType:
    offer_onnxruntime()
    try:
        return importlib.import_module(EXTENSION)
    except ModuleNotFoundError:
        built = pathlib.Path(os.environ.get("BUILD_DIR", CHECKOUT_PATH / "build")) / "python"
        if not any(built.glob("_core.*")):
            raise ImportError(
                f"colmap_lazyloc has no extension module: install the wheel, or run scripts/setup.sh to build {built}",
                name=EXTENSION,
            ) from None
    colmap_lazyloc.__path__.append(str(built))
    importlib.invalidate_caches()
    return importlib.import_module(EXTENSION)


if TYPE_CHECKING:
    from colmap_lazyloc import _core

    core = _core
else:
    core = _load()
