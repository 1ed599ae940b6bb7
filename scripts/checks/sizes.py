#!/usr/bin/env python3
"""Checks the length of functions, C++ and Python, in physical lines."""

import ast
import sys

import tree
from cpp_source import Source

MAX_FUNCTION_LINES = 50  # between the braces, or below the line with `def`

# Maps "path:function" to the reason why it may be longer.
EXCEPTIONS = {}


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
    """Returns (key, message) of each function of a file that is too long."""
    functions = (python_functions if path.suffix == ".py" else cpp_functions)(path.read_text(encoding="utf-8"))
    for name, line, length in functions:
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
