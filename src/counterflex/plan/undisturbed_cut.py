"""The cut of the undisturbed tool: what it meets along the nominal path, and the force that decides the correction.

Cuts deeper than the flutes are long are refused: above them the shank would rub.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import ModelError
from counterflex.core.progress import Progress
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan import chip_range
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.inputs import CompensationInputs, place

WINDOW_M = 2.0 * MM
"""Stretch of path over which the removed volume is added up; it smooths over the grid of the stock."""


def least_depth(path: ToolPath, volume_m3: Float, diameter_m: Float, reach_m: Float | None = None) -> Float:
    """Axial depth that a cut has at least, as its removed volume says.

    Over a length L square to its axis a mill of diameter D removes at most ``D L a`` at the depth a, and
    ``pi D^2/4 dz`` more where it descends by dz along the axis. So ``a >= (V - pi D^2/4 dz) / (D L)``; in a full slot
    the two are equal. Where the axis turns, L is the longer of the ways at the tip and at the upper end of the flutes.

    Args:
        path: n points.
        volume_m3: (n,) removed on the way to each point.
        diameter_m: (n,) of the cutter there.
        reach_m: (n,) length of its flutes; None stands for zero.

    Returns:
        (n,) m, 0 where the tool moves less than the window or not in feed.
    """
    feed = path.kind == FEED
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    axis = path.axis_part
    along = np.sum(step * axis, axis=1)
    way = np.linalg.norm(step - along[:, None] * axis, axis=1)
    turn = np.diff(axis, axis=0, prepend=axis[:1])
    turns = np.any(turn != 0.0, axis=1) & (reach_m is not None)
    reach_m = np.zeros(len(path)) if reach_m is None else reach_m
    upper = step[turns] + reach_m[turns, None] * turn[turns]
    upper -= np.sum(upper * axis[turns], axis=1)[:, None] * axis[turns]
    way[turns] = np.maximum(way[turns], np.linalg.norm(upper, axis=1))
    station = np.cumsum(way)
    down = np.cumsum(np.maximum(0.0, -along) * 0.25 * np.pi * diameter_m**2)
    volume = np.cumsum(np.where(feed, volume_m3, 0.0))
    first = np.searchsorted(station, station - WINDOW_M, side="right") - 1
    known = first >= 0
    first = np.maximum(first, 0)
    length = station - station[first]
    enough = known & (length >= 0.99 * WINDOW_M) & feed
    removed = volume - volume[first] - (down - down[first])
    out: Float = np.where(enough, np.maximum(0.0, removed) / (diameter_m * np.where(enough, length, 1.0)), 0.0)
    return out


def check_flutes(
    path: ToolPath, volume_m3: Float, cutter_of: Callable[[int], Cutter], place: Callable[[int], str]
) -> None:
    """Check that no cut is certainly deeper than the flutes are long.

    ``volume_m3``: (n,) removed on the way to each point; ``place``: says where a point is.

    Raises:
        ModelError: One is, by more than 5 %.
    """
    cutters = {int(number): cutter_of(int(number)) for number in np.unique(path.tool[(path.kind == FEED)])}
    if not cutters:
        return
    some = next(iter(cutters.values()))
    diameter = np.array([cutters.get(int(number), some).diameter_m for number in path.tool])
    flutes = np.array([cutters.get(int(number), some).flute_length_m for number in path.tool])
    depth = least_depth(path, volume_m3, diameter, np.where(np.isfinite(flutes), flutes, 0.0))
    row = int(np.argmax(depth / flutes))
    # 5 %: what the depth from a volume on a grid may be off (preflight.rapids.DEPTH_SHARE).
    if depth[row] > 1.05 * flutes[row]:
        raise ModelError(
            "the cut is deeper than the flutes of the tool are long",
            where=place(row),
            value=f"{depth[row] / MM:.1f} mm",
            limit=f"at most {flutes[row] / MM:g} mm (tools.flute_length_mm)",
            hint="Cut in several levels",
        )


_CONTACT_M3 = 1e-12


@dataclass(frozen=True, eq=False)
class UndisturbedCut:
    """Forces and engagement of a tool that runs along the nominal path."""

    cut: Cut  # engagement, chips and force of each row
    contact: Bool  # (n,) rows at feed that take material
    extrapolated: Bool  # (n,) rows whose mean chip is outside the range of the force law
    w_tcp_part: Float  # (n, 6) N, N m at the points, about the tip, part axes


def undisturbed_cut(inputs: CompensationInputs, progress: Progress) -> UndisturbedCut:
    """Cut along the nominal path with a tool that does not yield.

    Args:
        inputs: Path, blank, tools and law.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        ModelError: The force is uncertain because its chips are outside the law's range, or a cut is deeper than the
            flutes are long.
        ProgramError: Material is cut with the spindle stopped.
    """
    path, setting = inputs.path, inputs.setting
    result = cut(path, path.p_part_tcp, inputs.stock.copy(), setting.cutter_of, setting.law, progress=progress)
    contact = (path.kind == FEED) & (result.volume_m3 > _CONTACT_M3)
    check_flutes(path, result.volume_m3, setting.cutter_of, lambda row: place(path, inputs.line, row))
    extrapolated = _check_chips(result, contact, inputs)
    return UndisturbedCut(result, contact, extrapolated, at_points(result.w_tcp_part, contact))


def _check_chips(result: Cut, contact: Bool, inputs: CompensationInputs) -> Bool:
    """Rows cut with a mean chip outside the law's range; refused where the force is uncertain as a whole."""
    path, law = inputs.path, inputs.setting.law
    estimate = chip_range.outside(law, result.chip_m, contact, result.w_tcp_part, path.time_s)
    if not inputs.setting.allow_extrapolation:
        worst = int(np.argmax(estimate.row_share * np.linalg.norm(result.w_tcp_part[:, :3], axis=1)))
        chip_range.check(estimate, law, result.chip_m, worst, place(path, inputs.line, worst))
    return estimate.rows
