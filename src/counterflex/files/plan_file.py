"""The plan file (``counterflex-plan``, version 1, or 2 with measured parts): one row per path point, Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM, MM_PER_MIN, RPM, UM, URAD
from counterflex.files.parquet_table import Column, columns, read, table, write
from counterflex.files.summary_file import require_whole
from counterflex.path.toolpath import ToolPath
from counterflex.plan.plan import Plan, job_hash
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes

KIND = "counterflex-plan"
VERSION = 2
CLASS_ASSUMED = "stiffness_assumed_from_class"
"""Key of the metadata: the plan stands on the median of the robot's class, and so must what runs it."""
WORKING_PLANE = "working_plane"
"""Key of the metadata: axes of the frame that a plan for a tilted tool is given in, as columns in part axes."""
AXES = "controller_axes"
"""Key of the metadata: how the axes of the file follow from the angles of the model, where they are not the same."""
TOOL_TURNS = "tool_turns"
"""Key of the metadata: the tool cuts in several directions, or turns while it cuts; the plan is in part axes."""
EXTERNAL_PLACES = "external_places"
"""Key of the metadata: so many places external axes take along the plan, which has no column for them."""

LAYOUT = (
    Column("time_s", "path.time_s"),
    Column("line", "line", whole=True),
    Column("motion", "path.motion", whole=True),
    Column("kind", "path.kind", whole=True),
    Column("tool", "path.tool", whole=True),
    *columns("x_mm y_mm z_mm", "path.p_part_tcp", MM),
    *columns("axis_x axis_y axis_z", "path.axis_part"),
    Column("feed_mm_min", "path.feed_m_s", unit=MM_PER_MIN),
    Column("spindle_rpm", "path.spindle_rad_s", unit=RPM),
    *columns("q1_deg q2_deg q3_deg q4_deg q5_deg q6_deg", "q", DEG),
    *columns("fx_n fy_n fz_n mx_nm my_nm mz_nm", "w_tcp_part"),
    *(
        Column(f"deflection_{name}", "deflection_part", i, unit)
        for i, (name, unit) in enumerate(
            [("x_um", UM), ("y_um", UM), ("z_um", UM), ("rx_urad", URAD), ("ry_urad", URAD), ("rz_urad", URAD)]
        )
    ),
    *columns("sag_x_um sag_y_um sag_z_um", "sag_part", UM),
    *columns("play_x_um play_y_um play_z_um", "play_part", UM),
    *columns("correction_x_um correction_y_um correction_z_um", "correction_part", UM),
    *columns("correction_rx_urad correction_ry_urad correction_rz_urad", "rotvec_part", URAD),
    Column("volume_mm3", "volume_m3", unit=MM**3),
    Column("axial_depth_mm", "axial_depth_m", unit=MM),
    Column("entry_deg", "entry_rad", unit=DEG),
    Column("exit_deg", "exit_rad", unit=DEG),
    Column("feed_per_tooth_mm", "feed_per_tooth_m", unit=MM),
    *columns("nominal_deviation_x_um nominal_deviation_y_um nominal_deviation_z_um", "deviation_nominal_part", UM),
    *columns(
        "compensated_deviation_x_um compensated_deviation_y_um compensated_deviation_z_um",
        "deviation_compensated_part",
        UM,
    ),
    Column("extrapolated", "extrapolated", whole=True),
    *columns("nominal_fx_n nominal_fy_n nominal_fz_n nominal_mx_nm nominal_my_nm nominal_mz_nm", "w_nominal_part"),
)
MEASURED = columns("measured_x_um measured_y_um measured_z_um", "measured_part", UM)
"""Columns of version 2: plans that measured parts have corrected; all others are written as version 1."""


def plan_table(plan: Plan, axes: ControllerAxes = AS_MODEL) -> pl.DataFrame:
    """A plan as the table that its file holds: one row per path point, shop units, axes of the controller."""
    shown = replace(plan, q=axes.shown(plan.q))
    return table(LAYOUT + MEASURED if plan.measured_part is not None else LAYOUT, shown)


def write_plan(path: Path, plan: Plan, about: Mapping[str, Any], axes: ControllerAxes = AS_MODEL) -> None:
    """Write a plan.

    Args:
        about: Which program, cell and version made it; ``job_hash`` is added to it, and how the controller counts axes
            that are not the angles of the model.
    """
    measured = plan.measured_part is not None
    layout, version = (LAYOUT + MEASURED, VERSION) if measured else (LAYOUT, VERSION - 1)
    counted = {} if axes.matrix is None else {AXES: {"matrix": axes.matrix.tolist(), "zero_rad": axes.zero.tolist()}}
    shown = plan if axes.matrix is None else replace(plan, q=axes.shown(plan.q))
    write(path, KIND, version, layout, shown, {**about, **counted, "job_hash": job_hash(plan)})


def read_plan(path: Path) -> tuple[Plan, dict[str, Any]]:
    """Read a plan and its metadata; its folder must be whole, see ``require_whole``."""
    layout = LAYOUT + MEASURED if is_corrected(path) else LAYOUT
    data, about = read(path, KIND, VERSION, layout)
    require_whole(path.parent)
    tool_path = ToolPath(**{name.removeprefix("path."): data.pop(name) for name in list(data) if "." in name})
    counted = about.get(AXES)
    if counted is not None:
        axes = ControllerAxes(matrix=np.array(counted["matrix"]), zero_rad=np.array(counted["zero_rad"]))
        data["q"] = axes.model(data["q"])
    return Plan(path=tool_path, **data), about


def is_corrected(path: Path) -> bool:
    """Whether a plan file has the columns of version 2; False for what is no plan file."""
    try:
        with file_content.readable(path, "a Parquet file"):
            return MEASURED[0].name in pl.read_parquet_schema(path)
    except FileFormatError:
        return False
