"""Targets by name: the literals of a ``.dat`` file, and where each of them stands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.krl.program import Component
from counterflex.programs.krl.read.literals import code_of, components

_HEAD: Final = re.compile(r"\s*DEFDAT\s+\w+(\s+PUBLIC)?\s*", re.IGNORECASE)
_END: Final = re.compile(r"\s*ENDDAT\s*", re.IGNORECASE)
_VALUE: Final = re.compile(
    r"\s*(?:DECL\s+)?(?:GLOBAL\s+)?(?:CONST\s+)?(?:[A-Za-z]\w*\s+)?(?P<name>[A-Za-z$]\w*(?:\s*\[\s*\d+\s*\])?)\s*=\s*\{",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Named:
    """A literal of a data list.

    Attributes:
        line: 1-based.
        text: The line.
        start: Index of the opening brace.
    """

    line: int
    text: str
    start: int

    def components(self, file: str, *, mixed: bool = False) -> tuple[dict[str, Component], int]:
        """Its components and the index of its closing brace. As :func:`~.literals.components`."""
        return components(self.text, self.start, f"{file}:{self.line}", mixed=mixed)


def key_of(name: str) -> str:
    """A name as KRL compares it: capitals, no blanks."""
    return "".join(name.split()).upper()


def data_list(lines: Sequence[str], name: str) -> dict[str, Named]:
    """Literals of a data list by name.

    Args:
        lines: Of the file.
        name: Of the file, for errors.

    Returns:
        Every variable that is given as a literal in braces; whether it is a position shows where it is used.

    Raises:
        ProgramError: The file has no DEFDAT or ENDDAT, or gives a name twice.
    """
    out: dict[str, Named] = {}
    begun = ended = False
    for number, line in enumerate(lines, start=1):
        code = code_of(line)
        if _HEAD.fullmatch(code):
            begun = True
        elif _END.fullmatch(code):
            ended = True
            break
        elif (match := _VALUE.match(code)) is not None:
            key = key_of(match["name"])
            if key in out:
                raise ProgramError(
                    f"{match['name']} is given twice", where=f"{name}:{number}:{match.start('name') + 1}",
                    value=line.strip()[:60], limit=f"once; first in line {out[key].line}",
                )  # fmt: skip
            out[key] = Named(number, line, match.end() - 1)
    if not begun or not ended:
        raise ProgramError(
            f"the data list has no {'DEFDAT' if not begun else 'ENDDAT'}: it may be cut off",
            where=f"{name}:{1 if not begun else max(1, len(lines))}",
            hint="Post the program again, .src and .dat together",
        )
    return out


def data_file_of(source: Path) -> Path | None:
    """The ``.dat`` file beside a ``.src`` file, in any case of the letters; None where there is none."""
    candidates = [source.with_suffix(suffix) for suffix in (".dat", ".DAT", ".Dat")]
    return next((file for file in candidates if file.is_file()), None)
