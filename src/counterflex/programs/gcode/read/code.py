"""A row of a table of codes: modal group, treatment, words that belong to it."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.programs.statement_table import Statement, Treatment


@dataclass(frozen=True)
class Code:
    """A G or M code.

    Attributes:
        word: As written; with a letter behind it (``G5.1 Q``) where that word makes it another code.
        treatment: What the reader does with it.
        group: Modal group; two codes of one group in a block are refused. Empty for a refused one.
        reason: See :class:`~counterflex.programs.statement_table.Statement`.
        remedy: There too.
        sample: A complete block.
        takes: Letters of the words that belong to a neutral code.
    """

    word: str
    treatment: Treatment
    group: str
    reason: str
    remedy: str = ""
    sample: str = ""
    takes: str = ""

    @property
    def statement(self) -> Statement:
        """Row of the table of statements."""
        return Statement(self.word, self.treatment, self.reason, self.remedy, (self.sample,))


def read(words: str, group: str, reason: str, sample: str = "") -> list[Code]:
    """Return rows of codes that are evaluated; ``*`` in the sample stands for the code."""
    return [
        Code(word, Treatment.EVALUATED, group, reason, sample=sample.replace("*", word) or word)
        for word in words.split()
    ]


def neutral(words: str, reason: str, sample: str = "", takes: str = "", group: str = "") -> list[Code]:
    """Return rows of neutral codes, divided by ``|``; each is a group of its own where none is named."""
    return [
        Code(w, Treatment.NEUTRAL, group or w, reason, sample=sample.replace("*", w) or w, takes=takes)
        for w in words.split("|")
    ]


def refused(words: str, reason: str, remedy: str, sample: str = "") -> list[Code]:
    """Return rows of refused codes; ``*`` in reason and sample stands for the code."""
    return [
        Code(word, Treatment.REFUSED, "", reason.replace("*", word), remedy, sample.replace("*", word) or word)
        for word in words.split()
    ]
