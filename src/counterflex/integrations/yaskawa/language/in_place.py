"""The same job back with only its positions and speeds changed."""

from __future__ import annotations

import re
from typing import ClassVar, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.yaskawa.language import LIMITS, program as inform
from counterflex.integrations.yaskawa.language.program import comments, entry_text, numbers_text, speed_text
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.limits import Limits
from counterflex.programs.robot_text.circle_fit import FittedCircle, Spans
from counterflex.programs.robot_text.in_place import SAME_TURN, PointsInPlace, near_angles

_DECIMALS: Final = np.array([10.0**-LIMITS.position_decimals] * 3 + [10.0**-LIMITS.angle_decimals] * 3)
_ADDED: Final = re.compile(r"(?:ACC|DEC|PL=[1-8]|CR)\S*", re.IGNORECASE)
_OF_ARCS: Final = re.compile(r"\s+(?:FPT|COORD=\S+)(?=\s|$)", re.IGNORECASE)
_FRAME: Final = re.compile(r"\s+(?:BF|RF|TF|UF#\(\d+\))(?=\s|$)", re.IGNORECASE)
_LINE_END: Final = re.compile(r"\r\n|\n|\r|\Z")


class _JobEdits:
    """Changes of one job."""

    def __init__(self, job: inform.JobText, newline: str) -> None:
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

    def entry(self, header: inform.Header, T_frame_tool: Float) -> str:
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


