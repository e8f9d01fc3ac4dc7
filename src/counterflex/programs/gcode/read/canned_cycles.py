"""Canned drilling and boring cycles as the moves they stand for.

Source: LinuxCNC, "Canned Cycles": before the first hole of a series a rapid up to R, then per hole a rapid in the
plane, a rapid to R, the cycle, and retraction to R (G99) or to the higher of R and the series' first height (G98).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.core.units import INCH

# How far G73 and G83 stay off the chips.
_CLEARANCE_M: Final = 0.010 * INCH
# A hole of more pecks than this is a mistake in Q.
MOST_PECKS: Final = 100_000


@dataclass(frozen=True)
class Step:
    """One move of a cycle along its axis, or a dwell.

    Attributes:
        kind: ``rapid``, ``feed`` or ``dwell``.
        height: Target along the cycle's axis, m; of a dwell the height it happens at.
        dwell_s: Of a dwell.
        spindle: The spindle runs (G86 stops it for the way out).
    """

    kind: str
    height: float
    dwell_s: float = 0.0
    spindle: bool = True


def hole(code: int, r: float, bottom: float, clear: float, peck: float, dwell_s: float) -> Iterator[Step]:
    """Yield the moves of one hole, from the R height to the clear height.

    Args:
        code: Tenths of the G code: 730, 810, 820, 830, 850, 860 or 890.
        r: R height, m.
        bottom: Bottom of the hole, m, at most ``r``.
        clear: Height to retract to, m.
        peck: Q, m, > 0 for G73 and G83.
        dwell_s: P, s.
    """
    if code in (730, 830):
        depth = r - peck
        while depth > bottom + 1e-12:
            yield Step("feed", depth)
            if code == 730:
                yield Step("rapid", depth + _CLEARANCE_M)
            else:
                yield Step("rapid", r)
                yield Step("rapid", depth + _CLEARANCE_M)
            depth -= peck
    yield Step("feed", bottom)
    if code in (820, 860, 890):
        yield Step("dwell", bottom, dwell_s)
    if code == 850:
        yield Step("feed", r)
        if clear > r:
            yield Step("rapid", clear)
    elif code == 890:
        yield Step("feed", clear)
    else:
        yield Step("rapid", clear, spindle=code != 860)
