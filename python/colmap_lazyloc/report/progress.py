"""Shows how far a long step is."""

from collections.abc import Iterable


def progress(items: Iterable, text: str) -> Iterable:
    """Returns the items, with a bar on a terminal if tqdm is installed."""
    try:
        from tqdm import tqdm
    except ImportError:
        return items
    return tqdm(items, desc=text, disable=None, leave=False)
