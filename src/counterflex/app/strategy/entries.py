"""Begin and end of the cuts of a program, by the engagement of the stock simulation, and the move that softens each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from counterflex.app.inputs import Job
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM
from counterflex.path.toolpath import FEED
from counterflex.plan.cut import Cut
from counterflex.programs.program import Block, Motion, Program

Kind = Literal["wall in", "wall out", "plunge", "edge", "run-up"]
_TANGENT_RAD: Final = 0.25
_CONTACT_M3: Final = 1e-12
_LEVEL_M: Final = 1e-9
_SOON_M: Final = 0.5 * MM  # A cut that takes material within so much of its beginning begins in the material
_CORNER: Final = math.cos(math.pi / 9.0)  # Cosine of a turn between two motions that is a corner
_WORDS: Final = frozenset("GXYZFIJKN")


@dataclass(frozen=True, eq=False)
class Entry:
    """Begin or end of a cut."""

    # Beside a wall (``in``, ``out``), plunged into the full width, or over an edge of the blank (``edge`` gets a ramp,
    # ``run-up`` a longer way through the air)
    kind: Kind
    motion: int  # Index of the level motion that cuts
    vertical: int  # Index of the motion before (down, or straight at the wall) or behind (up); -1: none
    radius_m: float
    point: Float  # (3,) m
    tangent: Float  # (2,) unit, direction of the cut there
    free: Float  # (2,) unit, away from the wall; along ``tangent`` where there is none
    top_m: float = 0.0  # Height at which the plunge meets material
    air_m: float = 0.0  # Way in the direction of the cut before the first contact
    refusal: str = ""  # Why it is left as it is; empty where a move can be written


def entries_of(
    job: Job, cut: Cut, radius_of: dict[int, float], top_m: float, run_up_m: float, *, edges: bool
) -> list[Entry]:
    """Beginnings and ends of all cuts.

    Args:
        radius_of: Radius of each tool by its number, m.
        run_up_m: Way through the air that a cut over an edge begins with, in its own direction.
        edges: Slots that begin over an edge of the blank get a ramp, too.
    """
    entries: list[Entry] = []
    rows = _EntryRows(job, cut)
    for group in _groups(job.program):
        level = [k for k in group if _is_level(job.program.motions[k])]
        if not level:
            continue
        radius = radius_of[job.program.motions[level[0]].tool]
        begin = _straight_at_wall(job.program, rows, level, radius)
        begin = _beginning(job.program, rows, group, level[0], radius) if begin is None else begin
        if begin is not None and begin.kind == "edge":
            sloped = edges and rows.side(rows.of(begin.motion)) == "slot"
            begin = (_sloped_edge if sloped else _run_up)(job.program, rows, begin, top_m if sloped else run_up_m)
        end = _ending(job.program, rows, group, level[-1], radius)
        entries += [entry for entry in (begin, end) if entry is not None]
    return entries


class _EntryRows:
    """Rows of the path by motion."""

    def __init__(self, job: Job, cut: Cut) -> None:
        path = job.path
        step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
        self.length: Float = np.linalg.norm(step, axis=1)
        self.motion, self.p, self.cut = path.motion, path.p_part_tcp, cut
        self.contact: Bool = (path.kind == FEED) & (cut.volume_m3 > _CONTACT_M3) & (self.length > 0.0)

    def of(self, motion: int) -> Int:
        """Rows of a motion."""
        first, last = np.searchsorted(self.motion, [motion, motion + 1])
        return np.arange(first, last)

    def near(self, motion: int, low_m: float, high_m: float, *, end: bool) -> Int:
        """Rows of a motion between two distances from its start or its end."""
        rows = self.of(motion)
        along = np.cumsum(self.length[rows])
        if end:
            along = along[-1] - along + self.length[rows] if len(rows) else along
        return rows[(along >= low_m) & (along <= high_m)]

    def side(self, rows: Int) -> str:
        """``up``, ``down``, ``slot`` or nothing: how most of some rows are milled."""
        rows = rows[self.contact[rows]]
        if len(rows) == 0:
            return ""
        left = float(np.median(self.cut.entry_rad[rows])) < _TANGENT_RAD
        right = float(np.median(self.cut.exit_rad[rows])) > math.pi - _TANGENT_RAD
        return {(True, True): "slot", (True, False): "up", (False, True): "down", (False, False): ""}[left, right]


def _groups(program: Program) -> Iterator[list[int]]:
    """Feed motions in a row with no rapid between."""
    group: list[int] = []
    for k, motion in enumerate(program.motions):
        if motion.kind in ("feed", "arc"):
            group.append(k)
        elif motion.kind == "rapid" and group:
            yield group
            group = []
    if group:
        yield group


def _is_level(motion: Motion) -> bool:
    return motion.kind == "arc" or float(np.linalg.norm(motion.p_end[:2] - motion.p_start[:2])) > _LEVEL_M


def _is_vertical(motion: Motion) -> bool:
    return motion.kind in ("feed", "rapid") and float(np.linalg.norm(motion.p_end[:2] - motion.p_start[:2])) < _LEVEL_M


def _free(tangent: Float, side: str) -> Float:
    left = np.array([-tangent[1], tangent[0]])
    return {"up": -left, "down": left}.get(side, tangent)


def _beginning(program: Program, rows: _EntryRows, group: list[int], k: int, radius: float) -> Entry | None:
    motion = program.motions[k]
    start = rows.near(k, 0.0, 4.0 * radius, end=False)
    if not rows.contact[start].any():
        return None
    side, tangent = rows.side(start), motion.tangent_at(end=False)
    first = int(np.argmax(rows.contact[start]))
    down = group[: group.index(k)]
    in_plunge = np.concatenate([rows.of(j) for j in down]) if down else np.zeros(0, dtype=np.int64)
    plunged = in_plunge[rows.contact[in_plunge]]
    vertical = down[-1] if down else k - 1
    common = (k, vertical, radius, motion.p_start, tangent, _free(tangent, side))
    if len(plunged) == 0 and float(rows.length[start[:first]].sum()) > _SOON_M:
        return Entry("edge", *common)
    refusal = _refusal(program, [k, vertical]) or _unless_vertical(program, vertical, "approached straight down")
    if not refusal and len(down) > 1:
        refusal = "not approached straight down"
    if side == "slot" or not side:
        if len(plunged) == 0:
            return Entry("edge", *common)
        top = float(rows.p[plunged[0] - 1, 2])
        return Entry("plunge", *common, top_m=top, refusal=refusal or _unless_level(motion))
    return Entry("wall in", *common, refusal=refusal or _arc_refusal(program, k))


def _sloped_edge(program: Program, rows: _EntryRows, entry: Entry, top_m: float) -> Entry:
    """An entry over an edge with the place of its ramp, or with what speaks against it."""
    motion, k = program.motions[entry.motion], entry.motion
    refusal = _refusal(program, [k, entry.vertical])
    if not refusal and not (
        _is_vertical(program.motions[entry.vertical]) and program.motions[entry.vertical].kind == "feed"
    ):
        refusal = "not approached straight down at feed"
    refusal = refusal or _unless_level(motion)
    if rows.side(rows.near(k, 0.0, np.inf, end=False)) != "slot":
        refusal = refusal or "no slot over the whole width"
    row = rows.of(k)[rows.contact[rows.of(k)]][0]
    return replace(entry, point=rows.p[row - 1], top_m=top_m, refusal=refusal)


def _run_up(program: Program, rows: _EntryRows, entry: Entry, run_up_m: float) -> Entry:
    """An entry over an edge that is come to in the direction of the cut, or what speaks against it."""
    motion, k = program.motions[entry.motion], entry.motion
    refusal = _refusal(program, [k, entry.vertical])
    refusal = refusal or _unless_vertical(program, entry.vertical, "approached straight down") or _unless_level(motion)
    own = rows.of(k)
    air = float(rows.length[own[: int(np.argmax(rows.contact[own]))]].sum())
    if air >= run_up_m - _LEVEL_M:
        refusal = refusal or "runs up already"
    return replace(entry, kind="run-up", air_m=air, refusal=refusal)


def _straight_at_wall(program: Program, rows: _EntryRows, level: list[int], radius: float) -> Entry | None:
    """A line that runs into the material beside a wall, and turns there; None where the cut begins otherwise."""
    if len(level) < 2 or program.motions[level[0]].kind != "feed" or level[1] != level[0] + 1:
        return None
    line, k = level[:2]
    side = rows.side(rows.near(k, 0.0, 4.0 * radius, end=False))
    tangent = program.motions[k].tangent_at(end=False)
    sharp = float(program.motions[line].tangent_at(end=True) @ tangent) < _CORNER
    meets = rows.contact[rows.of(line)].any() and not rows.contact[rows.near(line, 0.0, _SOON_M, end=False)].any()
    if side not in ("up", "down") or not sharp or not meets:
        return None
    refusal = _refusal(program, [line, k]) or _arc_refusal(program, k)
    point = program.motions[k].p_start
    return Entry("wall in", k, line, radius, point, tangent, _free(tangent, side), refusal=refusal)


def _ending(program: Program, rows: _EntryRows, group: list[int], k: int, radius: float) -> Entry | None:
    motion, near = program.motions[k], rows.near(k, 0.0, radius, end=True)
    side = rows.side(near)
    last = rows.near(k, 0.0, _SOON_M, end=True)
    if side not in ("up", "down") or not rows.contact[last].any() or k != group[-1]:
        return None
    tangent = motion.tangent_at(end=True)
    behind = k + 1 if k + 1 < len(program.motions) else -1
    refusal = _refusal(program, [k, behind]) or _arc_refusal(program, k)
    refusal = refusal or _unless_vertical(program, behind, "left straight up")
    return Entry("wall out", k, behind, radius, motion.p_end, tangent, _free(tangent, side), refusal=refusal)


def _unless_vertical(program: Program, k: int, text: str) -> str:
    return "" if k >= 0 and _is_vertical(program.motions[k]) else f"not {text}"


def _unless_level(motion: Motion) -> str:
    sloped = motion.kind == "arc" or abs(float(motion.p_end[2] - motion.p_start[2])) > _LEVEL_M
    return "what follows is no straight level line" if sloped else ""


def _refusal(program: Program, motions: list[int]) -> str:
    """Return why lines cannot be edited; empty where they can."""
    for k in motions:
        block = program.blocks[program.motions[k].block]
        if not block.single or block.cycle or block.motion_count != 1 or not _plain(block):
            return f"line {block.line} does more than one plain motion"
        if not block.modal.absolute or block.modal.plane != 17 or block.modal.feed_mode != 94:
            return "needs G90, G17 and G94"
    return ""


def _plain(block: Block) -> bool:
    return {word.letter for word in block.words} <= _WORDS


def _arc_refusal(program: Program, k: int) -> str:
    return "needs G91.1" if program.blocks[program.motions[k].block].modal.arc_absolute else ""
