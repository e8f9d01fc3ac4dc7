"""FANUC TP: a compensated path as L instructions with their positions, in listings (.ls)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.integrations.fanuc.language import LIMITS
from counterflex.integrations.fanuc.language.program import wpr_of
from counterflex.integrations.fanuc.language.spelling import remarks, short, values_text
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.writer import RobotSettings, RobotWords, RobotWriter

_CONFIG: Final = re.compile(r"[NF] [UD] [TB], -?\d, -?\d, -?\d")
_POSE: Final = "\0"
"""Stands before the entry of /POS in a line until the lines of a file are numbered."""


@dataclass(frozen=True, kw_only=True)
class FanucSettings(RobotSettings):
    """Settings of a FANUC program beside those of every language; names have up to 36 characters."""

    tool: int = 1  # UTOOL of tools that ``tool_data`` does not name
    base: int = 1  # UFRAME that is the part frame
    # CONFIG of every position: wrist (N F), elbow (U D), arm (T B), turns of J1, J4 and J6
    configuration: str = "N U T, 0, 0, 0"
    blend: int = 100  # CNT of points that need not be reached, 0 to 100
    axis_percent: int = 10  # Speed of J, per cent, 1 to 100
    cycle_s: float = 0.008
    points_per_file: int = LIMITS.points_per_file
    tool_data: Mapping[int, int] = field(default_factory=dict)  # Number of UTOOL by number of the tool in the program
    # (4, 4) m, what the UFRAME must be on the controller, stated as a remark; None states nothing
    T_world_part: Float | None = None
    T_flange_tcp: Float | None = None  # (4, 4) m, likewise of the first UTOOL

    def check(self) -> None:
        """Check ranges.

        Raises:
            InputError: A setting is out of range.
        """
        check_name(self.name, LIMITS, "FANUC")
        super().check()
        if not _CONFIG.fullmatch(self.configuration):
            raise InputError("no CONFIG", value=self.configuration, limit="N U T, 0, 0, 0")
        if not 0 <= self.blend <= 100 or not 1 <= self.axis_percent <= 100:
            raise InputError("blend or axis_percent is out of range", value=(self.blend, self.axis_percent),
                             limit="0 to 100, 1 to 100")  # fmt: skip

    def tool_of(self, tool: int) -> int:
        """UTOOL of a tool of the program."""
        return self.tool_data.get(tool, self.tool)


def fanuc_frames(settings: FanucSettings, tool: int) -> list[str]:
    """Statements that set the frames of a tool."""
    return [f"UFRAME_NUM={settings.base}", f"UTOOL_NUM={settings.tool_of(tool)}"]


def fanuc_motion(
    settings: FanucSettings, tool: int, word: str, Ts_part_tcp: Sequence[Float], speed: str, termination: str,
    external_axes: Mapping[int, float] | None = None,
) -> str:  # fmt: skip
    """A motion with the entries of its positions, until :func:`fanuc_program` numbers them.

    Args:
        settings: Frames and configuration.
        tool: Number of the tool in the program.
        word: ``L``, ``J`` or ``C``.
        Ts_part_tcp: (4, 4) m, its points: of C the one on the circle first.
        speed: As written, with its unit.
        termination: ``FINE``, ``CNT100``.
        external_axes: Where they stand; None: as at the begin.
    """
    names = "\n    :  ".join("P[#]" for _ in Ts_part_tcp)
    external = _external(settings, settings.external_axes if external_axes is None else external_axes)
    frames = f"\tUF : {settings.base}, UT : {settings.tool_of(tool)},\t\tCONFIG : '{settings.configuration}',\n"
    entries = "".join(f"{_POSE}{frames}{values_text(T)}{external}" for T in Ts_part_tcp)
    return f"{word} {names} {speed} {termination}{entries}"


def fanuc_joint_motion(settings: FanucSettings, tool: int) -> str:
    """The motion to the start posture, by axes."""
    axes = enumerate(settings.start_axes_rad, start=1)
    values = ",\n".join(f"\tJ{i} = {number(angle / DEG, LIMITS.angle_decimals)} deg" for i, angle in axes)
    frames = f"\tUF : {settings.base}, UT : {settings.tool_of(tool)},\n"
    return f"J P[#] {settings.axis_percent}% FINE{_POSE}{frames}{values}{_external(settings, settings.external_axes)}"


def _external(settings: FanucSettings, external_axes: Mapping[int, float]) -> str:
    units = {axis: "deg" if axis in settings.turning_axes else "mm" for axis in external_axes}
    return "".join(f",\n\tE{axis} = {number(value, 4)} {units[axis]}" for axis, value in sorted(external_axes.items()))


def speed_text(speed_m_s: float) -> str:
    """A speed along the path, mm/sec."""
    return f"{short(speed_m_s / MM_PER_S)}mm/sec"


def fanuc_program(name: str, lines: Sequence[str]) -> str:
    """Text of a listing: lines numbered, positions as entries of /POS."""
    statements: list[str] = []
    entries: list[str] = []
    for line in _remarks_cut(lines):
        form, *poses = line.split(_POSE)
        for pose in poses:
            form = form.replace("P[#]", f"P[{len(entries) + 1}]", 1)
            entries.append(f"P[{len(entries) + 1}]{{\n   GP1:\n{pose}\n}};")
        gap = "" if poses else "  "
        statements.append(f"{len(statements) + 1:4d}:{gap}{form} ;")
    head = [
        f"/PROG {name.upper()}", "/ATTR", 'COMMENT = "counterflex";', "PROTECT = READ_WRITE;",
        "DEFAULT_GROUP = 1,*,*,*,*;", "/MN",
    ]  # fmt: skip
    return "\n".join([*head, *statements, "/POS", *entries, "/END", ""])


def _remarks_cut(lines: Sequence[str]) -> Iterator[str]:
    for line in lines:
        text = line.strip()
        if text.startswith("!"):
            yield from (f"!{part}" for part in remarks([text[1:].strip()]))
        else:
            yield text


class FanucWords(RobotWords[FanucSettings]):
    """Listings."""

    language, sign, stop, wait = "fanuc", "!", "PAUSE", "WAIT {}(sec)"

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One listing."""
        check_name(name, LIMITS, "FANUC")
        return {f"{name}.ls": fanuc_program(name, lines)}

    def call(self, part: str) -> str:
        """CALL."""
        return f"CALL {part.upper()}"


