#!/usr/bin/env python3
"""Prints figures that show how simple the code is, to follow them over time."""

import comments
import sizes
import tree
from cpp_source import Source


def is_test(path):
    """True if the file is a unit test or support code for tests."""
    return path.stem.endswith("_test") or "_test_" in path.stem or path.parent.name == "testing"


def longest_function(root, paths):
    """Returns (lines, "file: name") of the longest function."""
    return max((length, f"{path.relative_to(root)}: {name}") for path in paths for name, _, length in functions(path))


def functions(path):
    """Returns (name, line, number of lines) of a file's functions; a file without any counts as one of 0 lines."""
    return sizes.cpp_functions(path.read_text(encoding="utf-8")) or [("none", 1, 0)]


def public_fields(paths):
    """Returns the number of public data members by type."""
    counts = {}
    for path in paths:
        for _, owner, _ in Source(path.read_text(encoding="utf-8")).fields:
            counts[owner] = counts.get(owner, 0) + 1
    return counts


def main():
    """Prints one figure per line."""
    root = tree.parse_root(__doc__)
    source = root / "src" / "colmap_lazyloc"
    code = [path for path in tree.list_files(root, "*.h", "*.cc") if path.is_relative_to(root / "src")]
    paths = [path for path in code if not is_test(path)]
    lines = sum(path.read_text(encoding="utf-8").count("\n") for path in paths)
    length, name = longest_function(root, paths)
    option_lists = [path for path in source.glob("cli/*option*.*") if not is_test(path)]
    options = sum(path.read_text(encoding="utf-8").count('add("') for path in option_lists)
    fields = public_fields(sorted((source / "pipeline").glob("*.h")))
    by_type = ", ".join(f"{owner} {count}" for owner, count in sorted(fields.items(), key=lambda item: -item[1]))
    print(f"lines of src/ without tests: {lines}")
    print(f"files of src/ without tests: {len(paths)}")
    print(f"longest function: {length} lines, {name}")
    print(f"command-line options registered: {options}")
    print(f"C++ comments: {comments.ratio_text(*comments.count(tree.list_files(root, '*.h', '*.cc')))}")
    print(f"Python comments: {comments.ratio_text(*comments.count(tree.list_files(root, '*.py')))}")
    print(f"public data fields in pipeline/*.h: {sum(fields.values())} ({by_type})")


if __name__ == "__main__":
    main()
