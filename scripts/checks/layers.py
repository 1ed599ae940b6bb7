#!/usr/bin/env python3
"""Checks that data flows one way: which folder of src/colmap_lazyloc/ may include which (CONTRIBUTING.md, "Layers")."""

import re

import tree

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"|<)(?P<path>[^">]+)', re.MULTILINE)

TYPES = {"math", "scene"}  # plain types and pure functions, which every folder may include
STAGES = {"two_view", "rotation", "translation", "structure", "refinement"}

# The other folders that a folder's files may include. Stages hand values to each other: only pipeline/ knows them all.
MAY_INCLUDE = {
    "math": set(),
    "scene": {"math"},
    "files": TYPES,  # reads and writes files of any kind, for io/ and others with files of their own
    "database": TYPES,
    "bridge": TYPES,
    "matching": TYPES | {"files", "bridge", "database"},
    "two_view": TYPES | {"bridge"},  # COLMAP's two-view geometry
    "rotation": TYPES,
    "translation": TYPES,
    "structure": TYPES,
    "refinement": TYPES,
    "ablation": TYPES | STAGES | {"bridge"},  # the paper's alternatives, used only by pipeline/
    "pipeline": TYPES | STAGES | {"bridge", "ablation"},
    "io": TYPES | {"files", "bridge", "database", "matching"},
    "cli": TYPES | {"files", "bridge", "database", "matching", "pipeline", "io"},
    "python": TYPES | {"bridge", "pipeline", "io", "cli", "database"},  # the extension module of the Python package
    "testing": TYPES | {"bridge", "database", "refinement"},
}
# Only bridge/ may include COLMAP, because differences between its versions must stay in one place.
COLMAP_FOLDER = "bridge"


def is_test(path):
    """True if the file belongs to a unit test, which may also include testing/."""
    return path.stem.endswith("_test") or "_test_" in path.stem


def file_problems(path, relative):
    """Returns the includes of one file that break a rule. `relative`: its path below src/colmap_lazyloc, or None."""
    problems = []
    folder = relative.parts[0] if relative else None
    text = path.read_text(encoding="utf-8")
    for match in INCLUDE.finditer(text):
        line = text.count("\n", 0, match.start("path")) + 1
        parts = match["path"].split("/")
        if parts[0] == "colmap" and folder != COLMAP_FOLDER:
            problems.append(f"{path}:{line}: only {COLMAP_FOLDER}/ may include COLMAP's headers")
        if parts[0] != "colmap_lazyloc" or folder is None or len(parts) < 3 or parts[1] == folder:
            continue
        allowed = MAY_INCLUDE.get(folder, set()) | ({"testing"} if is_test(path) else set())
        if parts[1] not in allowed:
            problems.append(f"{path}:{line}: {folder}/ must not include {parts[1]}/")
    if folder is not None and folder not in MAY_INCLUDE and len(relative.parts) > 1:
        problems.append(f"{path}:1: the folder {folder}/ is not in the table of {__file__}")
    return problems


def main():
    """Checks all C++ files."""
    root = tree.parse_root(__doc__)
    source = root / "src" / "colmap_lazyloc"
    files = tree.list_files(root, "*.h", "*.cc")
    problems = []
    for path in files:
        relative = path.relative_to(source) if path.is_relative_to(source) else None
        problems += file_problems(path, relative)
    tree.finish("layers", problems, f"{len(files)} files")


if __name__ == "__main__":
    main()
