"""Shows how far a long step is."""

import sys
from collections.abc import Iterable
from typing import TypeVar

Item = TypeVar("Item")


def progress(items: Iterable[Item], text: str) -> Iterable[Item]:
    """Returns the items, with a bar on a terminal if tqdm is installed."""
    if not sys.stderr.isatty():
        return items
    try:
        from tqdm import tqdm
    except ImportError:
        return items
    bar: Iterable[Item] = tqdm(items, desc=text, leave=False)
    return bar
