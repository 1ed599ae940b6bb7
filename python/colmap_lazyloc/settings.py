"""Options of the command line as Python values."""

import difflib
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.extension import core
from colmap_lazyloc.inputs import Option, Options


def list_options() -> dict[str, str]:
    """Returns {name: help text} for all options. Names are as on the command line: "LazyLocalizer.num_retrieved"."""
    return {name: f"{text} (default: {default})" if default else text for name, default, text in core.settings()}


def to_settings(options: Options) -> list[tuple[str, str]]:
    """Returns full names and texts of options, as the command line takes them.

    A name may be full ("LazyLocalizer.num_retrieved"), in nested dicts ({"LazyLocalizer": {"num_retrieved": 20}}), or
    its last part ("num_retrieved"), which is unique. Raises InputError for a name that is unknown or appears twice.
    """
    known = [name for name, _, _ in core.settings()]
    texts: dict[str, str] = {}
    for name, value in _flatten(options):
        full_name = _full_name(name, known)
        if full_name in texts:
            raise InputError(f"option {full_name} is given twice")
        texts[full_name] = _text(full_name, value)
    # Leave out empty values, because the command line cannot take them; they are the defaults of paths.
    return [(name, text) for name, text in texts.items() if text]


def check_text(text: str, label: str) -> None:
    """Raises InputError if no file can have this text as its name."""
    try:
        is_usable = b"\0" not in text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        is_usable = False
    if not is_usable:
        raise InputError(f"{label} contains a null character or a character that is not Unicode")


def _flatten(options: Options, prefix: str = "") -> Iterator[tuple[str, Option]]:
    if not isinstance(options, Mapping):
        raise InputError(f"options must be a dict, but are of type {type(options).__name__}")
    for name, value in options.items():
        if not isinstance(name, str):
            raise InputError(f"option {prefix}{name!r}: a name must be a string")
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _full_name(name: str, known: list[str]) -> str:
    matching = [full for full in known if full == name or full.endswith(f".{name}")]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise InputError(f"option {name} may be {' or '.join(matching)}")
    last_parts = {full.rpartition(".")[2]: full for full in known}
    near = difflib.get_close_matches(name, known, 1) or [
        last_parts[part] for part in difflib.get_close_matches(name.rpartition(".")[2], last_parts, 1)
    ]
    raise InputError(f"unknown option {name}" + (f"; the nearest is {near[0]}" if near else ""))


def _text(name: str, value: Any) -> str:
    if hasattr(value, "item") and not isinstance(value, str):
        try:
            value = value.item()  # of a numpy number
        except ValueError:
            value = list(value)
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        if isinstance(text, bytes):
            text = os.fsdecode(text)
        check_text(text, f"option {name}: the value")
        return text
    if isinstance(value, Sequence) and all(isinstance(number, int | float) for number in value):
        return ",".join(repr(float(number)) for number in value)
    raise InputError(f"option {name}: a value of type {type(value).__name__} cannot be used")
