"""Return whether a plan file belongs to a cell: where its joint angles put the tool in this cell."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.files.plan_file import WORKING_PLANE
from counterflex.plan.plan import Plan
from counterflex.robot.elasticity.chain import forward

APART_M: Final = 50.0 * MM
"""A tool that is farther from its point than this was planned in another cell. A part frame or a tool that is measured
again moves by some mm; a plan holds on there."""
_ROWS: Final = 50


def require_of_cell(plan: Plan, about: Mapping[str, Any], cell: Cell, where: str | Path) -> None:
    """Refuse a plan of another robot, another tool or another place of the part.

    The joint angles of the plan lead the tool of this cell to the points of the plan in the part frame of this cell, or
    the plan was made for another one. Plans for a part that the robot holds are compared by the robot's name alone.

    Args:
        plan: As read.
        about: Its metadata.
        cell: The cell it is used with.
        where: Its file.

    Raises:
        InputError: It was made for another cell.
    """
    robot = about.get("robot")
    if isinstance(robot, str) and robot != cell.chain.name:
        raise InputError(
            "the plan is of another cell", where=str(where), value=robot, limit=cell.chain.name,
            hint="Plan the program again with this cell file",
        )  # fmt: skip
    if cell.holds_part or len(plan.path) == 0 or (WORKING_PLANE in about and cell.R_part_plane is None):
        return
    rows = np.unique(np.linspace(0, len(plan.path) - 1, _ROWS).astype(int))
    p_base = plan.path.p_part_tcp[rows] @ cell.T_base_part[:3, :3].T + cell.T_base_part[:3, 3]
    distance = np.linalg.norm(forward(cell.controller_chain, plan.q[rows])[:, :3, 3] - p_base, axis=1)
    row = int(np.argmax(distance))
    if distance[row] > APART_M:
        raise InputError(
            "the plan is of another cell: its joint angles put the tool elsewhere",
            where=f"{where}, line {int(plan.line[rows[row]])}",
            value=f"{distance[row] / MM:.0f} mm away from its point",
            limit=f"at most {APART_M / MM:g} mm in {cell.path}",
            hint="Plan the program again with this cell file",
        )
