"""One path statement of Klartext being rewritten: coordinates, function and feed; all else stays as it is."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from counterflex.integrations.heidenhain.language.emitter import signed
from counterflex.integrations.heidenhain.language.source import code_of
from counterflex.integrations.heidenhain.language.values import VALUE
from counterflex.programs.program import Block, Word

_FUNCTION: Final = re.compile(r"\s*(LP|LN|L|CC|CTP|CT|CR|CP|C|RND)(?![A-Z0-9])", re.IGNORECASE)
_GEOMETRY: Final = re.compile(
    rf"\s*(?:I?P[RA]\s*{VALUE}|I?[XYZ]\s*{VALUE}|DR\s*[+-]|R(?!0(?![\d.,]))\s*{VALUE})", re.IGNORECASE
)
_FEED: Final = re.compile(rf"\s*F\s*(?:AUTO(?![A-Z])|{VALUE})", re.IGNORECASE)
_M: Final = re.compile(r"\s*(?<![A-Z])M\s*(\d+)(?![\d.])", re.IGNORECASE)
_ACT_LAST: Final = frozenset((0, 1, 2, 5, 6, 9, 30, 89, 99, 127, 129))
"""M functions that act at the end of their block (TNC 640, "M functions")."""
_ORDER: Final = "XYZABC"


def function_of(block: Block) -> str:
    """Return the path function of a block; empty where it is none."""
    match = _FUNCTION.match(code_of(block.text)) if "\n" not in block.text else None
    return "" if match is None else match[1].upper()


class PathLine:
    """The line of a path statement."""

    def __init__(self, block: Block) -> None:
        self.text, self.words = block.text, tuple(word for word in block.words if word.end > word.start)
        self._edits: list[tuple[int, int, str]] = []
        code = code_of(block.text)
        match = _FUNCTION.match(code)
        self._code, self._head = code, 0 if match is None else match.end()
        self._function = (0, 0) if match is None else match.span(1)

    def find(self, letter: str) -> Word | None:
        """First word with this letter."""
        return next((word for word in self.words if word.letter == letter), None)

    @property
    def has_feed(self) -> bool:
        """It says its feed."""
        return _FEED.search(self._code, self._head) is not None

    def set(self, letter: str, text: str) -> None:
        """Replace a coordinate, or put it in its place among the others."""
        word = self.find(letter)
        if word is not None:
            self._edits.append((word.start, word.end, text))
            return
        at = self._head
        for other in self.words:
            if other.letter in _ORDER and _ORDER.index(other.letter) < _ORDER.index(letter):
                at = max(at, other.end)
        self._edits.append((at, at, f" {text}"))

    def set_vector(self, texts: Iterable[str]) -> None:
        """Replace TX, TY and TZ where the line has them."""
        for letter, text in zip("IJK", texts, strict=True):
            word = self.find(letter)
            if word is not None:
                self._edits.append((word.start, word.end, text))

    def set_feed(self, text: str) -> None:
        """Replace the feed, or put it before the M functions."""
        match = _FEED.search(self._code, self._head)
        if match is not None:
            self._edits.append((*match.span(), f" {text}"))
            return
        m = _M.search(self._code, self._head)
        at = len(self._code.rstrip()) if m is None else m.start()
        self._edits.append((at, at, f" {text}"))

    def become(self, function: str, coordinates: str) -> None:
        """Let the line have another path function and other coordinates."""
        self._edits += [(*match.span(), "") for match in _GEOMETRY.finditer(self._code, self._head)]
        self._edits.append((*self._function, f"{function} {coordinates}"))

    def take_last(self) -> str:
        """Take out the M functions that act at the end of the block, and return them."""
        last = [match for match in _M.finditer(self._code, self._head) if int(match[1]) in _ACT_LAST]
        self._edits += [(*match.span(), "") for match in last]
        return "".join(f" M{match[1]}" for match in last)

    def take(self, number: int) -> None:
        """Take out an M function."""
        self._edits += [(*m.span(), "") for m in _M.finditer(self._code, self._head) if int(m[1]) == number]

    def render(self) -> str:
        """Return the line with all edits."""
        out, at = list[str](), 0
        for start, end, text in sorted(self._edits, key=lambda edit: (edit[0], edit[1])):
            out.append(self.text[at:start] if start > at else "")
            out.append(text)
            at = max(at, end)
        out.append(self.text[at:])
        return "".join(out)


def spelled(letter: str, value: float, decimals: int) -> str:
    """Return an absolute coordinate as written."""
    return f"{letter}{signed(value, decimals)}"
