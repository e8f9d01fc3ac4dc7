"""Tool length and work offsets that a program selects by number, followed from block to block.

Sources: LinuxCNC, G-codes (G43, G43.1, G49, G54 to G59.3, G10 L2 and L20); SINUMERIK 840D sl, Programming Manual
Fundamentals (D0 cancels the tool offset; D1 is active after a tool change, MD20270; G54 to G57, G505 to G599); TwinCAT
NC I (D, G54 to G57).
"""

from __future__ import annotations

from typing import Final

from counterflex.programs.language import LANGUAGES, object_at
from counterflex.programs.program import Block

NONE: Final = -1
"""No tool length offset is active."""
OWN: Final = -2
"""The offset belongs to the tool itself: another tool's cannot be meant."""
UNSAID: Final = -3
"""The language has no word for it."""
_OF_TOOL: Final = (43.0, 43.4, 43.5, 44.0)
_GIVEN: Final = 43.1
_CANCEL: Final = 49.0
_FURTHER: Final = {54.0, 54.1, 154.0}  # Further offsets of Fanuc and Haas, with P
_HAAS: Final = {float(code) for code in range(110, 130)}  # The same by numbers of their own, P1 to P20
_OFFSETS: Final = (*range(54, 60), 59.1, 59.2, 59.3)


def codes_of(block: Block, letter: str) -> set[float]:
    """Return the values of the words of a letter, to a tenth."""
    return {round(word.value, 1) for word in block.words if word.letter == letter}


def _value(block: Block, letter: str) -> int | None:
    return next((round(word.value) for word in block.words if word.letter == letter), None)


class OffsetReader:
    """Active offsets, followed from block to block."""

    def __init__(self) -> None:
        self.length, self.offset, self.defined = UNSAID, "", set[str]()

    def take(self, block: Block) -> None:
        """Apply the words of a block; here the language has no offsets of numbers."""


class IsoOffsets(OffsetReader):
    """G43 and G54 as LinuxCNC has them."""

    def __init__(self) -> None:
        super().__init__()
        self.length, self.offset = NONE, "G54"

    def take(self, block: Block) -> None:
        """Apply the words of a block."""
        codes = codes_of(block, "G")
        self.length = self._length_after(codes, _value(block, "H"))
        if 10.0 in codes and _value(block, "L") in (2, 20):
            number = _value(block, "P")
            self.defined |= {self.offset} if not number else {_named(_OFFSETS[number - 1])} if number <= 9 else set()
        for code in codes & set(_OFFSETS):
            self.offset = _named(code)
        further = _value(block, "P") if codes & _FURTHER else next((round(c) - 109 for c in codes & _HAAS), None)
        if further is not None:
            self.offset = f"G54.1 P{further}"

    def _length_after(self, codes: set[float], number: int | None) -> int:
        """Length offset behind a block with these G codes and this H."""
        if codes & set(_OF_TOOL):
            return OWN if number is None else number or NONE
        if codes & {_GIVEN, _CANCEL}:
            return OWN if _GIVEN in codes else NONE
        return number or NONE if self.length > 0 and number is not None else self.length


class SettableOffsets(OffsetReader):
    """D, G54 to G57 and G505 to G599."""

    def __init__(self) -> None:
        super().__init__()
        self.length = NONE

    def take(self, block: Block) -> None:
        """Apply the words of a block."""
        number = _value(block, "D")
        if number is not None:
            self.length = OWN if number else NONE
        for code in codes_of(block, "G"):
            if 54 <= code <= 57 or 505 <= code <= 599:
                self.offset = _named(code)


class ToolBoundOffsets(SettableOffsets):
    """The same where a tool comes with its first offset (D1, MD20270)."""

    def __init__(self) -> None:
        super().__init__()
        self.length = OWN

    def take(self, block: Block) -> None:
        """Apply the words of a block."""
        if 6.0 in codes_of(block, "M"):
            self.length = OWN
        super().take(block)


def offset_reader(dialect: str) -> OffsetReader:
    """Return a reader of the numbered offsets of a language."""
    place = LANGUAGES[dialect].offsets
    reader: OffsetReader = OffsetReader() if place is None else object_at(place)()
    return reader


def _named(code: float) -> str:
    return f"G{code:g}"
