"""The same FANUC listing back with only its positions and speeds changed."""

from __future__ import annotations

from collections import Counter

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, MM_PER_S
from counterflex.geometry import pose
from counterflex.integrations.fanuc.language import LIMITS
from counterflex.integrations.fanuc.language.program import (
    LETTERS,
    FanucListing,
    FanucMotion,
    FanucPosition,
    FanucProgram,
    frame_of,
    wpr_of,
)
from counterflex.integrations.fanuc.language.spelling import remarks, short, values_text
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.robot_text.circle_fit import FittedCircle
from counterflex.programs.robot_text.in_place import InPlace, InPlaceText
from counterflex.programs.robot_text.spans import Spans

_DECIMAL_MM = 10.0**-LIMITS.position_decimals
_DECIMAL_DEG = 10.0**-LIMITS.angle_decimals
_ADDED_TERMINATION = "CNT100"
_CONVERT = "counterflex convert writes the program out, one instruction for each motion: compensate that one"


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
        Files and counts; those of the job that do not change are byte for byte as read.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: A circle of A, or an instruction that runs more than once, is corrected.
    """
    as_positive("tolerance_m", tolerance_m)
    as_positive("cycle_s", cycle_s)
    writer = _InPlace(program, compensated, tolerance_m=tolerance_m, cycle_s=cycle_s, decimal_m=_DECIMAL_MM * MM)
    if not writer.changed:
        return writer.result({name: listing.text for name, listing in program.listings.items()})
    writer.run()
    return writer.result(writer.files(writer.messages(__version__, cell, mark(job) if job else "")))


class _Edits:
    """Changes of one listing.

    Args:
        listing: As read.
    """

    def __init__(self, listing: FanucListing) -> None:
        self.listing, self.spans = listing, Spans()
        self.entries: list[str] = []
        self.next = max(listing.positions, default=0) + 1

    @property
    def changed(self) -> bool:
        """Anything differs."""
        return bool(self.entries or self.spans.sorted())

    def entry(self, text: str) -> str:
        """Add an entry of /POS; returns ``P[n]``."""
        self.entries.append(text)
        self.next += 1
        return f"P[{self.next - 1}]"


class _InPlace(InPlace):
    """Edits of the listings of a job."""

    def __init__(self, program: FanucProgram, compensated: CompensatedPath, **options: float) -> None:
        super().__init__(program, compensated, **options)
        self.program = program
        self._edits = {name: _Edits(listing) for name, listing in program.listings.items()}
        self._again = Counter((move.file, move.start) for move in program.moves)

    def files(self, messages: list[str]) -> dict[str, str]:
        """Texts with all edits; comments at the head of /MN and entries behind the last one of those that change."""
        newline, out = self.program.newline, {}
        for name, edits in self._edits.items():
            if edits.changed or name == self.program.name:
                head = "".join(f"{newline}    :  !{line} ;" for line in remarks(messages))
                edits.spans.insert(edits.listing.main, head)
                entries = "".join(f"{newline}{entry}" for entry in edits.entries)
                if entries and not edits.listing.has_positions:
                    entries = f"/POS{entries}{newline}"
                edits.spans.insert(edits.listing.behind, entries)
            out[name] = edits.spans.applied(edits.listing.text)
        return out

    # ---- language --------------------------------------------------------------------------------------------

    def rounded(self, p: Float) -> Float:
        """(3,) m, as positions are written."""
        out: Float = np.round(p / MM, LIMITS.position_decimals) * MM
        return out

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``L`` on a line of its own before the instruction."""
        move, like = self.program.moves[index], self._like(index)
        self._refuse_repeated(move)
        edits = self._edits[move.file]
        T = self._in_user(like, p, R_part_tcp)
        name = edits.entry(self._entry_text(like, edits, T))
        speed = like.speed_text
        if like.word == "J":
            speed = f"{short((speed_m_s or self._first_feed_m_s()) / MM_PER_S)}mm/sec"
        elif speed_m_s is not None:
            speed = f"{short(speed_m_s / like.unit_m_s)}{like.unit}"
            self.counts.speeds_changed += 1
        termination = "FINE" if exact else _ADDED_TERMINATION if like.exact else like.termination
        edits.spans.insert(move.head, f"    :L {name} {speed} {termination} ;{self.program.newline}")

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The position of the instruction, and its speed."""
        move = self.program.moves[index]
        if move.word == "WAIT" or move.T_user_tool is None:  # a place by axes stays
            return p if move.word == "WAIT" else np.asarray(self.program.motions[index].p_end)
        if speed_m_s is not None and move.unit_m_s > 0.0:
            self._refuse_repeated(move)
            self.counts.speeds_changed += 1
            edits = self._edits[move.file]
            edits.spans.replace(*move.speed, f"{short(speed_m_s / move.unit_m_s)}{move.unit}")
        return self._write(move, p, R_part_tcp)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        auxiliary = self._auxiliary(move)
        p = (move.T_part_user @ frame_of(auxiliary.values))[:3, 3]
        T = pose.inverse(move.T_part_user) @ pose.make(np.eye(3), fit.at(p))
        self._write_literal(move, auxiliary, move.auxiliary_named, T[:3, 3], None)

    def straightened(self, index: int) -> None:
        """``L`` with the end alone."""
        move = self.program.moves[index]
        self._auxiliary(move)
        self._refuse_repeated(move)
        spans = self._edits[move.file].spans
        spans.replace(move.start, move.start + 1, "L")
        spans.replace(move.auxiliary_named[0], move.named[0], "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _first_feed_m_s(self) -> float:
        return next(motion.feed_m_s for motion in self.program.motions if motion.feed_m_s > 0.0)

    def _auxiliary(self, move: FanucMotion) -> FanucPosition:
        if move.auxiliary is None:
            what = "a circle of A is corrected" if move.word == "A" else "a circle to computed points is corrected"
            raise self._refusal(
                move, f"{what}, and is not written back", "Write it as C" if move.word == "A" else _CONVERT
            )
        return move.auxiliary

    def _refusal(self, move: FanucMotion, what: str, hint: str, **data: bool) -> ProgramError:
        text = self.program.listings[move.file].text[move.start : move.end]
        shown = " ".join(text.split())[:60]
        return ProgramError(what, where=f"{move.file}:{move.line}", value=shown, hint=hint, **data)

    def _refuse_repeated(self, move: FanucMotion) -> None:
        """Refuse to change an instruction that runs more than once: each run has a correction of its own."""
        if self._again[move.file, move.start] > 1:
            raise self._refusal(move, "an instruction that runs more than once is corrected, and is not written back",
                                _CONVERT, each_pass=True)  # fmt: skip

    def _like(self, index: int) -> FanucMotion:
        """The instruction that an added one is like: that of the motion, of a wait the one before."""
        moves = self.program.moves
        return next(moves[i] for i in range(index, -1, -1) if moves[i].T_user_tool is not None)

    def _in_user(self, move: FanucMotion, p: Float, R_part_tcp: Float) -> Float:
        """(4, 4) m of the tool frame in the user frame of an instruction."""
        out: Float = pose.inverse(move.T_part_user) @ pose.make(R_part_tcp @ move.R_tcp_tool, p)
        return out

    def _write(self, move: FanucMotion, p: Float, R_part_tcp: Float | None) -> Float:
        """Give an instruction another end; returns its place as it is written, (3,) m."""
        old = move.T_part_user @ (np.eye(4) if move.T_user_tool is None else move.T_user_tool)
        T = pose.inverse(move.T_part_user) @ pose.make(
            old[:3, :3] if R_part_tcp is None else R_part_tcp @ move.R_tcp_tool, p
        )
        if move.position is not None:
            wpr = None if R_part_tcp is None else wpr_of(T[:3, :3])
            return self._write_literal(move, move.position, move.named, T[:3, 3], wpr)
        moved = float(np.abs(p - old[:3, 3]).max()) > 0.5 * self.decimal_m
        if not moved and R_part_tcp is None:
            unchanged: Float = old[:3, 3]
            return unchanged
        self._refuse_repeated(move)
        edits = self._edits[move.file]
        edits.spans.replace(*move.named, edits.entry(self._entry_text(move, edits, T)))
        for start, end in move.options:
            edits.spans.replace(start, end, "")
        self.counts.targets_written_out += 1
        return self.rounded(p)

    def _write_literal(
        self, move: FanucMotion, position: FanucPosition, named: tuple[int, int], p_user: Float,
        wpr: tuple[float, float, float] | None,
    ) -> Float:  # fmt: skip
        """Give a position other numbers; returns its place in the part as it is written, (3,) m."""
        changes = self._numbers(position, p_user, wpr)
        edits = self._edits[move.file]
        if not changes:
            unchanged: Float = (move.T_part_user @ frame_of(position.values))[:3, 3]
            return unchanged
        self._refuse_repeated(move)
        if edits.listing.mentions.get(position.number, 0) > 1:
            edits.spans.replace(*named, edits.entry(self._like_entry(edits, position, changes)))
            self.counts.targets_written_out += 1
        else:
            for change in changes:
                edits.spans.replace(*change)
            self.counts.targets_declared += 1
        out: Float = (move.T_part_user @ np.append(self.rounded(p_user), 1.0))[:3]
        return out

    def _entry_text(self, like: FanucMotion, edits: _Edits, T_user_tool: Float) -> str:
        """An entry like the end of an instruction."""
        if like.position is not None:
            wpr = wpr_of(T_user_tool[:3, :3])
            changes = self._numbers(like.position, T_user_tool[:3, 3], wpr)
            return self._like_entry(edits, like.position, changes)
        if not like.config:
            raise self._refusal(like, "a target is corrected whose CONFIG is the controller's, and is not written back",
                                _CONVERT)  # fmt: skip
        frame, tool = like.frames
        newline = self.program.newline
        text = f"P[{edits.next}]{{\n   GP1:\n\tUF : {frame}, UT : {tool},\t\tCONFIG : '{like.config}',\n"
        return f"{text}{values_text(T_user_tool)}\n}};".replace("\n", newline)

    def _like_entry(self, edits: _Edits, like: FanucPosition, changes: list[tuple[int, int, str]]) -> str:
        """An entry like another one with other numbers."""
        spans = Spans()
        for change in changes:
            spans.replace(*change)
        spans.replace(*like.index, f"{edits.next}")
        return spans.applied(edits.listing.text, like.start, like.end)

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
                (LIMITS.position_decimals, 0.5 * _DECIMAL_MM)
                if letter in "XYZ"
                else (LIMITS.angle_decimals, 0.5 * _DECIMAL_DEG)
            )
            if letter in values and abs(values[letter] - position.values[letter]) > half:
                out.append((*position.numbers[letter], number(values[letter], decimals)))
        return out


def _near(wpr: tuple[float, float, float], old: Float) -> list[float]:
    """W, P, R of the same orientation, deg, in +-180, near others."""
    w, p, r = wpr
    ways = [np.array([w, p, r]), np.array([w + 180.0, 180.0 - p, r + 180.0])]
    ways = [way - 360.0 * np.round((way - old) / 360.0) for way in ways]
    best = min(ways, key=lambda way: float(np.abs(way - old).max()))
    best = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
    out: list[float] = best.tolist()
    return out
