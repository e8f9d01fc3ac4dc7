"""Text of a RAPID module as statements, each with its place; comments and the contents of strings do not count."""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.read.literals import arguments

_COMMENT: Final = re.compile(r'"(?:[^"\n]|"")*"|![^\r\n]*|%%%.*?%%%', re.DOTALL)
_STRING: Final = re.compile(r'"(?:[^"\n]|"")*"')
_WORD: Final = re.compile(r"[\w%]+")
_I: Final = re.IGNORECASE
_SCOPE: Final = r"(?:(?:LOCAL|TASK|GLOBAL)\s+)?"
_STRUCTURE: Final = re.compile(
    rf"""MODULE\s+\w+(?:[^\S\r\n]*\([^)]*\))? | ENDMODULE\b
    | {_SCOPE}(?:PROC|TRAP)\s+\w+(?:\s*\([^)]*\))? | {_SCOPE}FUNC\s+\w+\s+\w+\s*\([^)]*\) | {_SCOPE}RECORD\s+\w+
    | END(?:PROC|TRAP|FUNC|RECORD|IF|FOR|WHILE|TEST)\b
    | (?:ELSE)?IF\b[^;]*?\bTHEN\b | ELSE\b | FOR\b[^;]*?\bDO\b | WHILE\b[^;]*?\bDO\b
    | TEST\b[^;\r\n]* | CASE\b[^;\r\n]*?:(?!=) | DEFAULT\s*:(?!=)
    | ERROR\b(?:\s*\([^)]*\))?(?!\s*;) | UNDO\b(?!\s*;) | BACKWARD\b(?!\s*;) | \w+\s*:(?!=)""",
    _I | re.VERBOSE,
)


@dataclass(frozen=True, slots=True)
class RapidStatement:
    """A statement, or a word that opens or closes a part of the program."""

    start: int  # Index of its first character in the text
    end: int  # Index behind its last one; of a statement that ends in a semicolon that of the semicolon
    code: str  # The text between, comments as blanks
    line: int  # 1-based line of its first character, in its file
    structure: bool  # It opens or closes a part and has no semicolon
    word: str = ""  # Its first word, in capitals

    def names_given(self) -> Iterator[tuple[int, str, str]]:
        """Return the arguments that are names: position or -1, option or nothing, name in capitals."""
        position = 0
        word = re.match(r"\w+", self.code)
        given = arguments(self.code, 0 if word is None else word.end(), len(self.code))
        for argument in given:
            for option, (text, _, _) in argument.options.items():
                if (match := re.match(r"[A-Za-z]\w*", text)) is not None:
                    yield -1, option, match[0].upper()
            if not argument.text:
                continue
            if (match := re.match(r"[A-Za-z]\w*", argument.text)) is not None:
                yield position, "", match[0].upper()
            position += 1


@dataclass(frozen=True, slots=True)
class FilePart:
    """Place of a file in the joined text of a program."""

    name: str  # Of the file
    start: int  # Index of its first character
    end: int  # Index behind its last one
    first_line: int = 0  # Number of lines before it


class RapidSource:
    """Text of the modules of a program, one after the other.

    Args:
        name: Of the file, for errors.
        parts: Where each file stands in the text; none: it is one file.
    """

    def __init__(self, text: str, name: str, parts: Sequence[FilePart] = ()) -> None:
        self.text, self.name = text, name
        self.parts = tuple(parts) or (FilePart(name, 0, len(text)),)  # As given
        self.code = _COMMENT.sub(_blanked, text)  # The text with comments as blanks, as long as the text
        self._bare = _STRING.sub(lambda match: f'"{"x" * (len(match[0]) - 2)}"', self.code)
        self._ends = [match.start() for match in re.finditer(r"\r\n|\n|\r", text)]

    def line(self, at: int) -> int:
        """1-based line of an index."""
        return bisect.bisect_left(self._ends, at) + 1

    def place(self, at: int) -> str:
        """``name:line:column`` of an index."""
        line = self.line(at)
        before = 0 if line == 1 else self._ends[line - 2]
        while before < len(self.text) and self.text[before] in "\r\n" and before < at:
            before += 1
        part = self.part(at)
        return f"{part.name}:{line - part.first_line}:{at - before + 1}"

    def where(self, at: int) -> str:
        """``name:line`` of an index."""
        return self.place(at).rsplit(":", 1)[0]

    def part(self, at: int) -> FilePart:
        """The file that an index is in."""
        if len(self.parts) == 1:
            return self.parts[0]
        return next((part for part in reversed(self.parts) if part.start <= at), self.parts[0])

    def statements(self) -> Iterator[RapidStatement]:
        """Statements in order. Raises ProgramError: one is not closed."""
        bare, at = self._bare, 0
        while True:
            while at < len(bare) and (bare[at].isspace() or bare[at] == ";"):
                at += 1
            if at >= len(bare):
                return
            match = _STRUCTURE.match(bare, at)
            if match is not None and match.end() > at:
                end, structure = match.end(), True
            else:
                end, structure = bare.find(";", at), False
                if end < 0:
                    raise ProgramError(
                        "a statement without its semicolon: the file may be cut off",
                        where=self.place(at), value=self.code[at:].strip().splitlines()[0][:60],
                        hint="Post the module again",
                    )  # fmt: skip
            code = self.code[at:end]
            first = _WORD.match(code)
            yield RapidStatement(
                at,
                end,
                code,
                self.line(at) - self.part(at).first_line,
                structure,
                "" if first is None else first[0].upper(),
            )
            at = end


def _blanked(match: re.Match[str]) -> str:
    """A comment as blanks, its line ends kept; strings stay."""
    return match[0] if match[0].startswith('"') else re.sub(r"[^\r\n]", " ", match[0])


def statements_of(line: str) -> list[str]:
    """Statements of a line of the cell file's table, without semicolons."""
    bare = _STRING.sub(lambda match: "x" * len(match[0]), line)
    ends = [index for index, character in enumerate(bare) if character == ";"] or [len(line)]
    parts = [
        line[start:end].strip() for start, end in zip([0, *(end + 1 for end in ends)], [*ends, len(line)], strict=True)
    ]
    return [part for part in parts if part]
