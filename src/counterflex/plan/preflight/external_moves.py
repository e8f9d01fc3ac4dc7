"""External axes that move between operations: where part and floor are meanwhile, and where the tool stands then."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.external_axes import ExternalPlaces, moving
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import Setting
from counterflex.plan.preflight.collision import PartAlongPath
from counterflex.plan.preflight.process.moves import height_over
from counterflex.plan.preflight.row import Row

CHECK: Final = "external axes"
_REACH_M: Final = 10.0
"""Farthest point of a body from an axis that turns it: what is farther away is no part of a cell. A larger value costs
time only."""
_IN_M: Final = 1e-6


def moved_m(places: ExternalPlaces, place: Float) -> Float:
    """(n,) m, bound of the way that any point of part and floor has gone in the robot base from row 0 on.

    Args:
        place: (n,) along the path.
    """
    lever = np.array([_REACH_M if axis.turning else 1.0 for axis in places.axes])
    step = np.abs(np.diff(places.values_at(place), axis=0)) @ lever
    out: Float = np.concatenate([[0.0], np.cumsum(step)])[: len(place)]
    return out


def standing_along(path: ToolPath, setting: Setting) -> PartAlongPath:
    """Part and floor in the robot base along a path."""
    if setting.places is None:
        return PartAlongPath(setting.T_base_part)
    moved = moved_m(setting.places, path.place)
    return PartAlongPath(setting.Ts_base_part(path), setting.Ts_base_before(path), moved)


def external_row(path: ToolPath, setting: Setting, stock: HeightMap, cutter_of: Callable[[int], Cutter | None]) -> Row:
    """Return where the tool is lowest over the blank while an external axis moves.

    ``cutter_of``: gives the cutter of a tool number, None for one that the cell does not have.
    """
    if setting.places is None:
        return Row(CHECK, "ok", what="they stand in one place")
    places = setting.places
    beyond = places.beyond()
    if beyond is not None:
        number, k = beyond
        axis = places.axes[k]
        what = (
            f"E{axis.number} goes to {places.shown(number)[axis.number]:g} {axis.word}, "
            f"limits {axis.low / axis.unit:g} to {axis.high / axis.unit:g} {axis.word}"
        )
        at = int(np.argmax(path.place >= number))
        return Row(CHECK, "fail", point=at, what=what, advice="Choose places within the travel of the axis")
    rows = np.flatnonzero(moving(path))
    count = f"{len(places.values) - 1} moves between operations"
    if len(rows) == 0:
        return Row(CHECK, "ok", what=count)
    used = np.union1d(rows, np.maximum(rows - 1, 0))
    cutters = {int(n): cutter_of(int(n)) for n in np.unique(path.tool[used])}
    radius = {n: 0.0 if cutter is None else cutter.radius_m for n, cutter in cutters.items()}
    points, first = np.unique(np.round(path.p_part_tcp[used], 9), axis=0, return_index=True)
    height = [height_over(stock, p, radius[int(path.tool[used[k]])]) for p, k in zip(points, first, strict=True)]
    worst = int(np.argmin(height))
    over = height[worst]
    row = int(used[first[worst]])
    if over < -_IN_M:
        return Row(CHECK, "fail", over, 0.0, "m", row, "an external axis moves while the tool is in the blank",
                   advice="Retract above the blank before it moves")  # fmt: skip
    over = over if np.isfinite(over) else float(path.p_part_tcp[row, 2] - stock.z.max())
    return Row(CHECK, "ok", over, 0.0, "m", row, f"{count}, the tool over the blank")
