"""Runs `localize_lazyloc` as `python -m colmap_lazyloc.hloc`."""

import sys

from colmap_lazyloc.hloc.localize_lazyloc import command_line

if __name__ == "__main__":
    sys.exit(command_line())
