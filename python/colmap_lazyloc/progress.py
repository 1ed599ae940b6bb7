"""Shows how far a long step is."""

import sys
from collections.abc import Iterable
from typing import Any, TypeVar

Item = TypeVar("Item")


def terminal_bar() -> Any:
    """Returns the class tqdm, or None unless it is installed and there is a terminal.

    Elsewhere not even a hidden bar is made, because an interrupt while it is made leaves a traceback.
    """
    if not sys.stderr.isatty():
        return None
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    return tqdm


def progress(items: Iterable[Item], text: str, total: int | None = None) -> Iterable[Item]:
    """Returns the items, with a bar on a terminal if tqdm is installed. `total`: their number, by default their length
    if they have one."""
    bar = terminal_bar()
    shown: Iterable[Item] = items if bar is None else bar(items, desc=text, total=total, leave=False)
    return shown
