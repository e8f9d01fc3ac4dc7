"""INFORM jobs of a cell: what a job is held against, what is written for one, and what must be set."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final

import numpy as np

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import axes_in, part_in_world
from counterflex.app.robot_programs import numbered_facts, refuse_held_part
from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.geometry.circle import angle_to, circle, turned
from counterflex.integrations.yaskawa.language.frames import InformCell
from counterflex.integrations.yaskawa.language.program import DIALECT, rconf, speed_text, values_of
from counterflex.integrations.yaskawa.language.writer import (
    InformSettings,
    InformWords,
    InformWriter,
    inform_motion,
    written_pose,
)
from counterflex.programs.convert.emitter import Conversion, turn_deg
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.kinematics.inverse_seeds import branch_of

_FLAT_M: Final = 1e-7
_HALF_DEG: Final = 180.0
_MOST_PIECES: Final = 12
_WITHIN_M: Final = 0.9 * UM  # Largest distance of a written arc from the programmed one: positions are rounded to 1 um


class InformEmitter(InformWords, RobotEmitter[InformSettings]):
    """INFORM: MOVJ, MOVL, MOVC."""

    dwell_decimals: ClassVar[int] = 2

    def __init__(
        self, program: Program, settings: InformSettings, functions: MachineFunctions, tolerance_m: float
    ) -> None:
        super().__init__(program, settings, functions, tolerance_m)
        self._in_arc = False

    def _count(self) -> None:
        """A job begins with no arc to go on with."""
        cuts = len(self._cuts)
        super()._count()
        self._in_arc = self._in_arc and len(self._cuts) == cuts

    def straight(self, move: Move, share: float) -> None:
        """MOVJ or MOVL: no arc goes on behind it."""
        super().straight(move, share)
        self._in_arc = False

    def _append(self, T_part_tcp: Float, rest: str) -> None:
        self.lines.append(inform_motion(self.settings, self.tool, "MOVC", T_part_tcp, rest))

    def arc_shares(self, move: Move) -> list[float] | None:
        """Pieces through whose rounded points the circle stays; a helix becomes straight moves."""
        if abs(move.rise_m) > _FLAT_M:
            return None
        least = max(1, math.ceil(turn_deg(move) / _HALF_DEG - 1e-6))
        for count in range(least, least + _MOST_PIECES):
            ends = [k / count for k in range(count + 1)]
            if all(self._keeps(move, a, b) for a, b in itertools.pairwise(ends)):
                return ends[1:]
        return None

    def _keeps(self, move: Move, a: float, b: float) -> bool:
        """Return whether the circle through the rounded points of a piece has its middle where it was."""
        points = [written_pose(pose.make(p=move.at(share)))[:3, 3] for share in (a, 0.5 * (a + b), b)]
        parts = circle(*points)
        if parts is None:
            return False
        angle = angle_to(points[0], points[2], *parts)
        middle = turned(points[0], *parts, 0.5 * angle)
        return float(np.linalg.norm(middle - move.at(0.5 * (a + b)))) < _WITHIN_M

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """MOVC: at its start, unless an arc ends there, in the middle, and at its end."""
        speed = f"V={speed_text(self._speed(move))}"
        on_the_way = f"{speed} PL=0" if self.first else speed
        middle, end = self.through(move, start_share, end_share)
        if not self._in_arc:
            R = move.R_part_start if start_share == 0.0 else self.orientation(move, start_share)
            self._append(pose.make(R, move.at(start_share)), on_the_way)
        self._append(middle, on_the_way)
        self._append(end, f"{speed}{' PL=0' if self.exact or self.first else ''} FPT")
        self._in_arc = True


def cell_of(cell: Cell) -> InformCell:
    """Return the cell as the reader of jobs needs it; refuse a cell whose robot holds the part."""
    own = cell.tables.robot.controller_axes
    pulses = () if own is None or own.pulses_per_deg is None else own.pulses_per_deg
    return InformCell(**numbered_facts(cell, DIALECT, "INFORM"), pulses_per_deg=pulses)


def configurations(cell: Cell, start: str | Float) -> Callable[[Float], str]:
    """Return RCONF of tool poses (4, 4) m in the part frame that follow each other.

    Args:
        start: Posture of the first one, such as ``front up noflip``, or (6,) rad, angles of the model near it.

    Raises:
        InputError: Nothing says how the controller counts the axes of this robot.
    """
    axes, _ = axes_in(cell, DIALECT)
    chain, near = cell.controller_chain, [start]

    def configuration(T_part_tcp: Float) -> str:
        q = inverse(chain, cell.T_base_part @ T_part_tcp, near[0], sigma_floor=0.0).q
        near[0] = q
        return rconf(branch_of(chain, q), np.asarray(axes.shown(q)).tolist())

    return configuration


def _settings(program: Program, cell: Cell, common: dict[str, Any], start: str | Float) -> InformSettings:
    refuse_held_part(cell, "INFORM")
    return InformSettings(
        **common,
        configuration=configurations(cell, start),
        T_world_part=part_in_world(cell, DIALECT),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        tool=cell.tables.controller.tool_number,
        base=cell.tables.controller.base_number,
        tool_data={tool: int(value) for tool, value in tool_data(program, cell, DIALECT).items()},
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language as a job."""
    refuse_held_part(order.cell, "INFORM")
    common = writer_settings(order, DIALECT, moving=False)
    settings = _settings(order.job.program, order.cell, common, np.asarray(order.plan.q[0]))
    return robot_text(order, InformWriter, settings, DIALECT)


def convert(order: Conversion) -> InformEmitter:
    """Return the writer of a conversion."""
    start = order.cell.tables.posture.branch
    settings = _settings(order.program, order.cell, emitter_settings(order), start)
    settings.check()
    return InformEmitter(order.program, settings, order.cell.machine_functions(DIALECT), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files, user frame and tool file that a job needs."""
    if cell.holds_part:
        return against_fixed_tool(files, cell)
    part, tip = (_shown(T) for T in (part_in_world(cell, DIALECT), cell.controller_chain.T_flange_tcp))
    controller = cell.tables.controller
    return (
        Fact("Load", files, "", "as jobs (JBI), all of them"),
        Fact(f"UF#({controller.base_number})", part, "mm, deg", "X Y Z Rx Ry Rz, the part frame that was planned with"),
        *tool_frames(cell, DIALECT, tools, frame=tip, other=f"TOOL {controller.tool_number}", form="TOOL {}"),
    )


def _shown(T: Float) -> str:
    return ", ".join(f"{value:.{3 if k < 3 else 4}f}" for k, value in enumerate(values_of(T)))
