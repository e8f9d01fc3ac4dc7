"""A simulated robot controller alone on a real socket: what KUKA and ABB have in common."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.core.atomic import open_record
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM, US
from counterflex.files.cell.cell import Cell
from counterflex.protocols.system.realtime import prepare
from counterflex.twin.devices.applied import Applied
from counterflex.twin.devices.commanded_motion import CommandedMotion, RobotController
from counterflex.twin.devices.exact_robot import ControlledRobot, ExactRobot
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.robot_server import CycleSeen, RobotServer, Timing
from counterflex.twin.network.faults import FaultSchedule

Address = tuple[str, int]


@dataclass(frozen=True, eq=False, kw_only=True)
class LoneController:
    """Settings of a lone controller of any protocol."""

    program: Path | None = None  # G-code that it runs in ``cell``
    cell: Path | None = None  # Cell file: what the controller has been told of robot, tool and part
    peer: Address | None = None  # Where telegrams go
    seconds: float | None = None  # Limit, or None
    timing: Timing = field(default_factory=Timing)  # How it keeps time
    answer: PathAnswer = field(default_factory=PathAnswer)  # How it answers a correction of its path
    faults: FaultSchedule = field(default_factory=FaultSchedule)  # Scripted

    def serve(
        self,
        robot: ControlledRobot,
        controller: RobotController,
        peer: Address,
        watched: Watched,
        *,
        most_cycles: int | None,
        see: Callable[[CycleSeen], None] = lambda _: None,
    ) -> tuple[RobotServer, dict[str, Any]]:
        """Run a controller until its program has ended or it has stopped.

        Args:
            robot: That it drives.
            controller: Its side of the protocol.
            peer: Where telegrams go.
            most_cycles: Limit, or None.

        Returns:
            The server, and figures of what was applied.

        Raises:
            OutputError: No sensor program answers, or the record cannot be written.
        """
        with contextlib.ExitStack() as stack:
            server = RobotServer(
                robot,
                controller,
                peer,
                timing=self.timing,
                faults=self.faults,
                observe=lambda seen: _observe(applied, see, seen),
            )
            stack.callback(server.close)
            watched.started(server.address, server.peer)
            if self.timing.realtime:
                prepare()
            server.meet()  # before anything is written
            record = watched.record
            applied = Applied(None if record is None else stack.enter_context(open_record(record, encoding="ascii")))
            server.run(after=0, most_cycles=most_cycles, progress=watched.progress)
        return server, _figures(applied)


@dataclass(frozen=True)
class Watched:
    """Callbacks and record of a lone controller."""

    record: Path | None = None  # CSV file of every cycle, or None; written as it goes
    started: Callable[[Address, Address], None] = lambda *_: None  # Told from where telegrams come and where they go
    progress: Progress = silent  # Progress callback, fraction 0 to 1


def _observe(applied: Applied, see: Callable[[CycleSeen], None], seen: CycleSeen) -> None:
    applied.see(seen)
    see(seen)


def _figures(applied: Applied) -> dict[str, Any]:
    """Return what a controller applied, in shop units."""
    reply = np.asarray(applied.reply_s, dtype=np.float64) / US
    quantiles = np.quantile(reply, [0.5, 0.99, 0.999, 1.0], method="higher") if len(reply) else np.full(4, np.nan)
    return {
        "refused": dict(sorted(applied.refused.items())),
        "clamped_cycles": applied.clamped,
        "largest_correction": {
            "mm": round(applied.correction_m / MM, 6),
            "deg": round(applied.correction_rad / DEG, 6),
            "axes_deg": round(applied.axes_rad / DEG, 6),
        },
        "largest_step": {
            "mm": round(applied.step_m / MM, 6),
            "deg": round(applied.step_rad / DEG, 6),
            "axes_deg": round(applied.step_axes_rad / DEG, 6),
        },
        "age_cycles": {
            "max": max(applied.ages, default=0),
            "share_at_most_4": round(applied.young(4), 8),
        },
        "reply_us": None
        if not len(reply)
        else dict(zip(("p50", "p99", "p999", "max"), (round(float(v), 1) for v in quantiles), strict=True)),
    }


def running_robot(cell: Cell, program: Path, period_s: float, answer: PathAnswer) -> ExactRobot:
    """A robot without physics that runs a program in a cell.

    Args:
        cell: What the controller has been told.
        answer: How the controller answers corrections.
    """
    job = read_job(program, cell)
    controller = replace(simulate.controller(cell), cycle_s=period_s)
    return ExactRobot(CommandedMotion(job.machined, controller, answer))
