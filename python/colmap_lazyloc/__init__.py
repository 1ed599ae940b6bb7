"""Localizes photos against images with known poses, without a 3D map.

    import colmap_lazyloc as ll

    with ll.Localizer("database.db", "model") as localizer:
        result = localizer.localize("query/a.jpg")

The modules with poses, file formats and commands need neither the extension module nor COLMAP. The package imports none
of its modules by itself, because each needs other third-party packages.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from colmap_lazyloc.errors import InputError
    from colmap_lazyloc.inputs import Matches, Photo
    from colmap_lazyloc.localizer import Localizer
    from colmap_lazyloc.result import Result
    from colmap_lazyloc.settings import list_options

__version__ = "0.1.0"
__all__ = ["InputError", "Localizer", "Matches", "Photo", "Result", "list_options"]

_MODULES = {
    "InputError": "errors",
    "Localizer": "localizer",
    "Matches": "inputs",
    "Photo": "inputs",
    "Result": "result",
    "list_options": "settings",
}


def __getattr__(name: str) -> object:
    """Imports what the package offers when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
