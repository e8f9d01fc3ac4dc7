"""The record of a machined program (``counterflex-run``, version 1): one row per controller cycle, Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from counterflex.core.arrays import Float, Int
from counterflex.core.units import DEG, MM, URAD
from counterflex.files.parquet_table import Column, columns, read, write

KIND = "counterflex-run"
VERSION = 1

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


@dataclass(frozen=True, eq=False)
class Run:
    """What a machining recorded, however it was machined; n rows, part axes, SI.

    Attributes:
        time_s: (n,) controller time; stretches of air may be left out.
        motion: (n,) program motion.
        kind: (n,) RAPID or FEED.
        progress: (n,) share 0..1 of the program's path length that is done.
        p_part_command: (n, 3) m, interpolated set-point.
        p_part_tcp: (n, 3) m, where the tool tip was.
        tilt_part: (n, 3) rad, from the commanded to the true orientation.
        force_part: (n, 3) N, mean force on the tool.
        moment_part: (n, 3) N m.
        force_peak_n: (n,) N.
        depth_m: (n,) m, engaged axial depth, 0 in air.
        q_motor: (n, 6) rad.
    """

    time_s: Float
    motion: Int
    kind: Int
    progress: Float
    p_part_command: Float
    p_part_tcp: Float
    tilt_part: Float
    force_part: Float
    moment_part: Float
    force_peak_n: Float
    depth_m: Float
    q_motor: Float


def write_run(path: Path, run: Any, about: Mapping[str, Any]) -> None:
    """Write a run (any object with the attributes of :class:`Run`)."""
    write(path, KIND, VERSION, LAYOUT, run, about)


def read_run(path: Path) -> tuple[Run, dict[str, Any]]:
    """Read a run and its metadata. Raises FileFormatError as :func:`counterflex.files.parquet_table.read`."""
    data, about = read(path, KIND, VERSION, LAYOUT)
    return Run(**data), about
