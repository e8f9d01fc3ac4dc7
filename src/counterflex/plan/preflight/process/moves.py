"""Checks of the motions around the cut: the first one, tool changes, and the end of the program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.process.spindle import engaged
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row

FIRST: Final = "first motion"
CHANGE: Final = "tool change"
END: Final = "end of the program"
_DEEP_M: Final = 0.02 * MM
"""Less deep is rounding of the program."""
_ANGLES: Final = 16


def depth_in_stock(stock: HeightMap, p: Float, axis: Float, cutter: Cutter) -> float:
    """Depth by which a tool that stands in a place reaches into the material, m; 0 where it is clear.

    ``p``: (3,) m, tip; ``axis``: (3,) unit vector from the tip to the spindle.
    """
    tallest = float(stock.z.max()) - stock.bottom_m + abs(float(p[2]) - stock.bottom_m)
    length = min(cutter.flute_length_m, tallest + cutter.diameter_m)
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(axis, other)
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    angle = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    ring = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    heights = np.unique(np.append(np.linspace(0.0, length, 60), np.linspace(0.0, cutter.corner_radius_m, 12)))
    # Just inside the outline: a tool that stands along a wall it has made is clear of it.
    radii = np.array([cutter.radius_at(float(h)) for h in heights]) * (1.0 - 1e-6)
    centre = p + heights[:, None] * axis
    points = [centre + share * radii[:, None] * ring[k] for k in range(_ANGLES) for share in (0.0, 0.5, 1.0)]
    at = np.concatenate(points)
    top = _top(stock, at)
    deep = np.where(at[:, 2] > stock.bottom_m - _DEEP_M, top - at[:, 2], 0.0)
    return max(0.0, float(deep.max()))


def _top(stock: HeightMap, points: Float) -> Float:
    """(n,) m, height of the material under or over points; -inf beside the blank."""
    i = np.rint((points[:, 0] - stock.x0_m) / stock.cell_m).astype(np.int64)
    j = np.rint((points[:, 1] - stock.y0_m) / stock.cell_m).astype(np.int64)
    ny, nx = stock.z.shape
    inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
    z = stock.z[np.clip(j, 0, ny - 1), np.clip(i, 0, nx - 1)].astype(np.float64)
    return np.where(inside & (z > stock.bottom_m), z, -np.inf)


def height_over(stock: HeightMap, p: Float, radius_m: float) -> float:
    """Height of a tip above the highest material of the blank within its radius, m; inf beside the blank.

    ``p``: (3,) m.
    """
    rho = radius_m * np.linspace(0.0, 1.0, 6)
    angle = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    offsets = np.stack([np.outer(rho, np.cos(angle)).ravel(), np.outer(rho, np.sin(angle)).ravel()], axis=1)
    at = np.concatenate([p[:2] + offsets, np.full((len(offsets), 1), p[2])], axis=1)
    return float(p[2] - _top(stock, at).max())


def gap(stock: HeightMap, points: Float, radius_m: float) -> float:
    """Distance of tips (n, 3) m of a tool from the box around the blank where they come nearest, m."""
    ny, nx = stock.z.shape
    half = 0.5 * stock.cell_m
    low = np.array([stock.x0_m - half, stock.y0_m - half])
    high = low + np.array([nx, ny]) * stock.cell_m
    side = np.maximum(np.maximum(low - points[:, :2], points[:, :2] - high), 0.0)
    sideways = np.maximum(np.linalg.norm(side, axis=1) - radius_m, 0.0)
    above = np.maximum(points[:, 2] - float(stock.z.max()), 0.0)
    return float(np.min(np.hypot(sideways, above), initial=np.inf))


def first_row(
    path: ToolPath, stock: HeightMap, cutter_of: Callable[[int], Cutter | None], height_known: bool, arrival: int = 0
) -> Row:
    """Return where the first motion ends: on its way there the tool may come from anywhere.

    A program that names X, Y and Z in several motions is at a known place behind the last of them.

    Args:
        path: n rows.
        cutter_of: Gives the cutter of a tool number, None for one that the cell does not have.
        height_known: The program has named the height of the tool with or before its first motion.
        arrival: Motion at whose end X, Y and Z are named.
    """
    if len(path) < 2:
        return Row(FIRST, "ok", what="the program has one point")
    ends = np.flatnonzero(np.diff(path.motion, append=-1) != 0)
    ends = ends[path.motion[ends] <= max(arrival, int(path.motion[0]))]
    row = int(ends[np.argmin(path.p_part_tcp[ends, 2])])
    p, axis = path.p_part_tcp[row], path.axis_part[row]
    numbers = [int(path.tool[row]), *path.tool[path.tool != 0][:1].tolist()]
    cutter = next((match for n in numbers if (match := cutter_of(n)) is not None), None)
    over = float(p[2] - stock.z.max())
    if cutter is None:
        return Row(FIRST, NOT_LOOKED_AT, point=row, what="no tool is selected yet", missing="tools")
    if not height_known:
        text = "the program does not say at which height it begins: name Z above the blank in its first motion"
        return Row(FIRST, NOT_LOOKED_AT, point=row, what=text)
    deep = depth_in_stock(stock, p, axis, cutter)
    if deep > _DEEP_M:
        return Row(FIRST, "fail", -deep, 0.0, "m", row, "it ends in the blank, wherever the tool comes from",
                   advice="Begin above the blank: G0 Z, then X and Y")  # fmt: skip
    if over < -_DEEP_M:
        text = "it ends beside the blank, below its top, and the way to it is not known"
        return Row(FIRST, "warning", over, 0.0, "m", row, text,
                   advice="Begin above the blank: G0 Z, then X and Y")  # fmt: skip
    return Row(FIRST, "ok", over, 0.0, "m", row, "its end, over the blank")


def change_row(path: ToolPath, stock: HeightMap, cutter_of: Callable[[int], Cutter | None]) -> Row:
    """Return the tool change at which the tool stands deepest over or in the blank.

    ``cutter_of``: gives the cutter of a tool number, None for one that the cell does not have.
    """
    places = np.flatnonzero((np.diff(path.tool) != 0) & (path.tool[:-1] != 0))
    if len(places) == 0:
        return Row(CHANGE, "ok", what="the tool is not changed in the program")
    heights = [_height(path, int(row), stock, cutter_of) for row in places]
    worst = int(np.argmin(heights))
    row, height = int(places[worst]), heights[worst]
    inside = height < -_DEEP_M
    text = f"T{int(path.tool[row])} to T{int(path.tool[row + 1])}" + (" in the blank" if inside else "")
    value = float(path.p_part_tcp[row, 2] - stock.z.max())
    return Row(CHANGE, "fail" if inside else "ok", height if inside else value, 0.0, "m", row, text,
               advice="Retract above the blank before M6" if inside else "")  # fmt: skip


def end_row(
    path: ToolPath, contact: Bool, stock: HeightMap, cutter_of: Callable[[int], Cutter | None], spindle_on: bool
) -> Row:
    """Return how the program ends: in the cut, without a retract, or with the spindle on.

    Args:
        path: n rows.
        contact: (n,) segments that remove material.
        cutter_of: See :func:`change_row`.
        spindle_on: The program does not stop the spindle.
    """
    row = len(path) - 1
    height = _height(path, row, stock, cutter_of)
    value = float(path.p_part_tcp[row, 2] - stock.z.max())
    if engaged(path, contact)[row]:
        return Row(
            END, "fail", height, 0.0, "m", row, "the program ends in the cut", advice="Retract behind the last cut"
        )
    if height < -_DEEP_M:
        return Row(
            END, "warning", height, 0.0, "m", row, "the tool stays in the part", advice="Retract above the blank"
        )
    if spindle_on:
        return Row(END, "warning", value, 0.0, "m", row, "the spindle is not stopped", advice="M5, or M30")
    return Row(END, "ok", value, 0.0, "m", row, "height of the tool over the blank")


def _height(path: ToolPath, row: int, stock: HeightMap, cutter_of: Callable[[int], Cutter | None]) -> float:
    cutter = cutter_of(int(path.tool[row]))
    return height_over(stock, path.p_part_tcp[row], 0.0 if cutter is None else cutter.radius_m)
