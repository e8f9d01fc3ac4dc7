"""Spindle, coolant and tool change of a robot program: the table of the cell file, read backwards."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.robot_writer.machine_functions import KEYS, MachineFunctions

NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?"
_HOLE: Final = re.compile(r"\{[stdpqer]\}")


@dataclass(frozen=True)
class ProcessWord:
    """A machine function of a program."""

    code: int  # M-code that the table gives these statements for
    values: dict[str, float]  # By letter: S speed in rpm, T tool, D tool data, and words of the M-code (P, Q, E, R)
    lines: int  # Number of statements that it takes


@dataclass(frozen=True)
class _Pattern:
    code: int
    lines: tuple[re.Pattern[str], ...]
    letters: tuple[tuple[str, ...], ...]
    behind: tuple[str, ...]


class ProcessWords:
    """Finds the statements of ``[controller.spindle]`` of a language.

    Blanks and capitals do not count; ``{s}`` stands for a number. Of several that fit, the longest counts.

    Args:
        code_of: The part of a line before its comment.
        split: Statements of a line of the table; each line is one where it is left out.
    """

    def __init__(
        self,
        functions: MachineFunctions,
        code_of: Callable[[str], str],
        split: Callable[[str], Sequence[str]] = lambda line: [line],
    ) -> None:
        self._where, self._code_of, self._language = functions.where, code_of, functions.language
        patterns = [
            self._pattern(code, [part for line in lines for part in split(line)], [
                part for line in behind for part in split(line)
            ])
            for code, (lines, behind) in sorted(functions.templates().items())
        ]  # fmt: skip
        self._patterns = sorted(patterns, key=lambda pattern: -len(pattern.lines))

    def find(self, statements: Sequence[str], at: int, where: str) -> ProcessWord | None:
        """The machine function that begins at a statement.

        Args:
            statements: Lines of the program that are no mere comments, comments behind them included.
            where: File and line, for errors.

        Raises:
            ProgramError: The table gives the same statements for two functions.
        """
        fits = [
            (pattern, values)
            for pattern in self._patterns
            if (values := self._match(pattern, statements, at)) is not None
        ]
        if not fits:
            return None
        best = len(fits[0][0].lines)
        codes = sorted({pattern.code for pattern, _ in fits if len(pattern.lines) == best})
        if len(codes) > 1:
            raise ProgramError(
                "the cell file gives the same statements for two functions, so which one is meant is not known",
                where=where, value=statements[at].strip()[:60],
                limit=", ".join(KEYS.get(code, f"m_codes.M{code}") for code in codes),
                hint=f"Tell them apart in [controller.spindle.{self._language}] of {self._where}",
            )  # fmt: skip
        pattern, values = fits[0]
        rest = [normal(self._code_of(line)) for line in statements[at + best : at + best + len(pattern.behind)]]
        length = best + (len(pattern.behind) if pattern.behind and rest == list(pattern.behind) else 0)
        return ProcessWord(pattern.code, values, length)

    def _pattern(self, code: int, lines: Sequence[str], behind: Sequence[str]) -> _Pattern:
        patterns, letters = [], []
        for line in lines:
            text = self._plain(line, full=";" in line)
            holes = _HOLE.findall(text.lower())
            parts = [re.escape(part) for part in re.split(_HOLE.pattern, text, flags=re.IGNORECASE)]
            patterns.append(re.compile(f"({NUMBER})".join(parts)))
            letters.append(tuple(hole[1].upper() for hole in holes))
        return _Pattern(code, tuple(patterns), tuple(letters), tuple(normal(self._code_of(line)) for line in behind))

    def _plain(self, line: str, *, full: bool) -> str:
        return normal(line if full else self._code_of(line))

    def _match(self, pattern: _Pattern, statements: Sequence[str], at: int) -> dict[str, float] | None:
        """Values of the words of a pattern that begins at a statement; None where it does not fit."""
        if at + len(pattern.lines) > len(statements):
            return None
        values: dict[str, float] = {}
        for offset, (expression, letters) in enumerate(zip(pattern.lines, pattern.letters, strict=True)):
            match = expression.fullmatch(self._plain(statements[at + offset], full=";" in expression.pattern))
            if match is None:
                return None
            for letter, text in zip(letters, match.groups(), strict=True):
                if values.setdefault(letter, float(text)) != float(text):
                    return None
        return values


def normal(code: str) -> str:
    """A statement without blanks outside of quotes, in capitals: robot languages tell neither apart."""
    parts = code.split('"')
    parts[::2] = ["".join(part.split()).upper() for part in parts[::2]]
    return '"'.join(parts)
