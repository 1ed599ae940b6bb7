"""Finds and runs the colmap program.

    python -m colmap_lazyloc.program COMMAND

prints the option that switches the GPU on and off for a COLMAP command (feature_extractor or a matcher).
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from colmap_lazyloc.errors import InputError, command
from colmap_lazyloc.onnx import offer_onnxruntime
from colmap_lazyloc.text_files import Path

if TYPE_CHECKING:
    from colmap_lazyloc.model import Camera  # needs numpy, which this command must do without

COLOUR = re.compile(r"\x1b\[[\d;]*m")  # in which COLMAP 4 prints errors
PACKAGE_PATH = pathlib.Path(__file__).resolve().parent


def find_colmap() -> pathlib.Path:
    """Returns the program that the environment variable COLMAP names, else the one built in the checkout, else that of
    the Debian package, else that of the wheel, else `colmap`."""
    offer_onnxruntime()
    if "COLMAP" in os.environ:
        return pathlib.Path(os.environ["COLMAP"])
    built = PACKAGE_PATH.parents[1] / "build" / "bin" / "colmap"
    wheel = PACKAGE_PATH / "bin" / "colmap"
    paths = (built, shutil.which("colmap-lazyloc"), wheel)
    return next((pathlib.Path(path) for path in paths if path and pathlib.Path(path).exists()), pathlib.Path("colmap"))


def run_colmap(colmap: Path, *arguments: object, log_path: pathlib.Path | None = None) -> str:
    """Runs a COLMAP command and returns its words, the standard error output; raises RuntimeError if it fails.

    The command line and all output are written to `log_path`, if one is given.
    """
    words = [str(word) for word in (colmap, *arguments)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if log_path is not None:
        log_path.write_text(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
    if done.returncode != 0:
        last_line = (COLOUR.sub("", done.stderr).strip() or "no message").splitlines()[-1]
        raise RuntimeError(f"colmap {words[1]} ended with code {done.returncode}: {last_line}")
    return done.stderr


def gpu_option(colmap: Path, command_name: str) -> str:
    """Returns the option that switches the GPU; its name differs between COLMAP 3 and COLMAP 4."""
    return find_option(colmap, command_name, r"(Sift|Feature)(Extraction|Matching)\.use_gpu", "that switches the GPU")


def has_command(colmap: Path, command_name: str) -> bool:
    """True if a colmap program has a command, for example lazy_localizer."""
    done = subprocess.run([str(colmap), "help"], capture_output=True, text=True, check=False)
    return re.search(rf"^\s+{command_name}$", done.stdout + done.stderr, re.MULTILINE) is not None


def option_names(colmap: Path, command_name: str, flag: str = "--help") -> list[str]:
    """Returns the names of a command's options, without dashes."""
    done = subprocess.run([str(colmap), command_name, flag], capture_output=True, text=True, check=False)
    return re.findall(r"^ +(?:-h \[ )?--([\w.]+)", done.stdout + done.stderr, re.MULTILINE)


def find_option(colmap: Path, command_name: str, pattern: str, purpose: str) -> str:
    """Returns the option, with dashes, whose name is another one in other versions of COLMAP: the first that fits."""
    for name in option_names(colmap, command_name):
        if re.fullmatch(pattern, name):
            return f"--{name}"
    raise InputError(f"{colmap} {command_name}: has no option {purpose}")


def extract_features(
    colmap: Path, database_path: Path, image_path: Path, names: Iterable[str], camera: "Camera", *options: object
) -> None:
    """Extracts the SIFT features of images below `image_path`, all taken by one camera (model.Camera)."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as names_file:
        names_file.write("".join(f"{name}\n" for name in names))
        names_file.flush()
        run_colmap(
            colmap,
            "feature_extractor",
            "--database_path",
            database_path,
            "--image_path",
            image_path,
            "--image_list_path",
            names_file.name,
            "--ImageReader.single_camera",
            1,
            "--ImageReader.camera_model",
            camera.model,
            "--ImageReader.camera_params",
            ",".join(map(repr, camera.params)),
            gpu_option(colmap, "feature_extractor"),
            0,
            *options,
        )


@command
def main(arguments: Sequence[str] | None = None) -> None:
    arguments = sys.argv[1:] if arguments is None else arguments
    if len(arguments) != 1:
        raise InputError("name one command of COLMAP, such as feature_extractor")
    print(gpu_option(os.environ.get("COLMAP", "colmap"), arguments[0]))


if __name__ == "__main__":
    sys.exit(main())
