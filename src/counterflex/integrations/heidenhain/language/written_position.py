"""Place of the tool while a Klartext program is written back, and the words that take it elsewhere."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MINUTE
from counterflex.integrations.heidenhain.language import VECTOR_DECIMALS
from counterflex.integrations.heidenhain.language.emitter import feed_text, signed
from counterflex.integrations.heidenhain.language.written import PathLine, function_of, spelled
from counterflex.programs.machine_in_place import MachineInPlace
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Block, Modal, Motion

_POLAR: Final = frozenset(("C", "CP", "LP"))


class WrittenPosition(MachineInPlace):
    """Position, pole and feed of the written program."""

    def prepare(self) -> None:
        """Begin where the program begins."""
        self._here: Float = np.array(self.program.motions[0].p_start if self.program.motions else np.zeros(3))
        self._nominal: Float = self._here.copy()
        self._feed: float | None = None
        self._pole: tuple[float, float] | None = None
        self._pole_block: Block | None = None
        self._pole_written = True
        self._forced: set[int] = set()

    def _stand(self, p: Float, index: int) -> None:
        """Take the offset along where the program jumps to the start of a motion."""
        self._here = self._here + (np.asarray(p) - self._nominal)
        self._nominal = np.array(p)
        start = int(self.rows.first[index]) - 1
        if self.rows.last[index] >= 0 and math.isnan(self.written[start, 0]):
            self.written[start] = self._here

    def _arrive(self, index: int, motion: Motion) -> None:
        self._nominal = np.array(motion.p_end)
        last = int(self.rows.last[index])
        if last >= 0:
            self.written[last], self.checked[last] = self._here, True

    def _corrected(self, index: int) -> bool:
        """Return whether a motion is written anew."""
        return bool(self.rows.moved[index]) or index in self._forced or not self.program.straight

    def _follows(self) -> bool:
        """The written position differs from that of the source by more than rounding."""
        return bool(np.any(np.abs(self._here - self._nominal) > 0.5 * self.resolution_m))

    def _copy(self, block: Block) -> None:
        self.lines.extend(block.text.split("\n"))

    def _flush(self) -> None:
        """Write the CC that waits for its arc."""
        if self._pole_block is not None:
            self._copy(self._pole_block)
            self._pole_block, self._pole_written = None, True

    @staticmethod
    def _work(modal: Modal, p: Float) -> Float:
        """A point in programmed axes, m."""
        away = np.asarray(p) - np.array(modal.p_part_origin)
        out: Float = away if modal.R_part_work is None else away @ np.array(modal.R_part_work)
        return out

    @staticmethod
    def _part(modal: Modal, p: Float) -> Float:
        turned = p if modal.R_part_work is None else np.array(modal.R_part_work) @ p
        out: Float = np.array(modal.p_part_origin) + turned
        return out

    def _rounded(self, modal: Modal, value_m: float) -> float:
        return round(value_m / modal.unit_m, self._digits)

    def _centre(self, block: Block, pole: tuple[float, float]) -> str:
        """A CC with both coordinates; the line of a CC keeps its number and comment."""
        values = [self._rounded(block.modal, value) for value in pole]
        coordinates = f"X{signed(values[0], self._digits)} Y{signed(values[1], self._digits)}"
        if function_of(block) != "CC":
            return f"CC {coordinates}"
        line = PathLine(block)
        line.become("CC", coordinates)
        return line.render()

    def _go(self, line: PathLine | None, modal: Modal, p: Float, *, every: bool = False) -> str:
        """Let a line lead to a point, or return the coordinates of a new one; the written position is there then."""
        goal, at = self._work(modal, p), self._work(modal, self._here)
        half = 0.5000001 * modal.unit_m * 10.0**-self._digits
        out = []
        for axis, letter in enumerate("XYZ"):
            word = None if line is None else line.find(letter)
            if (
                word is not None
                and word.absolute
                and word.literal
                and abs(word.value * modal.unit_m - goal[axis]) <= half
            ):
                at[axis] = word.value * modal.unit_m
                continue
            if word is None and not every and abs(goal[axis] - at[axis]) <= half:
                continue
            value = self._rounded(modal, float(goal[axis]))
            text = spelled(letter, value, self._digits)
            at[axis] = value * modal.unit_m
            if line is not None:
                line.set(letter, text)
            out.append(text)
        self._here = self._part(modal, at)
        return " ".join(out)

    def _turn(self, line: PathLine | None, block: Block, row: int) -> str:
        """Let a line have the rotary words or tool vector of a row; of a new line these words."""
        if self._angles is None:
            return ""
        nominal, command = self._angles[0][row], self._angles[1][row]
        mode = block.modal.tool_centre
        if mode == TOOL_CENTRE:
            return self._rotary(line, {word.letter for word in block.words}, command)
        if mode == TOOL_VECTOR and function_of(block) == "LN":
            size = float(np.linalg.norm(command)) or 1.0
            R = block.modal.R_part_work
            vector = command / size if R is None else command / size @ np.array(R)
            vectors = [f"T{c}{signed(float(v), VECTOR_DECIMALS)}" for c, v in zip("XYZ", vector, strict=True)]
            if line is not None:
                line.set_vector(vectors)
            return " ".join(vectors)
        self.dropped_rad = max(self.dropped_rad, float(np.linalg.norm(command - nominal)))
        return ""

    @staticmethod
    def _rotary(line: PathLine | None, named: set[str], command: Float) -> str:
        """Rotary words of a row, rad, that a block names, put into its line."""
        texts = {c: spelled(c, round(float(v) / DEG, 4), 4) for c, v in zip("ABC", command, strict=True)}
        for letter, text in texts.items():
            if line is not None and line.find(letter) is not None:
                line.set(letter, text)
        return " ".join(text for letter, text in texts.items() if letter in named)

    def _f(self, block: Block, motion: Motion, factor: float, line: PathLine | None, *, local: bool = False) -> str:
        """F of a piece where it differs from the one in force; it is put into the line."""
        if block.modal.feed_mode != 94 or motion.feed_m_s <= 0.0 or motion.kind == "rapid":
            return ""
        nominal = motion.feed_m_s * MINUTE / block.modal.unit_of_feed_m
        requested = nominal * factor
        own = line is not None and line.has_feed
        current = nominal if own else self._feed
        if current is not None and abs(requested / current - 1.0) <= (LEAST_FEED_CHANGE if factor != 1.0 else 1e-6):
            self._feed = self._feed if local else current
            return ""
        if current is None and factor == 1.0:
            self._feed = nominal
            return ""
        text = feed_text(requested, 3 if factor == 1.0 else 1)
        if not local:
            self._feed = float(text[1:])
        if line is not None:
            line.set_feed(text)
        return f" {text}"

    def _restore_pole(self, function: str) -> None:
        """Write the pole of the source where a statement that stays counts from it."""
        if function in _POLAR and not self._pole_written and self._pole is not None:
            x, y = (value / self._unit_m for value in self._pole)
            self.lines.append(f"CC X{signed(x, self._digits)} Y{signed(y, self._digits)}")
            self._pole_written = True

    def _keep(self, block: Block, index: int, motion: Motion, factor: float, function: str) -> None:
        """Write a path statement as it is."""
        line = PathLine(block)
        self._flush()
        self._restore_pole(function)
        self._f(block, motion, factor, line, local=function == "RND")
        self._here = np.array(motion.p_end)
        self.lines.append(line.render())
        self._arrive(index, motion)
