"""Refuse cuts that are deeper than the flutes are long: above them the shank would rub."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, ToolPath

WINDOW_M = 2.0 * MM
"""Stretch of path over which the removed volume is added up; it smooths over the grid of the stock."""


def least_depth(path: ToolPath, volume_m3: Float, diameter_m: Float) -> Float:
    """Axial depth that a cut has at least, as its removed volume says.

    Over a horizontal length L a mill of diameter D removes at most ``D L a`` at the depth a, and ``pi D^2/4 dz`` more
    where it descends by dz. So ``a >= (V - pi D^2/4 dz) / (D L)``; in a full slot the two are equal.

    Args:
        path: n points.
        volume_m3: (n,) removed on the way to each point.
        diameter_m: (n,) of the cutter there.

    Returns:
        (n,) m, 0 where the tool moves less than the window or not in feed.
    """
    feed = path.kind == FEED
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    station = np.cumsum(np.linalg.norm(step[:, :2], axis=1))
    down = np.cumsum(np.maximum(0.0, -step[:, 2]) * 0.25 * np.pi * diameter_m**2)
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

    Args:
        path: n points.
        volume_m3: (n,) removed on the way to each point.
        cutter_of: Gives the cutter of a tool number.
        place: Says where a point is.

    Raises:
        ModelError: One is, by more than 5 %.
    """
    cutters = {int(number): cutter_of(int(number)) for number in np.unique(path.tool[(path.kind == FEED)])}
    if not cutters:
        return
    some = next(iter(cutters.values()))
    diameter = np.array([cutters.get(int(number), some).diameter_m for number in path.tool])
    flutes = np.array([cutters.get(int(number), some).flute_length_m for number in path.tool])
    depth = least_depth(path, volume_m3, diameter)
    row = int(np.argmax(depth / flutes))
    if depth[row] > 1.05 * flutes[row]:
        raise ModelError(
            "the cut is deeper than the flutes of the tool are long",
            where=place(row),
            value=f"{depth[row] / MM:.1f} mm",
            limit=f"at most {flutes[row] / MM:g} mm (tools.flute_length_mm)",
            hint="Cut in several levels",
        )
