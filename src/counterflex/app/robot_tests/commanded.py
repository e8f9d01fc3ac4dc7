"""Commanded poses or a commanded path, from a table of points or from the program that ran."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from counterflex.app.inputs import Reading
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.iso230.circular_test import Circle, fitted_circle, require_circle
from counterflex.evaluate.iso9283.path_cycles import CommandedPath, path_of
from counterflex.files.commanded_file import read_commanded
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.compensated import tool_path
from counterflex.programs.program import Program

_SAME_M = 1.0 * UM


@dataclass(frozen=True, eq=False)
class CommandedPoses:
    """Poses of a test."""

    Ts_command: Float  # (k, 4, 4) m, in the order in which they are attained
    oriented: bool

    @classmethod
    def of(cls, file: str | Path) -> CommandedPoses:
        """Poses of a table (.csv), or the places at which a program dwells (one cycle of them).

        Raises:
            InputError: The program never dwells.
        """
        if _is_table(file):
            Ts, oriented, _ = read_commanded(file)
            return cls(Ts, oriented)
        program, path = _read(file)
        kinds = np.array([motion.kind == "dwell" for motion in program.motions])
        rows = np.flatnonzero(kinds[path.motion] & (np.diff(path.motion, prepend=-1) != 0))
        if len(rows) == 0:
            raise InputError(
                "the program dwells nowhere: its poses are not known", where=str(file), hint="G4 P1 at each"
            )
        p = path.p_part_tcp[rows]
        again = np.flatnonzero(np.linalg.norm(p[1:] - p[0], axis=1) < _SAME_M)
        p = p[: int(again[0]) + 1] if len(again) else p
        Ts = np.tile(np.eye(4), (len(p), 1, 1))
        Ts[:, :3, 3] = p
        return cls(Ts, oriented=False)


def commanded_path(file: str | Path) -> CommandedPath:
    """Path of a table (.csv), or the feed moves of a program between its rapids (one cycle of them).

    Raises:
        InputError: The program feeds along different paths, or nowhere.
    """
    if _is_table(file):
        Ts, oriented, speed = read_commanded(file)
        return path_of(Ts[:, :3, 3], Ts[:, :3, :3] if oriented else None, speed)
    program, path = _read(file)
    moves = np.array([motion.kind != "dwell" for motion in program.motions])[path.motion]
    feeds = (path.kind == FEED) & moves
    feeds[0] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], feeds, [False]]).astype(np.int8)))
    runs = [slice(int(a) - 1, int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if not runs:
        raise InputError("the program has no feed moves: its path is not known", where=str(file))
    first = path.p_part_tcp[runs[0]]
    for run in runs[1:]:
        other = path.p_part_tcp[run]
        if len(other) != len(first) or float(np.abs(other - first).max()) > _SAME_M:
            raise InputError(
                "the program feeds along different paths between its rapids",
                where=str(file),
                value=", ".join(f"{_length(path.p_part_tcp[r]) / MM:.1f} mm" for r in runs[:6]),
                hint="Give the path that is judged as a table (.csv) or as a program of its own",
            )
    feed = np.unique(np.round(path.feed_m_s[runs[0]][1:], 9))
    return path_of(first, None, float(feed[0]) if len(feed) == 1 else None)


def commanded_circle(file: str | Path) -> Circle:
    """Circle of a table of points (.csv), or of the arcs of a program.

    Raises:
        InputError: The program has no arcs, or the points lie on no circle.
    """
    if _is_table(file):
        p = read_commanded(file)[0][:, :3, 3]
    else:
        program, path = _read(file)
        arcs = np.array([motion.kind == "arc" for motion in program.motions])[path.motion]
        if not arcs.any():
            raise InputError("the program has no arcs", where=str(file))
        p = path.p_part_tcp[arcs]
    circle = fitted_circle(p)
    require_circle(p, circle)
    return circle


def _is_table(file: str | Path) -> bool:
    return Path(file).suffix.lower() in (".csv", ".txt")


def _read(file: str | Path) -> tuple[Program, ToolPath]:
    program = Reading().program(file)
    return program, tool_path(program)


def _length(p: Float) -> float:
    return float(np.sum(np.linalg.norm(np.diff(p, axis=0), axis=1)))
