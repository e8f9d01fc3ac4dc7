"""Coarse bodies of a cell while a program runs: those of the cell file, and assumed ones for what it does not say."""

from __future__ import annotations

import numpy as np

from counterflex.app.inputs import Job
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell
from counterflex.plan.preflight.bodies import Body, carried, links, part_bodies, with_given


def coarse_bodies(job: Job, cell: Cell, stock: HeightMap) -> list[Body]:
    """Links, spindle, every tool that the program has in it, blank and table; with those of the cell file.

    Args:
        job: The program.
        cell: The cell.
        stock: Its blank.
    """
    known = {tool.number: tool for tool in cell.tables.tools}
    used = [number for number in np.unique(job.machined.tool).tolist() if number in known]
    overhang = {n: length for n in used if (length := known[n].overhang_m) is not None}
    chain = cell.controller_chain
    given, removed = cell.tables.cell.bodies()
    assumed = [*links(chain), *carried(chain, {n: cell.cutter(n) for n in used}, overhang), *part_bodies(stock)]
    return with_given(assumed, given, removed)
