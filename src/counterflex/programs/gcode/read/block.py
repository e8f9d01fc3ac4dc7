"""The words of one block with their values: which codes it names, and which words nothing has used yet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read import codes
from counterflex.programs.program import Word

_KNOWN: Final = frozenset("ABCDEFGHIJKLMNPQRSTXYZ")
_BLENDING: Final = 640  # G64, whose words have limits
_MODAL_GROUPS_OF_ONE: Final = "Two codes of one modal group contradict each other: put them on two lines"


class BlockWords:
    """Words of a block, checked against the tables of codes.

    Args:
        words: In order of appearance.
        fault: Makes an error on this line from what, column, value and hint.
        line: 1-based number of the line.

    Raises:
        ProgramError: An unknown letter or code, a repeated word, two codes of one modal group, a refused code.
    """

    def __init__(
        self, words: tuple[Word, ...], fault: Callable[[str, int, object, str | None], ProgramError], line: int = 0
    ) -> None:
        self._fault = fault
        self.line = line
        self.g: dict[str, int] = {}  # Code of each modal group named, in tenths
        self.m: dict[str, int] = {}  # M codes in tenths, in order
        self._values: dict[str, float] = {}
        self._columns: dict[str, int] = {}
        self._letters = frozenset(word.letter for word in words)
        for word in words:
            if word.letter == "G":
                self._code(word, "G", codes.G_GROUP, codes.REFUSED_G, self.g)
            elif word.letter == "M":
                self._code(word, "M", codes.M_GROUP, codes.REFUSED_M, self.m)
            elif word.letter not in _KNOWN:
                axis = word.letter in "UVW"
                what = "axes U V W are not read" if axis else "an unknown word"
                raise fault(what, word.start, f"{word.letter}{word.value:g}", "Post X Y Z" if axis else None)
            elif word.letter in self._values:
                raise fault("the word appears twice in one block", word.start, f"{word.letter}{word.value:g}", None)
            else:
                self._values[word.letter] = word.value
                self._columns[word.letter] = word.start
        self._unused = set(self._values) - {"N"}
        for code in self.g.values():
            self._unused -= set(codes.TAKEN_BY_G.get(code, "")) if code != _BLENDING else set()

    def _code(
        self, word: Word, letter: str, groups: dict[int, str], refused: dict[int, tuple[str, str]], into: dict[str, int]
    ) -> None:
        code = round(word.value * 10.0) if abs(word.value) < 1e6 else -1
        name = f"{letter}{word.value:g}"
        if abs(word.value * 10.0 - code) > 1e-3 or (code not in groups and code not in refused):
            own = letter == "M" and 1000 <= code < 2000
            hint = (
                "User-defined M codes run programs of the machine: take it out, or write what it does"
                if own
                else f"Take it out, or post without it. The {letter} codes that are read: docs/statements/linuxcnc.md"
            )
            raise self._fault(f"an unknown {letter} code", word.start, name, hint)
        neutral = self._neutral_by_word(code) if letter == "G" else ""
        if neutral:
            self.g[neutral] = code
            self._columns[letter + str(code)] = word.start
            return
        if code in refused:
            what, hint = refused[code]
            raise self._fault(what, word.start, name, hint)
        group = groups[code]
        if group in into and 800 in (code, into[group]) and letter == "G":
            # G80 beside another motion code only ends a canned cycle.
            code = code if into[group] == 800 else into[group]
        elif group in into:
            raise self._fault(
                f"two codes of the modal group '{group}' in one block", word.start,
                f"{codes.code_name(letter, into[group])} and {codes.code_name(letter, code)}", _MODAL_GROUPS_OF_ONE,
            )  # fmt: skip
        into[group] = code
        self._columns[letter + str(code)] = word.start

    def _neutral_by_word(self, code: int) -> str:
        """Modal group of a code that another word of the block makes neutral: G5.1 with Q and without I and J."""
        if not self._letters.isdisjoint("IJ" if code == 51 else "XYIJ"):
            return ""
        return next(
            (group for (c, letter), group in codes.NEUTRAL_BY_WORD.items() if c == code and letter in self._letters), ""
        )

    def fault(self, what: str, letter: str = "", value: object = None, hint: str | None = None) -> ProgramError:
        """Make an error at a word (``"X"``), a code (``"G830"``), or the line's beginning."""
        if value is None and letter in self._values:
            value = f"{letter}{self._values[letter]:g}"
        return self._fault(what, self._columns.get(letter, 0), value, hint)

    def has(self, letters: str) -> bool:
        """Return whether one of the letters has a word that nothing has used yet."""
        return any(letter in self._unused for letter in letters)

    def names(self, letter: str) -> bool:
        """Return whether the block has this word, used or not."""
        return letter in self._values

    def take(self, letter: str) -> float | None:
        """Use a word; None where the block has none.

        Raises:
            ProgramError: Something else of the block has used it: ``M62 P1`` beside the dwell P of a cycle.
        """
        if letter not in self._unused:
            if letter in self._values and letter not in codes.AXES:
                raise self.fault(
                    f"two codes of one block both take the word {letter}", letter, hint="Put them on two lines"
                )
            return None
        self._unused.discard(letter)
        return self._values[letter]

    def take_axes(self) -> dict[int, float]:
        """Use all axis words; value in program units or degrees by axis number 0 ... 5."""
        return {index: self._values[letter] for index, letter in enumerate(codes.AXES) if self.take(letter) is not None}

    def whole(self, letter: str, least: int, most: int) -> int | None:
        """Use a word that must be a whole number within limits."""
        value = self.take(letter)
        if value is None:
            return None
        number = round(value) if abs(value) < 1e15 else most + 1
        if abs(value - number) > 1e-4 or not least <= number <= most:
            raise self.fault(f"{letter} needs a whole number from {least} to {most}", letter)
        return number

    def finish(self, idle: str = "") -> None:
        """Refuse words that nothing used.

        Args:
            idle: Letters that may stand without a use.

        Raises:
            ProgramError: There is one.
        """
        self._unused -= set(idle)
        if self._unused:
            letter = min(self._unused, key=lambda name: self._columns[name])
            hint = "Name the motion code, for example G1" if letter in codes.AXES else None
            raise self.fault(f"nothing in this block uses the word {letter}", letter, None, hint)
