"""Shows what is installed: versions, the colmap program, the Python extension, and the optional packages.

lazyloc doctor
"""

import argparse
import importlib.metadata
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence

import numpy as np

import colmap_lazyloc
from colmap_lazyloc.errors import Parser, command
from colmap_lazyloc.extras import EXTRAS, Extra, install_command, is_installed
from colmap_lazyloc.program import find_colmap, has_command

FEATURES, LOCALIZER = "feature_extractor", "lazy_localizer"


def describe_program() -> str:
    """Returns the program that is found, its version, and what it can do."""
    path = shutil.which(find_colmap())
    if path is None:
        return "not found: install the package colmap-lazyloc or COLMAP, or name the program in the variable COLMAP"
    done = subprocess.run([path, "help"], capture_output=True, text=True, check=False)
    version = re.search(r"^COLMAP [\w.+-]+", done.stdout + done.stderr, re.MULTILINE)
    text = f"{path} ({version.group() if version else 'unknown version'})"
    return text if has_command(path, LOCALIZER) else f"{text}, without {LOCALIZER}"


def describe_extension() -> str:
    """Returns whether Python can localize in its own process."""
    try:
        from colmap_lazyloc.extension import core
    except ImportError as error:
        return f"not found: {error}" if "scripts" not in str(error) else "not built or not installed (the wheel has it)"
    return str(core.__file__)


def describe_extra(name: str, extra: Extra) -> str:
    """Returns a line about an extra: the versions of its packages, or how to get them."""
    versions: list[str] = []
    missing: dict[str, str] = {}
    for package, module in extra.modules.items():
        if is_installed(module):
            versions.append(f"{package} {_version(package, module)}".strip())
        else:
            missing[package] = module
    if not missing:
        return f"{name:<14} {', '.join(versions)}"
    how = install_command(name, list(missing.values()))
    return f"{name:<14} missing: {', '.join(missing)}; {how} brings {extra.purpose}"


def _version(package: str, module: str) -> str:
    for name in importlib.metadata.packages_distributions().get(module, [package]):
        try:
            return importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return ""


@command(name="lazyloc doctor")
def main(arguments: Sequence[str] | None = None) -> None:
    parser = Parser(prog="lazyloc doctor", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args(arguments)
    print(f"colmap_lazyloc {colmap_lazyloc.__version__}")
    print(f"Python {platform.python_version()}, numpy {np.__version__}, {platform.platform()}")
    print(f"program    {describe_program()}")
    print(f"extension  {describe_extension()}")
    print("extras:")
    for name, extra in EXTRAS.items():
        print(f"  {describe_extra(name, extra)}")


if __name__ == "__main__":
    sys.exit(main())
