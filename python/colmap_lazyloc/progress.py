"""Shows how far a long step is."""

from collections.abc import Iterable
from typing import TypeVar

Item = TypeVar("Item")


def progress(items: Iterable[Item], text: str) -> Iterable[Item]:
    """Returns the items, with a bar on a terminal if tqdm is installed."""
    try:
        from tqdm import tqdm
    except ImportError:
        return items
    bar: Iterable[Item] = tqdm(items, desc=text, disable=None, leave=False)
    return bar
