"""The same FANUC listing back with only its positions and speeds changed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from counterflex.core.arrays import Float
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
    remarks,
    short,
    values_text,
    wpr_of,
)
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits
from counterflex.programs.robot_text.circle_fit import FittedCircle, Spans
from counterflex.programs.robot_text.in_place import PointsInPlace, near_angles

_DECIMAL_MM = 10.0**-LIMITS.position_decimals
_DECIMAL_DEG = 10.0**-LIMITS.angle_decimals
_ADDED_TERMINATION = "CNT100"


class _ListingEdits:
    """Changes of one listing."""

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


class FanucInPlace(PointsInPlace[FanucProgram, FanucMotion]):
    """Edits of the listings of a job.

    A position that the code names more than once gets an entry of its own. Added points are lines without a number
    before the instruction (a controller numbers lines itself), with entries of their own behind the last one: frames,
    CONFIG and external axes of the position that they lead to.
    """

    limits: ClassVar[Limits] = LIMITS
    cycle_s: ClassVar[float] = 0.008

    def __init__(self, program: FanucProgram, compensated: CompensatedPath, tolerance_m: float, cycle_s: float) -> None:
        super().__init__(program, compensated, tolerance_m, cycle_s)
        self._divided = -1  # Index of the motion that got its last added point with a speed of its own
        self._edits = {name: _ListingEdits(listing) for name, listing in program.listings.items()}

    def points_of(self, program: FanucProgram) -> list[FanucMotion]:
        """The instructions."""
        return list(program.moves)

    def files(self, messages: list[str]) -> dict[str, str]:
        """Texts with all edits; comments at the head of /MN and entries behind the last one of those that change."""
        newline, out = self.program.newline, {}
        for name, edits in self._edits.items():
            if edits.changed or (messages and name == self.program.name):
                head = "".join(f"{newline}    :  !{line} ;" for line in remarks(messages))
                edits.spans.insert(edits.listing.main, head)
                entries = "".join(f"{newline}{entry}" for entry in edits.entries)
                if entries and not edits.listing.has_positions:
                    entries = f"/POS{entries}{newline}"
                edits.spans.insert(edits.listing.behind, entries)
            out[name] = edits.spans.applied(edits.listing.text)
        return out

    # ---- language --------------------------------------------------------------------------------------------

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``L`` on a line of its own before the instruction."""
        move, like = self.program.moves[index], self.like(index)
        self.refuse_repeated(move)
        edits = self._edits[move.file]
        name = edits.entry(self._entry_text(like, edits, like.in_frame(p, R_part_tcp)))
        speed = like.speed_text
        if like.word == "J":
            speed = f"{short((speed_m_s or self._first_feed_m_s()) / MM_PER_S)}mm/sec"
        elif speed_m_s is not None or like.by_time:
            speed_m_s = speed_m_s or self._fed(index)
            speed = f"{short(speed_m_s / like.unit_m_s)}{like.unit}"
            self.counts.speeds_changed += 1
            self._divided = index
        termination = "FINE" if exact else _ADDED_TERMINATION if like.exact else like.termination
        edits.spans.insert(move.head, f"    :L {name} {speed} {termination} ;{self.program.newline}")

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The position of the instruction, and its speed."""
        move = self.program.moves[index]
        if move.word == "WAIT" or move.T_frame_tool is None:  # a place by axes stays
            return p if move.word == "WAIT" else np.asarray(self.program.motions[index].p_end)
        if speed_m_s is None and move.by_time and self._divided == index:
            speed_m_s = self._fed(index)
        if speed_m_s is not None and move.unit_m_s > 0.0:
            self.refuse_repeated(move)
            self.counts.speeds_changed += 1
            edits = self._edits[move.file]
            edits.spans.replace(*move.speed, f"{short(speed_m_s / move.unit_m_s)}{move.unit}")
        return self.end_at(move, p, R_part_tcp)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        auxiliary = self._auxiliary(move)
        p = (move.T_part_frame @ frame_of(auxiliary.values))[:3, 3]
        T = pose.inverse(move.T_part_frame) @ pose.make(np.eye(3), fit.at(p))
        self._write_literal(move, auxiliary, move.auxiliary_named, T[:3, 3], None)

    def straightened(self, index: int) -> None:
        """``L`` with the end alone."""
        move = self.program.moves[index]
        self._auxiliary(move)
        self.refuse_repeated(move)
        spans = self._edits[move.file].spans
        spans.replace(move.start, move.start + 1, "L")
        spans.replace(move.auxiliary_named[0], move.named[0], "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _fed(self, index: int) -> float:
        """Speed of the last motion along the path up to one, m/s: a time of the whole is none of its pieces."""
        return next(motion.feed_m_s for motion in self.program.motions[index::-1] if motion.feed_m_s > 0.0)

    def _first_feed_m_s(self) -> float:
        return next(motion.feed_m_s for motion in self.program.motions if motion.feed_m_s > 0.0)

    def _auxiliary(self, move: FanucMotion) -> FanucPosition:
        if move.auxiliary is None:
            what = "a circle of A is corrected" if move.word == "A" else "a circle to computed points is corrected"
            raise self.refusal(move, f"{what}, and is not written back", "Write it as C" if move.word == "A" else "")
        return move.auxiliary

    def shown(self, point: FanucMotion) -> str:
        """Text of an instruction."""
        return self.program.listings[point.file].text[point.start : point.end]

    def literal(self, point: FanucMotion, T_frame_tool: Float, *, turned: bool) -> Float | None:
        """Change the entry of /POS."""
        if point.position is None:
            return None
        wpr = wpr_of(T_frame_tool[:3, :3]) if turned else None
        return self._write_literal(point, point.position, point.named, T_frame_tool[:3, 3], wpr)

    def write_out(self, point: FanucMotion, T_frame_tool: Float) -> None:
        """An entry of its own, without the options that displace it."""
        edits = self._edits[point.file]
        edits.spans.replace(*point.named, edits.entry(self._entry_text(point, edits, T_frame_tool)))
        for start, end in point.options:
            edits.spans.replace(start, end, "")

    def _write_literal(
        self, move: FanucMotion, position: FanucPosition, named: tuple[int, int], p_user: Float,
        wpr: tuple[float, float, float] | None,
    ) -> Float:  # fmt: skip
        """Give a position other numbers; returns its place in the part as it is written, (3,) m."""
        changes = self._numbers(position, p_user, wpr)
        edits = self._edits[move.file]
        if not changes:
            unchanged: Float = (move.T_part_frame @ frame_of(position.values))[:3, 3]
            return unchanged
        self.refuse_repeated(move)
        if edits.listing.mentions.get(position.number, 0) > 1:
            edits.spans.replace(*named, edits.entry(self._like_entry(edits, position, changes)))
            self.counts.targets_written_out += 1
        else:
            for change in changes:
                edits.spans.replace(*change)
            self.counts.targets_declared += 1
        out: Float = (move.T_part_frame @ np.append(self.rounded(p_user), 1.0))[:3]
        return out

    def _entry_text(self, like: FanucMotion, edits: _ListingEdits, T_user_tool: Float) -> str:
        """An entry like the end of an instruction."""
        if like.position is not None:
            wpr = wpr_of(T_user_tool[:3, :3])
            changes = self._numbers(like.position, T_user_tool[:3, 3], wpr)
            return self._like_entry(edits, like.position, changes)
        if not like.config:
            raise self.refusal(like, "a target is corrected whose CONFIG is the controller's, and is not written back")
        frame, tool = like.frames
        newline = self.program.newline
        text = f"P[{edits.next}]{{\n   GP1:\n\tUF : {frame}, UT : {tool},\t\tCONFIG : '{like.config}',\n"
        return f"{text}{values_text(T_user_tool)}\n}};".replace("\n", newline)

    def _like_entry(self, edits: _ListingEdits, like: FanucPosition, changes: list[tuple[int, int, str]]) -> str:
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
            values |= dict(zip("WPR", near_angles(wpr, old).tolist(), strict=True))
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


write_fanuc_in_place = FanucInPlace.write
