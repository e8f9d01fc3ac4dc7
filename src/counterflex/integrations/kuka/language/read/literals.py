"""Literals of KRL, ``{X 1.0,Y 2.0,...}``, with the place of every number; code and comment of a line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.program import LETTERS, Component, KrlFile
from counterflex.programs.robot_text.process_words import NUMBER

_FULL: Final = re.compile(NUMBER)
_COMPONENT: Final = re.compile(rf"\s*([A-Za-z_]\w*)\s*(?:({NUMBER})|'([BH]?)([0-9A-Fa-f]+)')\s*")
_OTHER: Final = re.compile(
    r"\s*[A-Za-z_]\w*\s*(?:\[\s*\])?\s*(?:#\s*\w+|\bTRUE\b|\bFALSE\b|\"[^\"]*\")\s*", re.IGNORECASE
)
_TYPE: Final = re.compile(r"\s*(\w+)\s*:")
CARTESIAN: Final = frozenset((*LETTERS, "S", "T", *(f"E{i}" for i in range(1, 7))))
_LARGEST_MM: Final = 100_000.0


def code_of(line: str) -> str:
    """The part of a line before its comment; a semicolon within quotes begins none."""
    if ";" not in line:
        return line
    quoted = False
    for index, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == ";" and not quoted:
            return line[:index]
    return line


def number_of(text: str) -> float | None:
    """Value of a number; None where the text is none."""
    text = text.strip()
    return float(text) if _FULL.fullmatch(text) else None


class NoNumber(ProgramError):
    """A component of a literal is no number, but may be an expression."""


def simple_record(text: str, start: int) -> dict[str, object] | None:
    """Return a literal of numbers alone that begins at a brace and ends the statement; None where it is another."""
    if text[start : start + 1] != "{":
        return None
    try:
        parts, close = components(text, start, "")
    except ProgramError:
        return None
    if code_of(text[close + 1 :]).strip():
        return None
    return {name: component.value for name, component in parts.items()}


def components(line: str, start: int, where: str, *, mixed: bool = False) -> tuple[dict[str, Component], int]:
    """Components of the literal that begins at a brace.

    Args:
        start: Index of the opening brace.
        where: Its file and line, for errors.
        mixed: The literal may hold names (``IPO_FRAME #BASE``), truth values and texts (``POINT2[] " "``) as well, as
            FDAT, LDAT and PDAT do; they are passed over.

    Returns:
        Components by name, and the index of the closing brace.

    Raises:
        ProgramError: The literal is not closed, or a component is no number.
    """
    close = line.find("}", start)
    if close < 0:
        raise ProgramError(
            "a literal is not closed: the line may be cut off",
            where=f"{where}:{start + 1}", value=line[start:].strip()[:60], limit="{X 0.0,Y 0.0,...}",
            hint="Post the program again",
        )  # fmt: skip
    at = start + 1
    if (match := _TYPE.match(line, at, close)) is not None:
        at = match.end()
    out: dict[str, Component] = {}
    while at < close:
        other = _OTHER.match(line, at, close) if mixed else None
        if other is not None and (other.end() == close or line[other.end()] == ","):
            at = other.end() + 1
            continue
        match = _COMPONENT.match(line, at, close)
        if match is None or (match.end() < close and line[match.end()] != ","):
            raise NoNumber(
                "a component of a literal is no number",
                where=f"{where}:{at + 1}", value=line[at:close].strip()[:40], limit="a name and a number: X 12.5",
                hint="Write the numbers themselves",
            )  # fmt: skip
        name = match[1].upper()
        if name in out:
            raise ProgramError(f"{name} stands twice in a literal", where=f"{where}:{at + 1}", value=line[start:close])
        group = 2 if match[2] is not None else 4
        value = float(match[2]) if group == 2 else _integer(match[4], match[3])
        out[name] = Component(value, match.start(group), match.end(group))
        at = match.end() + 1
    return out, close


def _integer(digits: str, base: str) -> float:
    """Value of an integer of KRL in quotes: binary (``'B101'``), hexadecimal (``'H1F'``) or decimal."""
    try:
        return float(int(digits, {"B": 2, "H": 16}.get(base.upper(), 10)))
    except ValueError:
        return float("nan")


def require_cartesian(parts: Mapping[str, Component], text: str, where: str) -> None:
    """Refuse components that a Cartesian target does not have, or that no robot reaches.

    Raises:
        ProgramError: There is one.
    """
    for name, component in parts.items():
        if name not in CARTESIAN:
            raise ProgramError(
                f"{name} is no component of a Cartesian target", where=where, value=text[:60],
                limit="X Y Z A B C S T E1 to E6",
            )  # fmt: skip
        if not abs(component.value) <= _LARGEST_MM:
            raise ProgramError(
                f"{name} is beyond every robot", where=where, value=f"{component.value:g}", limit=f"{_LARGEST_MM:g}"
            )


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
    """Read a data list. Raises ProgramError: the file has no DEFDAT or ENDDAT, or gives a name twice."""
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
