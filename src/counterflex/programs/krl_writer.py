"""KUKA KRL: a compensated path as LIN instructions with C_DIS, in .src and .dat files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.path.toolpath import ToolPath
from counterflex.programs.job_mark import mark
from counterflex.programs.limits import KRL, check_name
from counterflex.programs.program import Block, Program
from counterflex.programs.robot_points import (
    BlockLines,
    RobotPoints,
    RobotText,
    carried_text,
    choose_points,
    event_motions,
    m_code_lines,
    steps,
)
from counterflex.programs.written_line import number


@dataclass(frozen=True)
class KrlSettings:
    """What a KRL program needs beside the path.

    Attributes:
        name: Program name, up to 24 characters (20 where the program is split).
        start_axes_rad: (6,) A1..A6 of the posture the program starts from (PTP), rad.
        tool: Number of TOOL_DATA, or T_flange_tcp (4, 4) in m.
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
    Blocks of the source that are not motion are carried as comments, M0 and M1 as HALT, dwells as WAIT SEC.

    Args:
        program: The program the path was sampled from (its comments and M-codes are carried along).
        path: Nominal rows.
        Ts_part_tcp: (n, 4, 4) commanded poses of the tool frame (z out of the spindle) in the part frame, m.
        settings: Names, frames, speeds.
        tolerance_m: Largest distance of a commanded row from the written polyline before merging, m.
        tolerance_rad: The same for the orientation, rad.
        block_lines: KRL lines for a block (spindle, coolant, tool change), see
            :func:`counterflex.programs.robot_points.m_code_lines`; none when left out.

    Returns:
        Files and figures.

    Raises:
        InputError: A setting is out of range or the poses do not fit the path.
    """
    _check(settings)
    lines = block_lines or m_code_lines({})
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
    body = _Body(program, points, settings, lines)
    parts = body.parts()
    name = settings.name
    files: dict[str, str] = {}
    warnings = points.warnings(tolerance_m)
    if len(parts) == 1:
        files[f"{name}.src"] = _source(name, [*_head(program, settings), *parts[0]])
    else:
        names = [f"{name}_{i:03d}" for i in range(1, len(parts) + 1)]
        for part in names:
            check_name(part, KRL, "KRL")
        files[f"{name}.src"] = _source(name, [*_head(program, settings), *(f"{part}( )" for part in names)])
        for part, content in zip(names, parts, strict=True):
            files[f"{part}.src"] = _source(part, content)
            files[f"{part}.dat"] = _data(part, [])
        warnings = (*warnings, f"split into {len(parts)} parts of at most {settings.points_per_file} points")
    files[f"{name}.dat"] = _data(name, [f"DECL E6AXIS XSTART={{{_axes(settings.start_axes_rad)}}}"])
    return RobotText(
        files=files,
        points=len(points.row),
        merged_points=points.merged,
        too_close=points.too_close,
        largest_position_error_m=points.largest_position_error_m,
        largest_angle_error_rad=points.largest_angle_error_rad,
        warnings=warnings,
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


def _head(program: Program, settings: KrlSettings) -> list[str]:
    def plain(text: str) -> str:
        return "".join(c if 32 <= ord(c) < 127 else "?" for c in text)[:120]

    percent = settings.axis_percent
    return [
        f"; made by counterflex {__version__} from {plain(program.name)}",
        *([f"; cell {plain(settings.cell)}"] if settings.cell else []),
        *([f"; {mark(settings.job)}"] if settings.job else []),
        _frame("TOOL", settings.tool),
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
        "PTP XSTART",
    ]


class _Body:
    """Instructions in order, cut into parts by the number of points."""

    def __init__(self, program: Program, points: RobotPoints, settings: KrlSettings, lines: BlockLines) -> None:
        self._program = program
        self._points = points
        self._settings = settings
        self._lines = lines
        self._poses = points.Ts_part_tcp

    def parts(self) -> list[list[str]]:
        """Lines of each part."""
        out: list[list[str]] = [[]]
        speed: float | None = None
        count = 0
        for step in steps(self._program, self._points):
            if isinstance(step, Block):
                out[-1] += self._block(step)
            elif isinstance(step, float):
                out[-1].append(f"WAIT SEC {step:.3f}")
            else:
                if count == self._settings.points_per_file:
                    out.append([])
                    count = 0
                count += 1
                now = float(self._points.speed_m_s[step])
                if now > 0.0 and now != speed:
                    out[-1].append(f"$VEL.CP={now:.6f}")
                    speed = now
                elif speed is None:
                    speed = self._settings.rapid_m_s
                    out[-1].append(f"$VEL.CP={speed:.6f}")
                out[-1].append(self._point(step))
        return out

    def _block(self, block: Block) -> list[str]:
        text = carried_text(block)
        stops = any(w.letter == "M" and w.value in (0.0, 1.0, 60.0) for w in block.words)
        return [*([f"; {text}"] if text else []), *self._lines(block), *(["HALT"] if stops else [])]

    def _point(self, index: int) -> str:
        pose = krl_pose(self._poses[index])
        settings = self._settings
        if index == 0 and settings.status is not None:
            return f"PTP {{{pose},S {settings.status},T {settings.turn}}}"
        return f"LIN {{{pose}}}" + ("" if self._points.exact[index] or index == 0 else " C_DIS")
