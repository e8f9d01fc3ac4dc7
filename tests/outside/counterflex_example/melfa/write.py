"""Write MELFA-BASIC: compensated paths and conversions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
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
from counterflex.programs.robot_writer.writer import External, Poses, RobotSettings, RobotWords, RobotWriter

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


class MelfaWords(RobotWords[MelfaSettings]):
    """Mov, Mvs and Mvr to positions of their own, with speed and stop before them."""

    language, sign, stop = "melfa", "'", "Hlt"

    @cached_property
    def made(self) -> Text:
        """Statements and positions."""
        return Text(self.settings)

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One file."""
        return {f"{name}.prg": self.made.program(lines)}

    def call(self, part: str) -> str:
        """A part."""
        return f'CallP "{part}"'

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """Speed, whether it is passed, and the motion: a circle goes through three positions."""
        del external
        word = "Mov" if free else "Mvs" if len(Ts_part_tcp) == 1 else "Mvr"
        names = ",".join(self.made.position(T) for T in Ts_part_tcp)
        return [f"Spd {speed_m_s / MM_PER_S:.6f}", f"Cnt {0 if exact else 1}", f"{word} {names}"]


class MelfaWriter(MelfaWords, RobotWriter[MelfaSettings]):
    """A commanded path."""

    def point(self, index: int) -> list[str]:
        """By its axes to the first one, then straight."""
        exact, T = bool(self.points.exact[index] or index == 0), self.points.Ts_part_tcp[index]
        return self.motion([T], self.speed_to(index), exact=exact, free=index == 0)

    def enter(self, tool: int, place: int) -> list[str]:
        """The way back behind a change of tool."""
        self.tool = tool
        return [f"Mov {self.made.position(self.points.Ts_part_tcp[place])}"]

    def start(self, lead: Sequence[str]) -> list[str]:
        """Comments; the first position is approached from wherever the robot is."""
        return [*self.origin(), *lead]


class MelfaEmitter(MelfaWords, RobotEmitter[MelfaSettings]):
    """A converted program."""

    def through(self, move: Move, start_share: float, end_share: float) -> list[Float]:
        """Poses at the start, in the middle and at the end of a piece of a circle."""
        start = pose.make(self.orientation(move, start_share), move.at(start_share))
        return [start, *super().through(move, start_share, end_share)]


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
