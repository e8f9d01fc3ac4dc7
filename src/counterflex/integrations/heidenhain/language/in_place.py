"""The same Klartext program back with only its targets replaced."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language import LIMITS
from counterflex.integrations.heidenhain.language.arcs_in_place import ArcWriter
from counterflex.integrations.heidenhain.language.emitter import PathLine, dwell_lines, function_of
from counterflex.integrations.heidenhain.language.source import code_of
from counterflex.integrations.heidenhain.language.state import PLANES
from counterflex.programs.program import TOOL_VECTOR, Block, Motion, Program, Word

_FLOW: Final = re.compile(
    r"\s*(?:LBL\b|CALL\b|FN\s*\d|Q[LRS]?\d+\s*=|BEGIN\s+PGM\b|END\s+PGM\b|M\s*(?:2|30)\s*$)", re.IGNORECASE
)
_PARAMETER: Final = re.compile(r"(?<![A-Z0-9])(?:[A-Z]{0,6}[+-]?\s*)Q[LR]?\d+(?!\d*\s*=)", re.IGNORECASE)


def _refuse_unsaid(program: Program) -> None:
    """Refuse frames that the writer cannot go back through."""
    for block in program.blocks:
        if block.modal.not_written and block.motion_count:
            raise ProgramError(
                f"{block.modal.not_written} is not written back with other targets",
                where=block.where(program.name), value=block.text.strip()[:60],
                hint="Post the moves without it, or write another language (--as, convert)",
            )  # fmt: skip


class HeidenhainInPlace(ArcWriter):
    """Walks through the statements of a program.

    A corrected L gets its coordinates edited in place and further L behind it (these have no block number: the control
    numbers blocks itself). A corrected arc stays one about a CC of its own, or becomes several, or L. RND whose lines
    are corrected becomes an arc. A drilling cycle that is corrected is written out as L. F is written before pieces
    whose feed changes. A program with labels and calls is written in the order of execution.
    """

    own_decimals: ClassVar[int] = LIMITS.position_decimals

    def put_head(self, lines: list[str], texts: list[str]) -> None:
        """Behind BEGIN PGM."""
        place = 1 + next((k for k, line in enumerate(lines) if "BEGIN PGM" in line.upper()), -1)
        lines[place:place] = [f";{text}" for text in texts]

    def _chained(self) -> set[int]:
        """Motions that must be written because they share a corner (RND) with a corrected one."""
        out: set[int] = set()
        for number, block in enumerate(self.program.blocks):
            if block.motion_count == 1 and function_of(block) == "RND":
                index = block.first_motion
                pair = {index - 1, index}
                if any(bool(self.rows.moved[k]) for k in pair) or not self.program.blocks[number].single:
                    out |= pair
        return out

    def run(self) -> list[str]:
        """All lines of the written program."""
        _refuse_unsaid(self.program)
        straight, source, at = self.program.straight, self.program.lines, 0
        self._forced = self._chained()
        if len(self.written):
            self.written[0] = self.rows.nominal[0]
        if not straight:
            self.lines.append(next(line for line in source if "BEGIN PGM" in line.upper()))
        for block in self.program.blocks:
            if straight:
                at = block.line - 1 + len(block.text.split("\n"))
            elif self._is_flow(block):
                continue
            self._block(block)
        if straight:
            self._flush()
            self.lines.extend(source[at:])
        else:
            end = next((line for line in reversed(source) if "END PGM" in line.upper()), "END PGM")
            self.lines += ["M30", re.sub(r"^\s*\d+\s+", "", end), ""]
        return self.lines

    def _is_flow(self, block: Block) -> bool:
        """Return whether a block of a program that is written out says nothing but flow."""
        code = " ".join(code_of(line) for line in block.text.split("\n"))
        if _FLOW.match(code):
            return True
        if not block.motion_count and function_of(block) != "CC" and _PARAMETER.search(code):
            raise ProgramError(
                "a frame, tool or cycle with parameters in a program with labels is not written back",
                where=block.where(self.program.name), value=block.text.split("\n")[0].strip()[:60],
                hint="Write the values themselves, or write another language (--as, convert)",
            )  # fmt: skip
        return False

    def _block(self, block: Block) -> None:
        if block.motion_count == 0:
            self._still(block)
            return
        index = block.first_motion
        motion = self.program.motions[index]
        self._stand(motion.p_start, index)
        if block.cycle or block.motion_count > 1:
            self._cycle(block)
        elif motion.kind == "dwell":
            self._flush()
            self._relieve(block, index)
            self._copy(block)
            self._arrive(index, motion)
        elif motion.kind == "arc":
            self._arc(block, index, motion)
        else:
            self._straight(block, index, motion)

    def _still(self, block: Block) -> None:
        self._flush()
        feed = next((word for word in block.words if word.letter == "F"), None)
        match = re.search(r"TOOL\s+CALL.*?\bF\s*([\d.]+)", block.text, re.IGNORECASE)
        if feed is not None:
            self._feed = feed.value
        elif match is not None:
            self._feed = float(match[1])
        if function_of(block) != "CC":
            self._copy(block)
            return
        given = {word.letter: word for word in block.words if word.letter in "XYZ"}
        self._pole, self._pole_plane = self._pole_of(block, given), block.modal.plane
        if len(given) == 2 and all(word.absolute and word.literal for word in given.values()):
            self._pole_block = block
        elif self._follows() or not self._pole_written or not self.program.straight:
            self.lines.append(self._centre(block, self._pole))
            self._pole_written = True
        else:
            self._copy(block)

    def _pole_of(self, block: Block, given: dict[str, Word]) -> tuple[float, float]:
        """Pole of a CC in programmed axes, m, from the coordinates that it names."""
        here = self._work(block.modal, self._nominal).tolist()
        axes = PLANES[block.modal.plane][:2]
        pole = [here[axis] for axis in axes]
        for k, axis in enumerate(axes):
            word = given.get("XYZ"[axis])
            if word is not None:
                pole[k] = word.value * block.modal.unit_m + (0.0 if word.absolute else pole[k])
            elif given and self._pole is not None:
                pole[k] = self._pole[k]
        return pole[0], pole[1]

    def _straight(self, block: Block, index: int, motion: Motion) -> None:
        rows = self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        corrected = self._corrected(index)
        follows, function = self._follows(), function_of(block)
        self._flush()
        line = PathLine(block)
        relative = function == "LP" or any(w.absolute is False for w in line.words if w.letter in "XYZ")
        if not (corrected or (follows and (relative or self._leaves_out(block)))):
            self._keep(block, index, motion, 1.0, function)
            return
        self.completed_blocks += not corrected
        feeds = motion.kind == "feed"
        inner = rows.inner(index) if feeds else []
        if relative:
            line = self._absolute(block, function)
        tail = line.take_last() if inner else ""
        own: PathLine | None = line
        for before, row in itertools.pairwise([first - 1, *inner, last]):
            self._piece(block, motion, own, (before, row), tail if row == last else "")
            own = None
        self._arrive(index, motion)
        if feeds and last >= first:
            self.checked[first : last + 1] = True
        self.count_split(len(inner))

    def _piece(self, block: Block, motion: Motion, line: PathLine | None, ends: tuple[int, int], tail: str) -> None:
        """Write the line of one straight piece between two rows."""
        (before, row), rows = ends, self.rows
        known = motion.kind == "feed" and min(ends) >= 0
        factor = rows.factor(before, row, rows.command[before], rows.command[row]) if known else 1.0
        p = rows.command[row] if row >= 0 else np.asarray(motion.p_end)
        joined = any(word.end == word.start for word in block.words if word.letter in "XYZ")
        whole = joined or (line is None and function_of(block) == "LN")
        coordinates = self._go(line, block.modal, p, every=whole)
        turned = self._turn(line, block, row) if row >= 0 else ""
        feed = self._f(block, motion, factor, line)
        if row >= 0:
            self.written[row] = self._here
        if line is not None:
            self.lines.append(line.render() + tail)
            return
        head = "LN" if turned and block.modal.tool_centre == TOOL_VECTOR else "L"
        text = " ".join(part for part in (head, coordinates, turned) if part)
        self.lines.append(text + feed + tail)

    def _leaves_out(self, block: Block) -> bool:
        """An L that leaves out an axis inherits what was corrected before."""
        named = {word.letter for word in block.words if word.letter in "XYZ" and word.absolute}
        off = self._work(block.modal, self._here) - self._work(block.modal, self._nominal)
        return any(
            abs(off[axis]) > 0.5 * self.resolution_m and letter not in named for axis, letter in enumerate("XYZ")
        )

    @staticmethod
    def _absolute(block: Block, function: str) -> PathLine:
        """The line of an incremental or polar motion without its coordinates; absolute ones are put in later."""
        line = PathLine(block)
        line.become("L" if function == "LP" else function, "")
        text = re.sub(r"(?<=[LN]) (?= |$)", "", line.render())
        return PathLine(replace(block, text=text, words=()))

    def _relieve(self, block: Block, index: int) -> None:
        """Before a dwell, go to where it is planned, along the tool axis."""
        planned = self.rows.relieved(index)
        if planned is not None:
            coordinates = self._go(None, block.modal, planned)
            if coordinates:
                self.lines.append(f"L {coordinates}")
                self.vertices_added += 1

    def _cycle(self, block: Block) -> None:
        """A block with a drilling cycle: as it is where nothing of it is corrected, else as single moves."""
        self._flush()
        indices = block.motions
        motions = [self.program.motions[k] for k in indices]
        if not any(bool(self.rows.moved[k]) for k in indices) and not self._follows() and self.program.straight:
            self._copy(block)
            for k, motion in zip(indices, motions, strict=True):
                self._here = np.array(motion.p_end)
                self._arrive(k, motion)
            return
        self.cycles_expanded += 1
        for k, motion in zip(indices, motions, strict=True):
            last = int(self.rows.last[k])
            p = self.rows.command[last] if last >= 0 else np.asarray(motion.p_end)
            self._stand(motion.p_start, k)
            if motion.kind == "dwell":
                self.lines += dwell_lines(motion.duration_s)
            elif k == indices.start and function_of(block) in ("L", "LN"):
                line = PathLine(block)
                line.take(99)
                self._go(line, block.modal, p)
                self._f(block, motion, 1.0, line)
                self.lines.append(line.render())
            else:
                coordinates = self._go(None, block.modal, p, every=True)
                feed = " FMAX" if motion.kind == "rapid" else self._f(block, motion, 1.0, None)
                self.lines.append(f"L {coordinates} R0{feed}")
            self._arrive(k, motion)


write_heidenhain = HeidenhainInPlace.write
