"""Drilling cycles of Sinumerik as the moves they stand for: CYCLE81, CYCLE82, CYCLE83.

Source: SINUMERIK 840D sl/840D, Programming Manual Cycles (PGZ, 11/2006), "Drilling, centering - CYCLE81", "Drilling,
counterboring - CYCLE82", "Deep-hole drilling - CYCLE83": parameters, sequence of motions, degression, limit distance.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM

NAMES: Final = ("CYCLE81", "CYCLE82", "CYCLE83")
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_MOST: Final = 10_000
_CHIP_M: Final = 1.0 * MM  # How far chip breaking goes back (VARI = 0)
_DEEPEST_PLAIN_M: Final = 30.0 * MM


@dataclass(frozen=True)
class Plunge:
    """One move of a cycle along its axis, or a dwell."""

    kind: str  # ``rapid``, ``feed`` or ``dwell``
    height_m: float = 0.0  # Target in the axes of the program
    share: float = 1.0  # Of the programmed feed
    time_s: float = 0.0  # Of a dwell; negative in revolutions


@dataclass(frozen=True)
class Cycle:
    """A drilling cycle with its heights, in the axes of the program, m."""

    name: str  # Which
    retract_m: float  # Height at the end (RTP)
    safe_m: float  # Height from which it feeds (RFP + SDIS)
    reference_m: float  # Surface (RFP)
    bottom_m: float  # Final depth
    first_m: float = 0.0  # First depth of CYCLE83
    degression_m: float = 0.0  # Amount by which strokes get shorter; negative: a factor; 0: none
    at_depth_s: float = 0.0  # Dwell at each depth
    outside_s: float = 0.0  # Dwell outside of the hole, of chip removal
    first_share: float = 1.0  # Of the feed, for the first stroke
    removal: bool = False  # CYCLE83 goes out of the hole after each stroke

    def moves(self) -> Iterator[Plunge]:
        """From any height at or above ``safe_m``."""
        yield Plunge("rapid", self.safe_m)
        depths = self._depths() if self.name == "CYCLE83" else [self.bottom_m]
        for number, depth in enumerate(depths):
            yield Plunge("feed", depth, self.first_share if number == 0 else 1.0)
            if self.at_depth_s != 0.0:
                yield Plunge("dwell", depth, time_s=self.at_depth_s)
            if number + 1 == len(depths):
                continue
            if self.removal:
                yield Plunge("rapid", self.safe_m)
                if self.outside_s != 0.0:
                    yield Plunge("dwell", self.safe_m, time_s=self.outside_s)
                yield Plunge("rapid", min(depth + self._limit_m(depth), self.safe_m))
            else:
                yield Plunge("feed", min(depth + _CHIP_M, self.safe_m))
        yield Plunge("rapid", self.retract_m)

    def _limit_m(self, depth: float) -> float:
        """Distance that the rapid back into the hole stays above the depth reached: 0.6 mm, of deep holes depth/50."""
        deep = self.reference_m - depth
        return 0.6 * MM if deep <= _DEEPEST_PLAIN_M else min(deep / 50.0, 7.0 * MM)

    def _depths(self) -> list[float]:
        """Depths of the strokes: shorter by the degression, then as long as it is, the last two of one length."""
        depth, stroke, out = self.first_m, self.reference_m - self.first_m, [self.first_m]
        while depth - self.bottom_m > 1e-9 and len(out) < _MOST:
            left = depth - self.bottom_m
            if self.degression_m > 0.0:
                stroke = max(self.degression_m, stroke - self.degression_m)
            elif self.degression_m < 0.0:
                stroke = max(-self.degression_m * stroke, 1e-4)
            if stroke >= left:
                stroke = left
            elif self.degression_m > 0.0 and left <= 2.0 * stroke:
                stroke = 0.5 * left
                out.append(depth - stroke)
                depth -= stroke
                stroke = left - stroke
            depth -= stroke
            out.append(depth)
        out[-1] = self.bottom_m if len(out) > 1 else out[-1]
        return out


def cycle_of(text: str, unit_m: float, fault: Callable[[str], ProgramError]) -> Cycle:
    """A cycle from its call.

    Args:
        text: ``CYCLE81(50,0,2,-10,)``.
        unit_m: Length of a unit.
        fault: Makes the error of a message.

    Raises:
        ProgramError: An argument is no number, is missing, or contradicts the others.
    """
    name, _, inside = text.strip().partition("(")
    name = name.strip().upper()
    values = _arguments(name, inside, fault)
    lengths = [None if value is None else value * unit_m for value in values]
    retract, reference, safety = lengths[0], lengths[1], abs(lengths[2] or 0.0)
    if retract is None or reference is None:
        raise fault(f"{name} without RTP and RFP")
    bottom = _depth(lengths[3:5], reference)
    if bottom is None or bottom >= reference or retract < reference + safety:
        raise fault(f"{name} needs a depth (DP or DPR) below RFP, and RTP at or above RFP + SDIS")
    about = Cycle(name, retract, reference + safety, reference, bottom)
    if name == "CYCLE81":
        return about
    if name == "CYCLE82":
        return replace(about, at_depth_s=values[5] or 0.0)
    return _deep(about, values, _depth(lengths[5:7], reference), unit_m, fault)


def _deep(
    about: Cycle, values: list[float | None], first: float | None, unit_m: float, fault: Callable[[str], ProgramError]
) -> Cycle:
    """CYCLE83, with its strokes."""
    if first is None or not about.bottom_m <= first < about.reference_m:
        raise fault("CYCLE83 needs a first depth (FDEP or FDPR) between RFP and the final one")
    degression, at_depth_s, outside_s = (value or 0.0 for value in values[7:10])
    share = 1.0 if values[10] is None else values[10]
    if not 0.0 < share <= 1.0 or degression <= -1.0 or values[12:18] != [None] * 6:
        raise fault("arguments of CYCLE83 behind VARI, FRF beyond 0 to 1, or DAM below -1 are not read")
    degression *= unit_m if degression > 0.0 else 1.0
    return replace(about, first_m=first, degression_m=degression, at_depth_s=at_depth_s, outside_s=outside_s,
                   first_share=share, removal=values[11] == 1.0)  # fmt: skip


def _arguments(name: str, inside: str, fault: Callable[[str], ProgramError]) -> list[float | None]:
    """Arguments of a call, 18 at least; None where one is left out."""
    parts = [part.strip() for part in inside.rstrip().removesuffix(")").split(",")]
    if not all(_NUMBER.fullmatch(part) for part in parts if part):
        raise fault(f"an argument of {name} is no plain number")
    return [float(part) if part else None for part in parts] + [None] * (18 - len(parts))


def _depth(given: list[float | None], surface_m: float) -> float | None:
    """Depth from a pair of arguments: absolute, or from the surface, which wins."""
    absolute, relative = given
    return absolute if relative is None else surface_m - abs(relative)
