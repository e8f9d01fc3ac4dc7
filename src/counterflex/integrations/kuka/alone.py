"""A simulated KUKA controller, in the simulated cell or alone on a real socket: a program's path or a standstill."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.robot_axes import axes_in
from counterflex.app.run.robot_links import ControllerOrder, SimulatedController
from counterflex.app.simulated_cell.alone import LoneController, Watched, running_robot
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MS
from counterflex.files.cell.cell import read_cell
from counterflex.files.scenario_file import RsiTable
from counterflex.geometry import pose
from counterflex.integrations.kuka.link.config import read_config
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.devices.exact_robot import ControlledRobot, StandingRobot, Standstill
from counterflex.twin.plant.drives import MotorCurrents


def rsi_context(table: RsiTable) -> RsiContext:
    """RSI on a KUKA controller."""
    return RsiContext(
        mode=table.mode,
        cycle_s=table.cycle_ms * MS,
        timeout=table.timeout,
        precision=table.precision,
        clamp_m=table.clamp_mm * MM,
        clamp_rad=table.clamp_deg * DEG,
        monitor_m=table.monitor_mm * MM,
        monitor_rad=table.monitor_deg * DEG,
        axis_clamp_rad=table.axis_clamp_deg * DEG,
        empty_first=table.empty_first,
    )


def controller(order: ControllerOrder) -> SimulatedController:
    """Controller of the simulated cell: its telegrams go where its configuration says."""
    assert order.file is not None
    config = read_config(order.file)
    context = replace(rsi_context(order.scenario.rsi), axes=axes_in(order.cell, "krl")[0])
    rsi = FakeRsi(config, context, currents=MotorCurrents(order.seed), job=order.job)
    return SimulatedController(rsi, (config.host, config.port))


@dataclass(frozen=True, eq=False, kw_only=True)
class LoneRsi(LoneController):
    """A KUKA controller alone; without a program it stands still, without a cell any pose goes with any angles."""

    rsi: Path  # ETHERNET configuration; telegrams go to its IP_NUMBER and PORT where ``peer`` is None
    # (4, 4) where it stands still; with a cell the angles say where
    T_part_tcp: Float = field(default_factory=lambda: np.eye(4))
    q: Float = field(default_factory=lambda: np.zeros(6))  # (6,) rad, angles there
    seconds: float | None = 10.0
    context: RsiContext = field(default_factory=lambda: RsiContext(timeout=100))  # Settings of RSI on the controller

    def run(self, watched: Watched) -> dict[str, Any]:
        """Run the controller until its program has ended or it has stopped.

        Returns:
            Summary: cycles, why it ended, late and refused answers, largest correction and step, ages, reply times.

        Raises:
            InputError: The settings contradict each other.
            FileFormatError: A file cannot be used.
            OutputError: No sensor program answers, or the record cannot be written.
        """
        config = read_config(self.rsi)
        rsi = FakeRsi(config, self.context)
        most = None
        if self.program is not None and self.seconds is not None:
            most = max(1, round(self.seconds / self.context.cycle_s))
        peer = self.peer if self.peer is not None else (config.host, config.port)
        server, figures = self.serve(self.robot(), rsi, peer, watched, most_cycles=most)
        return {
            "job": "twin rsi",
            "ended": server.stop_reason,
            "cycles": server.cycles,
            "late_answers": rsi.late,
            "stalls": server.stalls,
            **figures,
            "seed": self.faults.seed,
            "counterflex": __version__,
        }

    def robot(self) -> ControlledRobot:
        """The robot of the settings: it runs their program, or stands still.

        Raises:
            InputError: The settings contradict each other.
        """
        period_s = self.context.cycle_s
        if self.program is not None and self.cell is None:
            raise InputError("a program needs the cell it runs in", value=self.program.name, hint="Give --cell")
        if self.program is None or self.cell is None:
            if self.seconds is None:
                raise InputError("the duration of the standstill is missing", hint="Give --seconds")
            T_part_tcp = self.T_part_tcp
            if self.cell is not None:  # pose and angles of the same telegram belong together
                standing = read_cell(self.cell)
                T_part_tcp = pose.inverse(standing.T_base_part) @ forward(standing.controller_chain, self.q)
            place = Standstill(T_part_tcp, self.q, self.seconds)
            return StandingRobot(place, period_s, self.answer)
        cell = read_cell(self.cell)
        return running_robot(cell, self.program, period_s, self.answer)


def alone(watched: Watched, *, table: RsiTable, **settings: Any) -> dict[str, Any]:
    """As :func:`run`, with the table of the scenario and the settings by name."""
    return LoneRsi(context=rsi_context(table), **settings).run(watched)
