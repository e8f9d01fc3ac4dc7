"""Geometry of G2 and G3: centre, sense and angle from I J K or R, with LinuxCNC's tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from counterflex.core.units import INCH, MM

# First and second axis of each plane; the normal completes a right-handed frame. G18 is Z then X, normal +Y.
PLANE_AXES: Final[dict[int, tuple[int, int, int]]] = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
_FULL_CIRCLE_RAD: Final = 1e-6
# Centre format: radii may differ by 0.1 % or by an absolute bound, whichever is more, and never by 100 times that bound
# (20 um, or 2 mil, in each of two directions). Radius format: R may fall short of half the chord by a rounding.
_RELATIVE: Final = 1e-3
_ABSOLUTE_MM: Final = 0.02 * math.sqrt(2.0)
_ABSOLUTE_INCH: Final = 0.002 * math.sqrt(2.0)
_RADIUS_MM: Final = 0.00127
_RADIUS_INCH: Final = 0.00005


class ArcFault(ValueError):
    """An arc that does not exist; ``value`` says which number shows it.

    Args:
        value: The numbers that show it.
        letter: Word at fault, or empty.
    """

    def __init__(self, what: str, value: str, letter: str = "") -> None:
        super().__init__(what)
        self.what = what
        self.value = value
        self.letter = letter


@dataclass(frozen=True)
class Arc:
    """An arc in its plane."""

    first: float  # Centre along the plane's first axis, m
    second: float  # Centre along the second, m
    turn_rad: float  # Signed angle about the plane's normal, whole turns included
    radius_m: float  # Mean of start and end radius

    @classmethod
    def by_centre(
        cls,
        start: tuple[float, float],
        end: tuple[float, float],
        centre: tuple[float, float],
        clockwise: bool,
        turns: int,
        unit_m: float,
    ) -> Arc:
        """Arc about a given centre.

        Args:
            start: In the plane's axes, m.
            end: In the plane's axes, m.
            centre: In the plane's axes, m.
            clockwise: G2.
            turns: P word, >= 1.
            unit_m: Program unit, which chooses the tolerance.

        Raises:
            ArcFault: The radius is zero, or differs between start and end by more than the tolerance.

        Source: LinuxCNC, "G2, G3 Arc Move", center format.
        """
        spoke = (start[0] - centre[0], start[1] - centre[1])
        end_spoke = (end[0] - centre[0], end[1] - centre[1])
        radius, end_radius = math.hypot(*spoke), math.hypot(*end_spoke)
        if min(radius, end_radius) < 1e-9:
            raise ArcFault("the arc has no radius", f"{radius / unit_m:.6g} and {end_radius / unit_m:.6g}")
        allowed = centre_tolerance(unit_m)
        off = abs(radius - end_radius)
        if off > 100.0 * allowed or (off > allowed and off > _RELATIVE * max(radius, end_radius)):
            raise ArcFault(
                "the arc's radius at its end differs from that at its start",
                f"{radius / unit_m:.6g} at the start and {end_radius / unit_m:.6g} at the end",
            )
        return cls(centre[0], centre[1], turn_angle(spoke, end_spoke, clockwise, turns), 0.5 * (radius + end_radius))

    @classmethod
    def by_radius(
        cls,
        start: tuple[float, float],
        end: tuple[float, float],
        radius: float,
        clockwise: bool,
        turns: int,
        unit_m: float,
    ) -> Arc:
        """Arc of a given radius; negative radius for the longer way round.

        Args:
            start: In the plane's axes, m.
            end: In the plane's axes, m.
            radius: R word, m.
            clockwise: G2.
            turns: P word, >= 1.
            unit_m: Program unit, which chooses the tolerance.

        Raises:
            ArcFault: R is zero, start and end are one point, or R is too small to reach the end.

        Source: LinuxCNC, "G2, G3 Arc Move", radius format.
        """
        along = (end[0] - start[0], end[1] - start[1])
        chord = math.hypot(*along)
        size = abs(radius)
        if size < 1e-9:
            raise ArcFault("the arc's R is zero", f"R{radius / unit_m:.6g}", "R")
        if chord < 1e-9:
            raise ArcFault(
                "an arc with R must end elsewhere than it starts", f"R{radius / unit_m:.6g} and the same point", "R"
            )
        half = 0.5 * chord
        if half - size > radius_tolerance(unit_m):
            raise ArcFault(
                "the arc's R is too small to reach the end point",
                f"R{radius / unit_m:.6g} for a chord of {chord / unit_m:.6g}",
                "R",
            )
        offset = math.sqrt(max(size * size - half * half, 0.0))
        side = -1.0 if clockwise == (radius > 0.0) else 1.0
        centre = (
            0.5 * (start[0] + end[0]) - side * offset * along[1] / chord,
            0.5 * (start[1] + end[1]) + side * offset * along[0] / chord,
        )
        spoke = (start[0] - centre[0], start[1] - centre[1])
        end_spoke = (end[0] - centre[0], end[1] - centre[1])
        return cls(centre[0], centre[1], turn_angle(spoke, end_spoke, clockwise, turns), math.hypot(*spoke))


def turn_angle(start: tuple[float, float], end: tuple[float, float], clockwise: bool, turns: int) -> float:
    """Signed angle from one spoke to another; equal directions are a full circle.

    Args:
        start: Vector from centre to start in the plane's axes, m.
        end: Vector from centre to end, m.
        clockwise: G2.
        turns: P word: passes through the end point, >= 1.

    Returns:
        rad, negative for clockwise, magnitude above 2 pi (turns - 1) and at most 2 pi turns.
    """
    cross = start[0] * end[1] - start[1] * end[0]
    dot = start[0] * end[0] + start[1] * end[1]
    angle = math.atan2(cross, dot)
    if clockwise:
        angle = -angle
    if angle <= _FULL_CIRCLE_RAD:
        angle += 2.0 * math.pi
    angle += 2.0 * math.pi * (turns - 1)
    return -angle if clockwise else angle


def centre_tolerance(unit_m: float) -> float:
    """Difference of start and end radius that is always allowed, m, for the program's unit."""
    return _ABSOLUTE_INCH * INCH if unit_m == INCH else _ABSOLUTE_MM * MM


def radius_tolerance(unit_m: float) -> float:
    """Largest shortfall of R against half the chord, m, for the program's unit."""
    return _RADIUS_INCH * INCH if unit_m == INCH else _RADIUS_MM * MM
