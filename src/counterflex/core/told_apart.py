"""Numbers as text: a value told from its limit, a figure with its interval."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

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
