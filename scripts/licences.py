#!/usr/bin/env python3
"""Lists what a wheel or the program contains, with licences: from the files that were compiled, linked and bundled.

    scripts/python.sh scripts/licences.py wheel repaired.whl BUILD dist    # a copy of the wheel with list and licences
    scripts/python.sh scripts/licences.py program BUILD FOLDER             # list, and a file of licences per component
    scripts/python.sh scripts/licences.py check FILE                       # fails on the GPL; FILE: wheel or list

BUILD is the build folder. The list (SBOM) is in the format CycloneDX. A file of unknown origin is an error, and so is a
component without a licence below. It needs Debian, whose packages come with a copyright file each.
"""

import argparse
import hashlib
import importlib.metadata
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass, field

# SPDX expressions by Debian's source package, part of COLMAP, or Python package. They are for what is in the libraries,
# not for programs, tests and packaging in the same source; where there is a choice, the chosen licence.
LICENCES = {
    "atlas": "BSD-3-Clause",
    "boost": "BSL-1.0",
    "ceres-solver": "BSD-3-Clause",
    "colmap": "BSD-3-Clause",
    "eigen3": "BSD-3-Clause AND MPL-2.0",
    "flann": "BSD-3-Clause",
    "freeimage": "FreeImage",
    "gcc": "GPL-3.0-or-later WITH GCC-exception-3.1 AND LGPL-2.0-or-later",
    "gflags": "BSD-3-Clause",
    "google-glog": "BSD-3-Clause",
    "imath": "BSD-3-Clause",
    "jbigkit": "GPL-2.0-or-later",
    "jxrlib": "BSD-2-Clause",
    "lapack": "BSD-3-Clause",
    "lcms2": "MIT",
    "lerc": "Apache-2.0",
    "libcereal": "BSD-3-Clause AND BSL-1.0 AND MIT",
    "libdeflate": "MIT",
    "libjpeg-turbo": "BSD-3-Clause AND IJG AND Zlib",
    "libpng": "libpng-2.0",
    "libraw": "LGPL-2.1-only",
    "libunwind": "MIT",
    "libwebp": "BSD-3-Clause",
    "libzstd": "BSD-3-Clause",
    "LSD": "AGPL-3.0-or-later",
    "lz4": "BSD-2-Clause",
    "metis": "Apache-2.0 AND LGPL-2.1-or-later",
    "nanobind": "BSD-3-Clause AND MIT",
    "nlohmann-json3": "MIT",
    "openblas": "BSD-3-Clause",
    "openexr": "BSD-3-Clause",
    "openjpeg2": "BSD-2-Clause",
    "PoissonRecon": "BSD-3-Clause AND MIT",
    "robin-map": "MIT",
    "sqlite3": "blessing",
    "suitesparse": "GPL-2.0-or-later AND LGPL-2.1-or-later",
    "three": "MIT",
    "tiff": "libtiff",
    "VLFeat": "BSD-2-Clause",
    "xz-utils": "0BSD",
    "zlib": "Zlib",
}
FORBIDDEN = re.compile(r"A?GPL-(?!.* WITH GCC-exception-3\.1$)")
# Debian's source packages whose headers are interfaces of the system. ONNX Runtime is loaded when the program runs.
SYSTEM = re.compile(r"cross-toolchain-base$|glibc$|linux$|onnxruntime$|python3")
ROOT = pathlib.Path(__file__).resolve().parents[1]
TARGETS = ("program", "lazyloc_python")
SBOM = "colmap-lazyloc.cdx.json"


@dataclass
class Component:
    """A part of a wheel or of the program; the files are those that are bundled, with their SHA-256."""

    name: str
    version: str
    licence_text: str
    files: dict[str, str] = field(default_factory=dict)

    @property
    def licence(self) -> str:
        licence = LICENCES.get(self.name) or LICENCES.get(re.sub(r"-?[\d.]+(-cross)?$", "", self.name))
        return licence or fail(f"{self.name}: scripts/licences.py does not know the licence of this component")

    def as_dict(self) -> dict:
        files = [
            {"type": "file", "name": name, "hashes": [{"alg": "SHA-256", "content": digest}]}
            for name, digest in sorted(self.files.items())
        ]
        licences = [{"expression": self.licence}]
        listed = {"type": "library", "name": self.name, "version": self.version, "licenses": licences}
        return {**listed, "components": files} if files else listed


def fail(message: str):
    raise SystemExit(f"licences: {message}")


def run(*command) -> str:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True).stdout


