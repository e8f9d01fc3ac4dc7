"""Keys of an operator's page: which action a key asks for, on any keyboard layout, with Caps Lock on or off."""

from __future__ import annotations

from typing import Final, Literal

Action = Literal["stop", "reset", "arm"]
IGNORED_IN: Final = ("input", "textarea")
"""Elements that take text: a key pressed there is text. A button that has the focus takes no key away."""
_LETTERS: Final[dict[str, Action]] = {"s": "stop", "r": "reset", "a": "arm"}
_PLACES: Final[dict[str, Action]] = {"KeyS": "stop", "KeyR": "reset", "KeyA": "arm"}


def action_of(name: str, code: str, *, shortcut: bool = False) -> Action | None:
    """What a key asks for.

    Escape, the letter S and the place of S on a keyboard of Latin letters all ramp out: of several readings of a key
    the one that stops is taken. The others go by the letter that is written on the key, and by the place where the
    layout has no Latin letters.

    Args:
        name: What the key writes, as the browser says it: ``s``, ``S``, ``Escape``.
        code: Where the key is: ``KeyS``, ``Escape``.
        shortcut: It is pressed together with Ctrl, Alt or Meta, which browsers have meanings for: only a stop counts.
    """
    letter = name.lower()
    if letter == "escape" or code == "Escape" or "stop" in (_LETTERS.get(letter), _PLACES.get(code)):
        return "stop"
    if shortcut:
        return None
    return _LETTERS.get(letter) if letter.isascii() else _PLACES.get(code)
