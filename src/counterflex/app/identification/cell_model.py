"""The cell as identification sees it."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.sensing import sensing_of
from counterflex.identify.data.model import CellModel

_ELSEWHERE: Final = frozenset(
    (
        *("format", "version", "name", "robot", "end_effector", "tcp", "part", "tools", "material"),
        *("posture", "controller", "dynamics", "limits", "identified"),
    )
)
"""Tables of the cell file that the model has as objects, or not at all."""


def model_of(cell: Cell) -> CellModel:
    """What recipes get to know of a cell."""
    tables = cell.tables.model_dump(mode="json", exclude_none=True)
    return CellModel(
        name=cell.name,
        robot=cell.robot,
        end_effector=cell.end_effector,
        nominal_robot=cell.nominal_robot,
        nominal_end_effector=cell.nominal_end_effector,
        calibration=cell.calibration,
        law_of=partial(getattr, cell, "force_law"),
        cutter_of=cell.cutter,
        frame_of=partial(getattr, cell, "T_base_part"),
        branch=cell.tables.posture.branch,
        joint_margin_rad=cell.tables.limits.limits.joint_margin_rad,
        rotation_about_tool_rad=cell.tables.posture.rotation_about_tool_rad,
        blank_part=_box(cell),
        datum_points_part=_datum_points(cell),
        tables={
            **{name: tables[name] for name in tables if name not in _ELSEWHERE},
            **sensing_of(cell.tables.sensor, cell.tables.holder, cell.chain),
        },
    )


def _datum_points(cell: Cell) -> Float | None:
    part = cell.tables.part
    return cell.datum_points_part if part is not None and part.measured_with == "robot" else None


def _box(cell: Cell) -> Float | None:
    part = cell.tables.part
    stock = None if part is None else part.stock
    if stock is None or stock.box_min_mm is None or stock.box_max_mm is None:
        return None
    return np.array([stock.box_min_mm, stock.box_max_mm]) * MM
