"""Sweeps of a program and of a run, each stretch with its tool; and the columns that a program leaves."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.tridexel.columns import ColumnStock, remove_turning
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import Run, ToolPath
from counterflex.twin.plant.simulate import mounted_tools


def top_of(cell: Cell, *paths: Float) -> float:
    """Height above the tip up to which a tool takes material away: all that stands above the lowest place of paths.

    Of a tool that turns it is all the way across the blank.
    """
    stock = cell.stock()
    if cell.tool_turns:
        ny, nx = stock.z.shape
        return float(np.hypot(np.hypot(nx, ny) * stock.cell_m, float(stock.z.max()) - stock.bottom_m))
    lowest = min(float(path[:, 2].min()) for path in paths)
    return float(stock.z.max()) - lowest + 10.0 * MM


def log_of_path(path: ToolPath, cell: Cell, top_m: float) -> CutLog:
    """Return what the program sweeps, each stretch with its tool."""
    axis = path.axis_part if cell.tool_turns else _upright(len(path))
    return _log(path.p_part_tcp, axis, mounted_tools(path), np.zeros(len(path), bool), cell, top_m)


def log_of_run(machined: Run, path: ToolPath, cell: Cell, top_m: float) -> CutLog:
    """Return what a run swept; stretches of air are left out of it.

    Raises:
        InputError: The tool turned, and the record does not say how.
    """
    axis = machined.axis_part if cell.tool_turns else _upright(len(machined.time_s))
    if axis is None:
        raise InputError(
            "the record of a tool that turns does not hold the direction of the tool",
            limit="a record of version 2",
            hint="Simulate the program again",
        )
    step = np.diff(machined.time_s, prepend=machined.time_s[0])
    broken = step > 1.5 * float(np.median(np.diff(machined.time_s)))
    last = np.maximum(np.searchsorted(path.motion, machined.motion, side="right") - 1, 0)
    return _log(machined.p_part_tcp, axis, mounted_tools(path)[last], broken, cell, top_m)


def undisturbed_columns(path: ToolPath, cell: Cell) -> ColumnStock:
    """Return what a program with a tool that turns would leave of the blank if nothing bent."""
    columns, top = ColumnStock.of(cell.stock()), top_of(cell)
    mounted = mounted_tools(path)
    changes = np.flatnonzero(np.diff(mounted[1:])) + 1
    for first, last in itertools.pairwise([0, *changes.tolist(), len(path) - 1]):
        if last > first:
            some, cutter = slice(first, last + 1), cell.cutter(int(mounted[last]))
            remove_turning(
                columns,
                path.p_part_tcp[some],
                path.axis_part[some],
                path.kind[some],
                cutter,
                top_m=_top(cutter, cell, top),
                engagement=False,
            )
    return columns


def _upright(n: int) -> Float:
    return np.tile([0.0, 0.0, 1.0], (n, 1))


def _top(cutter: Cutter, cell: Cell, top_m: float) -> float:
    """Of a tool that turns nothing is cut above the flutes."""
    return min(top_m + cutter.diameter_m, cutter.flute_length_m) if cell.tool_turns else top_m


def _log(p_part_tcp: Float, axis_part: Float, tool: Int, broken: Any, cell: Cell, top_m: float) -> CutLog:
    """Motions of a path that may be broken off and may change its tool; a row is run to with its own."""
    ends = np.flatnonzero(broken[1:] | (tool[1:] != tool[:-1])) + 1
    logs = []
    for first, last in itertools.pairwise([0, *ends.tolist(), len(p_part_tcp)]):
        begin = first if first == 0 or broken[first] else first - 1
        if last - begin > 1:
            cutter = cell.cutter(int(tool[last - 1]))
            top = _top(cutter, cell, top_m)
            logs.append(CutLog.of(p_part_tcp[begin:last], axis_part[begin:last], cutter, top_m=top))
    return CutLog.joined(logs)
