"""A simulated ABB controller, in the simulated cell or alone on a real socket: a path corrected or streamed."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.robot_axes import axes_in
from counterflex.app.run.robot_links import ControllerOrder, SimulatedController
from counterflex.app.simulated_cell.alone import Address, LoneController, Watched, running_robot
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MS
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.links import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import pose
from counterflex.integrations.abb.simulated import EgmContext, FakeEgm
from counterflex.twin.devices.robot_server import CycleSeen

_ROBOT_S = 4e-3


def egm_controller(cell: Cell, robotware: int = 7, **changes: Any) -> FakeEgm:
    """An ABB controller with the settings of the tables ``[egm]`` and ``[online]`` of a cell.

    MaxSpeedDeviation limits joints; here it limits the tool, by the distance of the part from the robot's first axis.

    Args:
        robotware: 6 or 7.
        changes: Further fields of :class:`counterflex.integrations.abb.simulated.EgmContext`, instead of the cell's.

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


def controller(order: ControllerOrder) -> SimulatedController:
    """Controller of the simulated cell."""
    egm = egm_controller(order.cell)
    address = ("127.0.0.1", (order.cell.tables.egm or EgmTable()).port)
    return SimulatedController(egm, address, functools.partial(setattr, egm, "force"))


class LargestShift:
    """Largest distance of the tool from its program."""

    largest_m = 0.0

    def see(self, seen: CycleSeen) -> None:
        """Take a cycle."""
        step = seen.report.T_part_actual[:3, 3] - seen.report.T_part_nominal[:3, 3]
        self.largest_m = max(self.largest_m, float(np.linalg.norm(step)))


@dataclass(frozen=True, eq=False, kw_only=True)
class LoneEgm(LoneController):
    """An ABB controller alone, in a cell with the tables ``[online]`` and ``[egm]``."""

    program: Path  # G-code that it runs; guided by poses, the path that it is judged by
    cell: Path  # Cell file
    peer: Address  # Where messages go
    robotware: int = 7  # 6 or 7
    force: Float | None = None  # (6,) N, N m that the robot measures itself, or None
    timeout_s: float | None = None  # CommTimeout, or None for the cell's
    dead_s: float = 12e-3  # Dead time of guidance

    def run(self, watched: Watched) -> dict[str, Any]:
        """Run the controller until its program has ended or it has stopped.

        Returns:
            Summary: messages, why it ended, cycles without a usable one, largest distance of the tool from its program.

        Raises:
            InputError: The settings contradict each other.
            FileFormatError: A file cannot be used.
            OutputError: No sensor program answers, or the record cannot be written.
        """
        cell = read_cell(self.cell)
        changes: dict[str, Any] = {"dead_s": self.dead_s}
        if self.timeout_s is not None:
            changes["timeout_s"] = self.timeout_s
        egm = egm_controller(cell, self.robotware, **changes)
        egm.force = self.force
        robot = running_robot(cell, self.program, _ROBOT_S, self.answer)
        most = None if self.seconds is None else max(1, round(self.seconds / egm.cycle_s))
        shift = LargestShift()
        server, figures = self.serve(robot, egm, self.peer, watched, most_cycles=most, see=shift.see)
        return {
            "job": "twin egm",
            "mode": egm.context.mode,
            "ended": server.stop_reason,
            "cycles": server.cycles,
            "late_answers": egm.late,
            "largest_shift_mm": round(shift.largest_m / MM, 4),
            **figures,
            "seed": self.faults.seed,
            "counterflex": __version__,
        }


def alone(watched: Watched, **settings: Any) -> dict[str, Any]:
    """As :func:`run`, with the settings by name."""
    return LoneEgm(**settings).run(watched)
