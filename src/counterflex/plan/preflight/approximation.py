"""Corners that the controller rounds: whether its approximation distance fits between the points, and what it cuts off.

A controller that rounds a corner leaves one side and meets the other at the approximation distance d (KUKA ``C_DIS``
with ``$APO.CDIS``, ABB zones, ``CR`` of FANUC, ``leave`` and ``reach`` of Staubli), on a parabola
(:func:`counterflex.path.path_speed.build_track`). Two roundings may not meet: d is at most half of the shorter of both
blocks, and the controller shortens it to that (KUKA and ABB manuals). A shorter rounding is a slower one. At the corner
the parabola passes it by ``d/2 sin(turn/2)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, CheckLimits, Row
from counterflex.plan.preflight.spacing import BlockSpacing

SMOOTH_RAD: Final = math.radians(3.0)
"""Corners that turn by less are none, see :mod:`counterflex.path.path_speed`."""
BACK_RAD: Final = math.radians(120.0)
"""Turns back by more are exact stops in programs that counterflex writes."""
BLENDING_KEY: Final = "controller.blending_mm"
ERROR_KEY: Final = "limits.corner_error_um"
LEAST_M: Final = 1e-9
"""Shorter segments do not move."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Places where one block ends and the next one goes on without a standstill, in order."""

    point: Int  # (k,) row of the path at which the block ends
    after: Int  # (k,) row at which the first segment behind it ends
    turn_rad: Float  # (k,) angle between both, 0 straight on, pi back
    side_m: Float  # (k,) length of the shorter of both blocks
    given_m: Float  # (k,) approximation distance that is asked for
    exact: Bool  # (k,) the program stops there

    @property
    def sharp(self) -> Bool:
        """(k,) it turns by 3 deg or more."""
        out: Bool = self.turn_rad >= SMOOTH_RAD
        return out

    @property
    def distance_m(self) -> Float:
        """(k,) distance at which the rounding begins: what is asked for, at most half of the shorter block."""
        out: Float = np.where(self.exact, 0.0, np.minimum(self.given_m, 0.5 * self.side_m))
        return out

    @property
    def error_m(self) -> Float:
        """(k,) how far the rounding passes the corner, ``d/2 sin(turn/2)``."""
        out: Float = 0.5 * self.distance_m * np.sin(0.5 * self.turn_rad)
        return out


def corners_of(path: ToolPath, blocks: BlockSpacing, approximation_m: Float, blending_m: float) -> Corners:
    """Corners between the blocks of a path.

    Args:
        path: n rows.
        approximation_m: (motions,) distance that the program itself names at the end of each motion, 0 for an exact
            stop; NaN where it names none.
        blending_m: Distance where the program names none.

    Returns:
        The corners; at turns back by more than 120 deg without a distance of the program the tool stops.
    """
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    moving = np.flatnonzero(length > LEAST_M)
    long = blocks.length_m > LEAST_M
    number = np.flatnonzero(~blocks.stands[:-1] & long[:-1] & long[1:])
    place = np.searchsorted(moving, blocks.point[number], side="right") - 1
    before, after = moving[place], moving[place + 1]
    unit = step / np.maximum(length, LEAST_M)[:, None]
    half = 0.5 * np.linalg.norm(unit[after] - unit[before], axis=1)
    turn = 2.0 * np.arcsin(np.minimum(half, 1.0))
    own = approximation_m[path.motion[before]]
    return Corners(
        point=before,
        after=after,
        turn_rad=turn,
        side_m=np.minimum(blocks.length_m[number], blocks.length_m[number + 1]),
        given_m=np.where(np.isnan(own), blending_m, own),
        exact=(own == 0.0) | (np.isnan(own) & (turn > BACK_RAD)),
    )


def approximation_rows(corners: Corners, cutting: Bool, bounds: CheckLimits) -> list[Row]:
    """Return whether the approximation fits between the points, and what it leaves of the corners.

    Args:
        cutting: (n,) segments that count.
        bounds: Tolerance of a corner, and whether the approximation distance is given.
    """
    within = cutting[corners.point] & cutting[corners.after] & corners.sharp
    rounded = np.flatnonzero(within & ~corners.exact & (corners.given_m > 0.0))
    stops = int(np.sum(within)) - len(rounded)
    also = f"; {stops} exact stops" if stops else ""
    names = ("approximation to points", "corner error of the approximation")
    if len(rounded) == 0:
        return [Row(name, "ok", what=f"no rounded corners in the cut{also}") for name in names]
    assumed = f"; {BLENDING_KEY} {bounds.blending_m / MM:g} is assumed" if BLENDING_KEY in bounds.assumed else ""
    return [
        _distance_row(names[0], corners, rounded, also + assumed),
        _error_row(names[1], corners, rounded, bounds.corner_error_m, assumed),
    ]


def _distance_row(name: str, corners: Corners, rounded: Int, also: str) -> Row:
    half, given = 0.5 * corners.side_m[rounded], corners.given_m[rounded]
    worst = int(np.argmin(half / given))
    short = half < given * (1.0 - 1e-9)
    what = f"{int(short.sum())} of {len(rounded)} corners have a point closer than twice their distance"
    return Row(
        name,
        "warning" if np.any(short) else "ok",
        float(half[worst]),
        float(given[worst]),
        "m",
        int(corners.point[rounded[worst]]),
        (what if np.any(short) else f"{len(rounded)} corners") + also,
        advice="The controller shortens the rounding there and slows down: fewer points beside corners, or a smaller "
        "distance"
        if np.any(short)
        else "",
    )


def _error_row(name: str, corners: Corners, rounded: Int, largest_m: float | None, assumed: str) -> Row:
    error = corners.error_m[rounded]
    worst = int(np.argmax(error))
    row = rounded[worst]
    what = (
        f"corner of {math.degrees(corners.turn_rad[row]):.0f} deg, rounded from {corners.distance_m[row] / MM:.3g} mm "
        f"before it{assumed}"
    )
    value, point = float(error[worst]), int(corners.point[row])
    if largest_m is None:
        return Row(name, NOT_LOOKED_AT, value, None, "m", point, what, ERROR_KEY)
    over = value > largest_m
    return Row(
        name,
        "warning" if over else "ok",
        value,
        largest_m,
        "m",
        point,
        (f"{int(np.sum(error > largest_m))} of {len(rounded)} corners; " if over else "") + what,
        advice="A smaller approximation distance, or an arc of the part's radius in the corner" if over else "",
    )
