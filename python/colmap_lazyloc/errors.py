"""Errors in the input, and how a command reports them."""

import argparse
import functools
import os
import sys

EXIT_INTERRUPTED = 130


class InputError(ValueError):
    """Raised for a file or an option that cannot be used; the message is one line that names it."""


def command(main):
    """Turns `main(arguments)`, which may return an exit code, into a command.

    If an argument or the input is bad, or a file cannot be read or written, the command prints what is wrong and ends
    with exit code 1; after Ctrl-C with exit code 130. It is no error if the reader of the output has seen enough.
    """
    # Take the name from the specification, because `python -m` names the module __main__.
    program = sys.modules[main.__module__].__spec__.name.removesuffix(".__main__")

    @functools.wraps(main)
    def run(arguments=None) -> int:
        try:
            try:
                exit_code = main(arguments) or 0
            except SystemExit as end:
                exit_code = 1 if end.code == 2 else end.code  # argparse ends with 2 if an argument is bad
            sys.stdout.flush()
            return exit_code
        except BrokenPipeError:
            # Drop the rest of the output, because Python would try to write it at its end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
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
