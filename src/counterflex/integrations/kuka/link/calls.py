"""Calls of RSI in a KRL program: in order, the motions between them, what it writes for the sensor."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import content
from counterflex.integrations.kuka.link.context import decimal

Mode = Literal["absolute", "relative"]
_MOTION: Final = re.compile(r"(PTP_REL|PTP|LIN_REL|LIN|CIRC_REL|CIRC|SPTP|SLIN|SCIRC|SPL|SPLINE)\b", re.IGNORECASE)
_CALL: Final = re.compile(r"\b(RSI_[A-Z0-9_]+)\s*\(([^()]*)\)", re.IGNORECASE)
_WRITTEN: Final = re.compile(r"(\$(?:SEN_PREA|SEN_PINT|OUT|FLAG)\[\s*\d+\s*\])\s*=(?!=)\s*(.*)", re.IGNORECASE)
_ROUTINE: Final = re.compile(r"(?:GLOBAL\s+)?DEF(?:FCT\s+\w+)?\s+(\w+)\s*\(", re.IGNORECASE)
_OPENS: Final = re.compile(r"(IF\b.*\bTHEN\b|CASE\b|DEFAULT\b)", re.IGNORECASE)
_CLOSES: Final = re.compile(r"(ENDIF|ENDSWITCH)\b", re.IGNORECASE)
_INTERRUPT: Final = re.compile(r"(?:GLOBAL\s+)?INTERRUPT\s+DECL\b", re.IGNORECASE)
_NAMED: Final = re.compile(r"(\w+)\s*\(([^()]*)\)\s*$")


@dataclass(frozen=True)
class KrlStatement:
    """Something that matters to RSI."""

    line: int  # Number in the file, from 1
    # ``RSI_ON``, ``LIN``, ``HALT``, ``WAIT``, ``WHILE`` (also REPEAT: a loop on a condition), ``INTERRUPT``, ``CALL``,
    # ``WRITE``, ``RSIOK``
    what: str
    # Of a call; name and arguments of a called routine; variable that is written, and what with; the line of a
    # condition, in capitals and without blanks
    arguments: tuple[str, ...] = ()
    guarded: bool = False  # It stands inside IF or CASE
    result: str = ""  # Variable that takes the result of a call, or empty

    def sets(self) -> bool:
        """Return whether it enables: 1, or the number of a job."""
        return decimal(self.arguments[1]) != 0.0 and self.arguments[1].upper() != "FALSE"


@dataclass(frozen=True)
class RsiCalls:
    """The main routine of a KRL program, as RSI sees it."""

    statements: tuple[KrlStatement, ...]  # In the order of the file
    where: str = ""  # Path, for messages

    def first(self, what: str) -> KrlStatement | None:
        """First statement of a kind, or None."""
        return next((item for item in self.statements if item.what == what), None)

    @property
    def mode(self) -> Mode | None:
        """Mode of RSI_ON; None without RSI_ON. The controller takes ABSOLUTE where it names none."""
        on = self.first("RSI_ON")
        if on is None:
            return None
        return "relative" if any(word.upper() == "#RELATIVE" for word in on.arguments) else "absolute"

    @property
    def cycle_ms(self) -> int:
        """12 for #IPO, else 4."""
        on = self.first("RSI_ON")
        return 12 if on is not None and any(word.upper() == "#IPO" for word in on.arguments) else 4

    def between(self, begin: str, end: str) -> tuple[KrlStatement, ...]:
        """Statements after the first ``begin`` and before the next ``end`` (or up to the end of the routine)."""
        statements: list[KrlStatement] = []
        inside = False
        for item in self.statements:
            if inside and item.what == end:
                break
            if inside:
                statements.append(item)
            inside = inside or item.what == begin
        return tuple(statements)

    def public_parameters(self) -> dict[tuple[str, str], tuple[float | None, int]]:
        """Settings of RSI_SETPUBLICPAR: value (None where it is computed) and line by object and parameter."""
        parameters: dict[tuple[str, str], tuple[float | None, int]] = {}
        for item in self.statements:
            if item.what == "RSI_SETPUBLICPAR" and len(item.arguments) == 4:
                name, parameter = (text.strip('"') for text in item.arguments[1:3])
                parameters[name, parameter] = (decimal(item.arguments[3]), item.line)
        return parameters


def read_calls(path: str | Path) -> RsiCalls:
    """Read a KRL program (``.src``). Raises FileFormatError: missing, or no KRL program."""
    file = Path(path)
    text = content(file).decode("latin-1")
    return parse_calls(text, str(file))


def parse_calls(text: str, where: str) -> RsiCalls:
    """Read the first routine of a KRL text. Raises as :func:`read_calls`."""
    statements: list[KrlStatement] = []
    inside, depth = False, 0
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split(";")[0].strip()
        if not inside:
            inside = bool(_ROUTINE.match(line))
            continue
        if line.upper() in ("END", "ENDFCT"):
            break
        if _CLOSES.match(line):
            depth = max(0, depth - 1)
            continue
        if "RSIOK" in line.upper():
            statements.append(KrlStatement(number, "RSIOK"))
        if re.match(r"SWITCH\b", line, re.IGNORECASE) or (_OPENS.match(line) and line.upper().startswith("IF")):
            depth += 1
        statements += _statements(line, number, depth > 0)
    if not inside:
        raise FileFormatError("not a KRL program: no DEF NAME( )", where=where)
    return RsiCalls(tuple(statements), where)


def _statements(line: str, number: int, guarded: bool) -> list[KrlStatement]:
    statements = []
    for call in _CALL.finditer(line):
        arguments = tuple(word.strip() for word in call[2].split(",")) if call[2].strip() else ()
        statements.append(KrlStatement(number, call[1].upper(), arguments, guarded, _result(line)))
    if statements:
        return statements
    motion = _MOTION.match(line)
    if motion:
        return [KrlStatement(number, motion[1].upper(), (), guarded)]
    if line.upper() == "HALT":
        return [KrlStatement(number, "HALT", (), guarded)]
    if re.match(r"WAIT\s+FOR\b", line, re.IGNORECASE):
        return [KrlStatement(number, "WAIT", (_condition(line),), guarded)]
    if re.match(r"(WHILE|REPEAT)\b", line, re.IGNORECASE):
        return [KrlStatement(number, "WHILE", (_condition(line),), guarded)]
    if _INTERRUPT.match(line):
        return [KrlStatement(number, "INTERRUPT", (_condition(line),), guarded)]
    written = _WRITTEN.match(line)
    if written:
        return [KrlStatement(number, "WRITE", (re.sub(r"\s", "", written[1]).upper(), written[2].strip()), guarded)]
    called = _NAMED.match(line)
    if called is None:
        return []
    values = tuple(word.strip() for word in called[2].split(",")) if called[2].strip() else ()
    return [KrlStatement(number, "CALL", (called[1], *values), guarded)]


def _condition(line: str) -> str:
    return re.sub(r"\s", "", line).upper()


def _result(line: str) -> str:
    match = re.match(r"(\w+)\s*=", line)
    return match[1] if match else ""
