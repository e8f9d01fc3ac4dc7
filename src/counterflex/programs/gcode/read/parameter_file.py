"""LinuxCNC's parameter file: stored positions and work offsets of a machine, as numbers and values in lines."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import content
from counterflex.core.units import MM
from counterflex.programs.gcode.read.parameters import HOME_POSITION, LAST
from counterflex.programs.gcode.read.work_offsets import LINUXCNC_OFFSETS

_OFFSETS: Final = {name: 5221 + 20 * i for i, name in enumerate(LINUXCNC_OFFSETS)}
_STORED: Final = frozenset(start + axis for start in HOME_POSITION.values() for axis in range(6))
_LAST_FREE: Final = 5060  # Last parameter that programs may write
_G92_IN_FORCE, _ACTIVE = 5210, 5220
_ROTATION: Final = 9  # Behind the first number of a work offset: its rotation about z, deg


@dataclass(frozen=True)
class MillingMachine:
    """Facts of the machine that a program of G-code was written for."""

    # Known beforehand, by number or by global name, in program units; the positions stored for G28 (5161 to 5166) and
    # G30 (5181 to 5186) in mm and degrees of the machine
    parameters: Mapping[str | int, float] = field(default_factory=dict)
    # Offsets by name ``G54`` ... ``G59.3``: x, y, z in m and, optionally, a, b, c in degrees.
    work_offsets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    # Length by tool number for G43, m, positive away from the spindle. None: lengths are compensated by the machine and
    # G43 changes nothing here.
    tool_lengths: Mapping[int, float] | None = None
    # G53 leads to machine coordinates, which are those of the part where no work offset is given. False: where the part
    # lies in the machine is not known, G53 leads nowhere that anything may follow.
    known: bool = True
    # The zero of the part is that of G54 as ``work_offsets`` has it, and not that of the machine
    part_at_g54: bool = False
    # Number of a tool by its name in capitals, for controls that call tools by name
    tool_names: Mapping[str, int] = field(default_factory=dict)
    # Zeros of work offsets in the part frame, as ``work_offsets``. No other offset is known then.
    part_offsets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    # The program is read to be listed: motions to and from places that are not known are kept and marked
    listed: bool = False

    @property
    def names_open(self) -> bool:
        """The program is listed and no tool has a name to compare with: the number of a tool called by name is 0."""
        return self.listed and not self.tool_names


def read_parameter_file(path: str | os.PathLike[str]) -> MillingMachine:
    """Read a parameter file of LinuxCNC (``.var``).

    Each line holds a number and a value; lengths are in mm, because the file does not say its unit.

    Returns:
        What it holds, in coordinates of the machine, with the zero of the part at G54.

    Raises:
        FileFormatError: It cannot be read, a line is no number and value, a number comes twice, or it holds what is not
            understood: a rotated offset, or G92 in force.

    Source: LinuxCNC, "Parameters" and "RS274NGC_PARAMETER_FILE".
    """
    file = Path(path)
    results: dict[int, float] = {}
    for number, text in enumerate(_text(file).splitlines(), start=1):
        words = text.split()
        if not words:
            continue
        where = f"{file}:{number}"
        try:
            index, value = (int(words[0]), float(words[1])) if len(words) == 2 else (0, math.nan)
        except ValueError:
            index, value = 0, math.nan
        if not 1 <= index <= LAST or not math.isfinite(value):
            raise FileFormatError(
                "no line of a parameter file", where=where, value=repr(text.strip()[:40]),
                limit=f"a number from 1 to {LAST} and a value", hint="LinuxCNC keeps it beside its INI file, as .var",
            )  # fmt: skip
        if index in results:
            raise FileFormatError("a parameter comes twice", where=where, value=f"#{index}")
        results[index] = value
    _understood(results, file)
    parameters: dict[str | int, float] = {
        index: value for index, value in results.items() if index <= _LAST_FREE or index in _STORED
    }
    offsets = {
        name: tuple(results.get(start + axis, 0.0) * (MM if axis < 3 else 1.0) for axis in range(6))
        for name, start in _OFFSETS.items()
    }
    return MillingMachine(parameters, offsets, part_at_g54=True)


def _understood(parameters: dict[int, float], file: Path) -> None:
    turn = "Turn the part frame of the cell file instead"
    rows = [
        (start + _ROTATION, 0.0, f"the work offset {name} is rotated", "0 deg", turn)
        for name, start in _OFFSETS.items()
    ]
    g54 = "Select G54 on the machine, or set it in the file"
    rows += [
        (_G92_IN_FORCE, 0.0, "an offset by G92 is in force", "0", "Clear it on the machine with G92.1"),
        (_ACTIVE, 1.0, "the machine stands in another work offset than G54", "1 (G54)", g54),
    ]
    for index, needed, what, limit, hint in rows:
        if (value := parameters.get(index, needed)) != needed:
            raise FileFormatError(what, where=f"{file}: #{index}", value=f"{value:g}", limit=limit, hint=hint)


def _text(file: Path) -> str:
    data = content(file)
    try:
        return data.decode("ascii")
    except UnicodeDecodeError as fault:
        raise FileFormatError("not a parameter file: it is not plain text", where=str(file)) from fault
