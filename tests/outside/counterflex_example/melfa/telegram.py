"""Lines of text that a program on the controller exchanges with the loop: mm, deg, a counter in ms.

``R counter enabled x y z a b c j1 ... j6`` is the commanded pose in the part frame and the axes without correction;
``C counter x y z rx ry rz stop`` is the correction in part axes, a rotation vector.
"""

from __future__ import annotations

import math
from typing import Final

LARGEST: Final = 512
_AHEAD: Final = 2**53
"""Counters above are none: a number of this size is not whole any more."""


def line(word: str, counter: int, numbers: list[float]) -> bytes:
    """A telegram."""
    return " ".join([word, str(counter), *(f"{value:.9f}" for value in numbers)]).encode("ascii")


def read(word: str, data: bytes, count: int) -> tuple[int, list[float]] | None:
    """Counter and numbers of a telegram; None where it is none."""
    words = data.split(b" ")
    if len(words) != count + 2 or words[0] != word.encode("ascii") or not words[1].isdigit() or len(words[1]) > 16:
        return None
    try:
        numbers = [float(one) for one in words[2:]]
    except ValueError:
        return None
    counter = int(words[1])
    return (counter, numbers) if counter < _AHEAD and all(map(math.isfinite, numbers)) else None
