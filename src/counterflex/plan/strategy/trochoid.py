"""A slot milled by a smaller tool in loops, so that its engagement never exceeds a wanted angle.

A slot of width W along a straight line is milled by a tool of radius r whose centre runs loops of radius
``rho = W / 2 - r`` about centres a step s apart. A loop is a half circle ahead, from one wall to the other, a step back
along the far wall, the half circle behind, in the slot, and two steps ahead along the near wall: both walls are left
without cusps. Turning clockwise seen from above (G2) mills up, the other way down.

On the half circle at the angle theta from the direction of the slot, the stock begins at the circle of radius W / 2
about the last centre. With ``q = |s + rho e(theta)|`` and ``theta_q`` its direction, the immersion from the point that
stays on the new wall to where the tool meets the stock is

    phi = theta_q - theta + acos((W^2 / 4 - q^2 - r^2) / (2 q r))

Its maximum over theta grows with s; the step is where it is the wanted angle. Towards the far wall phi falls to zero.

Source: derived here; arcs of engagement as in an inside corner, see ``examples/gallery/cutting/corner_engagement.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError

_THETA: Final = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 721)
_LEAST_LOOP: Final = 0.02
"""Least radius of the loops, of the tool's radius: below it there is no room to turn."""


@dataclass(frozen=True)
class TrochoidLoop:
    """Loops of a slot."""

    radius_m: float  # of the tool centre's circles, rho
    step_m: float  # from loop to loop, s
    engagement_rad: float  # largest immersion on the half circle ahead
    mean_rad: float  # its mean over that half circle


def immersions(width_m: float, tool_radius_m: float, step_m: float) -> Float:
    """Immersion along the half circle ahead, from the near wall to the far one.

    ``step_m``: from loop to loop, > 0.

    Returns:
        (721,) rad at angles from -90 to 90 deg from the direction of the slot.
    """
    rho, r = 0.5 * width_m - tool_radius_m, tool_radius_m
    x, y = step_m + rho * np.cos(_THETA), rho * np.sin(_THETA)
    q = np.hypot(x, y)
    cosine = (0.25 * width_m**2 - q**2 - r**2) / (2.0 * q * r)
    meets = np.arctan2(y, x) - _THETA + np.arccos(np.clip(cosine, -1.0, 1.0))
    out: Float = np.where(cosine >= 1.0, 0.0, np.clip(meets, 0.0, math.pi))
    return out


def loop_for(width_m: float, tool_radius_m: float, engagement_rad: float) -> TrochoidLoop:
    """Loops whose engagement reaches a wanted angle and no more.

    ``engagement_rad``: largest immersion, above 0, below 120 deg.

    Raises:
        InputError: The tool is as wide as the slot, or the angle is out of range.
    """
    as_positive("engagement_rad", engagement_rad)
    rho = 0.5 * width_m - as_positive("tool_radius_m", tool_radius_m)
    if rho < _LEAST_LOOP * tool_radius_m:
        raise InputError(
            "the tool is too wide for loops in this slot",
            value=f"{2e3 * tool_radius_m:g} mm",
            limit=f"below {1e3 * width_m / (1.0 + _LEAST_LOOP):.4g} mm",
            hint="Take a smaller tool, about 60 % of the width",
        )
    most = 2.0 * math.pi / 3.0
    if engagement_rad >= most:
        raise InputError(
            "the engagement of a trochoid is out of range",
            value=f"{math.degrees(engagement_rad):g} deg",
            limit="above 0, below 120 deg",
        )
    step = float(
        scipy.optimize.brentq(
            lambda one: float(immersions(width_m, tool_radius_m, one).max()) - engagement_rad,
            1e-7 * tool_radius_m,
            2.0 * tool_radius_m,
            xtol=1e-9,
        )
    )
    values = immersions(width_m, tool_radius_m, step)
    return TrochoidLoop(rho, step, float(values.max()), float(values.mean()))


@dataclass(frozen=True, eq=False)
class Piece:
    """A straight line or an arc about a centre; its end and centre in the plane, m."""

    end: Float  # (2,) m
    centre: Float | None = None  # (2,) m of an arc, else None


def pieces(start: Float, end: Float, loop: TrochoidLoop, *, up: bool) -> list[Piece]:
    """The way of the tool's centre that replaces a straight slot, from its start to its end.

    ``start``: (2,) m; ``end``: (2,) m; ``up``: turn clockwise (up-milling), not counter-clockwise.

    Returns:
        Pieces; the last ends at ``end``.
    """
    length = float(np.linalg.norm(end - start))
    x = (end - start) / length
    near = np.array([x[1], -x[0]]) * (-1.0 if up else 1.0) * loop.radius_m  # the loop turns from here to its opposite
    # Whole loops: a shorter step engages less, a longer one would pass the wanted angle.
    count = max(1, math.ceil(length / loop.step_m - 1e-9))
    step = length / count
    centres = [start + k * step * x for k in range(count + 1)]
    out = [Piece(centres[0] + near)]
    for k, c in enumerate(centres):
        back = centres[max(k - 1, 0)]
        out.append(Piece(c - near, c))
        if k:
            out.append(Piece(back - near))
        out.append(Piece(back + near, back))
        if k < count:
            out.append(Piece(centres[k + 1] + near))
    out.append(Piece(end))
    return out
