"""Names of users' files as text: what would steer a terminal, or hide or turn text round, is shown escaped."""

from __future__ import annotations

import re
from typing import Any, Final

_STEERS: Final = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
"""Control characters but tab and line feed, marks that set the direction of writing, surrogates."""


def printable(text: str) -> str:
    r"""Return a text in which control characters are shown, ``\x1b`` for the one that begins a terminal's command."""
    return _STEERS.sub(_shown, text)


def all_printable(value: Any) -> Any:
    """Return plain data (mappings, lists, numbers) with every text in it as :func:`printable` shows it."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {all_printable(key): all_printable(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [all_printable(part) for part in value]
    return value


def _shown(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
