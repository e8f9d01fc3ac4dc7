"""The simulated controller that a cell is started with: KUKA RSI by its configuration, ABB EGM by the cell file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.robot_axes import axes_in
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MS
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.egm import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import pose
from counterflex.protocols.kuka_rsi.config import read_config
from counterflex.twin.devices.abb_egm import EgmContext, FakeEgm
from counterflex.twin.devices.kuka_rsi import FakeRsi, RsiContext
from counterflex.twin.plant.drives import MotorCurrents

Address = tuple[str, int]


def which(rsi: Path | None, egm: Address | None) -> None:
    """Check that a controller's protocol is chosen.

    Raises:
        InputError: None or both are.
    """
    if (rsi is None) == (egm is None):
        raise InputError(
            "the controller's protocol is not clear",
            value="none" if rsi is None else "both",
            limit="one of RSI and EGM",
            hint="Give --rsi FILE for a KUKA controller, --egm HOST:PORT for an ABB one",
        )


def rsi_controller(config: Path, context: RsiContext, *, seed: int = 0, job: int = 0) -> tuple[FakeRsi, Address]:
    """A KUKA controller, and where its telegrams go by its configuration.

    Args:
        config: ETHERNET configuration file.
        context: Settings of RSI on the controller.
        seed: Of its motors' torque constants.
        job: Number that its program says; 0: none.
    """
    parsed = read_config(config)
    return FakeRsi(parsed, context, currents=MotorCurrents(seed), job=job), (parsed.host, parsed.port)


def egm_controller(cell: Cell, robotware: int = 7, **changes: Any) -> FakeEgm:
    """An ABB controller with the settings of the tables ``[egm]`` and ``[online]`` of a cell.

    MaxSpeedDeviation limits joints; here it limits the tool, by the distance of the part from the robot's first axis.

    Args:
        cell: See there.
        robotware: 6 or 7.
        changes: Further fields of :class:`counterflex.twin.devices.abb_egm.EgmContext`, instead of the cell's.

    Raises:
        InputError: EGM cannot run in the cycle of the table ``[online]``.
    """
    table, online = cell.tables.egm or EgmTable(), cell.tables.online or OnlineTable()
    table.require(online, str(cell.path))
    turn = table.speed_deviation_deg_s * DEG
    reach = float(np.hypot(*cell.T_base_part[:2, 3]))
    context = EgmContext(
        mode=table.mode,
        cycle_s=online.period_ms * MS,
        timeout_s=table.timeout_ms * MS,
        robotware=robotware,
        gain_per_s=table.position_gain_per_s,
        low_pass_hz=table.low_pass_hz,
        speed_m_s=turn * max(reach, 0.1),
        turn_rad_s=turn,
        ramp_in_s=table.ramp_in_ms * MS,
        window_m=table.window_mm * MM,
        window_rad=table.window_deg * DEG,
        condition_s=table.standing_s,
        axes=axes_in(cell, "rapid")[0],
    )
    T_part_frame = None if table.frame == "part" else pose.inverse(cell.T_base_part)
    return FakeEgm(replace(context, **changes), T_part_frame)
