#!/usr/bin/env python3
"""Checks the folders of src/colmap_lazyloc (CONTRIBUTING.md, "Layers"): who may include whom, on how many levels."""

import re

import tree

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"|<)(?P<path>[^">]+)', re.MULTILINE)

TYPES = {"math", "scene"}  # plain types and pure functions, which every folder may include
STAGES = {"two_view", "rotation", "translation", "structure", "refinement"}
METHOD = TYPES | STAGES | {"bridge"}  # what all parts of the method may include
PARTS = {
    "group",
    "noise",
    "uncertainty",
    "initialization",
    "paper",
    "depths",
    "intrinsics",
    "priors",
}  # of the method, for pipeline/
FILES = {"files", "database", "onnx", "features", "formats", "queries", "loading", "runs", "results"}

# The other folders that a folder's files may include, all of them above it in this table, so that data flows one way.
# Stages hand values to each other and never include one another.
MAY_INCLUDE = {
    "math": set(),
    "scene": {"math"},
    "files": TYPES,  # reads and writes files of any kind
    "database": TYPES,
    "bridge": TYPES,
    "onnx": TYPES,
    "features": TYPES | {"files", "bridge", "onnx", "database"},  # of photos
    "two_view": TYPES | {"bridge"},  # COLMAP's two-view geometry
    "rotation": TYPES,
    "translation": TYPES,
    "structure": TYPES,
    "refinement": TYPES,
    # The method:
    "group": METHOD,
    "noise": METHOD | {"group"},
    "uncertainty": METHOD | {"group", "noise"},
    "initialization": METHOD | {"group", "uncertainty"},
    "paper": METHOD | {"group", "initialization", "uncertainty"},  # the paper's method, as published
    "depths": METHOD | {"group"},
    "intrinsics": METHOD | {"group", "noise", "initialization", "uncertainty"},
    "priors": METHOD | {"group", "noise", "intrinsics", "uncertainty"},
    "pipeline": METHOD | PARTS,
    # Queries from files and the database, and what is written of them:
    "formats": TYPES | {"files", "bridge"},
    "queries": TYPES | {"files", "bridge", "database", "formats"},
    "loading": TYPES | {"files", "bridge", "database", "features", "formats", "queries"},
    "runs": TYPES | {"files", "queries"},
    "results": TYPES | {"files", "bridge", "database", "formats", "runs"},
    # The doors:
    "localizer": TYPES | {"group", "noise", "pipeline", "loading"},  # what happens to a query
    "epoch": METHOD | {"database", "files", "group", "noise", "localizer"},  # new photos together
    "options": TYPES | {"epoch", "bridge", "group", "features", "formats", "loading", "runs"},
    "cli": TYPES | FILES | {"bridge", "epoch", "localizer", "options"},
    "python": TYPES | FILES | {"bridge", "localizer", "options", "cli"},  # runs the commands, too
    "testing": TYPES | {"bridge", "database", "structure", "refinement", "group"},
}
# Only bridge/ may include COLMAP, because differences between its versions must stay in one place.
COLMAP_FOLDER = "bridge"

MAX_LEVELS = 8  # of files of a folder that include each other


def is_test(path):
    """True if the file belongs to a unit test."""
    return path.stem.endswith("_test") or "_test_" in path.stem


def may_include_in_tests(folder):
    """Returns what a folder's tests may include besides. Those of parts of the method may run all of it."""
    return {"testing", "pipeline"} if folder in PARTS else {"testing"}


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
        allowed = MAY_INCLUDE.get(folder, set()) | (may_include_in_tests(folder) if is_test(path) else set())
        if parts[1] not in allowed:
            problems.append(f"{path}:{line}: {folder}/ must not include {parts[1]}/")
    if folder is not None and folder not in MAY_INCLUDE and len(relative.parts) > 1:
        problems.append(f"{path}:1: the folder {folder}/ is not in the table of {__file__}")
    return problems


def num_levels(unit, includes, above=()):
    """Returns on how many levels files of a folder include each other, a source file being one with its header."""
    others = includes.get(unit, set()) - {unit, *above}
    return 1 + max((num_levels(other, includes, (*above, unit)) for other in others), default=0)


def folder_problems(folder, paths):
    """Returns the files of a folder that include each other on too many levels."""
    texts = {}
    for path in paths:
        if not is_test(path):
            texts[path.stem] = texts.get(path.stem, "") + path.read_text(encoding="utf-8")
    header = re.compile(rf'^#include "colmap_lazyloc/{folder}/(\w+)\.h"', re.MULTILINE)
    includes = {unit: set(header.findall(text)) for unit, text in texts.items()}
    for unit in includes:
        if num_levels(unit, includes) > MAX_LEVELS:
            yield f"{folder}/{unit} includes files of {folder}/ on more than {MAX_LEVELS} levels"


def main():
    """Checks all C++ files."""
    root = tree.parse_root(__doc__)
    source = root / "src" / "colmap_lazyloc"
    files = tree.list_files(root, "*.h", "*.cc")
    problems, folders = [], {}
    for path in files:
        relative = path.relative_to(source) if path.is_relative_to(source) else None
        problems += file_problems(path, relative)
        if relative and len(relative.parts) > 1:
            folders.setdefault(relative.parts[0], []).append(path)
    for folder, paths in folders.items():
        problems += folder_problems(folder, paths)
    tree.finish("layers", problems, f"{len(files)} files")


if __name__ == "__main__":
    main()
