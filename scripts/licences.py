#!/usr/bin/env python3
"""Collects the licences of what a wheel or the program contains: of libraries, COLMAP and what COLMAP contains.

    scripts/python.sh scripts/licences.py wheel repaired.whl dist     # a copy of the wheel with its licences
    scripts/python.sh scripts/licences.py program FOLDER              # a file each

`scripts/build_wheel.sh` and `scripts/build_deb.sh` run it on Debian, whose packages come with a copyright file each.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile

# Debian packages of header-only and static libraries in the extension module and the program.
STATIC_PACKAGES = (
    "libcereal-dev",
    "libceres-dev",
    "libeigen3-dev",
    "libflann-dev",
    "nlohmann-json3-dev",
    "libboost-graph-dev",
)
# Files of COLMAP's source with the licences of what the wheel uses, and of what only the build's program uses.
COLMAP_LICENCES = {
    "colmap": "COPYING.txt",
    "poisson_recon": "src/thirdparty/PoissonRecon/LICENSE",
    "vlfeat": "src/thirdparty/VLFeat/LICENSE",
}
PROGRAM_LICENCES = {"lsd": "src/thirdparty/LSD/LICENSE"}


def debian_package(library: str) -> str:
    """Returns the Debian package of a library that auditwheel has renamed, such as libglog-d41a13.so.0.6.0."""
    name = re.sub(r"-[0-9a-f]{8}\.", ".", library, count=1)
    done = subprocess.run(["dpkg-query", "-S", f"*/{name}"], capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return done.stdout.split(":")[0]
    raise SystemExit(f"licences: {library}: no Debian package contains this library, so that its licence is unknown")


def copyright_of(package: str) -> str:
    path = pathlib.Path("/usr/share/doc") / package / "copyright"
    if not path.exists():
        raise SystemExit(f"licences: {path}: the licence of {package} is missing")
    return path.read_text(encoding="utf-8", errors="replace")


def licences_of(libraries: list[str], colmap_licences: dict[str, str]) -> dict[str, str]:
    """Returns the licence texts by file name."""
    packages = [*map(debian_package, libraries), *STATIC_PACKAGES]
    texts = {f"{package}.txt": copyright_of(package) for package in packages}
    colmap_source = pathlib.Path(os.environ["COLMAP_SOURCE_DIR"])
    for name, path in colmap_licences.items():
        if (colmap_source / path).exists():
            texts[f"{name}.txt"] = (colmap_source / path).read_text(encoding="utf-8", errors="replace")
    return texts


def write_texts(texts: dict[str, str], folder: pathlib.Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def repack_wheel(wheel: pathlib.Path, output_path: pathlib.Path) -> None:
    run = [sys.executable, "-m", "wheel"]
    with tempfile.TemporaryDirectory() as work:
        subprocess.run([*run, "unpack", "--dest", work, wheel], check=True, stdout=subprocess.DEVNULL)
        (folder,) = pathlib.Path(work).iterdir()
        (licences,) = folder.glob("*.dist-info/licenses")
        libraries = sorted(path.name for path in folder.glob("*.libs/*.so*"))
        write_texts(licences_of(libraries, COLMAP_LICENCES), licences / "bundled")
        subprocess.run([*run, "pack", "--dest-dir", output_path, folder], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    wheel = kinds.add_parser("wheel")
    wheel.add_argument("wheel", type=pathlib.Path)
    for kind in (wheel, kinds.add_parser("program")):
        kind.add_argument("folder", type=pathlib.Path, help="folder for the new wheel, or for the licences")
    options = parser.parse_args()
    if options.kind == "wheel":
        repack_wheel(options.wheel, options.folder)
    else:
        write_texts(licences_of([], {**COLMAP_LICENCES, **PROGRAM_LICENCES}), options.folder)


if __name__ == "__main__":
    main()
