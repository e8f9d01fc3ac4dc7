"""Rotary words, or the tool axis as I J K, of a program being written."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG
from counterflex.programs.gcode.write.spelling import Spell
from counterflex.programs.gcode.write.written_line import WrittenLine, number
from counterflex.programs.program import TOOL_VECTOR, Modal

_MORE_DIGITS: Final = 1
"""A rotary word has one decimal more than a length: 1e-5 deg moves the tip by 0.1 um at 0.6 m."""
_VECTOR_DIGITS: Final = 3
"""A component of the tool axis has three more: 1e-7 rad."""


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
