#!/usr/bin/env python3
"""Checks the length of files and functions, C++ and Python, in physical lines."""

import ast
import sys

import tree
from cpp_source import Source

MAX_HEADER_LINES = 150
MAX_SOURCE_LINES = 350
MAX_TEST_LINES = 500
MAX_FUNCTION_LINES = 50  # between the braces, or below the line with `def`

# Maps "path" or "path:function" to the reason why it may be longer.
EXCEPTIONS = {}


def max_file_lines(path):
    """Returns the maximum number of lines of a file, which depends on its kind."""
    if path.stem.endswith("_test") or path.stem.startswith("test_") or "tests" in path.parts:
        return MAX_TEST_LINES
    return MAX_HEADER_LINES if path.suffix == ".h" else MAX_SOURCE_LINES


def cpp_functions(text):
    """Returns (name, line, number of lines) of the functions of a C++ file."""
    return [(function.name, function.first_line, function.num_lines) for function in Source(text).functions]


def python_functions(text):
    """Returns (name, line, number of lines) of the functions of a Python file."""
    functions = [
        node for node in ast.walk(ast.parse(text)) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    return [(node.name, node.lineno, node.end_lineno - node.body[0].lineno + 1) for node in functions]


def file_problems(path, relative):
    """Returns (key, message) of everything in a file that is too long."""
    text = path.read_text(encoding="utf-8")
    num_lines, max_lines = text.count("\n"), max_file_lines(relative)
    if num_lines > max_lines:
        yield str(relative), f"{relative}:1: {num_lines} lines, of at most {max_lines}"
    for name, line, length in (python_functions if path.suffix == ".py" else cpp_functions)(text):
        if length > MAX_FUNCTION_LINES:
            yield f"{relative}:{name}", f"{relative}:{line}: {name} has {length} lines, of at most {MAX_FUNCTION_LINES}"


def main():
    """Checks all C++ and Python files."""
    root = tree.parse_root(__doc__)
    files = tree.list_files(root, "*.h", "*.cc", "*.py")
    found = dict(problem for path in files for problem in file_problems(path, path.relative_to(root)))
    problems = [message for key, message in found.items() if key not in EXCEPTIONS]
    if (root / "scripts" / "checks").exists():  # the trees of tests have no checks
        problems += [f"{sys.argv[0]}: the exception {key} is not needed" for key in EXCEPTIONS if key not in found]
    tree.finish("sizes", problems, f"{len(files)} files, {len(EXCEPTIONS)} exception(s)")


if __name__ == "__main__":
    main()
