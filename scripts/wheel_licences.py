#!/usr/bin/env python3
"""Adds the licences of what a wheel contains to the wheel: those of its libraries, COLMAP and what COLMAP contains.

    scripts/python.sh scripts/wheel_licences.py repaired.whl --output_path dist

`scripts/build_wheel.sh` runs it on Debian, whose packages come with a copyright file each.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile

# Debian packages of header-only and static libraries in the extension module.
STATIC_PACKAGES = ("libceres-dev", "libeigen3-dev", "libflann-dev", "nlohmann-json3-dev", "libboost-graph-dev")
# Folders of COLMAP's source that the extension module uses.
COLMAP_LICENCES = {"colmap": "COPYING.txt", "vlfeat": "src/thirdparty/VLFeat/LICENSE"}


def debian_package(library: str) -> str:
    """Returns the Debian package of a library that auditwheel has renamed, such as libglog-d41a13.so.0.6.0."""
    name = re.sub(r"-[0-9a-f]{8}\.", ".", library, count=1)
    done = subprocess.run(["dpkg-query", "-S", f"*/{name}"], capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return done.stdout.split(":")[0]
    raise SystemExit(
        f"wheel_licences: {library}: no Debian package contains this library, so that its licence is unknown"
    )


def copyright_of(package: str) -> str:
    path = pathlib.Path("/usr/share/doc") / package / "copyright"
    if not path.exists():
        raise SystemExit(f"wheel_licences: {path}: the licence of {package} is missing")
    return path.read_text(encoding="utf-8", errors="replace")


def licences_of(folder: pathlib.Path, colmap_source: pathlib.Path) -> dict[str, str]:
    """Returns the licence texts by file name."""
    texts = {}
    for library in sorted(path.name for path in folder.glob("*.libs/*.so*")):
        package = debian_package(library)
        texts[f"{package}.txt"] = copyright_of(package)
    for package in STATIC_PACKAGES:
        texts[f"{package}.txt"] = copyright_of(package)
    for name, path in COLMAP_LICENCES.items():
        if (colmap_source / path).exists():
            texts[f"{name}.txt"] = (colmap_source / path).read_text(encoding="utf-8", errors="replace")
    return texts


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=pathlib.Path)
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="folder for the new wheel")
    options = parser.parse_args()
    run = [sys.executable, "-m", "wheel"]
    with tempfile.TemporaryDirectory() as work:
        subprocess.run([*run, "unpack", "--dest", work, options.wheel], check=True, stdout=subprocess.DEVNULL)
        (folder,) = pathlib.Path(work).iterdir()
        (licences,) = folder.glob("*.dist-info/licenses")
        for name, text in licences_of(folder, pathlib.Path(os.environ["COLMAP_SOURCE_DIR"])).items():
            (licences / "bundled").mkdir(exist_ok=True)
            (licences / "bundled" / name).write_text(text, encoding="utf-8")
        subprocess.run([*run, "pack", "--dest-dir", options.output_path, folder], check=True)


if __name__ == "__main__":
    main()
