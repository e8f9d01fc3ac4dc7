"""Place of the machine while a written program runs, and the words that take it elsewhere."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, INCH, MM
from counterflex.programs.gcode.write.written_line import AXES, Spell, WrittenLine, number, spelling_of
from counterflex.programs.machine_in_place import MachineInPlace
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE
from counterflex.programs.program import TOOL_VECTOR, Block, Modal, Motion, Program

_MORE_DIGITS: Final = 1  # A rotary word has one decimal more than a length: 1e-5 deg moves the tip by 0.1 um at 0.6 m
_VECTOR_DIGITS: Final = 3  # A component of the tool axis has three more: 1e-7 rad


class TurnWords:
    """Rotary positions of the written program, beside those of its points; nothing where a program does not turn.

    Args:
        angles: (rows, 3) rad to command, or components of the tool axis; None where nothing turns.
        decimals: Of lengths in mm.
        spell: Spells a component of the tool axis.
    """

    def __init__(self, angles: Float | None, decimals: int, spell: Spell) -> None:
        self._angles, self._spell = angles, spell
        self._frame: tuple[tuple[float, float, float], ...] | None = None
        self._decimals = decimals
        self._written: list[float | None] = [None, None, None]

    def differ(self, modal: Modal, row: int) -> bool:
        """Return whether a row needs words that differ from what is written."""
        return any(text is not None for _, text in self._changes(modal, row, ()))

    def _changes(self, modal: Modal, row: int, named: tuple[str, ...]) -> list[tuple[str, str | None]]:
        """Letter and text of each place; no text where it is written already. ``named`` are to be written again."""
        if self._angles is None:
            return []
        vector = modal.tool_centre == TOOL_VECTOR
        digits = self._decimals + (_VECTOR_DIGITS if vector else _MORE_DIGITS)
        unit, letters = (1.0, "IJK") if vector else (DEG, "ABC")
        values = [round(angle / unit, digits) for angle in self._row(modal, row)]
        known = [0.0 if value is None else value for value in self._written]
        texts = [number(value, digits) for value in values]
        if vector:  # all three, or none
            same = values == known and not named
            return [(letter, None if same else text) for letter, text in zip(letters, texts, strict=True)]
        return [
            (letter, None if value == before and letter not in named else text)
            for letter, text, value, before in zip(letters, texts, values, known, strict=True)
        ]

    def _row(self, modal: Modal, row: int) -> list[float]:
        """Angles of a row, or the components of the tool axis in the programmed axes."""
        assert self._angles is not None
        angles = np.asarray(self._angles[row], dtype=np.float64)
        if modal.R_part_work != self._frame:  # what is written counts in other axes
            self._frame, self._written = modal.R_part_work, [None, None, None]
        turned = modal.tool_centre == TOOL_VECTOR and modal.R_part_work is not None
        return [float(angle) for angle in (angles @ np.array(modal.R_part_work) if turned else angles)]

    def set(self, line: WrittenLine, modal: Modal, row: int) -> None:
        """Edit the words of a line so that it turns to a row."""
        if self._angles is None:
            return
        letters = "IJK" if modal.tool_centre == TOOL_VECTOR else "ABC"
        named = tuple(letter for letter in letters if line.find(letter) is not None)
        for letter, text in self._changes(modal, row, named):
            if text is not None:
                line.set(letter, text)
        self.reach(modal, row)

    def added(self, modal: Modal, row: int) -> str:
        """Words of an added block that turns to a row, each with a blank before it."""
        words = "".join(
            " " + self._spelled(modal, letter, text) for letter, text in self._changes(modal, row, ()) if text
        )
        self.reach(modal, row)
        return words

    def _spelled(self, modal: Modal, letter: str, text: str) -> str:
        return self._spell(letter, text) if modal.tool_centre == TOOL_VECTOR else letter + text

    def reach(self, modal: Modal, row: int) -> None:
        """The written program stands where it is commanded to be at a row."""
        if self._angles is not None:
            vector = modal.tool_centre == TOOL_VECTOR
            digits = self._decimals + (_VECTOR_DIGITS if vector else _MORE_DIGITS)
            self._written = [round(angle if vector else angle / DEG, digits) for angle in self._row(modal, row)]


MOTION_CODES: Final = frozenset(
    (0.0, 1.0, 2.0, 3.0, 33.0, 38.2, 38.3, 38.4, 38.5, 73.0, 76.0, 80.0, 81.0, 82.0, 83.0, 84.0, 85.0, 86.0, 87.0, 88.0)
) | {89.0}
_STOPS: Final = frozenset((0.0, 1.0, 2.0, 17.0, 30.0, 60.0))


def work_axes(modal: Modal, points: Float) -> Float:
    """Points (..., 3) of the part along the programmed axes, from the zero of the part."""
    return points if modal.R_part_work is None else points @ np.array(modal.R_part_work)


class WrittenMachine(MachineInPlace):
    """Position and modal motion of the machine at each block of the written program, and the counts of the result.

    The offset ``off`` is the written minus the nominal position of the source at the same block, in m; an axis that
    was never moved has exactly zero. It is what later blocks inherit where they leave out a word, count from the
    current position (G91) or set the origin there (G92).
    """

    def prepare(self) -> None:
        """Begin where the program begins."""
        self.off = [0.0, 0.0, 0.0]
        motions = self.program.motions
        self.nominal: list[float] = list(map(float, motions[0].p_start)) if motions else [0.0] * 3
        self.written_motion: str | None = None
        self.feed_written = 1.0
        self.spelling = spelling_of(self.program.dialect)
        self.turns = TurnWords(self.rows.angles, self._decimals, self.spelling.vector_word)

    @staticmethod
    def unit_m(program: Program) -> float:
        """The larger one, where a program has inches and millimetres."""
        return max((block.modal.unit_m for block in program.blocks), default=MM)

    # ---- positions and numbers -------------------------------------------------------------------------------

    def spell(self, modal: Modal) -> Spell:
        """Return the spelling of words in a block."""
        vector = modal.tool_centre == TOOL_VECTOR and modal.motion in ("G0", "G1")
        return self.spelling.vector_word if vector else self.spelling.word

    def digits(self, modal: Modal) -> int:
        """Decimals of a written word in the units of a block."""
        return self._decimals + (modal.unit_m == INCH)

    def stand(self, p: Float) -> None:
        """Set the nominal position; the offset stays."""
        self.nominal = p.tolist()

    def begin(self, index: int, motion: Motion) -> None:
        """A motion starts; where the source jumps to its start (another tool length), the offset goes along."""
        self.stand(motion.p_start)
        start = int(self.rows.first[index]) - 1
        if self.rows.last[index] >= 0 and math.isnan(self.written[start, 0]):
            self.written[start] = self.here()

    def current(self, axis: int) -> float:
        """Written position on one axis, m."""
        return self.nominal[axis] + self.off[axis]

    def here(self) -> Float:
        """Written position, (3,) m."""
        return np.array([self.current(0), self.current(1), self.current(2)])

    def inherits(self, modal: Modal) -> bool:
        """Return whether the written position differs from the source's by more than rounding."""
        x, y, z = self.off
        if x == 0.0 and y == 0.0 and z == 0.0:
            return False
        half = 0.5 * modal.unit_m * 10.0 ** -self.digits(modal)
        return abs(x) > half or abs(y) > half or abs(z) > half

    def arrive(self, index: int, motion: Motion) -> None:
        """The motion's end is reached; ``off`` is already that at the end."""
        self.stand(motion.p_end)
        last = self.rows.last[index]
        if last >= 0:
            self.written[last] = self.here()
            self.checked[last] = True

    def target(self, modal: Modal, axis: int, target: float) -> tuple[str, float]:
        """Word value for a target on one axis, and the position it leads to."""
        digits = self.digits(modal)
        base = modal.p_part_origin[axis] if modal.absolute else self.current(axis)
        value = round((target - base) / modal.unit_m, digits)
        return number(value, digits), base + value * modal.unit_m

    def changes(self, modal: Modal, axis: int, target: float) -> bool:
        """Return whether a target differs from the written position by more than rounding."""
        return abs(target - self.current(axis)) > 0.5 * modal.unit_m * 10.0 ** -self.digits(modal)

    def check_words(self, block: Block, motion: Motion) -> None:
        """Corrected blocks must lead to their target by their own words, else an edit would go elsewhere."""
        modal = block.modal
        zero, starts, ends = work_axes(modal, np.array([modal.p_part_origin, motion.p_start, motion.p_end])).tolist()
        for word in block.words:
            axis = AXES.find(word.letter)
            base = (zero if word.counts_from_zero(modal) else starts)[axis]
            if axis >= 0 and abs(base + word.value * modal.unit_m - ends[axis]) > 1e-7:
                raise ProgramError(
                    "a corrected block does not lead to its target by its own words",
                    where=f"{block.where(self.program.name)}:{word.start + 1}", value=block.text.strip(),
                    hint="Write the motion in the work coordinate system (no machine coordinates, no polar words)",
                )  # fmt: skip
        if motion.abc_start != motion.abc_end and self.rows.angles is None:
            raise ProgramError(
                "a motion that turns a rotary axis cannot be corrected",
                where=f"{block.where(self.program.name)}:1",
                value=block.text.strip(),
            )

    def keep(self, line: WrittenLine, modal: Modal) -> None:
        """A line that stays as it is: absolute words lead to the nominal position, everything else keeps its offset."""
        words = [line.find(letter) for letter in AXES]
        settled = [word is not None and word.counts_from_zero(modal) for word in words]
        if modal.R_part_work is not None and not all(settled):
            return
        self.off = [0.0 if named else off for named, off in zip(settled, self.off, strict=True)]

    def set_end(self, line: WrittenLine, block: Block, motion: Motion, shift: Float) -> None:
        """Edit the axis words of a line so that it leads to the end of a motion plus ``shift``."""
        modal = block.modal
        if modal.R_part_work is not None:
            self.go(line, modal, motion.p_end + shift)
            self.off = (self.here() - motion.p_end).tolist()
            self.stand(motion.p_end)
            return
        ends, moves = motion.p_end.tolist(), shift.tolist()
        for axis in range(3):
            word = line.find(AXES[axis])
            end, move = ends[axis], moves[axis]
            if word is not None and move == 0.0 and (word.counts_from_zero(modal) or self.off[axis] == 0.0):
                reached = end
            elif word is None and not self.changes(modal, axis, end + move):
                reached = self.current(axis)
            else:
                text, reached = self.target(modal, axis, end + move)
                line.set(AXES[axis], text)
            self.off[axis] = reached - end
        self.stand(motion.p_end)

    def added(self, modal: Modal, p: Float) -> str:
        """Words of an added block to ``p``; only axes that move. The position is there afterwards."""
        if modal.R_part_work is not None:
            return "".join(f" {AXES[axis]}{text}" for axis, text in self._go_turned(None, modal, p))
        words = []
        for axis in range(3):
            if self.changes(modal, axis, float(p[axis])):
                text, reached = self.target(modal, axis, float(p[axis]))
                words.append(" " + AXES[axis] + text)
                self.off[axis] += reached - self.current(axis)
        return "".join(words)

    def go(self, line: WrittenLine, modal: Modal, p: Float) -> None:
        """Edit the axis words of a line so that it leads to ``p``. The position is there afterwards."""
        if modal.R_part_work is not None:
            for axis, text in self._go_turned(line, modal, p):
                line.set(AXES[axis], text)
            return
        for axis in range(3):
            if line.find(AXES[axis]) is not None or self.changes(modal, axis, float(p[axis])):
                text, reached = self.target(modal, axis, float(p[axis]))
                line.set(AXES[axis], text)
                self.off[axis] += reached - self.current(axis)

    def _go_turned(self, line: WrittenLine | None, modal: Modal, p: Float) -> list[tuple[int, str]]:
        """Axis words that lead to ``p`` in turned axes, and the position there; words that fit already are left."""
        words, reached = self._turned_words(line, modal, p)
        self.off = (reached - np.array(self.nominal)).tolist()
        return words

    def _turned_words(self, line: WrittenLine | None, modal: Modal, p: Float) -> tuple[list[tuple[int, str]], Float]:
        """The words for :meth:`_go_turned`, and the point in the part that they lead to."""
        R, zero = np.array(modal.R_part_work), np.array(modal.p_part_origin)
        digits, unit = self.digits(modal), modal.unit_m
        at, goal = ((self.here() - zero) @ R).tolist(), ((p - zero) @ R).tolist()
        half = 0.5000001 * unit * 10.0**-digits
        words = []
        for axis in range(3):
            word = line.find(AXES[axis]) if line is not None else None
            if word is None and abs(goal[axis] - at[axis]) <= half:
                continue
            if word is not None and word.counts_from_zero(modal) and abs(goal[axis] - word.value * unit) <= half:
                at[axis] = word.value * unit
                continue
            base = 0.0 if modal.absolute else at[axis]
            value = round((goal[axis] - base) / unit, digits)
            words.append((axis, number(value, digits)))
            at[axis] = base + value * unit
        return words, zero + R @ np.array(at)

    # ---- modal motion ----------------------------------------------------------------------------------------

    def state_motion(self, block: Block, line: WrittenLine, code: str) -> bool:
        """Write the motion word where the line has none and another one than ``code`` is active."""
        active = self.written_motion or block.modal.motion
        missing = active != code and line.find("G", MOTION_CODES) is None
        if missing:
            line.lead(code)
        self.written_motion = None
        return missing

    @staticmethod
    def exact_stop_word(line: WrittenLine) -> str:
        """Take an exact stop for one block (G9) out of a line that gets followers; the last of them gets it."""
        word = line.find("G", (9.0,))
        if word is None:
            return ""
        line.remove(word)
        return "G9 "

    def stop_word(self, line: WrittenLine) -> str | None:
        """Take a program stop out of a line that gets followers; it acts behind the motion."""
        word = line.find("M", _STOPS)
        if word is None:
            return None
        line.remove(word)
        return f"M{int(word.value)}"

    def feeds(self, line: WrittenLine, modal: Modal, shares: list[float]) -> list[str]:
        """Feed words of the pieces of a block: none, except in inverse time, where each has its share of the time."""
        feed = line.find("F")
        if modal.feed_mode != 93 or feed is None:
            return [""] * len(shares)
        words = [" F" + number(feed.value / share, 4) for share in shares]
        line.replace(feed, words[0].strip())
        return words

    def hold_feed(self, line: WrittenLine | None, modal: Modal, feed_m_s: float, factor: float) -> str:
        """Keep the programmed feed of the tool relative to the part; in units per minute (G94) only.

        A corrected piece is longer or shorter than what the loaded tool covers in the part. At the programmed feed the
        chips would get thinner there and the force another one than planned, so F is multiplied by commanded over
        nominal length. A following piece without that factor gets the programmed feed back.

        Args:
            line: Line that gets the word where it is needed; or None for an added line.
            feed_m_s: Programmed feed; 0 where the block has no feed motion.
            factor: See :func:`feed_factor`.

        Returns:
            The word with a blank before it, for an added line, perhaps empty.
        """
        if modal.feed_mode != 94:
            return ""
        if line is not None and line.find("F") is not None:
            self.feed_written = 1.0
        if feed_m_s <= 0.0 or abs(factor / self.feed_written - 1.0) <= LEAST_FEED_CHANGE:
            return ""
        self.feed_written = factor
        text = number(feed_m_s * 60.0 / modal.unit_of_feed_m * factor, 4 if factor == 1.0 else 1)
        if line is not None:
            line.set("F", text)
        return " F" + text

    @staticmethod
    def _shares(start: float, ways: Float, steps: Float) -> list[float]:
        """Share of the motion's time for each piece, at the speed of the whole; even where the motion has no length."""
        # A piece without nominal length (the correction is taken back) gets what its commanded length takes, in
        # addition.
        total = float(ways[-1]) - start
        if total <= 0.0:
            return [1.0 / len(ways)] * len(ways)
        pieces = np.diff(np.concatenate([[start], ways]))
        return [max(float(d if d > 0.0 else step) / total, 1e-6) for d, step in zip(pieces, steps, strict=True)]

    def reached(self, line: WrittenLine | None, modal: Modal, p: Float) -> Float:
        """Position (3,) m that :meth:`go` (with its line) or :meth:`added` (None) leads to."""
        if modal.R_part_work is not None:
            return self._turned_words(line, modal, p)[1]
        return np.array([self._reach(line, modal, axis, float(p[axis])) for axis in range(3)])

    def _reach(self, line: WrittenLine | None, modal: Modal, axis: int, target: float) -> float:
        if self.changes(modal, axis, target) or (line is not None and line.find(AXES[axis]) is not None):
            return self.target(modal, axis, target)[1]
        return self.current(axis)