class InformInPlace(PointsInPlace[inform.InformProgram, inform.Point]):
    """Edits of the jobs of a program.

    A position that instructions name more than once gets an entry of its own. Added points are instructions before the
    one that they lead to, with entries behind the last C; the count in ``///NPOS`` follows.
    """

    limits: ClassVar[Limits] = LIMITS
    cycle_s: ClassVar[float] = 0.004

    def __init__(
        self, program: inform.InformProgram, compensated: CompensatedPath, tolerance_m: float, cycle_s: float
    ) -> None:
        super().__init__(program, compensated, tolerance_m, cycle_s)
        self._edits = {name: _JobEdits(job, program.newline) for name, job in program.jobs.items()}
        self._straightened: set[int] = set()
        self._starts: dict[int, Float] = {}

    def points_of(self, program: inform.InformProgram) -> list[inform.Point]:
        """Their ends."""
        return [move.point for move in program.moves]

    def files(self, messages: list[str]) -> dict[str, str]:
        """Texts with all edits."""
        for index, move in enumerate(self.program.moves if messages else ()):
            kept = self.program.motions[index].kind == "arc" and index not in self._straightened
            if kept and move.start is None and not move.piece and self._left_arc(index):
                self._begin_arc(index, self._starts[index])
        return {
            name: edits.text(messages) if edits.changed or (messages and name == self.program.name) else edits.job.text
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

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``MOVL`` on a line of its own before the instruction."""
        at, like = self.program.moves[index].point, self.like(index)
        if self.program.motions[index].kind == "dwell":
            self._straightened.add(index)
        self.refuse_repeated(at)
        edits = self._edits[at.file]
        name = edits.entry(like.header, like.in_frame(p, R_part_tcp))
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
            if move.word != "MOVJ" and self.moved(nominal, p, R_part_tcp):
                raise self.refusal(at, "a target in pulses is corrected, and is not written back")
            return nominal
        if speed_m_s is not None:
            self._set_speed(index, speed_m_s)
        return self.end_at(at, p, R_part_tcp)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Other points on the circle, and at its start where a MOVC stands there."""
        move = self.program.moves[index]
        self._refuse_piece(move)
        first, last = int(self.rows.first[index]), int(self.rows.last[index])
        if move.start is not None:
            self.end_at(move.start, fit.p_start, self._turned(index - 1, first - 1))
        for point in move.through:
            p = fit.at(point.T_part_tool[:3, 3])
            row = first + int(np.argmin(np.linalg.norm(self.rows.command[first : last + 1] - p, axis=1)))
            self.end_at(point, p, self._turned(index, row))

    def straightened(self, index: int) -> None:
        """``MOVL`` in place of ``MOVC``; the points between go."""
        move = self.program.moves[index]
        self._refuse_piece(move)
        self.refuse_repeated(move.point)
        self._straightened.add(index)
        spans = self._edits[move.point.file].spans
        if move.start is not None:
            spans.replace(move.start.start, move.start.start + 4, "MOVL")
            p = self._corrected_start(index)
            self.end_at(move.start, p, self._turned(index - 1, int(self.rows.first[index]) - 1))
        spans.replace(move.point.start, move.point.start + 4, "MOVL")
        text = self.program.jobs[move.point.file].text
        for match in _OF_ARCS.finditer(text, move.point.named[1], move.point.end):
            spans.replace(*match.span(), "")
        for point in move.through:
            behind = _LINE_END.search(text, point.end)
            spans.replace(point.head, point.end if behind is None else behind.end(), "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _turned(self, index: int, row: int) -> Float | None:
        """(3, 3) commanded orientation at a row of a motion: each point of an arc states its own; None as it was."""
        return self.orientation(index, row) if np.any(np.abs(self.rotvec[row]) > SAME_TURN) else None

    def _corrected_start(self, index: int) -> Float:
        """(3,) m, where an arc begins as it is written."""
        first = int(self.rows.first[index])
        out: Float = self.rounded(self.rows.command[first - 1])
        return out

    def _begin_arc(self, index: int, p_start: Float) -> None:
        """A MOVC at the start of an arc whose start was the end of one that is straight now."""
        before, move = self.like(index - 1), self.program.moves[index]
        edits = self._edits[before.file]
        R = self.orientation(index - 1, int(self.rows.first[index]) - 1)
        name = edits.entry(before.header, before.in_frame(p_start, R))
        first = move.through[0] if move.through else move.point
        speed = speed_text(self._programmed_m_s(index))
        edits.spans.insert(first.head, f"MOVC {name} V={speed}{self.program.newline}")

    def _set_speed(self, index: int, speed_m_s: float) -> None:
        """Give all instructions of a motion another speed."""
        move = self.program.moves[index]
        for at in (*move.through, move.point) if index not in self._straightened else (move.point,):
            self.refuse_repeated(at)
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

    def shown(self, point: inform.Point) -> str:
        """Text of an instruction."""
        return self.program.jobs[point.file].text[point.start : point.end]

    def place(self, point: inform.Point) -> str:
        """With its column."""
        return f"{super().place(point)}:{point.start - point.head + 1}"

    def _refuse_piece(self, move: inform.InformMotion) -> None:
        if move.piece:
            raise self.refusal(move.point, "an arc is corrected whose points differ in speed or have something "
                               "between them, and is not written back")  # fmt: skip

    def literal(self, point: inform.Point, T_frame_tool: Float, *, turned: bool) -> Float | None:
        """Change the entry of //POS."""
        if point.position is None:
            return None
        return self._write_literal(point, point.position, T_frame_tool, turned=turned)

    def write_out(self, point: inform.Point, T_frame_tool: Float) -> None:
        """An entry of its own; a MOVL in place of an IMOV."""
        edits = self._edits[point.file]
        if point.header.postype in ("", inform.PULSE):
            raise self.refusal(point, "a target whose frame is not stated is corrected")
        edits.spans.replace(*point.named, edits.entry(point.header, T_frame_tool))
        if point.relative:
            spans, text = edits.spans, edits.job.text
            spans.replace(point.start, point.start + 4, "MOVL")
            frame = _FRAME.search(text, point.named[1], point.end)
            if frame is not None:
                spans.replace(*frame.span(), "")

    def _write_literal(self, at: inform.Point, position: inform.Position, T: Float, *, turned: bool) -> Float:
        """Give a position other numbers; returns its place in the part as it is written, (3,) m."""
        old = np.array(position.values[:6])
        new = old.copy()
        new[:3] = T[:3, 3] / MM
        if turned:
            new[3:] = near_angles(inform.angles_of(T[:3, :3]), old[3:], LIMITS.angle_decimals)
        changed = np.abs(new - old) > 0.5 * _DECIMALS
        if not changed.any():
            unchanged: Float = at.T_part_tool[:3, 3]
            return unchanged
        self.refuse_repeated(at)
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


write_inform_in_place = InformInPlace.write
