"""What a program sweeps, and what a run swept, each stretch with its tool."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.files.cell.cell import Cell
from counterflex.path.run import Run
from counterflex.path.toolpath import ToolPath
from counterflex.twin.plant.simulate import mounted_tools


def top_of(cell: Cell, *paths: Float) -> float:
    """Height above the tip up to which a tool takes material away: all that stands above the lowest place of paths."""
    lowest = min(float(path[:, 2].min()) for path in paths)
    return float(cell.stock().z.max()) - lowest + 10.0 * MM


def log_of_path(path: ToolPath, cell: Cell, top_m: float) -> CutLog:
    """What the program sweeps, each stretch with its tool."""
    return _log(path.p_part_tcp, mounted_tools(path), np.zeros(len(path), bool), cell, top_m)


def log_of_run(machined: Run, path: ToolPath, cell: Cell, top_m: float) -> CutLog:
    """What a run swept; stretches of air are left out of it."""
    step = np.diff(machined.time_s, prepend=machined.time_s[0])
    broken = step > 1.5 * float(np.median(np.diff(machined.time_s)))
    last = np.maximum(np.searchsorted(path.motion, machined.motion, side="right") - 1, 0)
    return _log(machined.p_part_tcp, mounted_tools(path)[last], broken, cell, top_m)


def _log(p_part_tcp: Float, tool: Int, broken: Any, cell: Cell, top_m: float) -> CutLog:
    """Motions of a path that may be broken off and may change its tool; a row is run to with its own."""
    ends = np.flatnonzero(broken[1:] | (tool[1:] != tool[:-1])) + 1
    upright = np.array([0.0, 0.0, 1.0])
    logs = []
    for first, last in itertools.pairwise([0, *ends.tolist(), len(p_part_tcp)]):
        begin = first if first == 0 or broken[first] else first - 1
        if last - begin > 1:
            p = p_part_tcp[begin:last]
            logs.append(CutLog.of(p, np.tile(upright, (len(p), 1)), cell.cutter(int(tool[last - 1])), top_m=top_m))
    return CutLog.joined(logs)
