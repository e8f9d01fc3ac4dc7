"""A simulated KUKA controller alone on a real socket: a program's path or a standstill, no physics."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.core.arrays import Float
from counterflex.core.atomic import open_record
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM, US
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose
from counterflex.protocols.kuka_rsi.config import read_config
from counterflex.protocols.system.realtime import prepare
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.devices.applied import Applied
from counterflex.twin.devices.commanded_motion import CommandedMotion
from counterflex.twin.devices.exact_robot import ControlledRobot, ExactRobot, StandingRobot, Standstill
from counterflex.twin.devices.kuka_rsi import FakeRsi, RsiContext
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.robot_server import RobotServer
from counterflex.twin.network.faults import FaultSchedule


@dataclass(frozen=True, eq=False)
class LoneRsiSettings:
    """What a lone controller is started with.

    Attributes:
        rsi: ETHERNET configuration; telegrams go to its IP_NUMBER and PORT.
        program: G-code that it runs, with ``cell``; None stands still.
        cell: Cell file: what the controller has been told of robot, tool and part; None shows any pose beside
            any angles.
        T_part_tcp: (4, 4) where it stands still; with a cell the angles say where.
        q: (6,) rad, angles there.
        seconds: How long it stands still; with a program a limit, or None.
        peer: Where telegrams go instead, or None.
        realtime: Keep real time; else lockstep.
        wait_s: How long it waits for the sensor program; 0 does not wait.
        gate_s: How long the robot program waits before it starts.
        answer_s: Real time: how long an answer may take, or None for the whole cycle.
        context: Settings of RSI on the controller.
        answer: How the controller answers corrections.
        faults: Scripted.
    """

    rsi: Path
    program: Path | None = None
    cell: Path | None = None
    T_part_tcp: Float = field(default_factory=lambda: np.eye(4))
    q: Float = field(default_factory=lambda: np.zeros(6))
    seconds: float | None = 10.0
    peer: tuple[str, int] | None = None
    realtime: bool = False
    wait_s: float = 60.0
    gate_s: float = 0.8
    answer_s: float | None = None
    context: RsiContext = field(default_factory=lambda: RsiContext(timeout=100))
    answer: PathAnswer = field(default_factory=PathAnswer)
    faults: FaultSchedule = field(default_factory=FaultSchedule)


def run(
    settings: LoneRsiSettings,
    *,
    record: Path | None = None,
    started: Callable[[tuple[str, int], tuple[str, int]], None] = lambda *_: None,
    priority: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run the controller until its program has ended or it has stopped.

    Args:
        settings: See :class:`LoneRsiSettings`.
        record: CSV file of every cycle, or None; written as it goes.
        started: Told from where telegrams come and where they go.
        priority: Take real-time priority for this process, where it is allowed.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Summary: cycles, why it ended, late and refused answers, largest correction and step, ages, reply times.

    Raises:
        InputError: The settings contradict each other.
        FileFormatError: A file cannot be used.
        OutputError: No sensor program answers, or the record cannot be written.
    """
    config = read_config(settings.rsi)
    rsi = FakeRsi(config, settings.context)
    period_s = settings.context.cycle_s
    robot = robot_of(settings)
    most = None
    if settings.program is not None and settings.seconds is not None:
        most = max(1, round(settings.seconds / period_s))
    with contextlib.ExitStack() as stack:
        server = RobotServer(
            robot,
            rsi,
            settings.peer if settings.peer is not None else (config.host, config.port),
            realtime=settings.realtime,
            waiting_s=settings.wait_s,
            gate_cycles=round(settings.gate_s / period_s),
            answer_s=settings.answer_s,
            faults=settings.faults,
            observe=lambda seen: applied.see(seen),
        )
        stack.callback(server.close)
        started(server.address, server.peer)
        if priority:
            prepare()
        server.meet()  # before anything is written
        applied = Applied(None if record is None else stack.enter_context(open_record(record, encoding="ascii")))
        why = server.run(after=0, most_cycles=most, progress=progress)
    return {
        "job": "twin rsi",
        "ended": why,
        "cycles": server.cycles,
        "late_answers": rsi.late,
        "stalls": server.stalls,
        **summary_of(applied),
        "seed": settings.faults.seed,
        "counterflex": __version__,
    }


def summary_of(applied: Applied) -> dict[str, Any]:
    """Figures of what a controller applied, in shop units."""
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


def robot_of(settings: LoneRsiSettings) -> ControlledRobot:
    """The robot of the settings: it runs their program, or stands still.

    Raises:
        InputError: The settings contradict each other.
    """
    period_s = settings.context.cycle_s
    if settings.program is not None and settings.cell is None:
        raise InputError("a program needs the cell it runs in", value=settings.program.name, hint="Give --cell")
    if settings.program is None or settings.cell is None:
        if settings.seconds is None:
            raise InputError("how long the robot stands still is not said", hint="Give --seconds")
        T_part_tcp = settings.T_part_tcp
        if settings.cell is not None:  # pose and angles of the same telegram belong together
            standing = read_cell(settings.cell)
            T_part_tcp = pose.inverse(standing.T_base_part) @ forward(standing.controller_chain, settings.q)
        place = Standstill(T_part_tcp, settings.q, settings.seconds)
        return StandingRobot(place, period_s, settings.answer)
    cell = read_cell(settings.cell)
    return running_robot(cell, settings.program, period_s, settings.answer)


def running_robot(cell: Cell, program: Path, period_s: float, answer: PathAnswer) -> ExactRobot:
    """A robot without physics that runs a program in a cell.

    Args:
        cell: What the controller has been told.
        program: G-code.
        period_s: Cycle.
        answer: How the controller answers corrections.
    """
    job = read_job(program, cell)
    controller = replace(simulate.controller(cell), cycle_s=period_s)
    return ExactRobot(CommandedMotion(job.machined, controller, answer))
