"""Klartext statements: block numbers, comments, continued lines, the lines of one cycle, labels.

Source: HEIDENHAIN TNC 640 (34059x-05), User's Manual Conversational Programming, "Organization of an NC program", and
"Labeling subprograms and program section repeats".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.source_text import read_text

_NUMBER: Final = re.compile(r"\s*/?\s*(?:\d+(?=\s|$|\*|;|/))?\s*/?\s*")
_COMMENT: Final = re.compile(r'"[^"]*"|(;.*)')
_CYCLE_LINE: Final = re.compile(r"\s*CYCL\s+DEF\s+(\d+)\.(\d+)", re.IGNORECASE)
_BEGIN: Final = re.compile(r"\s*BEGIN\s+PGM\s+(?:(\S.*?)\s+)?(MM|INCH)\s*$", re.IGNORECASE)
LABEL: Final = re.compile(r'(\d+|"[^"]+"|Q[SLR]?\d+)', re.IGNORECASE)
_LABEL: Final = re.compile(rf"\s*LBL\s*{LABEL.pattern}\s*$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class KlartextStatement:
    """One statement, perhaps over several lines."""

    line: int  # 1-based line that it begins in
    text: str  # Its lines, joined by line feeds
    code: str  # The same with blanks in place of block numbers, comments, ``~`` and line ends: as long as the text

    def place(self, name: str, at: int) -> str:
        """Return ``name:line:column`` of an index into the text."""
        at = min(max(at, 0), len(self.text))
        before = self.text[:at]
        return f"{name}:{self.line + before.count(chr(10))}:{at - before.rfind(chr(10))}"

    @property
    def start(self) -> int:
        """Index of its first word."""
        return len(self.code) - len(self.code.lstrip()) if self.code.strip() else 0

    def fault(self, name: str, what: str, at: int | None = None, value: object = None, hint: str = "") -> ProgramError:
        """Make an error at an index, or at the first word."""
        shown = self.text.split("\n")[0].strip()[:40] if value is None else value
        return ProgramError(what, where=self.place(name, self.start if at is None else at), value=shown,
                            hint=hint or None)  # fmt: skip


def code_of(line: str) -> str:
    """Return a line with blanks in place of its number, comment and sign of continuation."""
    number = _NUMBER.match(line)
    end = number.end() if number is not None else 0
    code = " " * end + line[end:]
    if code.lstrip().startswith("*"):  # structure block
        return " " * len(line)
    for match in _COMMENT.finditer(code):
        if match[1] is not None:
            code = code[: match.start()].ljust(len(line))
            break
    stripped = code.rstrip()
    return (stripped.removesuffix("~")).ljust(len(line))


def _statements(lines: tuple[str, ...]) -> Iterator[KlartextStatement]:
    at = 0
    while at < len(lines):
        first, parts = at, [lines[at]]
        while parts[-1].rstrip().endswith("~") and at + 1 < len(lines):
            at += 1
            parts.append(lines[at])
        at += 1
        cycle = _CYCLE_LINE.match(code_of(parts[0]))
        if cycle is not None and int(cycle[2]) == 0:
            while at < len(lines):
                following = _CYCLE_LINE.match(code_of(lines[at]))
                if following is None or following[1] != cycle[1] or int(following[2]) == 0:
                    break
                parts.append(lines[at])
                at += 1
        yield KlartextStatement(first + 1, "\n".join(parts), " ".join(code_of(part) for part in parts))


@dataclass
class KlartextSource:
    """A program: its statements, labels and unit.

    Raises:
        ProgramError: A label is set twice, or the head is missing.
    """

    name: str
    lines: tuple[str, ...]
    statements: tuple[KlartextStatement, ...] = ()
    labels: dict[str, int] = field(default_factory=dict)
    inch: bool = False

    def __post_init__(self) -> None:
        """Find the head and the labels."""
        self.statements = tuple(_statements(self.lines))
        head = next((part for part in self.statements if part.code.strip()), None)
        begin = None if head is None else _BEGIN.match(head.code)
        if begin is None:
            raise (head or KlartextStatement(1, "", "")).fault(
                self.name, "a Klartext program begins with BEGIN PGM, its name and MM or INCH", None, None,
                "BEGIN PGM PART MM",
            )  # fmt: skip
        self.inch = begin[2].upper() == "INCH"
        for index, part in enumerate(self.statements):
            match = _LABEL.match(part.code)
            if match is None or match[1].strip('"') in ("0", "00"):
                continue
            key = label_key(match[1])
            if key in self.labels:
                raise part.fault(self.name, "the label is set twice", None, f"LBL {match[1]}", "Give it another number")
            self.labels[key] = index


def label_key(text: str) -> str:
    """Return a label as it is looked up: ``1`` of ``01``, names as they stand."""
    return str(int(text)) if text.isdecimal() else text.strip('"')


class Library:
    """Programs that CALL PGM finds beside the main one.

    Args:
        folder: That they stand in; None finds nothing.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._known: dict[str, KlartextSource] = {}

    def find(self, name: str) -> KlartextSource | None:
        """Return a program by the name or path that the control knows it by."""
        key = PureWindowsPath(name.strip().strip('"')).name.upper()
        key = key if "." in key else f"{key}.H"
        if key not in self._known and self._folder is not None:
            for file in sorted(self._folder.iterdir()):
                if file.name.upper() == key:
                    self._known[key] = KlartextSource(file.name, split_lines(read_text(file)[0]))
        return self._known.get(key)
