"""Errors in the input, and how a command reports them."""

import argparse
import functools
import sys

EXIT_INTERRUPTED = 130


class InputError(ValueError):
    """Raised for a file or an option that cannot be used; the message is one line that names it."""


def command(main):
    """Turns `main(arguments)`, which may return an exit code, into a command.

    If the input is bad, or a file cannot be read or written, the command prints one line and ends with exit code 1;
    after Ctrl-C with exit code 130.
    """
    # Take the name from the specification, because `python -m` names the module __main__.
    program = sys.modules[main.__module__].__spec__.name.removesuffix(".__main__")

    @functools.wraps(main)
    def run(arguments=None) -> int:
        try:
            return main(arguments) or 0
        except (InputError, OSError) as error:
            print(f"{program}: {_escape(str(error))}", file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            print(f"{program}: interrupted", file=sys.stderr)
            return EXIT_INTERRUPTED

    return run


def positive_int(text: str) -> int:
    """Parses an option's whole number of at least 1 for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, but is '{text}'")
    return int(text)


def _escape(text: str) -> str:
    """Escapes control characters, because a name from a damaged file may hold a newline."""
    return "".join(character if character.isprintable() else repr(character)[1:-1] for character in text)
