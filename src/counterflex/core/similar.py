"""Compare names: one that stands twice, and names and files close to one that does not exist."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

_MOST_DIGITS: Final = 15


def told_apart(value: float, limit: float, digits: int = 2) -> tuple[str, str]:
    """Return value and limit as texts that differ where the numbers do.

    Returns:
        Both texts: ``("2", "1")``, ``("2.02", "2")``.
    """
    for count in range(digits, _MOST_DIGITS + 1):
        texts = f"{value:.{count}g}", f"{limit:.{count}g}"
        if float(texts[0]) != float(texts[1]):
            return texts
    return f"{value!r}", f"{limit!r}"


def with_interval(value: Mapping[str, Any] | float | None, digits: int = 1) -> str:
    """Return a figure with its interval in brackets; empty where there is none."""
    if value is None:
        return ""
    if not isinstance(value, Mapping):
        return f"{value:.{digits}f}"
    if value["low"] is None:
        return f"{value['value']:.{digits}f}"
    return f"{value['value']:.{digits}f} ({value['low']:.{digits}f} to {value['high']:.{digits}f})"


Name = TypeVar("Name", bound=Hashable)
_LEAST_LETTERS: Final = 3  # A shorter text is part of too many names


def twice(names: Sequence[Name]) -> Name | None:
    """Return the first name that stands there more than once, or None."""
    return next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None


def close_to(name: str, among: Iterable[str], count: int = 3) -> list[str]:
    """Names most like ``name``, best first; case, blanks and punctuation do not count. Empty when none is near.

    Names that contain it (``7075``) come first, then those that it resembles as a whole (``en-aw-7057-vdi22``), then
    those of which it resembles a word (``stainles``, ``staubli_m20``).
    """
    import difflib  # only where a name is wrong: commands that start quickly need it seldom

    by_letters: dict[str, str] = {}
    words: dict[str, list[str]] = {}
    for item in among:
        by_letters.setdefault(_letters(item), item)
        for word in re.split(r"[^a-z0-9]+", item.casefold()):
            words.setdefault(word, []).append(item)
    plain = _letters(name)
    match = []
    if len(plain) >= _LEAST_LETTERS:
        match += sorted((letters for letters in by_letters if plain in letters), key=lambda one: (len(one), one))
    match += difflib.get_close_matches(plain, list(by_letters), n=count)
    names = [by_letters[letters] for letters in match]
    for word in [] if names else [plain, *re.split(r"[^a-z0-9]+", name.casefold())]:
        near = difflib.get_close_matches(word, list(words), n=1, cutoff=0.75) if len(word) >= _LEAST_LETTERS else []
        names += [item for other in near for item in sorted(words[other])]
    return list(dict.fromkeys(names))[:count]


def did_you_mean(name: str, among: Iterable[str], count: int = 1) -> str | None:
    """Return the question for an error's hint, or None where no name is near."""
    close = close_to(name, among, count)
    return f"Did you mean {' or '.join(map(repr, close))}?" if close else None


def _letters(name: str) -> str:
    return "".join(re.findall(r"[^\W_]", name.casefold()))


def missing_file(path: Path) -> str:
    """Return what to do about a file that does not exist: the nearest name beside it, or the folder that is missing."""
    try:
        names = [item.name for item in path.parent.iterdir()]
    except OSError:
        return f"The folder {path.parent} does not exist"
    close = close_to(path.name, names, 1)
    return f"Did you mean {close[0]}?" if close else "Check the path"
