"""ABB RAPID: a compensated path as MoveL instructions in modules."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.geometry import rotation
from counterflex.path.toolpath import ToolPath
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.job_mark import mark
from counterflex.programs.limits import RAPID, check_name
from counterflex.programs.program import Block, Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.robot_writer.parts import first_tool, robot_parts
from counterflex.programs.robot_writer.points import (
    BlockLines,
    RobotPoints,
    RobotText,
    carried_text,
    choose_points,
    event_motions,
    stops,
)

_NO_EXTERNAL = "[9E9,9E9,9E9,9E9,9E9,9E9]"


@dataclass(frozen=True)
class RapidSettings:
    """What a RAPID module needs beside the path.

    Attributes:
        name: Module and procedure name, up to 32 characters (28 where the program is split).
        start_axes_rad: (6,) axis angles of the posture the program starts from (MoveAbsJ), rad.
        T_flange_tcp: (4, 4) m, tool frame of tools that ``tool_data`` does not name.
        T_base_part: (4, 4) m, work object frame in the robot's base (world) frame.
        tool_mass_kg: Mass of the tool in tooldata, > 0.
        p_flange_cog: (3,) m, its centre of gravity.
        configuration: (4,) cf1, cf4, cf6, cfx of every target; supervision of linear moves is off.
        zone: ``fine``, ``z0``, ``z1``, ``z5`` ...
        rapid_m_s: Speed of rapids, m/s.
        start_m_s: Speed of the move to the start posture, m/s.
        orientation_deg_s: Reorientation speed, deg/s.
        cycle_s: Time the controller needs per point, s.
        points_per_file: Motion instructions in one module; longer programs are split and called by a master.
        cell: Name of the cell, for the header.
        job: Hash of the plan, for the header.
        tool_data: Name of the tooldata on the controller by number of the tool in the program.
    """

    name: str
    start_axes_rad: Sequence[float]
    T_flange_tcp: Float
    T_base_part: Float
    tool_mass_kg: float = 1.0
    p_flange_cog: Sequence[float] = (0.0, 0.0, 0.001)
    configuration: tuple[int, int, int, int] = (0, 0, 0, 0)
    zone: str = "z0"
    rapid_m_s: float = 0.2
    start_m_s: float = 0.1
    orientation_deg_s: float = 100.0
    cycle_s: float = 0.024
    points_per_file: int = RAPID.points_per_file
    cell: str = ""
    job: str = ""
    tool_data: Mapping[int, str] = field(default_factory=dict)

    def tool_frame(self, tool: int) -> str:
        """Name of the tooldata of a tool of the program."""
        return self.tool_data.get(tool, f"t_{self.name[:30]}")


def rapid_pose(T_a_b: Float) -> str:
    """``[x,y,z],[q1,q2,q3,q4]`` of a pose: mm and a unit quaternion with q1 (scalar) first and >= 0.

    Args:
        T_a_b: (4, 4), m.

    Returns:
        The two aggregates, comma between.
    """
    p = ",".join(number(float(v), RAPID.position_decimals) for v in T_a_b[:3, 3] / MM)
    q = ",".join(number(float(v), RAPID.angle_decimals) for v in rotation.quat_wxyz(T_a_b[:3, :3]))
    return f"[{p}],[{q}]"


def write_rapid(
    program: Program,
    path: ToolPath,
    Ts_part_tcp: Float,
    settings: RapidSettings,
    *,
    tolerance_m: float = 1e-5,
    tolerance_rad: float = 1e-4,
    block_lines: BlockLines | None = None,
) -> RobotText:
    """Write a commanded path as RAPID modules.

    Every point is a ``MoveL`` in the work object (the part frame); speeddata follows the programmed feed. Spindle,
    coolant and tool change are what ``block_lines`` says, M0 and M1 Stop, dwells WaitTime; the text of such blocks is
    carried beside them as a comment. The first change of tool comes before the move to the start; every other one
    begins a part (a module) with tooldata of its own, which first goes back to where the tool was changed.

    Args:
        program: The program the path was sampled from (its comments and M-codes are carried along).
        path: Nominal rows.
        Ts_part_tcp: (n, 4, 4) commanded poses of the tool frame (z out of the spindle) in the part frame, m.
        settings: Names, frames, speeds.
        tolerance_m: Largest distance of a commanded row from the written polyline before merging, m.
        tolerance_rad: The same for the orientation, rad.
        block_lines: RAPID lines for a block (spindle, coolant, tool change):
            :meth:`counterflex.programs.robot_writer.machine_functions.MachineFunctions.lines`. When left out, none is
            known.

    Returns:
        Files and figures.

    Raises:
        InputError: A setting is out of range or the poses do not fit the path.
        ProgramError: A block needs lines that are not known.
    """
    _check(settings)
    lines = block_lines or MachineFunctions("rapid").lines
    points = choose_points(
        program,
        path,
        Ts_part_tcp,
        tolerance_m=tolerance_m,
        tolerance_rad=tolerance_rad,
        cycle_s=settings.cycle_s,
        rapid_m_s=settings.rapid_m_s,
        events=event_motions(program, lines),
    )
    used = {float(speed) for speed in points.speed_m_s if speed > 0.0} | {settings.rapid_m_s}
    speeds = {speed: f"v_{settings.name[:24]}_{i}" for i, speed in enumerate(sorted(used), start=1)}
    first = first_tool(program)
    language = _Lines(points, settings, lines, speeds, first)
    parts = robot_parts(program, points, language, settings.points_per_file)
    name, tool = settings.name, settings.tool_frame(first)
    start = f"    MoveAbsJ [[{_axes(settings.start_axes_rad)}],{_NO_EXTERNAL}],{_speed(settings, settings.start_m_s)},"
    head = [*parts.lead, "    ConfJ \\Off;", "    ConfL \\Off;", f"{start}fine,{tool}\\WObj:={_wobj(name)};"]
    files: dict[str, str] = {}
    declarations = _declarations(program, settings, speeds)
    if len(parts.parts) == 1:
        body = [*head, *parts.opening, *parts.parts[0], *parts.ending]
        files[f"{name}.mod"] = _module(f"{name}_m", declarations, name, body)
    else:
        names = [f"{name}_{i:03d}" for i in range(1, len(parts.parts) + 1)]
        body = [*head, *parts.opening, *(f"    {part};" for part in names), *parts.ending]
        files[f"{name}.mod"] = _module(f"{name}_m", declarations, name, body)
        for part, content in zip(names, parts.parts, strict=True):
            check_name(f"{part}_m", RAPID, "RAPID")
            files[f"{part}.mod"] = _module(f"{part}_m", [], part, content)
    return RobotText(
        files=files,
        points=len(points.row),
        merged_points=points.merged,
        too_close=points.too_close,
        largest_position_error_m=points.largest_position_error_m,
        largest_angle_error_rad=points.largest_angle_error_rad,
        largest_position_error_line=points.line(program),
        warnings=(*points.warnings(program, tolerance_m), *parts.warnings(settings.points_per_file)),
    )


def _check(settings: RapidSettings) -> None:
    check_name(f"{settings.name}_m", RAPID, "RAPID")
    as_float("start_axes_rad", settings.start_axes_rad, (6,))
    as_float("T_flange_tcp", settings.T_flange_tcp, (4, 4))
    as_float("T_base_part", settings.T_base_part, (4, 4))
    as_float("p_flange_cog", settings.p_flange_cog, (3,))
    for key in ("rapid_m_s", "start_m_s", "orientation_deg_s", "cycle_s", "tool_mass_kg"):
        as_positive(key, getattr(settings, key))
    if not re.fullmatch(r"fine|z(0|1|5|10|15|20|30|40|50|60|80|100|150|200)", settings.zone):
        raise InputError("the zone is not a predefined one", value=settings.zone, limit="fine, z0, z1, z5, z10 .. z200")
    if settings.points_per_file < 1:
        raise InputError("points_per_file is out of range", value=settings.points_per_file, limit=">= 1")


def _wobj(name: str) -> str:
    return f"w_{name[:30]}"


def _axes(axes_rad: Sequence[float]) -> str:
    return ",".join(number(a / DEG, 5) for a in axes_rad)


def _speed(settings: RapidSettings, speed_m_s: float) -> str:
    return f"[{number(speed_m_s / MM_PER_S, 4)},{number(settings.orientation_deg_s, 3)},5000,1000]"


def _declarations(program: Program, settings: RapidSettings, speeds: dict[float, str]) -> list[str]:
    def plain(text: str) -> str:
        return "".join(c if 32 <= ord(c) < 127 else "?" for c in text)[:120]

    cog = ",".join(number(float(v) / MM, 4) for v in settings.p_flange_cog)
    load = f"[{settings.tool_mass_kg:.4f},[{cog}],[1,0,0,0],0,0,0]"
    tool = rapid_pose(np.asarray(settings.T_flange_tcp))
    used = {motion.tool for motion in program.motions if motion.tool}
    own = not used or not used <= settings.tool_data.keys()
    part = rapid_pose(np.asarray(settings.T_base_part))
    return [
        f"  ! made by counterflex {__version__} from {plain(program.name)}",
        *([f"  ! cell {plain(settings.cell)}"] if settings.cell else []),
        *([f"  ! {mark(settings.job)}"] if settings.job else []),
        *([f"  PERS tooldata {settings.tool_frame(0)}:=[TRUE,[{tool}],{load}];"] if own else []),
        f'  PERS wobjdata {_wobj(settings.name)}:=[FALSE,TRUE,"",[{part}],[[0,0,0],[1,0,0,0]]];',
        *(f"  CONST speeddata {name}:={_speed(settings, speed)};" for speed, name in speeds.items()),
    ]


def _module(module: str, declarations: Sequence[str], procedure: str, body: Sequence[str]) -> str:
    head = [f"MODULE {module}", *declarations, f"  PROC {procedure}()"]
    return "\n".join([*head, *body, "  ENDPROC", "ENDMODULE", ""])


class _Lines:
    """Instructions of RAPID; remembers the last speed."""

    def __init__(
        self, points: RobotPoints, settings: RapidSettings, lines: BlockLines, speeds: Mapping[float, str], tool: int
    ) -> None:
        self._points = points
        self._settings = settings
        self._lines = lines
        self._speeds = speeds
        self._speed = speeds[settings.rapid_m_s]
        self._tool = tool

    def block(self, block: Block) -> list[str]:
        text = carried_text(block)
        own = [f"    {line}" for line in self._lines(block)]
        return [*([f"    ! {text}"] if text else []), *own, *(["    Stop;"] if stops(block) else [])]

    def dwell(self, time_s: float) -> str:
        return f"    WaitTime {time_s:.3f};"

    def point(self, index: int) -> list[str]:
        self._speed = self._speeds.get(float(self._points.speed_m_s[index]), self._speed)
        zone = "fine" if self._points.exact[index] or index == 0 else self._settings.zone
        return [self._move(index, zone)]

    def enter(self, tool: int, place: int) -> list[str]:
        self._speed, self._tool = self._speeds[self._settings.rapid_m_s], tool
        return ["    ConfJ \\Off;", "    ConfL \\Off;", self._move(place, "fine")]

    def _move(self, index: int, zone: str) -> str:
        settings = self._settings
        conf = "[" + ",".join(str(int(c)) for c in settings.configuration) + "]"
        target = f"[{rapid_pose(self._points.Ts_part_tcp[index])},{conf},{_NO_EXTERNAL}]"
        tool = settings.tool_frame(self._tool)
        return f"    MoveL {target},{self._speed},{zone},{tool}\\WObj:={_wobj(settings.name)};"
