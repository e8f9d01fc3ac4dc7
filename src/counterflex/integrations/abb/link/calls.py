"""Calls of EGM in a RAPID module: its instructions in order, with arguments and switches."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import content

_WORD: Final = re.compile(r"[A-Za-z]\w*")
_MODULE: Final = re.compile(r"\s*MODULE\s+\w+", re.IGNORECASE)
_OPENING: Final = re.compile(
    r"\s*(?:MODULE\s+\w+(?:\s*\([^)]*\))?|(?:LOCAL\s+)?PROC\s+\w+\s*\([^)]*\)|ERROR\b|ENDPROC\b|ENDMODULE\b|ENDIF\b|"
    r"ENDWHILE\b|ELSE\b|IF\b.*?\bTHEN\b|ELSEIF\b.*?\bTHEN\b|WHILE\b.*?\bDO\b)",
    re.IGNORECASE | re.DOTALL,
)
_SWITCH: Final = re.compile(r"\\\s*([A-Za-z]\w*)\s*(?::=\s*([^\\]*))?", re.DOTALL)


@dataclass(frozen=True)
class Instruction:
    """One instruction."""

    line: int  # Where it begins, from 1
    # As written in capitals: ``EGMSETUPUC``, ``MOVEL``; ``IF`` and ``ERROR`` with their text in ``arguments``
    name: str
    arguments: tuple[str, ...] = ()  # Between commas, without switches
    # Optional arguments by name in lower case; empty text for one without value
    switches: dict[str, str] = field(default_factory=dict)

    def number(self, switch: str) -> float | None:
        """Value of a switch as a number; None where it is missing or computed."""
        try:
            return float(self.switches[switch])
        except (KeyError, ValueError):
            return None


@dataclass(frozen=True)
class EgmCalls:
    """The instructions of a module."""

    instructions: tuple[Instruction, ...]  # In the order of the file
    where: str = ""  # Path, for messages

    def of(self, *names: str) -> tuple[Instruction, ...]:
        """Instructions of these names."""
        return tuple(item for item in self.instructions if item.name in names)


def read_egm_calls(path: str | Path) -> EgmCalls:
    """Read a RAPID module (``.mod``, ``.modx``). Raises FileFormatError: missing, or no RAPID module."""
    file = Path(path)
    text = content(file).decode("latin-1")
    return parse_egm_calls(text, str(file))


def parse_egm_calls(text: str, where: str) -> EgmCalls:
    """Read a RAPID text. Raises as :func:`read_egm_calls`."""
    calls = []
    seen = False
    for line, statement in _statements(text):
        seen = seen or bool(_MODULE.match(statement))
        calls += [_instruction(number, part) for number, part in _parts(line, statement)]
    if not seen:
        raise FileFormatError("not a RAPID module: no MODULE NAME", where=where)
    return EgmCalls(tuple(calls), where)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Text up to each semicolon, without comments, with the line it begins on; strings are kept whole."""
    current: list[str] = []
    begin, line, inside = 1, 1, False
    for raw in text.splitlines():
        for sign in raw:
            if sign == '"':
                inside = not inside
            if sign == "!" and not inside:
                break
            if sign == ";" and not inside:
                yield begin, "".join(current)
                current = []
                continue
            if not current and sign.isspace():
                continue
            if not current:
                begin = line
            current.append(sign)
        inside = False  # a string does not go on in the next line
        if current:
            current.append("\n")
        line += 1
    if "".join(current).strip():
        yield begin, "".join(current)


def _parts(line: int, statement: str) -> Iterator[tuple[int, str]]:
    """Block words that end without a semicolon, then the instruction behind them."""
    while match := _OPENING.match(statement):
        yield line, match[0].strip()
        line += match[0].count("\n")
        statement = statement[match.end() :]
        lead = len(statement) - len(statement.lstrip())
        line += statement[:lead].count("\n")
        statement = statement[lead:]
    if statement.strip():
        yield line, statement.strip()


def _instruction(line: int, text: str) -> Instruction:
    word = _WORD.match(text)
    if word is None:
        return Instruction(line, "", (text,))
    name, rest = word[0].upper(), text[word.end() :].strip()
    if name in ("IF", "ELSEIF", "WHILE", "MODULE", "PROC", "LOCAL"):
        return Instruction(line, name, (rest,))
    switches: dict[str, str] = {}
    arguments = []
    for piece in _split(rest):
        head = piece.split("\\", 1)[0].strip()
        if head:
            arguments.append(head)
        for key, value in _SWITCH.findall(piece[len(piece.split("\\", 1)[0]) :]):
            switches[key.lower()] = value.strip()
    return Instruction(line, name, tuple(arguments), switches)


def _split(text: str) -> list[str]:
    """Parts between the commas that stand outside of brackets and strings."""
    parts, depth, inside = [""], 0, False
    for sign in text:
        if sign == '"':
            inside = not inside
        if not inside:
            depth += (sign in "[(") - (sign in "])")
            if sign == "," and depth == 0:
                parts.append("")
                continue
        parts[-1] += sign
    return [part.strip() for part in parts]
