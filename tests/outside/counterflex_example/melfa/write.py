"""Write MELFA-BASIC: compensated paths and conversions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import part_in_world
from counterflex.app.robot_programs import refuse_held_part, shared_facts
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose, rotation
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.robot_writer.writer import RobotSettings, RobotWriter

from . import LIMITS


@dataclass(frozen=True, kw_only=True)
class MelfaSettings(RobotSettings):
    """What a program needs besides: its frames (4, 4) m, and the flag of its posture."""

    points_per_file: int = LIMITS.points_per_file
    T_world_part: Float = field(default_factory=lambda: np.eye(4))
    T_flange_tcp: Float = field(default_factory=lambda: np.eye(4))
    flag: int = 7


def numbers(T: Float) -> str:
    """``X,Y,Z,A,B,C`` of a pose (4, 4) m: mm and deg, ``R = Rz(C) Ry(B) Rx(A)``."""
    values = [*(T[:3, 3] / MM), *(rotation.to_zyx(T[:3, :3])[::-1] / DEG)]
    return ",".join(f"{value:.5f}" for value in values)


class Text:
    """Statements and positions of one program."""

    def __init__(self, settings: MelfaSettings) -> None:
        self.settings, self.positions = settings, list[str]()

    def position(self, T_part_tcp: Float) -> str:
        """Name of a new position."""
        self.positions.append(f"P{len(self.positions) + 1}=({numbers(T_part_tcp)})({self.settings.flag},0)")
        return f"P{len(self.positions)}"

    def program(self, lines: Sequence[str]) -> str:
        """The file."""
        frames = [f"Base ({numbers(self.settings.T_world_part)})", f"Tool ({numbers(self.settings.T_flange_tcp)})"]
        return "\n".join([*frames, *lines, "End", *self.positions, ""])


class MelfaWriter(RobotWriter[MelfaSettings]):
    """Every point is ``Mvs`` to a position of its own."""

    language, sign, stop, wait = "melfa", "'", "Hlt", "Dly {}"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.made = Text(self.settings)

    def point(self, index: int) -> list[str]:
        """Its speed, whether it is passed, and the motion."""
        exact = bool(self.points.exact[index] or index == 0)
        word = "Mov" if index == 0 else "Mvs"
        name = self.made.position(self.points.Ts_part_tcp[index])
        return [f"Spd {self.speed_to(index) / MM_PER_S:.6f}", f"Cnt {0 if exact else 1}", f"{word} {name}"]

    def enter(self, tool: int, place: int) -> list[str]:
        """The way back behind a change of tool."""
        self.tool = tool
        return [f"Mov {self.made.position(self.points.Ts_part_tcp[place])}"]

    def start(self, lead: Sequence[str]) -> list[str]:
        """Comments; the first position is approached from wherever the robot is."""
        return [*self.origin(), *lead]

    def call(self, part: str) -> str:
        """A part."""
        return f'CallP "{part}"'

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One file."""
        return {f"{name}.prg": self.made.program(lines)}


class MelfaEmitter(RobotEmitter[MelfaSettings]):
    """Mov, Mvs, Mvr."""

    language, sign, stop, wait = "melfa", "'", "Hlt", "Dly {}"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.made = Text(self.settings)

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One file."""
        return {f"{name}.prg": self.made.program(lines)}

    def call(self, part: str) -> str:
        """A part."""
        return f'CallP "{part}"'

    def _set(self, move: Move) -> None:
        self.lines += [f"Spd {self._speed(move) / MM_PER_S:.6f}", f"Cnt {0 if self.exact or self.first else 1}"]

    def straight(self, move: Move, share: float) -> None:
        """Speed and stop before the motion."""
        self._set(move)
        super().straight(move, share)

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:  # noqa: ARG002 (Spd says it before)
        """Mov or Mvs."""
        self.lines.append(f"{'Mov' if free else 'Mvs'} {self.made.position(T_part_tcp)}")

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """Mvr through the middle of a piece."""
        self._set(move)
        shares = (start_share, 0.5 * (start_share + end_share), end_share)
        names = [self.made.position(pose.make(self.orientation(move, share), move.at(share))) for share in shares]
        self.lines.append(f"Mvr {','.join(names)}")


def cell_of(cell: Cell) -> RobotTextCell:
    """What a program is held against."""
    refuse_held_part(cell, "MELFA-BASIC")
    return RobotTextCell(**shared_facts(cell, "melfa"))


def _frames(cell: Cell) -> dict[str, Any]:
    refuse_held_part(cell, "MELFA-BASIC")
    arm, elbow, wrist = cell.tables.posture.branch.split()
    flag = 4 * (arm == "front") + 2 * (elbow == "up") + (wrist == "noflip")
    T_part, T_tool = part_in_world(cell, "melfa"), cell.controller_chain.T_flange_tcp
    return {"T_world_part": T_part, "T_flange_tcp": T_tool, "flag": flag}


def write(order: WritingOrder) -> Written:
    """Write a compensated program."""
    settings = MelfaSettings(**writer_settings(order, "melfa", moving=False), **_frames(order.cell))
    return robot_text(order, MelfaWriter, settings, "melfa")


def convert(order: Conversion) -> MelfaEmitter:
    """Return the writer of a conversion."""
    settings = MelfaSettings(**emitter_settings(order), **_frames(order.cell))
    return MelfaEmitter(order.program, settings, order.cell.machine_functions("melfa"), order.tolerance_m)
