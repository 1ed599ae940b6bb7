"""Errors in input, and commands that end with one line about them."""

import argparse
import contextlib
import difflib
import functools
import logging
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NoReturn, Protocol, overload

from colmap_lazyloc.extras import missing_package

EXIT_INTERRUPTED = 130

logger = logging.getLogger("colmap_lazyloc")

Main = Callable[..., int | None]


class Command(Protocol):
    """A command: it takes the words of the command line, by default those of this process, and returns an exit code."""

    def __call__(self, arguments: Sequence[str] | None = None) -> int: ...


class InputError(ValueError):
    """Raised for a file or an option that cannot be used; the message is one line that names it."""


@overload
def command(main: Main, *, name: str | None = None, extra: str | None = None) -> Command: ...


@overload
def command(main: None = None, *, name: str | None = None, extra: str | None = None) -> Callable[[Main], Command]: ...


def command(
    main: Main | None = None, *, name: str | None = None, extra: str | None = None
) -> Command | Callable[[Main], Command]:
    """Turns `main(arguments)`, which may return an exit code, into a command.

    If the input is bad, a file cannot be read or written, or an optional package is missing, the command prints one
    line and ends with exit code 1; after Ctrl-C with exit code 130, and the text of the KeyboardInterrupt if it has
    one. If the reader of its output has gone, it ends without a word. Meanwhile the package's log goes to the standard
    error output. `name`: the program's name in messages, if it is not that of the module; `extra`: the extra that
    brings its optional packages.
    """
    if main is None:
        return functools.partial(command, name=name, extra=extra)
    # Take the name from the specification, because `python -m` names the module __main__.
    spec = sys.modules[main.__module__].__spec__
    program = name or (spec.name if spec else main.__module__).removesuffix(".__main__")

    def fail(message: str) -> int:
        logger.error(message)
        return 1

    @functools.wraps(main)
    @_logging_to_stderr(program)
    def run(arguments: Sequence[str] | None = None) -> int:
        try:
            warnings.filterwarnings("ignore", module="PIL")  # on damaged EXIF; commands name what they cannot use
            try:
                code = main(arguments) or 0
            except SystemExit as end:  # argparse ends so: with 0 after --help, with 2 after its line about a bad option
                code = 1 if end.code not in (None, 0) else 0
            sys.stdout.flush()
            return code
        except BrokenPipeError:
            # Let nothing be written any more, because Python flushes the standard output at its end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        except (InputError, OSError) as error:
            return fail(str(error))
        except ImportError as error:
            message = missing_package(error, extra)
            if message is None:
                raise
            return fail(message)
        except KeyboardInterrupt as interrupt:
            logger.error("; ".join(["interrupted", *map(str, interrupt.args)]))
            return EXIT_INTERRUPTED

    return run


@contextlib.contextmanager
def _logging_to_stderr(program: str) -> Iterator[None]:
    """Writes the package's log to the standard error output, each message as a line that begins with the program."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter(f"{program.replace('%', '%%')}: %(message)s"))
    before = logger.handlers, logger.level, logger.propagate
    logger.handlers, logger.propagate = [handler], False
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.handlers, logger.propagate = before[0], before[2]
        logger.setLevel(before[1])


class _Formatter(logging.Formatter):
    """Escapes control characters, because a name from a damaged file may hold a newline, and shortens endless words."""

    def format(self, record: logging.LogRecord) -> str:
        text = re.sub(r"\S{1001,}", lambda word: f"{word[0][:50]}...{word[0][-10:]}", super().format(record))
        return "".join(character if character.isprintable() else repr(character)[1:-1] for character in text)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are InputError, one line; an unknown option is named first, with the nearest one.

    --output and --output_path are the same option.
    `is_foreign`: True for the name of an option, without dashes, that is left to another program.
    """

    def __init__(self, *arguments: Any, is_foreign: Callable[[str], bool] = lambda name: False, **options: Any):
        super().__init__(*arguments, **options)
        self._is_foreign = is_foreign

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        words = [self._known_spelling(word) for word in (sys.argv[1:] if args is None else args)]
        self._check_names(words)
        return super().parse_known_args(words, namespace)

    def error(self, message: str) -> NoReturn:
        choice = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if choice:
            near = nearest(choice[1], re.findall(r"'([^']*)'", choice[2]))
            message = message.partition(" (choose")[0] + (near or f"; choose from {choice[2]}")
        message = re.sub("invalid (int|float) value:", "expected a number, found", message)
        raise InputError(message.removeprefix("argument ") + f" ({self.prog} --help)")

    def _known_spelling(self, word: str) -> str:
        """Returns --output as --output_path and the other way round if only the other one is an option."""
        name, _, _ = word.partition("=")
        other = {"--output": "--output_path", "--output_path": "--output"}.get(name)
        is_other = other in self._option_string_actions and name not in self._option_string_actions
        return word.replace(name, str(other), 1) if is_other else word

    def _check_names(self, words: Sequence[str]) -> None:
        known = [name for name in self._option_string_actions if name.startswith("--")]
        for word in words:
            name = word.partition("=")[0]
            if word == "--":
                return
            if not word.startswith("--") or name in known or self._is_foreign(name.removeprefix("--")):
                continue
            if not self.allow_abbrev or not any(other.startswith(name) for other in known):
                raise InputError(f"unknown option {name}{nearest(name, known) or f' ({self.prog} --help)'}")


def first_names(names: Sequence[str], count: int) -> str:
    """Returns the first of some names, and how many more there are."""
    more = len(names) - count
    return ", ".join(names[:count]) + (f" and {more} more" if more > 0 else "")


def nearest(name: str, known: Iterable[str]) -> str:
    """Returns what an error about an unknown name ends with: the nearest known one, or nothing. The nearest name of a
    photo is one with more or fewer folders."""
    known = list(known)
    near = [other for other in known if other.endswith(f"/{name}") or name.endswith(f"/{other}")]
    if not near:
        # The dashes of options must not make short names look alike.
        without_dashes = {other.removeprefix("--"): other for other in known}
        close = difflib.get_close_matches(name.removeprefix("--"), without_dashes, 1)
        near = [without_dashes[word] for word in close]
    return f"; the nearest is {near[0]}" if near else ""


def positive_int(text: str) -> int:
    """Parses an option's whole number of at least 1 for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, but is '{text}'")
    return int(text)
