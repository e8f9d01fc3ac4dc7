"""The same FANUC listing back with only its positions and speeds changed."""

from __future__ import annotations

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, MM_PER_S
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.fanuc.program import LETTERS, FanucMotion, FanucPosition, FanucProgram, frame_of, wpr_of
from counterflex.programs.fanuc.spelling import remarks, short
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import FANUC
from counterflex.programs.robot_text.circle_fit import FittedCircle
from counterflex.programs.robot_text.in_place import InPlace, InPlaceText
from counterflex.programs.robot_text.spans import Spans

_DECIMAL_MM = 10.0**-FANUC.position_decimals
_DECIMAL_DEG = 10.0**-FANUC.angle_decimals
_ADDED_TERMINATION = "CNT100"


def write_fanuc_in_place(
    program: FanucProgram,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    cycle_s: float = 0.008,
    cell: str = "",
    job: str = "",
) -> InPlaceText:
    """Write a listing back with its positions replaced by the commanded ones.

    Every byte that is no number of a corrected position or of a changed speed stays. A position that the code names
    more than once gets an entry of its own. Added points are lines without a number before the instruction (a
    controller numbers lines itself), with entries of their own behind the last one: frames, CONFIG and external axes of
    the position that they lead to. Nothing at all changes when no row is corrected.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion,
            before rounding; > 0, m.
        cycle_s: Time the controller needs per point, s, > 0.
        cell: Name of the cell, for the comment at the head.
        job: Hash of the plan, for the same.

    Returns:
        File and counts.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: A circle of A is corrected.
    """
    as_positive("tolerance_m", tolerance_m)
    as_positive("cycle_s", cycle_s)
    writer = _InPlace(program, compensated, tolerance_m=tolerance_m, cycle_s=cycle_s, decimal_m=_DECIMAL_MM * MM)
    if not writer.changed:
        return writer.result({program.name: program.text})
    writer.run()
    return writer.result({program.name: writer.whole(writer.messages(__version__, cell, mark(job) if job else ""))})


