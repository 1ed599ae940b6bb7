"""Renders the demo scene: see scene.py."""

import sys
from collections.abc import Sequence

from colmap_lazyloc.errors import command


@command(name="lazyloc demo", extra="demo")
def main(arguments: Sequence[str] | None = None) -> int:
    # Import here, so that a missing package is one line.
    from colmap_lazyloc.demo import scene

    return int(scene.main(arguments))


if __name__ == "__main__":
    sys.exit(main())
