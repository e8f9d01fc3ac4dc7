"""KUKA KRL: a compensated path as LIN instructions with C_DIS, in .src and .dat files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.path.toolpath import ToolPath
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.job_mark import mark
from counterflex.programs.limits import KRL, check_name
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


@dataclass(frozen=True)
class KrlSettings:
    """What a KRL program needs beside the path.

    Attributes:
        name: Program name, up to 24 characters (20 where the program is split).
        start_axes_rad: (6,) A1..A6 of the posture the program starts from (PTP), rad.
        tool: Number of TOOL_DATA, or T_flange_tcp (4, 4) in m, of tools that ``tool_data`` does not name.
        base: Number of BASE_DATA, or T_base_part (4, 4) in m: KUKA's BASE is the frame of the workpiece.
        status: S of the first Cartesian point; with ``turn`` it is approached by PTP, else by LIN.
        turn: T of the first Cartesian point.
        rapid_m_s: Speed of rapids, m/s.
        acc_m_s2: $ACC.CP, m/s^2.
        blend_m: $APO.CDIS, m.
        orientation_deg_s: $VEL.ORI1 and $VEL.ORI2, deg/s.
        axis_percent: Speed and acceleration of PTP, per cent, 1 to 100.
        cycle_s: Time the controller needs per point, s.
        points_per_file: Motion instructions in one .src; longer programs are split and called by a master.
        cell: Name of the cell, for the header.
        job: Hash of the plan, for the header.
        tool_data: Number of TOOL_DATA by number of the tool in the program.
    """

    name: str
    start_axes_rad: Sequence[float]
    tool: int | Float = 1
    base: int | Float = 1
    status: int | None = None
    turn: int | None = None
    rapid_m_s: float = 0.2
    acc_m_s2: float = 1.0
    blend_m: float = 0.5e-3
    orientation_deg_s: float = 100.0
    axis_percent: int = 10
    cycle_s: float = 0.012
    points_per_file: int = KRL.points_per_file
    cell: str = ""
    job: str = ""
    tool_data: Mapping[int, int] = field(default_factory=dict)

    def tool_frame(self, tool: int) -> int | Float:
        """TOOL_DATA or frame of a tool of the program."""
        return self.tool_data.get(tool, self.tool)


def krl_pose(T_a_b: Float) -> str:
    """``X .., Y .., Z .., A .., B .., C ..`` of a pose: mm and deg, ``R = Rz(A) Ry(B) Rx(C)``.

    Args:
        T_a_b: (4, 4), m.

    Returns:
        The components of a KRL FRAME without braces.
    """
    p = T_a_b[:3, 3] / MM
    angles = rotation.to_zyx(T_a_b[:3, :3]) / DEG
    words = [f"{c} {number(float(v), KRL.position_decimals)}" for c, v in zip("XYZ", p, strict=True)]
    words += [f"{c} {number(float(v), KRL.angle_decimals)}" for c, v in zip("ABC", angles, strict=True)]
    return ",".join(words)


def write_krl(
    program: Program,
    path: ToolPath,
    Ts_part_tcp: Float,
    settings: KrlSettings,
    *,
    tolerance_m: float = 1e-5,
    tolerance_rad: float = 1e-4,
    block_lines: BlockLines | None = None,
) -> RobotText:
    """Write a commanded path as a KRL program.

    Every point is ``LIN {X,Y,Z,A,B,C} C_DIS`` in the part frame (KUKA BASE); $VEL.CP follows the programmed feed.
    Spindle, coolant and tool change are what ``block_lines`` says, M0 and M1 HALT, dwells WAIT SEC; the text of such
    blocks is carried beside them as a comment. The first change of tool comes before the move to the start; every
    other one begins a part (a file) with $TOOL of its own, which first goes back to where the tool was changed.

    Args:
        program: The program the path was sampled from (its comments and M-codes are carried along).
        path: Nominal rows.
        Ts_part_tcp: (n, 4, 4) commanded poses of the tool frame (z out of the spindle) in the part frame, m.
        settings: Names, frames, speeds.
        tolerance_m: Largest distance of a commanded row from the written polyline before merging, m.
        tolerance_rad: The same for the orientation, rad.
        block_lines: KRL lines for a block (spindle, coolant, tool change):
            :meth:`counterflex.programs.robot_writer.machine_functions.MachineFunctions.lines`. When left out, none is
            known.

    Returns:
        Files and figures.

    Raises:
        InputError: A setting is out of range or the poses do not fit the path.
        ProgramError: A block needs lines that are not known.
    """
    _check(settings)
    lines = block_lines or MachineFunctions("krl").lines
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
    parts = robot_parts(program, points, _Lines(points, settings, lines), settings.points_per_file)
    name = settings.name
    files: dict[str, str] = {}
    head = _head(program, settings, parts.lead)
    if len(parts.parts) == 1:
        files[f"{name}.src"] = _source(name, [*head, *parts.opening, *parts.parts[0], *parts.ending])
    else:
        names = [f"{name}_{i:03d}" for i in range(1, len(parts.parts) + 1)]
        for part in names:
            check_name(part, KRL, "KRL")
        calls = [f"{part}( )" for part in names]
        files[f"{name}.src"] = _source(name, [*head, *parts.opening, *calls, *parts.ending])
        for part, content in zip(names, parts.parts, strict=True):
            files[f"{part}.src"] = _source(part, content)
            files[f"{part}.dat"] = _data(part, [])
    files[f"{name}.dat"] = _data(name, [f"DECL E6AXIS XSTART={{{_axes(settings.start_axes_rad)}}}"])
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


def _check(settings: KrlSettings) -> None:
    check_name(settings.name, KRL, "KRL")
    as_float("start_axes_rad", settings.start_axes_rad, (6,))
    for key in ("rapid_m_s", "acc_m_s2", "orientation_deg_s", "cycle_s"):
        as_positive(key, getattr(settings, key))
    as_positive("blend_m", settings.blend_m, zero=True)
    if not 1 <= settings.axis_percent <= 100:
        raise InputError("axis_percent is out of range", value=settings.axis_percent, limit="1 .. 100")
    if settings.points_per_file < 1:
        raise InputError("points_per_file is out of range", value=settings.points_per_file, limit=">= 1")
    if (settings.status is None) != (settings.turn is None):
        raise InputError("S and T come together", value=(settings.status, settings.turn))


def _axes(axes_rad: Sequence[float]) -> str:
    return ",".join(f"A{i} {number(a / DEG, KRL.angle_decimals)}" for i, a in enumerate(axes_rad, start=1))


def _source(name: str, body: Sequence[str]) -> str:
    return "\n".join(["&ACCESS RVP", "&REL 1", f"DEF {name}( )", *body, "END", ""])


def _data(name: str, body: Sequence[str]) -> str:
    return "\n".join(["&ACCESS RVP", "&REL 1", f"DEFDAT {name}", *body, "ENDDAT", ""])


def _frame(word: str, value: int | Float) -> str:
    if isinstance(value, (int, np.integer)):
        return f"${word}={word}_DATA[{int(value)}]"
    return f"${word}={{{krl_pose(as_float(word, value, (4, 4)))}}}"


def _head(program: Program, settings: KrlSettings, lead: Sequence[str]) -> list[str]:
    def plain(text: str) -> str:
        return "".join(c if 32 <= ord(c) < 127 else "?" for c in text)[:120]

    return [
        f"; made by counterflex {__version__} from {plain(program.name)}",
        *([f"; cell {plain(settings.cell)}"] if settings.cell else []),
        *([f"; {mark(settings.job)}"] if settings.job else []),
        *lead,
        *_frames_and_speeds(settings, first_tool(program)),
        "PTP XSTART",
    ]


def _frames_and_speeds(settings: KrlSettings, tool: int) -> list[str]:
    percent = settings.axis_percent
    return [
        _frame("TOOL", settings.tool_frame(tool)),
        _frame("BASE", settings.base),
        "$IPO_MODE=#BASE",
        "$ORI_TYPE=#VAR",
        "$ADVANCE=3",
        *(f"$VEL_AXIS[{i}]={percent}" for i in range(1, 7)),
        *(f"$ACC_AXIS[{i}]={percent}" for i in range(1, 7)),
        f"$ACC.CP={settings.acc_m_s2:.4f}",
        f"$VEL.ORI1={settings.orientation_deg_s:.3f}",
        f"$VEL.ORI2={settings.orientation_deg_s:.3f}",
        f"$APO.CDIS={number(settings.blend_m / MM, 4)}",
    ]


class _Lines:
    """Instructions of KRL; remembers the speed that is set."""

    def __init__(self, points: RobotPoints, settings: KrlSettings, lines: BlockLines) -> None:
        self._points = points
        self._settings = settings
        self._lines = lines
        self._speed: float | None = None

    def block(self, block: Block) -> list[str]:
        text = carried_text(block)
        return [*([f"; {text}"] if text else []), *self._lines(block), *(["HALT"] if stops(block) else [])]

    def dwell(self, time_s: float) -> str:
        return f"WAIT SEC {time_s:.3f}"

    def point(self, index: int) -> list[str]:
        now, rapid = float(self._points.speed_m_s[index]), self._settings.rapid_m_s
        wanted = now if now > 0.0 else self._speed or rapid
        out = [] if wanted == self._speed else [f"$VEL.CP={wanted:.6f}"]
        self._speed = wanted
        pose, settings = krl_pose(self._points.Ts_part_tcp[index]), self._settings
        if index == 0 and settings.status is not None:
            return [*out, f"PTP {{{pose},S {settings.status},T {settings.turn}}}"]
        return [*out, f"LIN {{{pose}}}" + ("" if self._points.exact[index] or index == 0 else " C_DIS")]

    def enter(self, tool: int, place: int) -> list[str]:
        self._speed = self._settings.rapid_m_s
        return [
            *_frames_and_speeds(self._settings, tool),
            f"$VEL.CP={self._speed:.6f}",
            f"LIN {{{krl_pose(self._points.Ts_part_tcp[place])}}}",
        ]
