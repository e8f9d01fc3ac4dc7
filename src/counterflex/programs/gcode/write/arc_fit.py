"""Arcs and helices through commanded points, in the coordinates of the arc's plane.

Plane coordinates are (u, v, w): the two axes of the plane and the one along which a helix rises; G17 is (x, y, z), G18
(z, x, y), G19 (y, z, x). Counter-clockwise about w is positive.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.programs import limits

PLANE_AXES: Final = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""Index of x, y, z for u, v, w by plane number."""


def fit_centre(points: Float, turn_rad: float) -> tuple[float, float]:
    """Centre of the circle through the first and the last point that fits the others best.

    Both ends are commanded exactly, so only the place on their bisector is free: with the middle m and the unit
    normal n of the chord, ``c = m + t n`` minimises ``sum (|p - c|^2 - |p_0 - c|^2)^2``, linear in t. Where the ends
    coincide (full turns) both coordinates are free under the condition that the circle passes the start.

    Args:
        points: (n, 3) m in plane coordinates, start first, n >= 2.
        turn_rad: Signed angle of the nominal arc; decides where fewer than two points lie between the ends.

    Returns:
        Centre (u, v) in m. It need not fit: check with :func:`arc_error`.
    """
    p = points[:, :2]
    start, end = p[0], p[-1]
    chord = end - start
    length = math.hypot(chord[0], chord[1])
    if length < 1e-9:
        d = p[1:-1] - start
        solution = np.linalg.lstsq(2.0 * d, np.sum(d * d, axis=1), rcond=None)[0]
        return float(start[0] + solution[0]), float(start[1] + solution[1])
    middle = 0.5 * (start + end)
    normal = np.array([-chord[1], chord[0]]) / length
    d = p[1:-1] - middle
    along = d @ normal
    weight = float(along @ along)
    if len(d) == 0 or weight < 1e-24:
        t = 0.5 * length / math.tan(0.5 * turn_rad) if math.sin(0.5 * turn_rad) != 0.0 else 0.0
    else:
        t = 0.5 * float(along @ (np.sum(d * d, axis=1) - 0.25 * length * length)) / weight
    return float(middle[0] + t * normal[0]), float(middle[1] + t * normal[1])


def radius_centre(start: Float, end: Float, radius_m: float, turn_sign: float) -> tuple[float, float] | None:
    """Centre of an arc given by its radius, as RS274/NGC defines it (negative radius: more than half a turn).

    Args:
        start: (>=2,) m, plane coordinates.
        end: (>=2,) m.
        radius_m: Signed radius.
        turn_sign: +1 counter-clockwise, -1 clockwise.

    Returns:
        Centre (u, v) in m, or None where no such circle exists.
    """
    du, dv = float(end[0] - start[0]), float(end[1] - start[1])
    chord = math.hypot(du, dv)
    square = radius_m * radius_m - 0.25 * chord * chord
    if chord == 0.0 or square < 0.0:
        return None
    t = math.copysign(math.sqrt(square), radius_m) * turn_sign / chord
    return float(start[0]) + 0.5 * du - t * dv, float(start[1]) + 0.5 * dv + t * du


def written_turn(start: Float, end: Float, centre: tuple[float, float], turn_sign: float, turns: int) -> float:
    """Signed angle that an interpreter turns for the written start, end and centre.

    Args:
        start: (>=2,) m, plane coordinates.
        end: (>=2,) m.
        centre: (u, v) m.
        turn_sign: +1 counter-clockwise (G3), -1 clockwise (G2).
        turns: Value of the P word, 1 when there is none.

    Returns:
        rad; a full turn when start and end coincide.
    """
    a = math.atan2(start[1] - centre[1], start[0] - centre[0])
    b = math.atan2(end[1] - centre[1], end[0] - centre[0])
    angle = (turn_sign * (b - a)) % (2.0 * math.pi)
    if math.hypot(end[0] - start[0], end[1] - start[1]) < 1e-10 or angle == 0.0:
        angle = 2.0 * math.pi
    return turn_sign * (angle + 2.0 * math.pi * (turns - 1))


def arc_points(start: Float, end: Float, centre: tuple[float, float], turn_rad: float, share: Float) -> Float:
    """Points of a written arc at given shares of its way (radius and height change linearly along it).

    Args:
        start: (3,) m, plane coordinates.
        end: (3,) m.
        centre: (u, v) m.
        turn_rad: Signed angle.
        share: (n,) 0 at the start, 1 at the end.

    Returns:
        (n, 3) m.
    """
    radius_0 = math.hypot(start[0] - centre[0], start[1] - centre[1])
    radius_1 = math.hypot(end[0] - centre[0], end[1] - centre[1])
    angle = math.atan2(start[1] - centre[1], start[0] - centre[0]) + turn_rad * share
    radius = radius_0 + (radius_1 - radius_0) * share
    out: Float = np.stack(
        [
            centre[0] + radius * np.cos(angle),
            centre[1] + radius * np.sin(angle),
            start[2] + (end[2] - start[2]) * share,
        ],
        axis=-1,
    )
    return out


def arc_error(points: Float, share: Float, centre: tuple[float, float], turn_rad: float) -> float:
    """Largest distance between commanded points and the written arc at the same share of the way.

    Args:
        points: (n, 3) m, plane coordinates; the first and last are the written start and end.
        share: (n,) share of the way, 0 to 1.
        centre: (u, v) m.
        turn_rad: Signed angle the interpreter turns.

    Returns:
        m.
    """
    gap = arc_points(points[0], points[-1], centre, turn_rad, share) - points
    return float(np.sqrt(np.max(np.sum(gap * gap, axis=1))))


def radii_agree(start: Float, end: Float, centre: tuple[float, float]) -> bool:
    """Return whether LinuxCNC accepts the radii at the start and at the end of an arc as one arc.

    It refuses a difference above 0.5 mm, and one above 0.005 mm that is also above 0.1 % of the radius.

    Args:
        start: (>=2,) m, plane coordinates.
        end: (>=2,) m.
        centre: (u, v) m.
    """
    radius_0 = math.hypot(start[0] - centre[0], start[1] - centre[1])
    radius_1 = math.hypot(end[0] - centre[0], end[1] - centre[1])
    gap = abs(radius_1 - radius_0)
    return gap <= limits.LINUXCNC_RADIUS_LARGEST_M and (
        gap <= limits.LINUXCNC_RADIUS_ABSOLUTE_M or gap <= limits.LINUXCNC_RADIUS_RELATIVE * radius_0
    )
