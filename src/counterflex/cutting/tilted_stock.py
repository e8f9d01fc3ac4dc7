"""A blank seen along a tilted tool: the height map whose columns stand along the tool axis.

Cuts with one direction of the tool (3+2 axes) are three-axis cuts in a frame whose z is that direction. A column of the
map there holds the highest point of the blank on its line; what the blank leaves free below its own underside counts as
filled. That matters only where the tool breaks through the underside.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap, require_vertical

UPRIGHT: Final = 1.0 - 1e-12
"""Cosine of the tilt from which on a tool counts as one along z."""


def working_plane(axis_part: Float) -> Float:
    """Frame whose z is a tool axis and whose x is the part's x as far as it is square to it.

    Where the tool lies along x the part's y stands in, as in :func:`~counterflex.path.toolpath.tool_orientation`.

    Args:
        axis_part: (3,) unit vector from the tip to the spindle.

    Returns:
        R_part_plane (3, 3): its columns are the axes of the plane; the identity for an axis along z.
    """
    z = as_float("axis_part", axis_part, (3,))
    reference = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = reference - (reference @ z) * z
    x /= np.linalg.norm(x)
    out: Float = np.stack([x, np.cross(z, x), z], axis=1)
    return out


def box_along_tool(low_m: Float, high_m: Float, cell_m: float, R_part_plane: Float) -> HeightMap:
    """A rectangular block as a height map along a tilted tool.

    The line of a column leaves the block where the first of the three pairs of faces ends (slab method).

    Args:
        low_m: (3,) lowest corner, m, part frame.
        high_m: (3,) highest corner.
        cell_m: Side of a cell, m.
        R_part_plane: (3, 3) axes of the plane in the part frame.

    Returns:
        The map in the plane's frame, whose origin is that of the part; columns beside the block are empty.

    Raises:
        InputError: The grid is too small or too large.
    """
    low, high = as_float("low_m", low_m, (3,)), as_float("high_m", high_m, (3,))
    if not np.all(high > low):
        raise InputError("stock has no volume", value=(low.tolist(), high.tolist()), limit="low < high in x, y, z")
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    seen = corners @ R_part_plane
    bottom = float(seen[:, 2].min())
    box = HeightMap.from_box(tuple(seen.min(axis=0).tolist()), tuple(seen.max(axis=0).tolist()), cell_m)
    x, y = np.meshgrid(box.x_m(), box.y_m())
    base = np.stack([x, y, np.zeros_like(x)], axis=-1) @ R_part_plane.T
    enter, leave = np.full(x.shape, -np.inf), np.full(x.shape, np.inf)
    for axis in range(3):
        along = float(R_part_plane[axis, 2])
        if abs(along) < 1e-12:
            # Parallel to a pair of faces the line runs between them all along, or nowhere.
            outside = (base[..., axis] < low[axis]) | (base[..., axis] > high[axis])
            leave = np.where(outside, -np.inf, leave)
            continue
        a, b = (low[axis] - base[..., axis]) / along, (high[axis] - base[..., axis]) / along
        enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
    tops = np.where(leave > enter, leave, bottom)
    return HeightMap(box.x0_m, box.y0_m, cell_m, np.maximum(tops, bottom).astype(np.float32), bottom)


def may_touch(stock: HeightMap, p_part_tcp: Float, axis_part: Float, cutter: Cutter) -> Bool:
    """Points at which the fluted part of a tool of any direction may meet the box around the stock.

    The flutes are a capsule about the tool axis from the tip; it is held against the box at points an eighth of the
    diameter spacing, with half that distance added to the radius.

    ``p_part_tcp``: (n, 3) m, tips in the frame of the stock; ``axis_part``: (n, 3) unit vectors from the tip to the
    spindle.

    Returns:
        (n,) False where it is certainly clear.
    """
    ny, nx = stock.z.shape
    half = 0.5 * stock.cell_m
    low = np.array([stock.x0_m - half, stock.y0_m - half, stock.bottom_m])
    high = np.array([stock.x0_m + (nx - 0.5) * stock.cell_m, stock.y0_m + (ny - 0.5) * stock.cell_m, stock.z.max()])
    spacing = 0.25 * cutter.radius_m
    out = np.zeros(len(p_part_tcp), dtype=np.bool_)
    away = np.linalg.norm(p_part_tcp - 0.5 * (low + high), axis=1).max(initial=0.0)  # m, no tip is farther from the box
    length = min(cutter.flute_length_m, away + np.linalg.norm(high - low) + cutter.radius_m)
    for along in np.linspace(0.0, length, math.ceil(length / spacing) + 1):
        p = p_part_tcp + along * axis_part
        off = np.linalg.norm(np.maximum(np.maximum(low - p, p - high), 0.0), axis=1)
        out |= off <= cutter.radius_m + 0.5 * spacing
    return out


def cuts_tilted(stock: HeightMap, p_part_tcp: Float, axis_part: Float, cutter: Cutter) -> bool:
    """Return whether a tool may touch the stock while it is tilted; in the air it may lie and turn as it likes.

    ``p_part_tcp``: (n, 3) m, tips of feed motions, in the frame of the stock; ``axis_part``: (n, 3) unit vectors from
    the tip to the spindle.
    """
    rows = np.flatnonzero(axis_part[:, 2] < UPRIGHT)
    return bool(may_touch(stock, p_part_tcp[rows], axis_part[rows], cutter).any()) if len(rows) else False


def require_upright_cuts(stock: HeightMap, p_part_tcp: Float, axis_part: Float, cutter: Cutter) -> None:
    """Refuse a tool that is tilted where it may cut; in the air it may lie and turn as it likes.

    ``p_part_tcp``: (n, 3) m, tips of feed motions, in the frame of the stock; ``axis_part``: (n, 3) unit vectors from
    the tip to the spindle.

    Raises:
        ModelError: See :func:`~counterflex.cutting.stock.require_vertical`.
    """
    rows = np.flatnonzero(axis_part[:, 2] < UPRIGHT)
    if len(rows):
        require_vertical(axis_part[rows][may_touch(stock, p_part_tcp[rows], axis_part[rows], cutter)])
