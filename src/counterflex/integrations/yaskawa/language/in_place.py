"""The same job back with only its positions and speeds changed."""

from __future__ import annotations

import re
from collections import Counter
from typing import Final

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.integrations.yaskawa.language import LIMITS
from counterflex.integrations.yaskawa.language.program import (
    PULSE,
    Header,
    InformMotion,
    InformProgram,
    JobText,
    Point,
    Position,
    angles_of,
)
from counterflex.integrations.yaskawa.language.spelling import comments, entry_text, numbers_text, speed_text
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.robot_text.circle_fit import FittedCircle
from counterflex.programs.robot_text.in_place import InPlace, InPlaceText
from counterflex.programs.robot_text.spans import Spans

_DECIMALS: Final = np.array([10.0**-LIMITS.position_decimals] * 3 + [10.0**-LIMITS.angle_decimals] * 3)
_ADDED: Final = re.compile(r"(?:ACC|DEC|PL=[1-8]|CR)\S*", re.IGNORECASE)
_OF_ARCS: Final = re.compile(r"\s+(?:FPT|COORD=\S+)(?=\s|$)", re.IGNORECASE)
_FRAME: Final = re.compile(r"\s+(?:BF|RF|TF|UF#\(\d+\))(?=\s|$)", re.IGNORECASE)
_LINE_END: Final = re.compile(r"\r\n|\n|\r|\Z")
_CONVERT: Final = "counterflex convert writes the program out, one instruction for each motion: compensate that one"


def write_inform_in_place(
    program: InformProgram,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    cycle_s: float = 0.004,
    cell: str = "",
    job: str = "",
) -> InPlaceText:
    """Write a job back with its positions replaced by the commanded ones.

    Every byte that is no number of a corrected position or of a changed speed stays. A position that instructions name
    more than once gets an entry of its own. Added points are instructions before the one that they lead to, with
    entries behind the last C; the count in ``///NPOS`` follows. Nothing at all changes when no row is corrected.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion,
            before rounding; > 0, m.
        cycle_s: Time the controller needs per point, s, > 0.
        cell: Name of the cell, for the comment at the head.
        job: Hash of the plan, for the same.

    Returns:
        Files and counts; those of the job that do not change are byte for byte as read.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: An instruction that runs more than once, or a target in pulses, is corrected.
    """
    as_positive("tolerance_m", tolerance_m)
    as_positive("cycle_s", cycle_s)
    writer = _InPlace(
        program, compensated, tolerance_m=tolerance_m, cycle_s=cycle_s, decimal_m=float(_DECIMALS[0]) * MM
    )
    if not writer.changed:
        return writer.result({name: one.text for name, one in program.jobs.items()})
    writer.run()
    return writer.result(writer.files(writer.messages(__version__, cell, mark(job) if job else "")))


class _Edits:
    """Changes of one job.

    Args:
        job: As read.
        newline: Its line end.
    """

    def __init__(self, job: JobText, newline: str) -> None:
        self.job, self.newline, self.spans = job, newline, Spans()
        own = [number for kind, number in job.positions if kind == "C"]
        self._next, self._count = max(own, default=-1) + 1, len(own)
        self._entries: list[str] = []
        self._header = job.at_behind
        names = [
            job.text[one.start : one.end].partition("=")[0].strip() for (k, _), one in job.positions.items() if k == "C"
        ]
        self._digits = len(names[-1]) - 1 if names else 5

    @property
    def changed(self) -> bool:
        """Anything differs."""
        return bool(self._entries or self.spans.sorted())

    def entry(self, header: Header, T_frame_tool: Float) -> str:
        """Add an entry of //POS; returns its name."""
        if header != self._header:
            self._entries += header.lines()
            self._header = header
        self._entries.append(entry_text("C", self._next, T_frame_tool, self._digits))
        self._next, self._count = self._next + 1, self._count + 1
        return f"C{self._next - 1:0{self._digits}d}"

    def text(self, messages: list[str]) -> str:
        """The job with all edits, and comments behind NOP."""
        head = "".join(f"'{line}{self.newline}" for line in comments(messages))
        self.spans.insert(self.job.first, head)
        if self._entries:
            back = self.job.at_behind.lines() if self.job.followed and self._header != self.job.at_behind else []
            added = "".join(f"{self.newline}{line}" for line in [*self._entries, *back])
            self.spans.insert(self.job.behind, added)
            self.spans.replace(*self.job.npos, f"{self._count}")
        return self.spans.applied(self.job.text)


