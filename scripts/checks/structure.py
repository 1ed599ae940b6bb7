#!/usr/bin/env python3
"""Prints figures of the C++ code that say what a stranger must read and touch; there is nothing to fail.

The units of a query's path are the files that `--entry` includes, directly or not, each a header with its source file:
what can run between a loaded database and a record. Files that set a status are those with an assignment to the member
`status` of anything; constants are numbers in lines like `constexpr double kName = 0.5`. Judges compare two solutions
of the same images, so that one is kept: pipeline/choose.cc is one, and each function of COMPARISONS that another file
decides by is one.
"""

import argparse
import pathlib
import re

import layers
import tree

INCLUDE = re.compile(r'^#include "colmap_lazyloc/([^"]+)"', re.MULTILINE)
STATUS = re.compile(r"(?:\.|->)status = (?!.*\bsummary\b)")
CHOICE = "pipeline/choose.cc"
# What solutions are compared by, with the names of former versions.
COMPARISONS = (
    "ScoreStart",  # of the starts of one solve, before adjustment
    "ChooseOrientation",
    "CompareOrientations",
    "AreReconciled",
    "GivenOrEstimated",
    "CountLocalized",
)
CONSTANT = re.compile(r"\bk[A-Z]\w* = -?[\d.]")


def units_of_path(source, entry):
    """Returns the files that an entry includes, directly or not, with their source files."""
    found, open_files = set(), [entry]
    while open_files:
        file = open_files.pop()
        if file in found or not (source / file).is_file():
            continue
        found.add(file)
        open_files += INCLUDE.findall((source / file).read_text("utf-8"))
        open_files.append(file.removesuffix(".h") + ".cc" if file.endswith(".h") else file)
    return found


def judges_of(texts):
    """Returns what decides between solutions: pipeline/choose.cc, and comparisons that are called elsewhere."""
    judges = set()
    for name in COMPARISONS:
        call = re.compile(rf"^.*[ (!]{name}\(.*$", re.MULTILINE)
        definition = re.compile(rf"^\S.* {name}\(")  # or a declaration
        for file, text in texts.items():
            if any(not definition.match(line) for line in call.findall(text)):
                judges.add(CHOICE if file == CHOICE else name)
    return sorted(judges)


def main():
    """Prints one figure per line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", nargs="?", type=pathlib.Path, default=pathlib.Path())
    parser.add_argument(
        "--entry", default="localizer/localizer.cc", help="below src/colmap_lazyloc; default: %(default)s"
    )
    arguments = parser.parse_args()
    source = arguments.root / "src" / "colmap_lazyloc"
    paths = [path for path in tree.list_files(arguments.root, "src/*.h", "src/*.cc") if not layers.is_test(path)]
    paths = [path for path in paths if path.parent.name != "testing"]
    texts = {str(path.resolve().relative_to(source.resolve())): path.read_text("utf-8") for path in paths}
    on_path = [file for file in units_of_path(source, arguments.entry) if file in texts]
    setters = sorted(file for file, text in texts.items() if STATUS.search(text))
    print(f"lines of src/ without tests: {sum(text.count(chr(10)) for text in texts.values())} in {len(texts)} files")
    print(f"lines on a query's path: {sum(texts[file].count(chr(10)) for file in on_path)} in {len(on_path)} files")
    print(f"constants: {sum(len(CONSTANT.findall(text)) for text in texts.values())}")
    print(f"judges: {len(judges_of(texts))} ({', '.join(judges_of(texts))})")
    print(f"files that set a status: {len(setters)} ({', '.join(setters)})")


if __name__ == "__main__":
    main()
