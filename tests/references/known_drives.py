"""Cells of tests whose planner knows play, friction and loop gains of the axes: test data, no robot's.

Cell files that are handed out have no such tables, see tests/twin/test_private_constants.py.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse

_PLAY = {axis: (20, [75, 105, 120]) if axis <= 3 else (50, [12.5, 17.5, 20]) for axis in range(1, 7)}
_SPEED_GAIN = {1: 155550, 2: 186000, 3: 103350, 4: 10050, 5: 10950, 6: 4800}


def with_drives(text: str) -> str:
    """The text of a cell file with tables ``[[robot.play]]`` and ``[[robot.servo]]`` for all six axes at its end."""
    play = (
        f"[[robot.play]]\naxis = {axis}\ndead_band_half_urad = {half}\nfriction_nm = {dry}\nslip_urad = [10, 25, 60]\n"
        for axis, (half, dry) in _PLAY.items()
    )
    servo = (
        f"[[robot.servo]]\naxis = {axis}\nspeed_gain_nm_s = {gain}\nposition_gain_per_s = 20\nintegral_time_ms = 60\n"
        f"friction_nm = {60 if axis <= 3 else 12}\nslip_urad = 25\n"
        for axis, gain in _SPEED_GAIN.items()
    )
    return "\n".join((text, *play, *servo))


def cell_with_drives(file: str | Path) -> Cell:
    """The cell of a file, its planner told these drives."""
    text = with_drives(Path(file).read_text(encoding="utf-8"))
    return resolve(parse(CellTables, tomllib.loads(text), where=str(file)), Path(file))
