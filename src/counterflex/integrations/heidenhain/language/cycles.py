"""Drilling cycles of Klartext as the moves they stand for: 200 and 201.

Source: HEIDENHAIN TNC 640 (34059x-05), User's Manual Cycle Programming, "DRILLING (Cycle 200)", "REAMING (Cycle 201)":
parameters and sequence of motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError

FNumber = float
"""Number behind F: mm/min, 1/10 inch/min, or mm per revolution."""
DRILLING: Final = {200: "DRILLING", 201: "REAMING"}
_RAPID: Final = 99_999.0
_MOST: Final = 10_000
_LONGEST_S: Final = 3600.0
NEEDED: Final = {
    200: ("Q200", "Q201", "Q206", "Q202", "Q210", "Q203", "Q204", "Q211"),
    201: ("Q200", "Q201", "Q206", "Q211", "Q208", "Q203", "Q204"),
}


@dataclass(frozen=True)
class DrillPlunge:
    """One move along the tool axis."""

    kind: str  # ``rapid``, ``feed`` or ``dwell``
    height_m: float = 0.0  # Target in programmed axes
    value: float = 0.0  # F of a feed, seconds of a dwell

    @classmethod
    def fed(cls, height_m: float, feed: float) -> DrillPlunge:
        """Plunge at the feed of the cycle."""
        return cls("rapid", height_m) if feed >= _RAPID else cls("feed", height_m, feed)


@dataclass(frozen=True)
class Drilling:
    """A drilling cycle with its heights in programmed axes, m."""

    number: int  # 200 or 201
    surface_m: float  # Q203
    clear_m: float  # Height from which it feeds (Q203 + Q200)
    retract_m: float  # Height at the end: 2nd set-up clearance where that is higher
    bottom_m: float  # Q203 + Q201
    stroke_m: float  # Q202
    feed: float  # Q206
    second_feed: FNumber  # Q208 of cycle 201; 0: as ``feed``
    above_s: float  # Q210
    bottom_s: float  # Q211

    def moves(self) -> Iterator[DrillPlunge]:
        """Yield the moves from any height; none where the depth is zero."""
        if self.bottom_m == self.surface_m:
            return
        yield DrillPlunge("rapid", self.clear_m)
        depth, clearance = self.surface_m, self.clear_m - self.surface_m
        while True:
            depth = max(depth - self.stroke_m, self.bottom_m)
            yield DrillPlunge.fed(depth, self.feed)
            if depth <= self.bottom_m:
                break
            yield DrillPlunge("rapid", self.clear_m)
            if self.above_s > 0.0:
                yield DrillPlunge("dwell", self.clear_m, self.above_s)
            yield DrillPlunge("rapid", min(depth + clearance, self.clear_m))
        if self.bottom_s > 0.0:
            yield DrillPlunge("dwell", depth, self.bottom_s)
        if self.number == 201:
            yield DrillPlunge.fed(self.clear_m, self.second_feed or self.feed)
        yield DrillPlunge("rapid", self.retract_m)


def drilling(
    number: int, q: dict[str, float], unit_m: float, fault: Callable[[str, str, str], ProgramError]
) -> Drilling:
    """Return a drilling cycle from its parameters.

    Args:
        number: 200 or 201.
        q: Parameters by name.
        unit_m: Length of a unit.
        fault: Makes the error of a message, a parameter and a hint.

    Raises:
        ProgramError: One is missing or out of range, or the control decides what it means.
    """
    missing = next((name for name in NEEDED[number] if name not in q), None)
    if missing is not None:
        raise fault(f"cycle {number} without {missing}", "", f"It needs {' '.join(NEEDED[number])}")
    if q.get("Q395", 0.0) != 0.0:
        raise fault("a depth that refers to the diameter needs the tip angle of the tool table", "Q395", "Q395=0")
    if q["Q201"] > 0.0:
        raise fault("a positive depth: a machine parameter decides whether the control refuses it", "Q201",
                    "Give the depth a negative sign")  # fmt: skip
    if min(q["Q200"], q["Q204"]) < 0.0 or not 0.0 < q["Q206"] <= 1e6 or not 0.0 <= q.get("Q208", 0.0) <= 1e6:
        raise fault("a clearance or feed of the cycle is out of range", "", "Q200, Q204 >= 0, Q206 > 0")
    depth = -q["Q201"]
    stroke = q.get("Q202", 0.0) if number == 200 else depth
    if depth > 0.0 and (stroke <= 0.0 or depth / stroke > _MOST):
        raise fault("the plunging depth of the cycle is out of range", "Q202", "Above zero, at most 10000 strokes")
    above, bottom = _dwells(q, fault)
    if stroke < depth and bottom > 0.0:
        raise fault("whether Q211 acts at every plunging depth or at the bottom only depends on the software of the "
                    "control", "Q211", "Q211=0, or Q202 as deep as the hole")  # fmt: skip
    surface = q["Q203"] * unit_m
    return Drilling(
        number, surface, surface + q["Q200"] * unit_m, surface + max(q["Q200"], q["Q204"]) * unit_m,
        surface - depth * unit_m, stroke * unit_m, q["Q206"], q.get("Q208", 0.0), above, bottom,
    )  # fmt: skip


def _dwells(q: dict[str, float], fault: Callable[[str, str, str], ProgramError]) -> tuple[float, float]:
    """Dwells above the hole and at its bottom, s."""
    above, bottom = q.get("Q210", 0.0), q["Q211"]
    if not 0.0 <= min(above, bottom) <= max(above, bottom) <= _LONGEST_S:
        raise fault("a dwell of the cycle is out of range", "Q211", "0 to 3600 s")
    return above, bottom
