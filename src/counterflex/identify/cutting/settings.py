"""What a machine has to be told to mill test cuts, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from counterflex.core.errors import ModelError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.identify.data.model import CellModel

CELL_M = 0.2 * MM
"""Side of a cell of the simulated blank."""


def machine_settings(cell: CellModel, tool: int, cutter: Cutter) -> dict[str, Any]:
    """Controller, cutter and blank of a cell in plain values, SI.

    Raises:
        ModelError: The robot has no closed-form geometry, or the cell no box as blank.
    """
    opw, box = cell.nominal_robot.opw, cell.blank_part
    if opw is None or box is None:
        raise ModelError(
            "test cuts need the closed-form geometry of the robot and a box as blank", value=cell.nominal_robot.name
        )
    T = np.eye(4)
    for segment in cell.nominal_end_effector.segments:
        T = T @ segment.T_prev_seg
    settings: dict[str, Any] = {
        "tool": tool,
        "opw_m": [opw.a1_m, opw.a2_m, opw.b_m, opw.c1_m, opw.c2_m, opw.c3_m, opw.c4_m],
        "opw_offsets_rad": list(opw.offsets_rad),
        "opw_signs": [int(s) for s in opw.signs],
        "joint_limits_rad": cell.nominal_robot.joint_limits_rad.tolist(),
        "T_flange_tcp": (T @ cell.nominal_end_effector.T_last_tcp).tolist(),
        "T_base_part": cell.T_base_part.tolist(),
        "branch": cell.branch,
        "rotation_about_tool_rad": cell.rotation_about_tool_rad,
        "cutter_diameter_m": cutter.diameter_m,
        "cutter_corner_radius_m": cutter.corner_radius_m,
        "cutter_flutes": cutter.flutes,
        "cutter_flute_length_m": cutter.flute_length_m,
        "blank_low_m": box[0].tolist(),
        "blank_high_m": box[1].tolist(),
        "blank_cell_m": CELL_M,
    }
    if cell.datum_points_part is not None:
        settings["datum_points_m"] = cell.datum_points_part.tolist()
    return settings
