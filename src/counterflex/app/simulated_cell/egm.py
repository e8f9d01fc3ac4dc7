"""A simulated ABB controller alone on a real socket: a path that is corrected or streamed to it, no physics."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.simulated_cell.controllers import egm_controller
from counterflex.app.simulated_cell.rsi import running_robot, summary_of
from counterflex.core.arrays import Float
from counterflex.core.atomic import open_record
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.twin.devices.applied import Applied
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.robot_server import CycleSeen, RobotServer
from counterflex.twin.network.faults import FaultSchedule

_ROBOT_S = 4e-3


@dataclass(frozen=True, eq=False)
class LoneEgmSettings:
    """What a lone ABB controller is started with.

    Attributes:
        program: G-code that it runs; guided by poses, the path that it is judged by.
        cell: Cell file with the tables ``[online]`` and ``[egm]``.
        peer: Where messages go.
        robotware: 6 or 7.
        force: (6,) N, N m that the robot measures itself, or None.
        timeout_s: CommTimeout, or None for the cell's.
        dead_s: Dead time of guidance.
        answer: How the controller answers a correction of its path.
        seconds: Limit, or None.
        realtime: Keep real time; else lockstep.
        patience_s: Lockstep: how long an answer may take.
        wait_s: How long it waits for the sensor program; 0 does not wait.
        gate_s: Rest before the movement starts.
        faults: Scripted.
    """

    program: Path
    cell: Path
    peer: tuple[str, int]
    robotware: int = 7
    force: Float | None = None
    timeout_s: float | None = None
    dead_s: float = 12e-3
    answer: PathAnswer = field(default_factory=PathAnswer)
    seconds: float | None = None
    realtime: bool = False
    patience_s: float = 5.0
    wait_s: float = 60.0
    gate_s: float = 3.0
    faults: FaultSchedule = field(default_factory=FaultSchedule)


def run(
    settings: LoneEgmSettings,
    *,
    record: Path | None = None,
    started: Callable[[tuple[str, int], tuple[str, int]], None] = lambda *_: None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run the controller until its program has ended or it has stopped.

    Args:
        settings: See :class:`LoneEgmSettings`.
        record: CSV file of every cycle, or None; written as it goes.
        started: Told from where messages come and where they go.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Summary: messages, why it ended, cycles without a usable one, largest distance of the tool from its program.

    Raises:
        InputError: The settings contradict each other.
        FileFormatError: A file cannot be used.
        OutputError: No sensor program answers, or the record cannot be written.
    """
    cell = read_cell(settings.cell)
    changes: dict[str, Any] = {"dead_s": settings.dead_s}
    if settings.timeout_s is not None:
        changes["timeout_s"] = settings.timeout_s
    egm = egm_controller(cell, settings.robotware, **changes)
    egm.force = settings.force
    robot = running_robot(cell, settings.program, _ROBOT_S, settings.answer)
    most = None if settings.seconds is None else max(1, round(settings.seconds / egm.cycle_s))
    shift = [0.0]

    def see(seen: CycleSeen) -> None:
        applied.see(seen)
        step = seen.report.T_part_actual[:3, 3] - seen.report.T_part_nominal[:3, 3]
        shift[0] = max(shift[0], float(np.linalg.norm(step)))

    with contextlib.ExitStack() as stack:
        server = RobotServer(
            robot,
            egm,
            settings.peer,
            realtime=settings.realtime,
            patience_s=settings.patience_s,
            waiting_s=settings.wait_s,
            gate_cycles=round(settings.gate_s / egm.cycle_s),
            faults=settings.faults,
            observe=see,
        )
        stack.callback(server.close)
        started(server.address, server.peer)
        server.meet()  # before anything is written
        applied = Applied(None if record is None else stack.enter_context(open_record(record, encoding="ascii")))
        why = server.run(after=0, most_cycles=most, progress=progress)
    return {
        "job": "twin egm",
        "mode": egm.context.mode,
        "ended": why,
        "cycles": server.cycles,
        "late_answers": egm.late,
        "largest_shift_mm": round(shift[0] / MM, 4),
        **summary_of(applied),
        "seed": settings.faults.seed,
        "counterflex": __version__,
    }
