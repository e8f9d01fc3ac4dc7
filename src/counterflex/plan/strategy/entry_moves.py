"""Moves that begin and end a cut softly: arcs tangent to the path beside a wall, a zig-zag ramp into a slot.

An arc of radius r that joins the path with its direction comes from the free side: at the angle a before it joins, the
tool is ``r (1 - cos a)`` off the wall, so the width of cut and with it the force grow from nothing, and the path has no
corner at which the robot stops. A ramp goes back and down along the path that is cut next, pass after pass, and
leaves a slope over the length ``depth / tan(slope)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Arc:
    """An arc in a level plane."""

    start: Float  # (2,) m
    end: Float  # (2,) m
    centre: Float  # (2,) m
    left: bool  # it turns left (G3)


def arc_in(point: Float, tangent: Float, free: Float, radius_m: float, angle_rad: float) -> Arc:
    """The arc that ends at a point in a direction and comes from the free side.

    Args:
        point: (2,) m, where the cut begins.
        tangent: (2,) unit, direction of the cut there.
        free: (2,) unit, square to it, away from the wall.
        radius_m: Of the arc, > 0.
        angle_rad: That it turns, in (0, pi].

    Raises:
        InputError: Radius or angle is out of range.
    """
    centre, left = _centre(point, tangent, free, radius_m, angle_rad)
    start = centre + _turned(point - centre, -angle_rad if left else angle_rad)
    return Arc(start, np.array(point), centre, left)


def arc_out(point: Float, tangent: Float, free: Float, radius_m: float, angle_rad: float) -> Arc:
    """The arc that begins at a point in a direction and leaves to the free side; arguments as :func:`arc_in`."""
    centre, left = _centre(point, tangent, free, radius_m, angle_rad)
    end = centre + _turned(point - centre, angle_rad if left else -angle_rad)
    return Arc(np.array(point), end, centre, left)


def ramp(start: Float, end: Float, top_m: float, slope_rad: float, step_m: float) -> Float:
    """Passes back and down along a level line, each from the surface to its start and a step deeper there.

    They leave a slope that falls towards the start, on which the cut that follows is loaded gradually. A zig-zag whose
    passes end below each other leaves an upright front instead, as round as the tool, which it meets all at once.

    Args:
        start: (3,) m, where the level line begins.
        end: (3,) m, where it ends.
        top_m: Height at which the ramp begins, above the line.
        slope_rad: Largest slope, in (0, pi / 4]; steeper where the line is too short for it.
        step_m: Each pass takes at most so much, > 0.

    Returns:
        (2 k, 3) m, the turning points after ``start`` at ``top_m``; the last is ``start``.

    Raises:
        InputError: A value is out of range.
    """
    depth, way = top_m - float(start[2]), end - start
    length = float(np.linalg.norm(way))
    if not (0.0 < slope_rad <= 0.25 * math.pi):
        raise InputError("slope of a ramp is out of range", value=slope_rad, limit="> 0, at most pi / 4")
    if not (step_m > 0.0 and length > 0.0 and depth > 0.0):
        raise InputError("a ramp needs depth, length and step above 0", value=(depth, length, step_m))
    far = start + way * min(1.0, depth / math.tan(slope_rad) / length)
    passes = max(1, math.ceil(depth / step_m - 1e-9))
    points = np.array([point for _ in range(passes) for point in (far, start)])
    points[::2, 2] = top_m
    points[1::2, 2] = top_m - depth * np.arange(1, passes + 1) / passes
    return points


def _centre(point: Float, tangent: Float, free: Float, radius_m: float, angle_rad: float) -> tuple[Float, bool]:
    if not (math.isfinite(radius_m) and radius_m > 0.0):
        raise InputError("radius of an arc is out of range", value=radius_m, limit="> 0 m")
    if not (0.0 < angle_rad <= math.pi):
        raise InputError("angle of an arc is out of range", value=angle_rad, limit="> 0, at most pi")
    left = float(tangent[0] * free[1] - tangent[1] * free[0]) > 0.0
    return point + radius_m * free, left


def _turned(v: Float, angle_rad: float) -> Float:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])
