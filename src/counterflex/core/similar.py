"""What the user may have meant: names and files close to one that does not exist."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


def close_to(name: str, among: Iterable[str], count: int = 3) -> list[str]:
    """Names most like ``name``, best first; upper and lower case count as the same. Empty when none is near."""
    import difflib  # only where a name is wrong: commands that start quickly need it seldom

    by_folded: dict[str, str] = {}
    for item in among:
        by_folded.setdefault(item.casefold(), item)
    return [by_folded[key] for key in difflib.get_close_matches(name.casefold(), list(by_folded), n=count)]


def missing_file(path: Path) -> str:
    """What to do about a file that does not exist: the nearest name beside it, or the folder that is missing."""
    try:
        names = [item.name for item in path.parent.iterdir()]
    except OSError:
        return f"The folder {path.parent} does not exist"
    close = close_to(path.name, names, 1)
    return f"Did you mean {close[0]}?" if close else "Check the path"
