"""The same G-code back with only the targets changed."""

from __future__ import annotations

import itertools
import re
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.codes import CYCLES, code_name
from counterflex.programs.gcode.write.arcs import emit_arc
from counterflex.programs.gcode.write.machine import MOTION_CODES, WrittenMachine
from counterflex.programs.gcode.write.written_line import (
    AXES,
    WrittenLine,
    evaluated,
    flatten,
    number,
    without_comments,
)
from counterflex.programs.motion_rows import MotionRows, feed_factor
from counterflex.programs.program import Block, Modal, Motion, Program, Word, has_g

_NO_TARGET: Final = frozenset(
    (4.0, 5.1, 10.0, 22.0, 28.0, 30.0, 43.1, 50.1, 51.1, 52.0, 53.0, 65.0, 68.0, 92.0, 92.1, 92.2, 92.3)
)
_WRITTEN_OUT: Final = MOTION_CODES | {4.0, 28.0, 30.0}
_CYCLE_NAMES: Final = frozenset(code_name("G", code) for code in CYCLES)
_PATH_CONTROL: Final = frozenset((61.0, 61.1, 64.0))
_POSITION_PARAMETER: Final = re.compile(r"#\s*(5[0-4]\d\d|<\s*_(abs_)?[xyz]\s*>)", re.IGNORECASE)


