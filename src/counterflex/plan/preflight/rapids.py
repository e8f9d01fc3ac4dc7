"""Collisions of the tool with the stock: rapids through material, cuts deeper than its flutes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.preflight.row import Row
from counterflex.plan.undisturbed_cut import least_depth

STEP_M: Final = 5.0 * MM
"""Longest step of a rapid that is looked at."""
DEPTH_SHARE: Final = 0.05
"""By that much the depth from a volume on a grid may be off."""
WIDE_GRAINS: Final = 3.0
"""Columns of the stock that a cut is at least wide to have an engaged depth of its own."""
LEAST_M3: Final = 1e-2 * MM**3
"""Less is the grain of the stock."""


def rapid_row(path: ToolPath, volume_m3: Float) -> Row:
    """The rapid motion that removes most material.

    Args:
        path: n rows.
        volume_m3: (n,) removed on the way to each row, what was cut before it left out.
    """
    removed = np.where(path.kind == RAPID, volume_m3, 0.0)
    by_motion = np.bincount(path.motion, weights=removed, minlength=int(path.motion.max(initial=0)) + 1)
    cutting = np.flatnonzero(by_motion > LEAST_M3)
    if len(cutting) == 0:
        return Row("rapids into the stock", "ok", 0.0, 0.0, "m3")
    worst = int(np.argmax(by_motion))
    rows = np.flatnonzero((path.motion == worst) & (path.kind == RAPID))
    first = int(rows[np.argmax(volume_m3[rows] > 0.0)])
    down = path.p_part_tcp[rows[-1]] - path.p_part_tcp[max(0, rows[0] - 1)]
    plunges = -down[2] > 0.99 * float(np.linalg.norm(down))
    return Row(
        "rapids into the stock",
        "fail",
        float(by_motion[worst]),
        0.0,
        "m3",
        first,
        f"{len(cutting)} rapids; the worst {'plunges straight down' if plunges else 'moves through it'}",
        advice="Rapid to a plane above the stock and go down at feed; check the blank in [part.stock]",
    )


def flute_row(
    path: ToolPath, volume_m3: Float, axial_depth_m: Float, cutters: Mapping[int, Cutter], grain_m: float
) -> Row:
    """The cut that is deepest for the flutes of its tool; above them the shank would rub.

    The depth is the least that the removed volume allows (:func:`counterflex.plan.undisturbed_cut.least_depth`), or the
    engaged one where the cut is wider than the grain of the stock: beside a wall that stands, single columns are cut.

    Args:
        path: n rows.
        volume_m3: (n,) removed on the way to each row.
        axial_depth_m: (n,) largest engaged axial depth.
        cutters: By tool number; all that cut.
        grain_m: Side of a column of the stock.
    """
    name = "depth of cut to flutes"
    feed = path.kind == FEED
    if not np.any(feed):
        return Row(name, "ok", what="no feed motions")
    some = next(iter(cutters.values()))
    tools = [cutters.get(number, some) for number in path.tool.tolist()]
    diameter, flutes = np.array([c.diameter_m for c in tools]), np.array([c.flute_length_m for c in tools])
    depth = least_depth(path, volume_m3, diameter, np.where(np.isfinite(flutes), flutes, 0.0))
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    way = np.linalg.norm(step - np.sum(step * path.axis_part, axis=1)[:, None] * path.axis_part, axis=1)
    wide = feed & (volume_m3 > WIDE_GRAINS * grain_m * axial_depth_m * way) & (way > 0.0)
    depth = np.maximum(depth, np.where(wide, axial_depth_m, 0.0))
    row = int(np.argmax(depth / flutes))
    deep = depth[row] > (1.0 + DEPTH_SHARE) * flutes[row]
    return Row(
        name,
        "fail" if deep else "ok",
        float(depth[row]),
        float(flutes[row]),
        "m",
        row if depth[row] > 0.0 else None,
        f"tool T{int(path.tool[row])}",
        advice="Cut in several levels" if deep else "",
    )


def with_points_in_rapids(path: ToolPath, step_m: float = STEP_M, lines: Bool | None = None) -> ToolPath:
    """The same path with points between: a sampled path has those of feed motions only.

    ``step_m``: longest step of a rapid, > 0. ``lines``: (n,) rows to which a rapid goes along a line; None: all.
    """
    step = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1)
    rapid = path.kind == RAPID if lines is None else (path.kind == RAPID) & lines
    count = np.where(rapid, np.maximum(1, np.ceil(step / step_m)), 1).astype(np.int64)
    if np.all(count == 1):
        return path
    row = np.repeat(np.arange(len(path)), count)
    within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 1
    share = within / count[row]
    before = np.maximum(row - 1, 0)
    columns = {item.name: getattr(path, item.name)[row] for item in dataclasses.fields(path)}
    for name in ("p_part_tcp", "time_s", "place", "axis_part"):
        values: Float = getattr(path, name)
        at = share if values.ndim == 1 else share[:, None]
        columns[name] = np.where(at == 1.0, values[row], values[before] + at * (values[row] - values[before]))
    columns["axis_part"] /= np.linalg.norm(columns["axis_part"], axis=1, keepdims=True)
    return ToolPath(**columns)
