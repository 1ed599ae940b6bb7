#!/usr/bin/env python3
"""Writes the reference of docs/python.md from the package: all public members, their types and docstrings.

scripts/python.sh scripts/make_python_reference.py
"""

import ast
import inspect
import pathlib
import re

PROJECT_PATH = pathlib.Path(__file__).resolve().parents[1]
PAGE_PATH = PROJECT_PATH / "docs" / "python.md"
MARK = "<!-- Made by scripts/python.sh scripts/make_python_reference.py; do not edit. -->\n"

# The classes and functions of each module that the reference describes.
DESCRIBED = {
    "localizer": ["Localizer"],
    "result": ["Result", "PycolmapPose"],
    "inputs": ["Photo", "Matches"],
    "poses": ["Pose", "read_poses", "write_poses"],
    "model": ["Camera", "Image", "Model", "read_model", "write_model", "poses_of"],
    "settings": ["list_options"],
    "evaluate": ["evaluate", "summarize", "Summary", "Recall"],
    "results": ["read_results", "pose_of", "unconfirmed_pose_of"],
}
WITH_ALIASES = ("array_types", "inputs", "poses", "model", "evaluate")
WITH_ALL_CLASSES = "result_fields"
MAX_SIGNATURE = 100  # characters in a line
PARAMETER = re.compile(r"(?:^|(?<=[.;] )|(?<=\n))(?=(?:`\w+`(?:, )?)+: )")  # where a docstring describes a parameter


def read_module(name: str) -> tuple[ast.Module, list[str]]:
    """Returns the syntax tree of a module and its lines."""
    text = (PROJECT_PATH / "python" / "colmap_lazyloc" / f"{name}.py").read_text(encoding="utf-8")
    return ast.parse(text), text.splitlines()


def type_of(annotation: ast.expr | None) -> str:
    return "" if annotation is None else ast.unparse(annotation).replace("'", "")


def signature(function: ast.FunctionDef, name: str) -> str:
    """Returns `name(parameters) -> type`, with a line for each parameter if one line is too short."""
    arguments = function.args
    arguments.args = [argument for argument in arguments.args if argument.arg != "self"]
    result = "" if function.name == "__init__" else f" -> {type_of(function.returns)}"
    for argument in (*arguments.args, *arguments.kwonlyargs):
        argument.annotation = argument.annotation and ast.Name(type_of(argument.annotation))
    text = f"{name}({ast.unparse(arguments)}){result}"
    if len(text) <= MAX_SIGNATURE:
        return text
    parameters = re.split(r", (?=\*|\w+: )", ast.unparse(arguments))
    return f"{name}(\n" + "".join(f"    {parameter},\n" for parameter in parameters) + f"){result}"


def text_of(node: ast.ClassDef | ast.FunctionDef) -> str:
    return inspect.cleandoc(ast.get_docstring(node) or "")


def describe_function(function: ast.FunctionDef, name: str) -> list[str]:
    """Returns a heading with the name, for links, the signature, and the docstring with its parameters as a list. A
    constructor is below the heading of its class."""
    paragraphs = []
    for paragraph in text_of(function).split("\n\n"):
        text, *parameters = PARAMETER.split(paragraph)
        items = "\n".join(f"- {parameter.strip()}".replace("\n", "\n  ") for parameter in parameters)
        paragraphs += [part for part in (text.strip(), items) if part]
    heading = [] if function.name == "__init__" else [f"#### `{name}`", ""]
    return [*heading, "```python", signature(function, name), "```", "", "\n\n".join(paragraphs), ""]


def describe_class(cls: ast.ClassDef, lines: list[str]) -> list[str]:
    described = [f"### `{cls.name}`", "", text_of(cls), ""]
    fields = [describe_field(node, lines) for node in cls.body if isinstance(node, ast.AnnAssign)]
    described += [*(field for field in fields if not field.startswith("- `_")), ""]
    for node in cls.body:
        if not isinstance(node, ast.FunctionDef):
            continue
        is_property = any("property" in ast.unparse(decorator) for decorator in node.decorator_list)
        if is_property:
            described += [f"**`{node.name}: {type_of(node.returns)}`** {text_of(node)}", ""]
        elif node.name == "__init__" and text_of(node):
            described += describe_function(node, cls.name)
        elif not node.name.startswith("_"):
            described += describe_function(node, f"{cls.name}.{node.name}")
    return described


def describe_field(node: ast.AnnAssign, lines: list[str]) -> str:
    """Returns an item with a field, its type and default, and the comment on its line."""
    is_plain = node.value is not None and isinstance(node.value, ast.Constant)
    default = f" = {ast.unparse(node.value)}" if is_plain else ""
    return f"- `{ast.unparse(node.target)}: {type_of(node.annotation)}{default}`{comment_of(node, lines)}"


def comment_of(node: ast.stmt, lines: list[str]) -> str:
    _, mark, comment = lines[node.end_lineno - 1].partition("  # ")
    return f": {comment}" if mark else ""


def describe_aliases(name: str) -> list[str]:
    """Returns an item with each name of a type in a module."""
    tree, lines = read_module(name)
    return [
        f"- `{ast.unparse(node)}`{comment_of(node, lines)}".replace("'", "")
        for node in tree.body
        if isinstance(node, ast.Assign) and re.fullmatch(r"[A-Z][A-Za-z0-9]*[a-z]", ast.unparse(node.targets[0]))
        if "TypeVar" not in ast.unparse(node.value)
    ]


def describe_fields_of_files() -> list[str]:
    """Returns the TypedDicts of the files that a run writes."""
    tree, _ = read_module(WITH_ALL_CLASSES)
    described = []
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            fields = {ast.unparse(field.target): field.annotation for field in node.body[1:]}
            text = f"**`{node.name}`** {text_of(node)}"
        elif isinstance(node, ast.Assign):  # TypedDict(name, {field: type})
            name, types = node.value.args
            fields = {key.value: value for key, value in zip(types.keys, types.values)}
            text = f"**`{name.value}`**"
        else:
            continue
        described += [f"{text} {', '.join(f'`{field}: {type_of(value)}`' for field, value in fields.items())}", ""]
    return described


def make_reference() -> str:
    """Returns the reference as Markdown."""
    described, functions = [], ["### Functions", ""]
    for name, members in DESCRIBED.items():
        tree, lines = read_module(name)
        nodes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
        for member in members:
            node = nodes[member]
            if isinstance(node, ast.ClassDef):
                described += describe_class(node, lines)
            else:
                functions += describe_function(node, f"{name}.{member}")
    types = ["### Types", "", "The signatures above use these types. `ArrayLike` and `NDArray` are from numpy.", ""]
    for name in WITH_ALIASES:
        types += describe_aliases(name)
    explained = "Types of the dicts in result files. [Files and formats](formats.md) explains the fields."
    files = ["", explained, "", *describe_fields_of_files()]
    text = "\n".join([*described, *functions, *types, *files])
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def make_page() -> str:
    """Returns the page with a new reference."""
    head, mark, _ = PAGE_PATH.read_text(encoding="utf-8").partition(MARK)
    return f"{head}{mark}\n{make_reference()}"


if __name__ == "__main__":
    PAGE_PATH.write_text(make_page(), encoding="utf-8")
