"""Spelling of what a writer adds in the dialects of G-code."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.programs.language import LANGUAGES, object_at
from counterflex.programs.limits import LINUXCNC

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
