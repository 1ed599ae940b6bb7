#!/usr/bin/env python3
"""Writes the reference of docs/python.md from the signatures and docstrings of the package.

scripts/python.sh scripts/make_python_reference.py
"""

import inspect
import pathlib
import re

import colmap_lazyloc as ll

PAGE_PATH = pathlib.Path(__file__).resolve().parents[1] / "docs" / "python.md"
MARK = "<!-- Made by scripts/python.sh scripts/make_python_reference.py; do not edit. -->\n"


def signature(function, name: str) -> str:
    """Returns `name(parameters)` without types."""
    parameters = [
        parameter.replace(annotation=inspect.Parameter.empty)
        for parameter in inspect.signature(function).parameters.values()
        if parameter.name != "self"
    ]
    return f"{name}{inspect.Signature(parameters)}"


def text_of(documented) -> str:
    return inspect.getdoc(documented) or ""


def describe_class(cls) -> list[str]:
    lines = [f"### `{cls.__name__}`", "", text_of(cls), ""]
    if cls.__init__.__doc__ and not hasattr(cls, "__dataclass_fields__"):
        lines += [f"**`{signature(cls.__init__, cls.__name__)}`** {text_of(cls.__init__)}", ""]
    for name, member in vars(cls).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            lines += [f"**`{name}`** {text_of(member)}", ""]
        elif inspect.isfunction(member):
            lines += [f"**`{signature(member, name)}`** {text_of(member)}", ""]
    return lines


def make_reference() -> str:
    """Returns the reference as Markdown."""
    lines = []
    for cls in (ll.Localizer, ll.Result, ll.Photo, ll.Matches):
        lines += describe_class(cls)
    lines += ["### Functions", "", f"**`{signature(ll.list_options, 'list_options')}`** {text_of(ll.list_options)}"]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)) + "\n"


def make_page() -> str:
    """Returns the page with a new reference."""
    head, mark, _ = PAGE_PATH.read_text(encoding="utf-8").partition(MARK)
    return f"{head}{mark}\n{make_reference()}"


if __name__ == "__main__":
    PAGE_PATH.write_text(make_page(), encoding="utf-8")