class _InPlace(InPlace):
    """Edits of the jobs of a program."""

    def __init__(self, program: InformProgram, compensated: CompensatedPath, **options: float) -> None:
        super().__init__(program, compensated, **options)
        self.program = program
        self._edits = {name: _Edits(job, program.newline) for name, job in program.jobs.items()}
        self._again = Counter((move.point.file, move.point.start) for move in program.moves)
        self._straightened: set[int] = set()
        self._starts: dict[int, Float] = {}

    def files(self, messages: list[str]) -> dict[str, str]:
        """Texts with all edits."""
        for index, move in enumerate(self.program.moves):
            kept = self.program.motions[index].kind == "arc" and index not in self._straightened
            if kept and move.start is None and not move.piece and self._left_arc(index):
                self._begin_arc(index, self._starts[index])
        return {
            name: edits.text(messages) if edits.changed or name == self.program.name else edits.job.text
            for name, edits in self._edits.items()
        }

    def _left_arc(self, index: int) -> bool:
        """Return whether the MOVC that an arc begins at is a MOVL now, or a MOVL was put behind it."""
        before = index - 1
        while self.program.motions[before].kind == "dwell" and before not in self._straightened:
            before -= 1
        return before in self._straightened

    def begun(self, index: int) -> None:
        """Remember where a motion begins."""
        self._starts[index] = self.p_here

    # ---- language --------------------------------------------------------------------------------------------

    def rounded(self, p: Float) -> Float:
        """(3,) m, as positions are written."""
        out: Float = np.round(p / MM, LIMITS.position_decimals) * MM
        return out

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``MOVL`` on a line of its own before the instruction."""
        at, like = self.program.moves[index].point, self._like(index)
        if self.program.motions[index].kind == "dwell":
            self._straightened.add(index)
        self._refuse_repeated(at)
        edits = self._edits[at.file]
        name = edits.entry(like.header, self._in_frame(like, p, R_part_tcp))
        speed = speed_m_s or self._programmed_m_s(index)
        self.counts.speeds_changed += speed_m_s is not None
        carried = [word for word in _ADDED.findall(like.tail) if not exact or word[:2].upper() not in ("PL", "CR")]
        words = [f"MOVL {name}", like.words, f"V={speed_text(speed)}", "PL=0" if exact else "", *carried]
        edits.spans.insert(at.head, f"{' '.join(word for word in words if word)}{self.program.newline}")

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The position of the instruction, and its speed."""
        move = self.program.moves[index]
        at = move.point
        if move.word == "TIMER":
            return p
        if at.T_frame_tool is None:
            nominal = np.asarray(self.program.motions[index].p_end)
            if move.word != "MOVJ" and self._moves(nominal, p, R_part_tcp):
                raise self._refusal(at, "a target in pulses is corrected, and is not written back", _CONVERT)
            return nominal
        if speed_m_s is not None:
            self._set_speed(index, speed_m_s)
        return self._write(at, p, R_part_tcp)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Other points on the circle, and at its start where a MOVC stands there."""
        move = self.program.moves[index]
        self._refuse_piece(move)
        if move.start is not None:
            self._write(move.start, fit.p_start, None)
        for point in move.through:
            self._write(point, fit.at(point.T_part_tool[:3, 3]), None)

    def straightened(self, index: int) -> None:
        """``MOVL`` in place of ``MOVC``; the points between go."""
        move = self.program.moves[index]
        self._refuse_piece(move)
        self._refuse_repeated(move.point)
        self._straightened.add(index)
        spans = self._edits[move.point.file].spans
        if move.start is not None:
            spans.replace(move.start.start, move.start.start + 4, "MOVL")
            p = self._corrected_start(index)
            self._write(move.start, p, None)
        spans.replace(move.point.start, move.point.start + 4, "MOVL")
        text = self.program.jobs[move.point.file].text
        for match in _OF_ARCS.finditer(text, move.point.named[1], move.point.end):
            spans.replace(*match.span(), "")
        for point in move.through:
            behind = _LINE_END.search(text, point.end)
            spans.replace(point.head, point.end if behind is None else behind.end(), "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _corrected_start(self, index: int) -> Float:
        """(3,) m, where an arc begins as it is written."""
        first = int(self.rows.first[index])
        out: Float = self.rounded(self.rows.command[first - 1])
        return out

    def _begin_arc(self, index: int, p_start: Float) -> None:
        """A MOVC at the start of an arc whose start was the end of one that is straight now."""
        before, move = self._like(index - 1), self.program.moves[index]
        edits = self._edits[before.file]
        R = np.asarray(self.program.Rs_part_tcp)[index - 1]
        name = edits.entry(before.header, self._in_frame(before, p_start, R))
        first = move.through[0] if move.through else move.point
        speed = speed_text(self._programmed_m_s(index))
        edits.spans.insert(first.head, f"MOVC {name} V={speed}{self.program.newline}")

    def _set_speed(self, index: int, speed_m_s: float) -> None:
        """Give all instructions of a motion another speed."""
        move = self.program.moves[index]
        for at in (*move.through, move.point) if index not in self._straightened else (move.point,):
            self._refuse_repeated(at)
            text = f"V={speed_text(speed_m_s)}"
            spans = self._edits[at.file].spans
            if at.number[1] > at.number[0]:
                spans.replace(*at.number, text[2:])
            else:  # by SPEED
                spans.insert(at.named[1], f" {text}")
        self.counts.speeds_changed += 1

    def _programmed_m_s(self, index: int) -> float:
        own = self.program.motions[index].feed_m_s
        return own or next(motion.feed_m_s for motion in self.program.motions if motion.feed_m_s > 0.0)

    def _refusal(self, at: Point, what: str, hint: str, **data: bool) -> ProgramError:
        text = self.program.jobs[at.file].text
        return ProgramError(what, where=f"{at.file}:{at.line}:{at.start - at.head + 1}",
                            value=" ".join(text[at.start : at.end].split())[:60], hint=hint, **data)  # fmt: skip

    def _refuse_piece(self, move: InformMotion) -> None:
        if move.piece:
            raise self._refusal(move.point, "an arc is corrected whose points differ in speed or have something "
                                "between them, and is not written back", _CONVERT)  # fmt: skip

    def _refuse_repeated(self, at: Point) -> None:
        """Refuse to change an instruction that runs more than once: each run has a correction of its own."""
        if self._again[at.file, at.start] > 1:
            raise self._refusal(at, "an instruction that runs more than once is corrected, and is not written back",
                                _CONVERT, each_pass=True)  # fmt: skip

    def _like(self, index: int) -> Point:
        """The point that an added one is like: that of the motion, of a wait the one before."""
        points = [self.program.moves[i].point for i in range(index, -1, -1)]
        return next(point for point in points if point.T_frame_tool is not None)

    @staticmethod
    def _in_frame(at: Point, p: Float, R_part_tcp: Float) -> Float:
        """(4, 4) m of the tool frame in the frame of a point."""
        out: Float = pose.inverse(at.T_part_frame) @ pose.make(R_part_tcp @ at.R_tcp_tool, p)
        return out

    def _moves(self, old: Float, p: Float, R_part_tcp: Float | None) -> bool:
        return R_part_tcp is not None or float(np.abs(p - old).max()) > 0.5 * self.decimal_m

    def _write(self, at: Point, p: Float, R_part_tcp: Float | None) -> Float:
        """Give a point another place; returns it as it is written, (3,) m."""
        old = at.T_part_tool
        R = old[:3, :3] if R_part_tcp is None else R_part_tcp @ at.R_tcp_tool
        T = pose.inverse(at.T_part_frame) @ pose.make(R, p)
        if at.position is not None:
            return self._write_literal(at, at.position, T, turned=R_part_tcp is not None)
        if at.computed != "IMOV" and not self._moves(old[:3, 3], p, R_part_tcp):
            unchanged: Float = old[:3, 3]
            return unchanged
        self._refuse_repeated(at)
        edits = self._edits[at.file]
        if at.header.postype in ("", PULSE):
            raise self._refusal(at, "a target whose frame is not stated is corrected", _CONVERT)
        edits.spans.replace(*at.named, edits.entry(at.header, T))
        if at.computed == "IMOV":
            spans, text = edits.spans, edits.job.text
            spans.replace(at.start, at.start + 4, "MOVL")
            frame = _FRAME.search(text, at.named[1], at.end)
            if frame is not None:
                spans.replace(*frame.span(), "")
        self.counts.targets_written_out += 1
        return self.rounded(p)

    def _write_literal(self, at: Point, position: Position, T: Float, *, turned: bool) -> Float:
        """Give a position other numbers; returns its place in the part as it is written, (3,) m."""
        old = np.array(position.values[:6])
        new = old.copy()
        new[:3] = T[:3, 3] / MM
        if turned:
            new[3:] = _near(np.array(angles_of(T[:3, :3])), old[3:])
        changed = np.abs(new - old) > 0.5 * _DECIMALS
        if not changed.any():
            unchanged: Float = at.T_part_tool[:3, 3]
            return unchanged
        self._refuse_repeated(at)
        edits = self._edits[at.file]
        if edits.job.mentions.get(position.number, 0) > 1:
            edits.spans.replace(*at.named, edits.entry(position.header, T))
            self.counts.targets_written_out += 1
        else:
            texts = numbers_text(new.tolist())
            for k in np.flatnonzero(changed).tolist():
                edits.spans.replace(*position.numbers[k], texts[k])
            self.counts.targets_declared += 1
        out: Float = (at.T_part_frame @ np.append(self.rounded(T[:3, 3]), 1.0))[:3]
        return out


def _near(angles: Float, old: Float) -> Float:
    """(3,) Rx, Ry, Rz of the same orientation, deg, in +-180, near others."""
    x, y, z = angles
    ways = [np.array([x, y, z]), np.array([x + 180.0, 180.0 - y, z + 180.0])]
    ways = [way - 360.0 * np.round((way - old) / 360.0) for way in ways]
    best = np.round(min(ways, key=lambda way: float(np.abs(way - old).max())), LIMITS.angle_decimals)
    out: Float = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
    return out
