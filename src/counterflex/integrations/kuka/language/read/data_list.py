"""Data lists (``.dat``): declarations with their initial values, and where each of them stands."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.program import Component, KrlFile
from counterflex.integrations.kuka.language.read.literals import code_of, components

_I: Final = re.IGNORECASE
_HEAD: Final = re.compile(r"\s*DEFDAT\s+(\$?\w+)(\s+PUBLIC)?\s*", _I)
_END: Final = re.compile(r"\s*ENDDAT\s*", _I)
_NO_VALUE: Final = re.compile(r"\s*(?:GLOBAL\s+)?(?:EXT|EXTP|EXTFCT|IMPORT|STRUC|ENUM)\b", _I)
SIGNAL: Final = re.compile(r"\s*(?:GLOBAL\s+)?SIGNAL\s+([A-Za-z]\w*)\b.*", _I)
DECLARED: Final = re.compile(
    r"\s*(?P<words>(?:(?:DECL|GLOBAL|CONST|PRIVATE|PUBLIC)\s+)*)(?:(?P<type>[A-Za-z]\w*)\s+)?"
    r"(?P<name>[A-Za-z$]\w*)(?P<index>\s*\[[\s\d,]*\])?\s*(?P<rest>[=,].*)?",
    _I,
)
"""A declaration or an initial value; several names follow behind commas."""
IMPORT: Final = re.compile(r"\s*IMPORT\s+(?:\w+\s+)?(\w+)(?:\s*\[[\s,]*\])?\s+IS\s+(\S*?)\.\.(\$?\w+).*", _I)


@dataclass(frozen=True, slots=True)
class Named:
    """An initial value of a data list."""

    file: str  # Name of the file
    line: int  # 1-based
    text: str  # The line
    start: int  # Index of the first character of the value

    @property
    def where(self) -> str:
        """File, line and column."""
        return f"{self.file}:{self.line}:{self.start + 1}"

    def components(self, *, mixed: bool = False) -> tuple[dict[str, Component], int]:
        """Its components and the index of its closing brace. As :func:`~.literals.components`."""
        return components(self.text, self.start, f"{self.file}:{self.line}", mixed=mixed)


@dataclass(frozen=True)
class DataList:
    """A data list."""

    file: KrlFile  # The file
    stem: str  # Its name in DEFDAT, in capitals
    initial: dict[str, Named] = field(default_factory=dict)  # Initial values by name and, of arrays, index: ``P[2]``
    types: dict[str, str] = field(default_factory=dict)  # Type of each declared name
    public_names: set[str] = field(default_factory=set)  # Names that every program may use
    imports: dict[str, tuple[str, str]] = field(default_factory=dict)  # Module and name in it of each imported name

    def declare(self, code: str, line: str, number: int, *, public: bool) -> None:
        """Take in a line that declares."""
        match = DECLARED.fullmatch(code)
        if match is None:
            return
        name, kind, rest = match["name"].upper(), (match["type"] or "").upper(), match["rest"] or ""
        words = match["words"].upper()
        names = [name]
        if rest.startswith(","):
            names += [key_of(part).split("[")[0] for part in rest[1:].split(",") if re.match(r"\s*[A-Za-z$]", part)]
        for one in names:
            if kind:
                self.types[one] = kind
            if public and (self.stem == "$CONFIG" or "GLOBAL" in words):
                self.public_names.add(one)
        if not rest.startswith("="):
            return
        key = name + key_of(match["index"] or "")
        if key in self.initial:
            raise ProgramError(
                f"{match['name']} is given twice", where=f"{self.file.name}:{number}:{match.start('name') + 1}",
                value=line.strip()[:60], limit=f"once; first in line {self.initial[key].line}",
            )  # fmt: skip
        start = match.start("rest") + 1
        self.initial[key] = Named(self.file.name, number, line, start + len(line[start:]) - len(line[start:].lstrip()))


def key_of(name: str) -> str:
    """A name as KRL compares it: capitals, no blanks."""
    return "".join(name.split()).upper()


def data_list(file: KrlFile) -> DataList:
    """Read a data list.

    Raises:
        ProgramError: The file has no DEFDAT or ENDDAT, or gives a name twice.
    """
    out, public = DataList(file, ""), False
    begun = ended = False
    for number, line in enumerate(file.lines, start=1):
        code = code_of(line)
        if (head := _HEAD.fullmatch(code)) is not None:
            begun, out = True, DataList(file, head[1].upper())
            public = head[2] is not None or out.stem == "$CONFIG"
        elif _END.fullmatch(code):
            ended = True
            break
        elif (imported := IMPORT.fullmatch(code)) is not None:
            out.imports[imported[1].upper()] = (imported[2].rstrip("/").rsplit("/", 1)[-1].upper(), imported[3].upper())
        elif (signal := SIGNAL.fullmatch(code)) is not None:
            out.types[signal[1].upper()] = "SIGNAL"
            if public:
                out.public_names.add(signal[1].upper())
        elif code.strip() and not _NO_VALUE.match(code) and code.lstrip()[:1] != "&":
            out.declare(code, line, number, public=public)
    if not begun or not ended:
        raise ProgramError(
            f"the data list has no {'DEFDAT' if not begun else 'ENDDAT'}: it may be cut off",
            where=f"{file.name}:{1 if not begun else max(1, len(file.lines))}",
            hint="Post the program again, .src and .dat together",
        )
    return out