class Emitter(WrittenMachine):
    """Writes a program block by block."""

    def prepare(self) -> None:
        """Begin where the program begins."""
        super().prepare()
        self._expanding = False
        self._exact = False  # G61: the program stops at every corner anyway
        self._freeze = any(_POSITION_PARAMETER.search(line) for line in self.program.lines)

    def run(self) -> list[str]:
        """All lines of the written program."""
        source = self.program.lines
        at = 0
        if len(self.written):
            self.written[0] = self.rows.nominal[0]
        for block in self.program.blocks:
            if self.program.straight:
                self.lines.extend(source[at : block.line - 1])
                at = block.line
                text, words = evaluated(block, self.digits(block.modal)) if self._freeze else (block.text, block.words)
                self._block(block, WrittenLine(text, words, self.spell(block.modal)))
            else:
                text, words = flatten(block, self.digits(block.modal))
                if text or not block.text.strip():
                    self._block(block, WrittenLine(text, words, self.spell(block.modal)))
        if self.program.straight:
            self.lines.extend(source[at:])
        return self.lines

    def _block(self, block: Block, line: WrittenLine) -> None:
        before = len(self.lines)
        self._write_block(block, line)
        if line.text.lstrip().startswith("/"):  # what becomes several lines is skipped as one
            added = self.lines[before:]
            self.lines[before:] = [text if text.lstrip().startswith("/") else "/" + text for text in added]

    def _write_block(self, block: Block, line: WrittenLine) -> None:
        for word in line.words:
            if word.letter == "G" and word.value in _PATH_CONTROL:
                self._exact = word.value != 64.0
        if block.motion_count == 0:
            self.hold_feed(line, block.modal, 0.0, 1.0)
            self._still(block, line)
            return
        motion = self.program.motions[block.first_motion]
        self.begin(block.first_motion, motion)
        if block.cycle or block.motion_count > 1:
            self._cycle(block, line)
        else:
            self._expanding = False
            if motion.kind == "dwell":
                self.hold_feed(line, block.modal, 0.0, 1.0)
                self._relieve(block.modal, block.first_motion, motion)
                self.lines.append(line.render())
                self.arrive(block.first_motion, motion)
            elif motion.kind == "arc":
                index = block.first_motion
                share = self.rows.share_of(int(self.rows.first[index]), int(self.rows.last[index]))
                self.hold_feed(line, block.modal, motion.feed_m_s, share)
                emit_arc(self, block, line, block.first_motion, motion)
            else:
                self._straight(block, line, block.first_motion, motion)

    # ---- kinds of blocks -------------------------------------------------------------------------------------

    def _still(self, block: Block, line: WrittenLine) -> None:
        """A block without motion; origin settings and targets that say where the tool stands follow the offset."""
        modal, moved = block.modal, self.inherits(block.modal)
        axes = [w for w in line.words if w.letter in AXES]
        at_tool = has_g(line.words, 92.0) or (has_g(line.words, 10.0) and line.find("L", (20.0,)) is not None)
        if axes and moved and at_tool:
            for word in axes:
                value = word.value + self.off[AXES.index(word.letter)] / modal.unit_m
                line.replace(word, word.letter + number(value, self.digits(modal) + 2))
            self.completed_blocks += 1
        elif axes and not has_g(line.words, *_NO_TARGET) and modal.motion in ("G0", "G1", "G2", "G3"):
            self.completed_blocks += self._state_place(block, line, axes, moved and modal.absolute)
        elif has_g(line.words, 53.0):
            self.completed_blocks += self.state_motion(block, line, modal.motion)
        if line.find("G", MOTION_CODES) is not None:
            self.written_motion = None
            self._expanding = False
        self.lines.append(line.render())

    def _state_place(self, block: Block, line: WrittenLine, axes: list[Word], follows: bool) -> bool:
        """Axis words that say where the tool stands; whether the line had to be changed."""
        stated = self.state_motion(block, line, block.modal.motion)
        for word in axes if follows else ():
            axis = AXES.index(word.letter)
            line.replace(word, word.letter + self.target(block.modal, axis, self.current(axis))[0])
        return stated or follows

    def _straight(self, block: Block, line: WrittenLine, index: int, motion: Motion) -> None:
        modal, rows = block.modal, self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        turned = last >= 0 and motion.abc_start == motion.abc_end and self.turns.differ(modal, last)
        corrected, inherits = bool(rows.moved[index]), self.inherits(modal) or turned
        completed = self.state_motion(block, line, block.modal.motion)
        if not corrected and not inherits:
            self.keep(line, modal)
            self.turns.reach(modal, last)
            self.hold_feed(line, modal, motion.feed_m_s, 1.0)
        else:
            self.check_words(block, motion)
            shift = rows.shift[last] if last >= 0 else np.array(self.off)
            inner = rows.inner(index) if motion.kind == "feed" else []
            if inner:
                self._split(block, line, index, motion, inner)
                return
            start = self.here()
            self.set_end(line, block, motion, shift)
            self.turns.set(line, modal, last)
            factor = rows.factor(first - 1, last, start, self.here()) if corrected and last >= 0 else 1.0
            self.hold_feed(line, modal, motion.feed_m_s, factor)
            completed = not corrected and line.changed
        self.completed_blocks += completed
        self.lines.append(line.render())
        self.arrive(index, motion)
        if motion.kind == "feed":
            self.checked[first : last + 1] = True

    def _split(self, block: Block, line: WrittenLine, index: int, motion: Motion, inner: list[int]) -> None:
        """One straight motion as several blocks; the first is the source's own line."""
        modal, rows = block.modal, self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        stop, exact = self.stop_word(line), self.exact_stop_word(line)
        steps = [*inner, last]
        travel = np.linalg.norm(np.diff(rows.command[[first - 1, *steps]], axis=0), axis=1)
        factors = feed_factor(np.diff(rows.way[[first - 1, *steps]]), travel)
        factors = factors * [rows.share_of(a + 1, b) for a, b in itertools.pairwise([first - 1, *steps])]
        feeds = self.feeds(line, modal, self._shares(float(rows.way[first - 1]), rows.way[steps], travel))
        prefix = "G53 G1" if has_g(line.words, 53.0) else "G1"
        for step, row in enumerate(steps):
            if step == 0:
                self.go(line, modal, rows.command[row])
                self.turns.set(line, modal, row)
                self.hold_feed(line, modal, motion.feed_m_s, float(factors[0]))
                self.lines.append(line.render())
            else:
                feed_word = self.hold_feed(None, modal, motion.feed_m_s, float(factors[step]))
                words = self.added(modal, rows.command[row]) + self.turns.added(modal, row)
                prefix = exact + prefix if row == last else prefix
                self.lines.append(prefix + words + feeds[step] + feed_word)
            self.written[row] = self.here()
        self.off = [self.current(axis) - float(motion.p_end[axis]) for axis in range(3)]
        self.arrive(index, motion)
        self.checked[first : last + 1] = True
        if stop:
            self.lines.append(stop)
        self.count_split(len(inner))

    def _relieve(self, modal: Modal, index: int, motion: Motion) -> None:
        """Before a dwell, go to where it is planned; that lies along the tool axis, see :class:`MotionRows`."""
        # It goes at the feed of the last feed motion. In inverse time (G93) that needs a word of its own: F = feed /
        # length, in 1/min.
        planned = self.rows.relieved(index)
        if planned is None:
            return
        feed_m_s = next((m.feed_m_s for m in reversed(self.program.motions[:index]) if m.feed_m_s > 0.0), 0.0)
        if modal.feed_mode == 93 and feed_m_s == 0.0:
            return
        start = self.here()
        words = self.added(modal, planned)
        if words:
            if modal.feed_mode == 93:
                words += " F" + number(feed_m_s * 60.0 / float(np.linalg.norm(self.here() - start)), 4)
            self.lines.append("G1" + words)
            self.written_motion = "G1"
            self.vertices_added += 1
        self.off = [self.current(axis) - float(motion.p_end[axis]) for axis in range(3)]

    # ---- canned cycles ---------------------------------------------------------------------------------------

    def _cycle(self, block: Block, line: WrittenLine) -> None:
        """A canned cycle or homing block: as it is when nothing of it is corrected, else as single moves."""
        # Once one is written out, the rest of the run is too: words and the level to return to (G98) are those of the
        # first cycle of a run.
        indices = block.motions
        modal, motions = block.modal, self.program.motions
        fastest = max(indices, key=lambda i: motions[i].feed_m_s)
        share = self.rows.share_of(int(self.rows.first[fastest]), int(self.rows.last[fastest]))
        self.hold_feed(line, modal, motions[fastest].feed_m_s, share)
        homing = has_g(line.words, 28.0, 30.0)
        moved = bool(self.rows.moved[indices.start : indices.stop].any())
        if homing and not moved:
            named = {w.letter for w in line.words} & set(AXES) or set(AXES)
            self.off = [0.0 if letter in named else off for letter, off in zip(AXES, self.off, strict=True)]
        elif moved or self.inherits(modal) or (self._expanding and not homing):
            self._expand(block, line, indices)
            return
        if not homing:
            self.completed_blocks += self.state_motion(block, line, block.modal.motion)
        self._expanding = False
        self.lines.append(line.render())
        for i in indices:
            self.arrive(i, motions[i])

    def _expand(self, block: Block, line: WrittenLine, indices: range) -> None:
        reserved = line.taken_elsewhere()
        for word in line.words:
            of_motion = word.letter in "XYZRLPQIJK" and word.letter not in reserved
            if of_motion or (word.letter == "G" and word.value in _WRITTEN_OUT):
                line.remove(word)
        stop = self.stop_word(line)
        rest = line.render().strip()
        if rest:
            self.lines.append(rest)
        self.lines.append(self.spelling.remark(f"{block.modal.motion} written out"))
        turning = block.modal.spindle_rpm != 0.0
        for i in indices:
            motion = self.program.motions[i]
            self.begin(i, motion)
            turning = self._spindle(block, turning, motion.spindle_rad_s != 0.0)
            if motion.kind == "dwell":
                self._relieve(block.modal, i, motion)
                self.lines.append(f"G4 P{number(motion.duration_s, 3)}")
            elif self._expand_move(block, i, motion) and self._blends(block, i) and not (stop and i == indices[-1]):
                self.lines.append("G4 P0")
            self.off = [self.current(axis) - float(motion.p_end[axis]) for axis in range(3)]
            self.arrive(i, motion)
        self._spindle(block, turning, block.modal.spindle_rpm != 0.0)
        if stop:
            self.lines.append(stop)
        self._expanding = True
        self.cycles_expanded += 1

    def _expand_move(self, block: Block, index: int, motion: Motion) -> bool:
        """A move of a cycle as blocks of its own; whether its end needed one."""
        rows, feeds = self.rows, motion.kind == "feed"
        first, last = int(rows.first[index]), int(rows.last[index])
        code = "G1" if feeds else "G0"
        for row in rows.inner(index) if feeds else ():
            self.lines.append(code + self.added(block.modal, rows.command[row]))
            self.written[row] = self.here()
        shift = rows.shift[last] if last >= 0 else np.array(self.off)
        words = self.added(block.modal, np.asarray(motion.p_end) + shift)
        if words:
            self.lines.append(code + words)
            self.written_motion = code
        if feeds:
            self.checked[first : last + 1] = True
        return bool(words)

    def _blends(self, block: Block, index: int) -> bool:
        """Return whether the end of a motion of a cycle needs a stop of its own once it is written out."""
        # A cycle is run in exact path mode whatever the program has set. Moves of their own would be blended under G64:
        # the tool would turn back before the bottom, and go sideways before it is out of the hole.
        motions = self.program.motions
        dwells = index + 1 in block.motions and motions[index + 1].kind == "dwell"
        return not self._exact and not dwells and block.modal.motion in _CYCLE_NAMES

    def _spindle(self, block: Block, turning: bool, requested: bool) -> bool:
        """Stop or restart the spindle inside a cycle (G86)."""
        if turning != requested:
            self.lines.append("M5" if not requested else "M4" if block.modal.spindle_rpm < 0.0 else "M3")
        return requested


