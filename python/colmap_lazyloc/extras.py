"""The optional packages: which extra of the package brings what, and one line about a missing one."""

import dataclasses
import importlib.util
import pathlib
from collections.abc import Sequence


@dataclasses.dataclass(frozen=True)
class Extra:
    """An extra of pyproject.toml: what it is for, and the modules by the name of their packages."""

    purpose: str
    modules: dict[str, str]


OPENCV = {"opencv-python-headless": "cv2"}
TQDM = {"tqdm": "tqdm"}
EXTRAS = {
    "run": Extra(
        "lazyloc run: videos, HEIC, GPS, check of the poses, marked points, photos in the report, progress",
        {
            **OPENCV,
            "pillow": "PIL",
            "pillow-heif": "pillow_heif",
            "pycolmap": "pycolmap",
            "pyproj": "pyproj",
            "scipy": "scipy",
            **TQDM,
        },
    ),
    "import": Extra(
        "lazyloc import: sizes and GPS of photos, geographic coordinates, calibration files, angles, check of poses",
        {**OPENCV, "pillow": "PIL", "pyproj": "pyproj", "pyyaml": "yaml", "scipy": "scipy"},
    ),
    "report": Extra("lazyloc report: photos, progress", {**OPENCV, **TQDM}),
    "plots": Extra("lazyloc report --plots", {"matplotlib": "matplotlib"}),
    "control_points": Extra(
        "lazyloc control_points",
        {"pycolmap": "pycolmap", "pyproj": "pyproj", "scipy": "scipy"},
    ),
    "changes": Extra("lazyloc changes", {"pycolmap": "pycolmap", "scipy": "scipy"}),
    "demo": Extra(
        "lazyloc demo: rendering",
        {**OPENCV, "pillow": "PIL", "pycolmap": "pycolmap", "pyproj": "pyproj", "scipy": "scipy"},
    ),
    "retrieval": Extra("lazyloc retrieve: global descriptors", {"faiss-cpu": "faiss", "h5py": "h5py"}),
    "cluster": Extra("lazyloc cluster: Dask", {"bokeh": "bokeh", "distributed": "distributed", **TQDM}),
    "serve": Extra(
        "lazyloc serve: the HTTP service",
        {
            "fastapi": "fastapi",
            "pillow": "PIL",
            "pyproj": "pyproj",
            "python-multipart": "python_multipart",
            "uvicorn": "uvicorn",
        },
    ),
    "ros2": Extra("lazyloc export --format ros2: bags", {"rosbags": "rosbags"}),
    "onnx": Extra("photos against databases of ALIKED features", {"onnxruntime": "onnxruntime"}),
    "hloc": Extra("files of hloc, projection of points", {"h5py": "h5py", "pycolmap": "pycolmap"}),
}


# The folder of the Debian package, whose users install other packages with apt.
IS_DEBIAN_PACKAGE = pathlib.Path(__file__).is_relative_to("/usr/lib/python3/dist-packages")
DEBIAN_NAMES = {"cv2": "python3-opencv", "PIL": "python3-pil"}
# Or not as new as it must be, as those of `serve` in Debian 12.
NOT_IN_DEBIAN = ("bokeh", "fastapi", "pillow-heif", "pycolmap", "python_multipart", "rosbags", "uvicorn")


def is_installed(module: str) -> bool:
    """True if a module can be imported; does not import it."""
    return importlib.util.find_spec(module) is not None


def missing_package(error: ImportError, preferred: str | None = None) -> str | None:
    """Returns one line about the package that an import lacks; None if it is not an optional one.

    `preferred`: the extra to name if several bring it.
    """
    if error.name == "colmap_lazyloc._core":
        return str(error)
    module = (error.name or "").partition(".")[0]
    extras = [name for name, extra in EXTRAS.items() if module in extra.modules.values()]
    if not extras:
        return None
    name = preferred if preferred in extras else extras[0]
    package = next(package for package, import_name in EXTRAS[name].modules.items() if import_name == module)
    return f"{package} is missing: {install_command(name, [module])}"


def install_command(name: str, modules: Sequence[str]) -> str:
    """Returns the command that installs modules of an extra; next to the Debian package there may be two."""
    if not IS_DEBIAN_PACKAGE:
        return f"pip install 'colmap-lazyloc[{name}]'"
    by_apt = [DEBIAN_NAMES.get(module, f"python3-{module}") for module in modules if module not in NOT_IN_DEBIAN]
    by_pip = [module for module in modules if module in NOT_IN_DEBIAN]
    commands = [f"apt install {' '.join(by_apt)}"] if by_apt else []
    # Name a virtual environment, because pip refuses to change Debian's own.
    commands += [f"pip install {' '.join(by_pip)} in a virtual environment"] if by_pip else []
    return ", and ".join(commands)
