"""KRL programs of a cell: what a program is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import part_in_world, pose_text
from counterflex.app.robot_programs import numbered_facts
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.writer import (
    KrlSettings,
    KrlWords,
    KrlWriter,
    krl_frames,
    krl_pose,
)
from counterflex.programs.convert.emitter import Conversion, turn_deg
from counterflex.programs.convert.robot_languages import FLAT_M, RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Program
from counterflex.report.data import Fact

_NEARLY_WHOLE_DEG: Final = 340.0


class KrlEmitter(KrlWords, RobotEmitter[KrlSettings]):
    """KUKA KRL: PTP, LIN, CIRC."""

    def frames(self, tool: int) -> None:
        """$TOOL, $BASE, speeds."""
        self.lines += krl_frames(self.settings, tool)
        self._velocity = ""

    def _set(self, speed_m_s: float) -> None:
        text = number(speed_m_s, 8).rstrip("0")
        text = f"{text}0" if text.endswith(".") else text
        if text != self._velocity:
            self._velocity = text
            self.lines.append(f"$VEL.CP={text}")

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """PTP or LIN."""
        if not free:
            self._set(speed_m_s)
        self.lines.append(f"{'PTP' if free else 'LIN'} {{{krl_pose(T_part_tcp)}}}{self._behind(free=free)}")

    def _behind(self, *, free: bool = False) -> str:
        return "" if self.exact or self.first else " C_PTP" if free else " C_DIS"

    def arc_shares(self, move: Move) -> list[float] | None:
        """One CIRC; a helix becomes straight moves."""
        return None if abs(move.rise_m) > FLAT_M else [1.0]

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """CIRC through the middle, or by CA where the circle is nearly whole."""
        self._set(self._speed(move))
        angle = turn_deg(move) * (end_share - start_share)
        whole = angle > _NEARLY_WHOLE_DEG
        middle, last = (120.0 / angle, 240.0 / angle) if whole else (0.5, 1.0)
        poses = [krl_pose(pose.make(self.orientation(move, 1.0), move.at(share))) for share in (middle, last)]
        turns = f",CA {number(angle, 6)}" if whole else ""
        self.lines.append(f"CIRC {{{poses[0]}}},{{{poses[1]}}}{turns}{self._behind()}")


def cell_of(cell: Cell) -> KrlCell:
    """Return the cell as the reader of KRL needs it; refuse a cell whose robot holds the part."""
    return KrlCell(**numbered_facts(cell, "krl", "KRL"))


def _settings(program: Program, cell: Cell, common: dict[str, Any]) -> KrlSettings:
    controller = cell.tables.controller
    return KrlSettings(
        **common,
        tool=controller.tool_number,
        base=controller.base_number,
        acc_m_s2=controller.acceleration_m_s2,
        blend_m=controller.blending_m,
        tool_data={tool: int(value) for tool, value in tool_data(program, cell, "krl").items()},
        fixed_tool=cell.holds_part,
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language in KRL."""
    settings = _settings(order.job.program, order.cell, writer_settings(order, "krl"))
    return robot_text(order, KrlWriter, settings, "krl")


def convert(order: Conversion) -> KrlEmitter:
    """Return the writer of a conversion."""
    settings = _settings(order.program, order.cell, emitter_settings(order))
    return KrlEmitter(order.program, settings, order.cell.machine_functions("krl"), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files, BASE_DATA and TOOL_DATA that a program needs."""
    controller = cell.tables.controller
    base, tool = f"BASE_DATA[{controller.base_number}]", f"TOOL_DATA[{controller.tool_number}]"
    if cell.holds_part:
        return against_fixed_tool(files, cell, (base, tool))
    frame = pose_text(cell.controller_chain.T_flange_tcp)
    return (
        Fact("Copy", files, "", "to KRC:\\R1\\Program, all of them"),
        Fact(base, pose_text(part_in_world(cell, "krl")), "mm, deg", "the part frame that was planned with"),
        *tool_frames(cell, "krl", tools, frame=frame, other=tool, form="TOOL_DATA[{}]"),
    )
