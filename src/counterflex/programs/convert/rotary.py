"""Rotary words of a described machine as tool vectors, so that a language without that machine can say them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.path.toolpath import ToolPath
from counterflex.programs.motion_rows import simplify
from counterflex.programs.program import TOOL_VECTOR, Motion, Program
from counterflex.programs.rotary.fitted import fitted
from counterflex.programs.rotary.machine import RotaryMachine
from counterflex.programs.rotary.poses import RotaryWords, turned_path

_STEP_M: Final = 1.0 * MM
_LEVER_M: Final = 0.3  # A turn by 1 rad moves as much as this: the reach of a tool and its holder
_STILL_M: Final = 1e-9


def with_tool_vectors(
    program: Program, machine: RotaryMachine | None, *, tolerance_m: float, rapid_m_s: float
) -> Program:
    """The program with tips and tool axes in the part in place of machine positions and rotary words.

    A motion that turns becomes straight pieces between which tip and axis stay within the tolerance of where the
    machine has them; each has the speed of the tip, so that it takes as long. Arcs, made with the tool upright, stay.

    Args:
        program: That turns the tool by rotary words.
        machine: It was written for; None where the program needs none.
        tolerance_m: Largest distance of the pieces from the path of the tip; for the axis at a lever of 0.3 m.
        rapid_m_s: Speed assumed for rapids.

    Raises:
        ProgramError: As :func:`~counterflex.programs.rotary.fitted.fitted`; a feed that turns the tool about its tip.
    """
    known = fitted(program, machine)
    words = RotaryWords.of(known, machine)
    path = turned_path(known, words, step_m=_STEP_M, rapid_speed_m_s=rapid_m_s).path
    along = np.cumsum(
        np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1)
        + _LEVER_M * np.linalg.norm(np.diff(path.axis_part, axis=0, prepend=path.axis_part[:1]), axis=1)
    )
    motions: list[Motion] = []
    firsts: list[int] = []
    for index, motion in enumerate(known.motions):
        firsts.append(len(motions))
        rows = np.flatnonzero(path.motion == index)
        if len(rows) == 0 or motion.kind in ("arc", "dwell"):
            axis = path.axis_part[rows[-1]] if len(rows) else np.array([0.0, 0.0, 1.0])
            motions.append(replace(motion, abc_start=_three(axis), abc_end=_three(axis)))
            continue
        begin = max(int(rows[0]) - 1, 0)
        chosen = begin + simplify(
            along[begin : rows[-1] + 1], path.p_part_tcp[begin : rows[-1] + 1], tolerance_m,
            rotvec=path.axis_part[begin : rows[-1] + 1], tolerance_rad=tolerance_m / _LEVER_M,
        )  # fmt: skip
        motions += _pieces(known, motion, path, chosen)
    firsts.append(len(motions))
    blocks = tuple(
        replace(
            block,
            modal=replace(block.modal, tool_centre=TOOL_VECTOR),
            first_motion=firsts[block.first_motion],
            motion_count=firsts[block.first_motion + block.motion_count] - firsts[block.first_motion],
        )
        for block in known.blocks
    )
    return replace(known, blocks=blocks, motions=tuple(motions))


def _pieces(program: Program, motion: Motion, path: ToolPath, chosen: np.ndarray) -> list[Motion]:
    """Straight motions between chosen rows."""
    out = []
    pairs = list(itertools.pairwise(chosen.tolist())) or [(int(chosen[0]), int(chosen[0]))]
    for a, b in pairs:
        way = float(np.linalg.norm(path.p_part_tcp[b] - path.p_part_tcp[a]))
        time_s = float(path.time_s[b] - path.time_s[a])
        feed = 0.0 if motion.kind == "rapid" else way / time_s if time_s > 0.0 else motion.feed_m_s
        if motion.kind == "feed" and way <= _STILL_M and bool(np.any(path.axis_part[a] != path.axis_part[b])):
            block = program.blocks[motion.block]
            raise ProgramError(
                "a feed turns the tool about its tip, for which a path has no speed",
                where=block.where(Path(program.name).name), value=block.text.strip()[:60],
                hint="Turn it by a rapid (G0) above the part, or along a motion",
            )  # fmt: skip
        piece = replace(motion, p_start=path.p_part_tcp[a], p_end=path.p_part_tcp[b], feed_m_s=feed, feed_rad_s=0.0)
        axes = _three(path.axis_part[a]), _three(path.axis_part[b])
        out.append(replace(piece, abc_start=axes[0], abc_end=axes[1]))
    return out


def _three(values: Float) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
