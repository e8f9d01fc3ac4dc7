"""Numbers of a message with as many digits as it takes to tell a value from its limit."""

from __future__ import annotations

from typing import Final

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
