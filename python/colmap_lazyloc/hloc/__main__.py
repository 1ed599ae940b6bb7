"""Runs `localize_lazyloc` as `python -m colmap_lazyloc.hloc`."""

import sys
from collections.abc import Sequence

from colmap_lazyloc.errors import command


@command(extra="hloc")
def main(arguments: Sequence[str] | None = None) -> int:
    # Import here, so that a missing package is one line.
    from colmap_lazyloc.hloc.localize_lazyloc import command_line

    return command_line(arguments)


if __name__ == "__main__":
    sys.exit(main())