class _InPlace(InPlace):
    """Edits of the text of a listing."""

    def __init__(self, program: FanucProgram, compensated: CompensatedPath, **options: float) -> None:
        super().__init__(program, compensated, **options)
        self.program, self.edits = program, Spans()
        self._entries: list[str] = []
        self._next = max(program.positions, default=0) + 1

    def whole(self, messages: list[str]) -> str:
        """The text with all edits, comments at the head of /MN, and entries behind the last one."""
        program = self.program
        self.edits.insert(program.main, "".join(f"{program.newline}    :  !{line} ;" for line in remarks(messages)))
        self.edits.insert(program.behind, "".join(f"{program.newline}{entry}" for entry in self._entries))
        return self.edits.applied(program.text)

    # ---- language --------------------------------------------------------------------------------------------

    def rounded(self, p: Float) -> Float:
        """(3,) m, as positions are written."""
        out: Float = np.round(p / MM, FANUC.position_decimals) * MM
        return out

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``L`` on a line of its own before the instruction."""
        move, like = self.program.moves[index], self._like(index)
        if like.position is None:
            raise ValueError("a motion without a position")
        name = self._entry(like.position, p, wpr_of(R_part_tcp @ like.R_tcp_tool))
        speed, text = like.speed_text, self.program.text
        unit = text[like.speed[1] : text.index(like.termination, like.speed[1])].strip()
        if like.word == "J":
            speed, unit = short((speed_m_s or self._first_feed_m_s()) / MM_PER_S), "mm/sec"
        elif speed_m_s is not None:
            speed = short(speed_m_s / like.unit_m_s)
            self.counts.speeds_changed += 1
        termination = "FINE" if exact else _ADDED_TERMINATION if like.exact else like.termination
        self.edits.insert(move.head, f"    :L {name} {speed}{unit} {termination} ;{self.program.newline}")

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The position of the instruction, and its speed."""
        move = self.program.moves[index]
        if move.position is None:
            return p
        if speed_m_s is not None and move.unit_m_s > 0.0:
            self.counts.speeds_changed += 1
            self.edits.replace(*move.speed, short(speed_m_s / move.unit_m_s))
        wpr = None if R_part_tcp is None else wpr_of(R_part_tcp @ move.R_tcp_tool)
        return self._write(move.position, move.named, p, wpr)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        auxiliary = self._auxiliary(move)
        self._write(auxiliary, move.auxiliary_named, fit.at(frame_of(auxiliary.values)[:3, 3]), None)

    def straightened(self, index: int) -> None:
        """``L`` with the end alone."""
        move = self.program.moves[index]
        self._auxiliary(move)
        self.edits.replace(move.start, move.start + 1, "L")
        self.edits.replace(move.auxiliary_named[0], move.named[0], "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _first_feed_m_s(self) -> float:
        return next(motion.feed_m_s for motion in self.program.motions if motion.feed_m_s > 0.0)

    def _auxiliary(self, move: FanucMotion) -> FanucPosition:
        if move.auxiliary is None:
            raise ProgramError(
                "a circle of A is corrected, and is not written back", where=f"{self.program.name}:{move.line}",
                value=self.program.lines[move.line - 1].strip()[:60], hint="Write it as C",
            )  # fmt: skip
        return move.auxiliary

    def _like(self, index: int) -> FanucMotion:
        """The instruction that an added one is like: that of the motion, of a wait the one before."""
        moves = self.program.moves
        return next(moves[i] for i in range(index, -1, -1) if moves[i].position is not None)

    def _write(
        self, position: FanucPosition, named: tuple[int, int], p: Float,
        wpr: tuple[float, float, float] | None,
    ) -> Float:  # fmt: skip
        """Give a position other numbers; returns its place as it is written, (3,) m."""
        edits = self._numbers(position, p, wpr)
        if not edits:
            unchanged: Float = frame_of(position.values)[:3, 3]
            return unchanged
        if self.program.mentions.get(position.number, 0) > 1:
            self.edits.replace(*named, self._entry(position, p, wpr))
            self.counts.targets_written_out += 1
        else:
            for edit in edits:
                self.edits.replace(*edit)
            self.counts.targets_declared += 1
        return self.rounded(p)

    def _numbers(
        self, position: FanucPosition, p: Float, wpr: tuple[float, float, float] | None
    ) -> list[tuple[int, int, str]]:
        """Edits of the numbers that change; an angle is written as the turn that lies nearest."""
        values: dict[str, float] = dict(zip("XYZ", (p / MM).tolist(), strict=True))
        if wpr is not None:
            old = np.array([position.values[letter] for letter in "WPR"])
            values |= dict(zip("WPR", _near(wpr, old), strict=True))
        out = []
        for letter in LETTERS:
            decimals, half = (
                (FANUC.position_decimals, 0.5 * _DECIMAL_MM)
                if letter in "XYZ"
                else (FANUC.angle_decimals, 0.5 * _DECIMAL_DEG)
            )
            if letter in values and abs(values[letter] - position.values[letter]) > half:
                out.append((*position.numbers[letter], number(values[letter], decimals)))
        return out

    def _entry(self, like: FanucPosition, p: Float, wpr: tuple[float, float, float] | None) -> str:
        """A new entry like another one; returns ``P[n]``."""
        spans = Spans()
        for edit in self._numbers(like, p, wpr):
            spans.replace(*edit)
        spans.replace(*like.index, f"{self._next}")
        self._entries.append(spans.applied(self.program.text, like.start, like.end))
        self._next += 1
        return f"P[{self._next - 1}]"


def _near(wpr: tuple[float, float, float], old: Float) -> list[float]:
    """W, P, R of the same orientation, deg, in +-180, near others."""
    w, p, r = wpr
    ways = [np.array([w, p, r]), np.array([w + 180.0, 180.0 - p, r + 180.0])]
    ways = [way - 360.0 * np.round((way - old) / 360.0) for way in ways]
    best = min(ways, key=lambda way: float(np.abs(way - old).max()))
    best = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
    out: list[float] = best.tolist()
    return out
