"""The record of a machined program (``counterflex-run``, version 2): one row per controller cycle, Parquet.

Version 1 had no direction of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from counterflex.core.units import DEG, MM, URAD
from counterflex.files.parquet_table import Column, columns, read, write
from counterflex.files.summary_file import require_whole
from counterflex.path.toolpath import Run

KIND = "counterflex-run"
VERSION = 2

LAYOUT = (
    Column("time_s", "time_s"),
    Column("motion", "motion", whole=True),
    Column("kind", "kind", whole=True),
    Column("progress", "progress"),
    *columns("command_x_mm command_y_mm command_z_mm", "p_part_command", MM),
    *columns("x_mm y_mm z_mm", "p_part_tcp", MM),
    *columns("tilt_rx_urad tilt_ry_urad tilt_rz_urad", "tilt_part", URAD),
    *columns("fx_n fy_n fz_n", "force_part"),
    *columns("mx_nm my_nm mz_nm", "moment_part"),
    Column("force_peak_n", "force_peak_n"),
    Column("axial_depth_mm", "depth_m", unit=MM),
    *columns("q1_deg q2_deg q3_deg q4_deg q5_deg q6_deg", "q_motor", DEG),
)
AXIS = columns("axis_x axis_y axis_z", "axis_part")
"""Direction of the tool, from the tip to the spindle: of runs that have it."""


def write_run(path: Path, run: Run, about: Mapping[str, Any]) -> None:
    """Write a run."""
    write(path, KIND, VERSION, LAYOUT if run.axis_part is None else LAYOUT + AXIS, run, about)


def read_run(path: Path) -> tuple[Run, dict[str, Any]]:
    """Read a run and its metadata; its folder must be whole."""
    data, about = read(path, KIND, VERSION, LAYOUT, AXIS)
    require_whole(path.parent)
    return Run(**data), about
