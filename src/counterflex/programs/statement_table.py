"""The statements and instructions of a language, and what its reader does with each.

A reader is driven by its table: it evaluates a statement, passes it because it cannot move, stop short or displace the
tool, or refuses it. A statement that no row names is refused. The documentation prints the tables, and tests insert the
samples into programs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property


class Treatment(StrEnum):
    """Treatment of a statement by a reader."""

    EVALUATED = "evaluated"
    NEUTRAL = "neutral"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement or instruction of a language."""

    word: str  # Its key word, as the manual writes it
    treatment: Treatment  # What the reader does with it
    # Of an evaluated one what it sets; of a neutral one why the path stays the same; of a refused one what it would
    # change
    reason: str
    remedy: str = ""  # What to do about a refused one
    # Complete statements, for tests: those of a neutral one can stand anywhere between two motions
    samples: tuple[str, ...] = ()


@dataclass(frozen=True)
class StatementTable:
    """All statements and instructions of a language."""

    language: str  # As the reader's registry names it
    source: str  # The manual that lists them, with its edition
    rows: tuple[Statement, ...]  # One per statement; words are unique, upper and lower case are the same

    def find(self, word: str) -> Statement | None:
        """Return the row of a key word; None where the language has no such statement."""
        return self._by_word.get(word.upper())

    def of(self, treatment: Treatment) -> Sequence[Statement]:
        """Return the rows with a treatment, in the order of the table."""
        return [row for row in self.rows if row.treatment is treatment]

    @property
    def read_share(self) -> float:
        """Share of the statements that are evaluated or neutral, 0 to 1."""
        return 1.0 - len(self.of(Treatment.REFUSED)) / len(self.rows)

    def markdown(self) -> str:
        """Return the table as a page of the documentation has it."""
        lines = ["| statement | treatment | reason | remedy |", "|---|---|---|---|"]
        for row in self.rows:
            cells = (f"`{row.word}`", str(row.treatment), row.reason, row.remedy)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        return "\n".join(lines) + "\n"

    @cached_property
    def _by_word(self) -> dict[str, Statement]:
        return {row.word.upper(): row for row in self.rows}
