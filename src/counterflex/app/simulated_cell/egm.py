"""A simulated ABB controller alone on a real socket: a path that is corrected or streamed to it, no physics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.simulated_cell.alone import Address, LoneController, Watched, running_robot, serve
from counterflex.app.simulated_cell.controllers import egm_controller
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.twin.devices.robot_server import CycleSeen

_ROBOT_S = 4e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class LoneEgm(LoneController):
    """An ABB controller alone, in a cell with the tables ``[online]`` and ``[egm]``.

    Attributes:
        program: G-code that it runs; guided by poses, the path that it is judged by.
        cell: Cell file.
        peer: Where messages go.
        robotware: 6 or 7.
        force: (6,) N, N m that the robot measures itself, or None.
        timeout_s: CommTimeout, or None for the cell's.
        dead_s: Dead time of guidance.
    """

    program: Path
    cell: Path
    peer: Address
    robotware: int = 7
    force: Float | None = None
    timeout_s: float | None = None
    dead_s: float = 12e-3


def run(settings: LoneEgm, watched: Watched) -> dict[str, Any]:
    """Run the controller until its program has ended or it has stopped.

    Args:
        settings: See :class:`LoneEgm`.
        watched: See there.

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
        step = seen.report.T_part_actual[:3, 3] - seen.report.T_part_nominal[:3, 3]
        shift[0] = max(shift[0], float(np.linalg.norm(step)))

    server, figures = serve(settings, robot, egm, settings.peer, watched, most_cycles=most, see=see)
    return {
        "job": "twin egm",
        "mode": egm.context.mode,
        "ended": server.stop_reason,
        "cycles": server.cycles,
        "late_answers": egm.late,
        "largest_shift_mm": round(shift[0] / MM, 4),
        **figures,
        "seed": settings.faults.seed,
        "counterflex": __version__,
    }
