"""One tool around `colmap lazy_localizer`: `lazyloc COMMAND`, or `python -m colmap_lazyloc COMMAND`."""

import importlib
import sys
from collections.abc import Sequence

import colmap_lazyloc
from colmap_lazyloc.errors import InputError, command, nearest
from colmap_lazyloc.extras import missing_package

# The module of each command, and what it does. Modules are imported when they are needed, because they need other
# packages and take time to load.
COMMANDS = {
    "run": ("project.__main__", "find where new photos or video frames were taken, and write a report"),
    "import": ("import_poses", "convert camera poses of another program to a COLMAP model"),
    "export": ("export_poses", "write the results in the format of another program"),
    "check": ("agreement.__main__", "check whether camera poses fit the feature matches in a database"),
    "control_points": ("control_points", "compare poses with surveyed points that are marked in photos"),
    "changes": ("changes.__main__", "find what has moved, vanished or is new between two epochs"),
    "report": ("report.__main__", "write an HTML page that shows the results of a run"),
    "evaluate": ("evaluate", "compute pose errors from known true poses"),
    "retrieve": ("retrieval.__main__", "find similar database images by global descriptors"),
    "cluster": ("cluster.__main__", "localize many queries on a Dask cluster"),
    "serve": ("serve.__main__", "run an HTTP service that localizes photos"),
    "demo": ("demo.__main__", "render example photos"),
    "doctor": ("doctor", "show what is installed and what is missing"),
    "completion": ("completion", "print a script that completes commands and options in bash and zsh"),
}


def help_text() -> str:
    lines = [f"  {name:<14} {text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(
        [
            "usage: lazyloc COMMAND [options]",
            "",
            "Finds out where photos were taken, from photos with known poses.",
            "",
            *lines,
            "",
            "lazyloc COMMAND --help lists the options of a command, lazyloc --version the version.",
            "Localization itself is colmap lazy_localizer.",
        ]
    )


@command(name="lazyloc")
def main(arguments: Sequence[str] | None = None) -> int:
    words = sys.argv[1:] if arguments is None else list(arguments)
    name, rest = (words[0], words[1:]) if words else ("--help", [])
    if name == "help" and rest:
        name, rest = rest[0], ["--help"]
    if name in ("-h", "--help", "help"):
        print(help_text())
        return 0
    if name == "--version":
        print(f"lazyloc {colmap_lazyloc.__version__}")
        return 0
    if name not in COMMANDS:
        raise InputError(f"unknown command '{name}'{nearest(name, COMMANDS) or ' (lazyloc --help)'}")
    try:
        module = importlib.import_module(f"colmap_lazyloc.{COMMANDS[name][0]}")
    except ImportError as error:
        message = missing_package(error, preferred=name)
        if message is None:
            raise
        raise InputError(message) from error
    return int(module.main(rest))


if __name__ == "__main__":
    sys.exit(main())
