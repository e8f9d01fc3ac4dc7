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
from counterflex.integrations.fanuc.language.program import remarks, short, values_text, wpr_of
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.writer import External, Poses, RobotSettings, RobotWords, RobotWriter

_CONFIG: Final = re.compile(r"[NF] [UD] [TB], -?\d, -?\d, -?\d")
_POSE: Final = "\0"  # Stands before the entry of /POS in a line until the lines of a file are numbered


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
        """Check ranges. Raises InputError: a setting is out of range."""
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


def fanuc_joint_motion(settings: FanucSettings, tool: int) -> str:
    """The motion to the start posture, by axes."""
    axes = enumerate(settings.start_axes_rad, start=1)
    values = ",\n".join(f"\tJ{i} = {number(angle / DEG, LIMITS.angle_decimals)} deg" for i, angle in axes)
    frames = f"\tUF : {settings.base}, UT : {settings.tool_of(tool)},\n"
    return f"J P[#] {settings.axis_percent}% FINE{_POSE}{frames}{values}{_external(settings, settings.external_axes)}"


def _external(settings: FanucSettings, external_axes: Mapping[int, float]) -> str:
    units = {axis: "deg" if axis in settings.turning_axes else "mm" for axis in external_axes}
    return "".join(f",\n\tE{axis} = {number(value, 4)} {units[axis]}" for axis, value in sorted(external_axes.items()))


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
    """Listings: ``J``, ``L`` and ``C`` with positions of their own in the user frame."""

    language, sign, stop = "fanuc", "!", "PAUSE"

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One listing."""
        check_name(name, LIMITS, "FANUC")
        return {f"{name}.ls": fanuc_program(name, lines)}

    def call(self, part: str) -> str:
        """CALL."""
        return f"CALL {part.upper()}"

    def frames(self, tool: int) -> list[str]:
        """UFRAME_NUM, UTOOL_NUM."""
        return [f"UFRAME_NUM={self.settings.base}", f"UTOOL_NUM={self.settings.tool_of(tool)}"]

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """A motion with the entries of its positions, until :func:`fanuc_program` numbers them."""
        settings = self.settings
        word = "J" if free else "L" if len(Ts_part_tcp) == 1 else "C"
        speed = f"{settings.axis_percent}%" if free else f"{short(speed_m_s / MM_PER_S)}mm/sec"
        names = "\n    :  ".join("P[#]" for _ in Ts_part_tcp)
        axes = _external(settings, settings.external_axes if external is None else external)
        frames = (
            f"\tUF : {settings.base}, UT : {settings.tool_of(self.tool)},\t\tCONFIG : '{settings.configuration}',\n"
        )
        entries = "".join(f"{_POSE}{frames}{values_text(T)}{axes}" for T in Ts_part_tcp)
        return [f"{word} {names} {speed} {'FINE' if exact else f'CNT{settings.blend}'}{entries}"]


class FanucWriter(FanucWords, RobotWriter[FanucSettings]):
    """A commanded path as a listing."""

    def start(self, lead: Sequence[str]) -> list[str]:
        """Return origin, first tool, frames, start posture."""
        settings = self.settings
        return [
            *self.origin(), *self._stated(), *lead, *self.frames(self.first_tool),
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
