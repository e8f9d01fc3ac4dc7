"""Axes of a campaign besides the simulated cells: programs, placements of the part, postures."""

from __future__ import annotations

import csv
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.similar import twice
from counterflex.files.cell.set_up import POSE_KEYS
from counterflex.files.small_table import are_columns
from counterflex.robot.model.opw import BRANCHES

PRESENT: Final = "present"
"""The posture of the cell file."""
CHOSEN: Final = "chosen"
"""The posture that ``plan posture`` chooses, for each program and placement by itself."""
MOST_PLACEMENTS: Final = 100_000
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


@dataclass(frozen=True)
class Placement:
    """Place of the part."""

    name: str = ""  # Of files and rows; empty for the place that the cell file says
    pose: dict[str, float] = field(default_factory=dict)  # Keys of ``[part]`` that differ from the cell file

    @classmethod
    def of(cls, row: Mapping[str, Any], columns: Sequence[str], where: str) -> Placement:
        """Read a placement from a row of its table."""
        if None in row:  # what stands behind the last column
            raise FileFormatError("a row has more cells than the header", where=where, limit=len(columns))
        name = row["name"] or ""
        if not _NAME.fullmatch(name):
            raise FileFormatError("no name for a folder", where=where, value=name, limit="letters, digits, . _ -")
        return cls(name, {key: _number(row[key], where, key) for key in columns if key != "name"})


@dataclass(frozen=True)
class CampaignSetup:
    """One program at one placement in one posture."""

    name: str  # Of its folders; empty where the campaign has only one
    program: str  # Name of the program's file
    placement: Placement  # Where the part stands
    posture: str  # ``present``, ``chosen``, or configuration and rotation: ``front up noflip 180``

    @property
    def moved(self) -> bool:
        """Return whether part or posture are not those of the cell file."""
        return bool(self.placement.pose) or self.posture != PRESENT


@dataclass(frozen=True)
class Grid:
    """Machinings on every simulated cell: each program at each placement in each posture."""

    programs: Sequence[str | Path] = ()
    placements: Sequence[Placement] = ()  # Where the part stands; none is where the cell file says
    postures: Sequence[str] = ()  # As in :class:`CampaignSetup`; none is that of the cell file

    def setups(self) -> tuple[CampaignSetup, ...]:
        """Every program at every placement in every posture; none where there is no program.

        Raises:
            InputError: Placements or postures without a program, two programs have the same name, a posture is none or
                is named twice.
        """
        programs, placements, postures = tuple(map(Path, self.programs)), self.placements, self.postures
        if not programs and (placements or postures):
            raise InputError("placements and postures are those of a program", value="no program", hint="Name one")
        if (stem := twice([program.stem.lower() for program in programs])) is not None:
            raise InputError(
                "two programs have the same name", value=stem, hint="Rename one; results are named after them"
            )
        places, held = tuple(placements) or (Placement(),), tuple(postures) or (PRESENT,)
        for posture in held:
            if posture not in (PRESENT, CHOSEN):
                branch_and_rotation(posture)
        if twice(held) is not None:
            raise InputError("a posture is named twice", value=", ".join(held))
        setups = []
        for program, place, posture in itertools.product(programs, places, held):
            parts = (
                program.stem if len(programs) > 1 else "",
                place.name,
                posture.replace(" ", "-") if len(held) > 1 or posture != PRESENT else "",
            )
            setups.append(CampaignSetup("_".join(filter(None, parts)), program.name, place, posture))
        return tuple(setups)


IDENTIFY_ONLY: Final = Grid()


def read_placements(file: str | Path) -> tuple[Placement, ...]:
    """Placements from a CSV file.

    Its first line names the columns: ``name`` and any of ``x_mm y_mm z_mm a_deg b_deg c_deg``, the keys of ``[part]``
    in the cell file; what has no column stays as it is there. Further columns are an error.

    Raises:
        FileFormatError: The file is not so, a value is no number, or a name is no name or is there twice.
    """
    where = str(file)
    text = file_content.text(file, "Save it as CSV, UTF-8")
    with file_content.readable(file, "CSV", "Save it as CSV, UTF-8"):
        table = csv.DictReader(text.splitlines(), strict=True)
        columns, rows = list(table.fieldnames or ()), list(table)
    if not rows:
        raise FileFormatError("there is no placement in this file", where=where, limit="a header and a row for each")
    known = ("name", *POSE_KEYS)
    if not are_columns(columns, ("name",), known):
        raise FileFormatError("the columns are not those of placements", where=where, value=columns, limit=known)
    if len(rows) > MOST_PLACEMENTS:
        raise FileFormatError("too many placements", where=where, value=len(rows), limit=MOST_PLACEMENTS)
    placements = [Placement.of(row, columns, f"{where}:{number}") for number, row in enumerate(rows, start=2)]
    if (name := twice([place.name.lower() for place in placements])) is not None:
        raise FileFormatError("two placements have the same name", where=where, value=name)
    return tuple(placements)


def branch_and_rotation(text: str) -> tuple[str, float]:
    """Configuration of the arm and rotation about the tool axis in degrees, from ``front up noflip 180``.

    Raises:
        InputError: It is no such text.
    """
    *words, angle = text.split() or [""]
    try:
        rotation_deg = float(angle)
    except ValueError:
        rotation_deg = math.nan
    if " ".join(words) not in BRANCHES or not abs(rotation_deg) <= 360.0:
        raise InputError(
            "that is no posture",
            value=text,
            limit=f'{PRESENT}, {CHOSEN}, or such as "front up noflip 180" (degrees, -360 to 360)',
        )
    return " ".join(words), rotation_deg


def _number(text: str | None, where: str, key: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError(f"{key} is no number", where=where, value=text)
    return value