def read_text(path: pathlib.Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def compiled_files(build: pathlib.Path) -> set[pathlib.Path]:
    """Returns the sources, headers and static libraries of a build's programs, as ninja has recorded them."""
    inputs = set(run("ninja", "-C", build, "-t", "inputs", *TARGETS).splitlines())
    recorded = re.split(r"^(\S.*): #deps .*$", run("ninja", "-C", build, "-t", "deps"), flags=re.MULTILINE)
    headers = [block.split("\n") for name, block in zip(recorded[1::2], recorded[2::2]) if name in inputs]
    static = [path for path in inputs if path.startswith("/") and not re.search(r"\.so[.\d]*$", path)]
    paths = [*static, *(line.strip() for lines in headers for line in lines if line)]
    return {pathlib.Path(os.path.realpath(build / path)) for path in paths}


def packages_of(paths: list[pathlib.Path]) -> dict[pathlib.Path, str]:
    """Returns the Debian package of each file that a package contains, with the architecture if it can have several."""
    # The database may name a file below /lib that is below /usr/lib.
    names = [name for path in paths for name in (str(path), str(path).removeprefix("/usr"))]
    listed = subprocess.run(["dpkg-query", "-S", *names], capture_output=True, text=True, check=False).stdout
    found = {path: package for package, path in re.findall(r"^(\S+?)(?:, .*)?: (/.*)$", listed, re.MULTILINE)}
    packages = {path: found.get(str(path)) or found.get(str(path).removeprefix("/usr")) for path in paths}
    return {path: package for path, package in packages.items() if package}


def debian_component(package: str) -> Component:
    name, version = run("dpkg-query", "-W", "-f", "${source:Package} ${source:Version}", package).split()
    return Component(name, version, read_text(pathlib.Path("/usr/share/doc", package.partition(":")[0], "copyright")))


def nanobind_component() -> Component:
    """Returns the component with the licences of nanobind and of the hash table that it contains."""
    distribution = importlib.metadata.distribution("nanobind")
    texts = {file.name: file for file in distribution.files or () if file.name in ("LICENSE", "robin_map.h")}
    text = texts["LICENSE"].read_text() + "\n" + texts["robin_map.h"].read_text().split("*/")[0]
    return Component("nanobind", distribution.version, text)


def viewer_component() -> Component:
    """Returns what the viewer of the report page contains."""
    text = read_text(ROOT / "python" / "colmap_lazyloc" / "report" / "viewer_licenses.txt")
    name, version = text.split("\n")[0].split()
    return Component(name, version, text)


class Origins:
    """Tells which component a file belongs to."""

    def __init__(self, build: pathlib.Path):
        cache = read_text(build / "CMakeCache.txt")
        self.variables = dict(re.findall(r"^(\w+):\w+=(.+)$", cache, re.MULTILINE))
        self.colmap = pathlib.Path(self.variables["COLMAP_SOURCE_DIR"]).resolve()
        ceres = pathlib.Path(self.variables["Ceres_DIR"]).resolve()
        self.libraries = next((path for path in ceres.parents if (path / "components").is_dir()), None)
        source = pathlib.Path(self.variables["CMAKE_HOME_DIRECTORY"]).resolve()
        self.own, self.vendored = [source, build.resolve()], source / "vendored"  # see scripts/build_deb.sh

    def components_of(self, paths: set[pathlib.Path]) -> list[Component]:
        """Returns the components that the files belong to, without the system's."""
        paths = {
            path
            for path in paths
            if path.is_relative_to(self.vendored) or not any(path.is_relative_to(folder) for folder in self.own)
        }
        packages = packages_of(sorted(paths))
        found = [debian_component(package) for package in sorted(set(packages.values()))]
        found += [self.other_component(path) for path in sorted(paths - set(packages))]
        return [component for component in found if not SYSTEM.match(component.name)]

    def other_component(self, path: pathlib.Path) -> Component:
        """Returns the component of a file that is not from a Debian package."""
        if path.is_relative_to(self.colmap):
            return self.colmap_component(path.relative_to(self.colmap))
        if self.libraries and path.is_relative_to(self.libraries):
            return self.built_component("tiff" if path.name.startswith("libtiff") else "ceres-solver")
        if "nanobind" in path.parts:
            return nanobind_component()
        for name, variable in {"onnxruntime": "ONNXRUNTIME_INCLUDE_DIR", "python3": "_Python_INCLUDE_DIR"}.items():
            if path.is_relative_to(pathlib.Path(self.variables.get(variable, "/nowhere")).resolve()):
                return Component(name, "", "")
        fail(f"{path}: no package contains this file, so that its licence is unknown")

    def colmap_component(self, path: pathlib.Path) -> Component:
        version = re.search(r'set\(COLMAP_VERSION "(.*)"\)', read_text(self.colmap / "CMakeLists.txt"))
        name, text = "colmap", self.colmap / "COPYING.txt"
        if path.parts[:2] == ("src", "thirdparty") and len(path.parts) > 3:
            name, text = path.parts[2], self.colmap.joinpath(*path.parts[:3], "LICENSE")
        return Component(name, version[1] if version else "", read_text(text))

    def built_component(self, name: str) -> Component:
        folder = self.libraries / "components" / name
        return Component(name, read_text(folder / "version").strip(), read_text(folder / "copyright"))

    def original(self, bundled: str) -> pathlib.Path:
        """Returns the library that auditwheel has bundled under a new name, such as libglog-d41a13ba.so.0.6.0."""
        name = re.sub(r"-[0-9a-f]{8}\.", ".", bundled, count=1)
        if self.libraries and (self.libraries / "lib" / name).exists():
            return self.libraries / "lib" / name
        return pathlib.Path(run("dpkg-query", "-S", f"*/{name}").splitlines()[0].split(": ")[1])


def merge(components: list[Component]) -> list[Component]:
    merged: dict[str, Component] = {}
    for component in components:
        merged.setdefault(component.name, component).files.update(component.files)
    return [merged[name] for name in sorted(merged, key=str.lower)]


def expression_of(components: list[Component]) -> str:
    """Returns the SPDX expression of our code together with all components."""
    terms = {term for component in components for term in component.licence.split(" AND ")}
    return " AND ".join(sorted({"BSD-3-Clause", *terms}))


def write_list(components: list[Component], folder: pathlib.Path, sbom: pathlib.Path) -> None:
    """Writes a file with the licences of each component, and the list of the components."""
    folder.mkdir(parents=True, exist_ok=True)
    sbom.parent.mkdir(exist_ok=True)
    for component in components:
        (folder / f"{component.name}.txt").write_text(component.licence_text, encoding="utf-8")
    subject = {"type": "application", "name": "colmap-lazyloc", "licenses": [{"expression": expression_of(components)}]}
    listed = {"bomFormat": "CycloneDX", "specVersion": "1.6", "version": 1, "metadata": {"component": subject}}
    listed["components"] = [component.as_dict() for component in components]
    sbom.write_text(json.dumps(listed, indent=1) + "\n", encoding="utf-8")


def repack_wheel(wheel: pathlib.Path, build: pathlib.Path, output_path: pathlib.Path) -> None:
    """Adds the list and the licences to a wheel, whose metadata then states the licences of all that it contains."""
    python = [sys.executable, "-m", "wheel"]
    origins = Origins(build)
    components = origins.components_of(compiled_files(build))
    with tempfile.TemporaryDirectory() as work:
        subprocess.run([*python, "unpack", "--dest", work, wheel], check=True, stdout=subprocess.DEVNULL)
        (folder,) = pathlib.Path(work).iterdir()
        (info,) = folder.glob("*.dist-info")
        for path in folder.glob("*.libs/*.so*"):
            (component,) = origins.components_of({origins.original(path.name)})
            component.files[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
            components.append(component)
        components = merge([*components, viewer_component()])
        write_list(components, info / "licenses" / "bundled", info / "sboms" / SBOM)
        metadata = info / "METADATA"
        stated = f"License-Expression: {expression_of(components)}"
        metadata.write_text(re.sub(r"^License-Expression: .*$", stated, metadata.read_text(), flags=re.MULTILINE))
        subprocess.run([*python, "pack", "--dest-dir", output_path, folder], check=True)


def check(path: pathlib.Path) -> None:
    """Fails if a component is under the GPL or AGPL."""
    if path.suffix == ".whl":
        with zipfile.ZipFile(path) as wheel:
            (name,) = (name for name in wheel.namelist() if name.endswith(f"/{SBOM}"))
            text = wheel.read(name)
    else:
        text = path.read_bytes()
    components = json.loads(text)["components"]
    licences = {component["name"]: component["licenses"][0]["expression"] for component in components}
    found = [f"{name} ({text})" for name, text in licences.items() if any(map(FORBIDDEN.match, text.split(" AND ")))]
    if found:
        fail(f"{path} contains {', '.join(found)}")
    print(f"{path}: {len(components)} components, none under the GPL or AGPL")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    for kind, names in {"wheel": "wheel build folder", "program": "build folder", "check": "file"}.items():
        command = kinds.add_parser(kind)
        for name in names.split():
            command.add_argument(name, type=pathlib.Path)
    options = parser.parse_args()
    if options.kind == "wheel":
        repack_wheel(options.wheel, options.build, options.folder)
    elif options.kind == "program":
        components = Origins(options.build).components_of(compiled_files(options.build))
        components = merge([*components, viewer_component()])
        write_list(components, options.folder, options.folder / SBOM)
    else:
        check(options.file)


if __name__ == "__main__":
    main()
