"""A blank seen along a tilted tool: the height map whose columns stand along the tool axis.

Cuts with one direction of the tool (3+2 axes) are three-axis cuts in a frame whose z is that direction. A column of the
map there holds the highest point of the blank on its line; what the blank leaves free below its own underside counts as
filled. That matters only where the tool breaks through the underside.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.stock import HeightMap


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
            outside = (base[..., axis] < low[axis]) | (base[..., axis] > high[axis])
            leave = np.where(outside, -np.inf, leave)
            continue
        a, b = (low[axis] - base[..., axis]) / along, (high[axis] - base[..., axis]) / along
        enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
    tops = np.where(leave > enter, leave, bottom)
    return HeightMap(box.x0_m, box.y0_m, cell_m, np.maximum(tops, bottom).astype(np.float32), bottom)
