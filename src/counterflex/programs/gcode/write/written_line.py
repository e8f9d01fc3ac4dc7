"""One line of G-code being rewritten: words replaced, added and taken out, everything else left as it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.programs.gcode.read.codes import TAKEN_BY_G
from counterflex.programs.language import LANGUAGES, object_at
from counterflex.programs.limits import LINUXCNC, WORDS_OF_M
from counterflex.programs.program import Block, Word

Spell = Callable[[str, str], str]
"""Letter (the role of a word) and value to the word as written."""


@dataclass(frozen=True)
class Spelling:
    """Words of a dialect where they differ from RS274/NGC."""

    radius: str  # Before the radius of an arc
    vector: tuple[str, str, str]  # Before the components of the tool axis
    comment: tuple[str, str]  # Before and behind the text of a comment
    line_characters: int  # Longest line
    head: re.Pattern[str]  # Lines that stay first in a file

    def word(self, letter: str, text: str) -> str:
        """A word of a block that moves on an arc or straight with a tool that does not turn."""
        return (self.radius if letter == "R" else letter) + text

    def vector_word(self, letter: str, text: str) -> str:
        """A word of a straight block whose I J K is the tool axis."""
        return (self.vector["IJK".index(letter)] if letter in "IJK" else letter) + text

    def remark(self, text: str) -> str:
        """A comment on a line of its own."""
        return f"{self.comment[0]}{text}{self.comment[1]}"

    def first_line(self, lines: Sequence[str]) -> int:
        """Index of the first line that something may be put before."""
        return next((index for index, line in enumerate(lines) if not self.head.match(line)), len(lines))


def spelling_of(dialect: str) -> Spelling:
    """Return the spelling of a dialect of G-code, :attr:`~counterflex.programs.language.Language.spelling`."""
    result: Spelling = object_at(LANGUAGES[dialect].spelling)
    return result


RS274: Final = Spelling("R", ("I", "J", "K"), ("(", ")"), LINUXCNC.line_characters, re.compile(r"\s*%\s*$"))
"""As LinuxCNC reads it."""


AXES = "XYZ"
_ORDER = "XYZABCIJKRF"
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_TAKEN_BY_G = {code / 10.0: letters for code, letters in TAKEN_BY_G.items()}
_FLOW_LETTERS = frozenset("ON")
_CALLS = {"M": (97.0, 98.0, 99.0), "G": (65.0, 67.0)}


def number(value: float, decimals: int) -> str:
    """A number with fixed decimals and never a negative zero."""
    text = f"{value:.{decimals}f}"
    return text[1:] if text[0] == "-" and not text.strip("-0.") else text


class WrittenLine:
    """Edits on one line, applied together at the end, so that word positions stay those of the source.

    Args:
        text: The line without line end.
        words: Its words with their places in ``text``.
        spell: Spells a word that is put in.
    """

    def __init__(self, text: str, words: Sequence[Word], spell: Spell = RS274.word) -> None:
        self.text = text
        self._spell = spell
        self.words = words
        self._edits: list[tuple[int, int, str]] = []
        self._added: list[tuple[int, str]] = []

    def find(self, letter: str, values: Collection[float] | None = None) -> Word | None:
        """First word with this letter and one of these values, or None."""
        for word in self.words:
            if word.letter == letter and (values is None or word.value in values):
                return word
        return None

    def taken_elsewhere(self) -> frozenset[str]:
        """Letters that belong to another code of the line than its motion: P of ``M62 P1``."""
        taken = [_TAKEN_BY_G.get(w.value, "") for w in self.words if w.letter == "G"]
        taken += [WORDS_OF_M.get(int(w.value), "") for w in self.words if w.letter == "M"]
        return frozenset("".join(taken))

    def replace(self, word: Word, text: str) -> None:
        """Put ``text`` (letter included) in the place of a word."""
        self._edits.append((word.start, word.end, text))

    def remove(self, word: Word) -> None:
        """Take a word out together with the blank before it."""
        start = word.start
        if start and self.text[start - 1] == " ":
            start -= 1
        self._edits.append((start, word.end, ""))

    def set(self, letter: str, text: str) -> None:
        """Replace the word with this letter, or add one in its usual place (X Y Z A B C I J K R F)."""
        word = self.find(letter)
        if word is None:
            self._added.append((_ORDER.index(letter), self._spell(letter, text)))
        else:
            self.replace(word, self._spell(letter, text))

    def lead(self, text: str) -> None:
        """Put a word at the head of the line, behind the block number if there is one."""
        first = next((w for w in self.words if w.letter not in "N/"), None)
        place = first.start if first is not None else len(self.text)
        self._edits.append((place, place, text + " "))

    @property
    def changed(self) -> bool:
        """True when any edit was made."""
        return bool(self._edits or self._added)

    def render(self) -> str:
        """The line with all edits."""
        if not self.changed:
            return self.text
        edits = list(self._edits)
        for place, text in sorted(self._added):
            edits.append(self._insertion(place, text))
        out: list[str] = []
        at = 0
        for start, end, text in sorted(edits, key=lambda e: (e[0], e[1])):
            out.append(self.text[at:start] if start > at else "")
            out.append(text)
            at = max(at, end)
        out.append(self.text[at:])
        return "".join(out)

    def _insertion(self, place: int, text: str) -> tuple[int, int, str]:
        """Return place and text of a new word: behind the last word of smaller order, else before a larger one."""
        smaller = [w.end for w in self.words if 0 <= _ORDER.find(w.letter) < place]
        if smaller:
            return smaller[-1], smaller[-1], " " + text
        larger = [w.start for w in self.words if _ORDER.find(w.letter) > place]
        if larger:
            before = larger[0] - 1
            if any(start == before and not new for start, _, new in self._edits):  # taken out with its blank
                return before, before, " " + text
            return larger[0], larger[0], text + " "
        end = max((w.end for w in self.words), default=len(self.text))
        return end, end, " " + text


def flatten(block: Block, decimals: int) -> tuple[str, tuple[Word, ...]]:
    """Rebuild a block without flow: every word with its value, comments kept, O-words, calls and block numbers gone.

    Args:
        block: Executed block, possibly one pass of a loop.
        decimals: Decimals for values that came from expressions.

    Returns:
        The line and its words at their new places. An empty line when only flow or assignments were there.
    """
    call = any(w.value in _CALLS.get(w.letter, ()) for w in block.words)
    flow = any(w.letter == "O" for w in block.words) or call
    parts: list[str] = []
    words: list[Word] = []
    at = 0
    for word in [*block.words, None]:
        parts += _comments(block.text[at : word.start if word else len(block.text)])
        if word is None:
            break
        at = word.end
        if flow or word.letter in _FLOW_LETTERS:
            continue
        text = block.text[word.start : word.end].strip() if word.literal else word.letter + _short(word.value, decimals)
        start = len(" ".join([*parts, ""]))
        parts.append(text)
        words.append(Word(word.letter, word.value, start, start + len(text)))
    return " ".join(parts), tuple(words)


def evaluated(block: Block, decimals: int) -> tuple[str, tuple[Word, ...]]:
    """Replace the expressions of a block by their values and leave everything else.

    Args:
        block: Executed block.
        decimals: Decimals for values that came from expressions.

    Returns:
        The line and its words at their new places.
    """
    if all(word.literal for word in block.words):
        return block.text, block.words
    parts: list[str] = []
    words: list[Word] = []
    at = length = 0
    for word in block.words:
        text = block.text[word.start : word.end] if word.literal else word.letter + _short(word.value, decimals)
        gap = block.text[at : word.start]
        start = length + len(gap)
        words.append(Word(word.letter, word.value, start, start + len(text)))
        parts += [gap, text]
        length = start + len(text)
        at = word.end
    return "".join(parts) + block.text[at:], tuple(words)


def _short(value: float, decimals: int) -> str:
    return str(int(value)) if value == int(value) else number(value, max(decimals, 6)).rstrip("0")


def without_comments(text: str) -> tuple[str, list[str]]:
    """A line without its comments, and the comments in order."""
    return " ".join(_COMMENT.sub(" ", text).split()), _COMMENT.findall(text)


def _comments(gap: str) -> Iterable[str]:
    return _COMMENT.findall(gap)
