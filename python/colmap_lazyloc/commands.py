"""The commands of an installed package, which are those of the colmap program."""

import sys

from colmap_lazyloc.extension import core


def lazy_localizer() -> int:
    """Runs `colmap lazy_localizer` with the arguments of this process and returns its exit code."""
    return int(core.run_lazy_localizer(sys.argv))


def lazy_merger() -> int:
    """Runs `colmap lazy_merger` with the arguments of this process and returns its exit code."""
    return int(core.run_lazy_merger(sys.argv))


def lazy_epoch() -> int:
    """Runs `colmap lazy_epoch` with the arguments of this process and returns its exit code."""
    return int(core.run_lazy_epoch(sys.argv))


def lazy_indexer() -> int:
    """Runs `colmap lazy_indexer` with the arguments of this process and returns its exit code."""
    return int(core.run_lazy_indexer(sys.argv))
