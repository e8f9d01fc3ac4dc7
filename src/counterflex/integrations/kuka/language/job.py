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
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWords, KrlWriter, krl_frames
from counterflex.programs.convert.emitter import Conversion, turn_deg
from counterflex.programs.convert.robot_languages import FLAT_M, RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Program
from counterflex.report.data import Fact

_NEARLY_WHOLE_DEG: Final = 340.0


class KrlEmitter(KrlWords, RobotEmitter[KrlSettings]):
    """A converted program in KRL."""

    _velocity = ""

    def frames(self, tool: int) -> list[str]:
        """$TOOL, $BASE, speeds."""
        self._velocity = ""
        return krl_frames(self.settings, tool)

    def velocity(self, speed_m_s: float) -> list[str]:
        """$VEL.CP as it is, up to eight decimals."""
        text = number(speed_m_s, 8).rstrip("0")
        before, self._velocity = self._velocity, f"{text}0" if text.endswith(".") else text
        return [] if self._velocity == before else [f"$VEL.CP={self._velocity}"]

    def arc_shares(self, move: Move) -> list[float] | None:
        """One CIRC; a helix becomes straight moves."""
        return None if abs(move.rise_m) > FLAT_M else [1.0]

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """CIRC through the middle, or by CA where the circle is nearly whole."""
        angle = turn_deg(move) * (end_share - start_share)
        whole = angle > _NEARLY_WHOLE_DEG
        shares = (120.0 / angle, 240.0 / angle) if whole else (0.5, 1.0)
        poses = [pose.make(self.orientation(move, 1.0), move.at(share)) for share in shares]
        *lines, circle = self.motion(poses, self._speed(move), exact=self.exact or self.first)
        if whole:
            head, brace, behind = circle.rpartition("}")
            circle = f"{head}{brace},CA {number(angle, 6)}{behind}"
        self.lines += [*lines, circle]


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
