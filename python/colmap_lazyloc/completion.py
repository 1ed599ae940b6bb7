"""Prints a script that completes the commands and options of lazyloc and colmap in bash and zsh.

    eval "$(lazyloc completion)"

Put this line into ~/.bashrc or ~/.zshrc.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from colmap_lazyloc.errors import Parser, command


@command(name="lazyloc completion")
def main(arguments: Sequence[str] | None = None) -> None:
    formatter = argparse.RawDescriptionHelpFormatter
    Parser(prog="lazyloc completion", description=__doc__, formatter_class=formatter).parse_args(arguments)
    print(pathlib.Path(__file__).with_suffix(".sh").read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    sys.exit(main())