class GcodeInPlace(Emitter):
    """G-code of each dialect.

    Where a block leaves out an axis word, a motion word or counts from the current position, and the position or the
    motion it would inherit is no longer that of the source, the missing word is written. A program with loops or calls
    is written in the order of execution, its expressions replaced by their values.
    """

    def run(self) -> list[str]:
        """All lines of the written program, none too long for its interpreter."""
        _refuse_unsaid(self.program, self.rows)
        most = self.spelling.line_characters
        return [part for line in super().run() for part in _short_enough(line, self.program, most)]

    def put_head(self, lines: list[str], texts: list[str]) -> None:
        """Behind what must stand first."""
        place = self.spelling.first_line(lines)
        lines[place:place] = [self.spelling.remark(text) for text in texts]


write_gcode = GcodeInPlace.write


def _refuse_unsaid(program: Program, rows: MotionRows) -> None:
    """Refuse corrections that the writer cannot say."""
    # Mirror images, polar coordinates; of Sinumerik drilling cycles, CIP, loops and subprograms.
    hint = "Post its moves as G0, G1, G2 and G3, or write another language (--as, convert)"
    for block in program.blocks:
        if block.modal.not_written and block.motion_count:
            raise ProgramError(
                f"{block.modal.not_written} is not written back with other targets",
                where=block.where(program.name), value=block.text.strip()[:60], hint=hint,
            )  # fmt: skip
    if program.dialect == "linuxcnc":
        return
    if not program.straight:
        block = next(block for block in program.blocks if not block.single)
        raise ProgramError(
            "a program with loops or subprograms is not written back", where=block.where(program.name),
            value=block.text.strip()[:60], hint=hint,
        )  # fmt: skip
    for block in program.blocks:
        if block.cycle and any(rows.moved[index] for index in block.motions):
            raise ProgramError(
                "a drilling cycle or CIP is corrected, and is not written back", where=block.where(program.name),
                value=block.text.strip()[:60], hint=hint,
            )  # fmt: skip


def _short_enough(line: str, program: Program, most: int) -> list[str]:
    """A line that added words made too long for the interpreter, with its comments on lines of their own before it."""
    if len(line) <= most or line in program.lines:
        return [line]
    code, comments = without_comments(line)
    if len(code) > most:
        raise ProgramError(
            "a corrected block is longer than the interpreter takes", where=program.name,
            value=f"{len(code)} characters", limit=f"<= {most}", hint="Shorten the expressions of the block",
        )  # fmt: skip
    return [*comments, code]