class FanucWriter(FanucWords, RobotWriter[FanucSettings]):
    """The words of FANUC TP: every point is an ``L`` with a position of its own in the user frame."""

    def point(self, index: int) -> list[str]:
        """A point: L, FINE at the first one and where it must be reached."""
        speed = self.speed_to(index)
        exact = self.points.exact[index] or index == 0
        return [self._move(index, speed, "FINE" if exact else f"CNT{self.settings.blend}")]

    def enter(self, tool: int, place: int) -> list[str]:
        """The frames behind a change of tool, and the way back."""
        self.speed, self.tool = self.settings.rapid_m_s, tool
        return [*fanuc_frames(self.settings, tool), self._move(place, self.speed, "FINE")]

    def start(self, lead: Sequence[str]) -> list[str]:
        """Return origin, first tool, frames, start posture."""
        settings = self.settings
        return [
            *self.origin(), *self._stated(), *lead, *fanuc_frames(settings, self.first_tool),
            fanuc_joint_motion(settings, self.first_tool),
        ]  # fmt: skip

    def _stated(self) -> list[str]:
        """Remarks of what the frames, which the program names by number, must be on the controller."""
        settings, out = self.settings, []
        for name, T in (
            (f"UFRAME {settings.base} in the world", settings.T_world_part),
            (f"UTOOL {settings.tool_of(self.first_tool)}", settings.T_flange_tcp),
        ):
            if T is not None:
                values = [*(T[:3, 3] / MM), *wpr_of(T[:3, :3])]
                texts = [f"{c} {number(float(v), 3)}" for c, v in zip("XYZWPR", values, strict=True)]
                out += [f"! {name}", *(f"! {a} {b}" for a, b in zip(texts[::2], texts[1::2], strict=True))]
        return out

    def _move(self, index: int, speed_m_s: float, termination: str) -> str:
        T = self.points.Ts_part_tcp[index]
        return fanuc_motion(self.settings, self.tool, "L", [T], speed_text(speed_m_s), termination,
                            self.external_at(index))  # fmt: skip
