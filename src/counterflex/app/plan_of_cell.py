"""Refuse what was made for another cell: a plan by its joint angles, a part by robot, tool and place."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.external_moves import refuse_places
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.files.plan_file import EXTERNAL_PLACES, WORKING_PLANE
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

    Raises:
        InputError: It was made for another cell, or external axes move along it.
    """
    robot = about.get("robot")
    if isinstance(robot, str) and robot != cell.chain.name:
        raise InputError(
            "the plan is of another cell", where=str(where), value=robot, limit=cell.chain.name,
            hint="Plan the program again with this cell file",
        )  # fmt: skip
    refuse_places(int(about.get(EXTERNAL_PLACES, 1)), where)
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


def require_same_cell(made: Cell, cell: Cell, where: str | Path) -> None:
    """Refuse a part that was machined in another cell: by another robot, with other tools, at another place.

    Stiffness, force constants and a part frame that was measured again may differ: they are what is corrected.

    Raises:
        InputError: Names what differs.
    """
    differing = _differing(made, cell)
    if differing is not None:
        what, value, limit = differing
        raise InputError(f"the part was machined in another cell: {what}", where=str(where), value=value, limit=limit,
                         hint=f"Give a part of {cell.path}, or the cell file of this part")  # fmt: skip


def _differing(made: Cell, cell: Cell) -> tuple[str, str, str] | None:
    if made.chain.name != cell.chain.name:
        return "another robot", made.chain.name, cell.chain.name
    for tool in cell.tables.tools:
        other = next((one for one in made.tables.tools if one.number == tool.number), None)
        if other is not None and (other.diameter_mm, other.corner_radius_mm) != (
            tool.diameter_mm,
            tool.corner_radius_mm,
        ):
            shown = [
                f"diameter {one.diameter_mm:g} mm, corner radius {one.corner_radius_mm:g} mm" for one in (other, tool)
            ]
            return f"another tool T{tool.number}", shown[0], shown[1]
    if made.holds_part or cell.holds_part:
        return None if made.holds_part == cell.holds_part else ("the robot holds the part in one of them", "yes", "no")
    apart_m = float(np.linalg.norm(made.T_base_part[:3, 3] - cell.T_base_part[:3, 3]))
    if apart_m > APART_M:
        return "the part lies elsewhere", f"{apart_m / MM:.0f} mm away", f"at most {APART_M / MM:g} mm"
    return None
