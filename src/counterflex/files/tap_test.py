"""A tap test as text: one row per frequency and pair of directions, at the tip of the tool.

Columns ``frequency_hz,force,motion`` and either ``real_um_n,imag_um_n`` (receptance, motion per force) or
``real_m_s2_n,imag_m_s2_n`` (accelerance, what an accelerometer gives: receptance is ``-a / omega^2``), in any order.
``force`` and ``motion`` are directions of the base: ``x``, ``-x``, ``y``, ``-y``, ``z``, ``-z``. Lines that begin with
``#`` are comments.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import UM
from counterflex.files.small_table import number, read_rows
from counterflex.plan.tap_fit import Tap

_WHERE: Final = ("frequency_hz", "force", "motion")
RECEPTANCE: Final = (*_WHERE, "real_um_n", "imag_um_n")
ACCELERANCE: Final = (*_WHERE, "real_m_s2_n", "imag_m_s2_n")
_DIRECTIONS: Final = {
    sign + name: (-1.0 if sign else 1.0) * axis
    for sign in ("", "-")
    for name, axis in zip("xyz", np.eye(3), strict=True)
}


def read_tap_test(path: str | Path) -> Tap:
    """Read a tap test.

    Raises:
        FileFormatError: Missing, not text, other columns, not a number, a frequency not above 0, an unknown direction.
    """
    file = Path(path)
    table = read_rows(file)
    if len(table) < 2:
        raise FileFormatError("the file has no rows", where=str(file))
    names = [name.strip() for name in table[0][1]]
    columns = next((known for known in (RECEPTANCE, ACCELERANCE) if sorted(names) == sorted(known)), None)
    if columns is None:
        raise FileFormatError(
            "other columns than those of a tap test",
            where=f"{file}:{table[0][0]}",
            value=",".join(names),
            limit=f"{','.join(RECEPTANCE)} or {','.join(ACCELERANCE)}",
        )
    order = [names.index(name) for name in columns]
    hz, forces, motions, response = [], [], [], []
    for line, row in table[1:]:
        place = f"{file}:{line}"
        if len(row) != len(columns):
            raise FileFormatError("values in a line", where=place, value=len(row), limit=len(columns))
        cells = [row[k].strip() for k in order]
        hz.append(number(cells[0], place))
        if hz[-1] <= 0.0:
            raise FileFormatError("a frequency must be above 0", where=place, value=hz[-1], limit="> 0 Hz")
        forces.append(_direction(cells[1], place))
        motions.append(_direction(cells[2], place))
        response.append(complex(number(cells[3], place), number(cells[4], place)))
    omega, values = 2.0 * math.pi * np.array(hz), np.array(response, dtype=np.complex128)
    receptance = values * UM if columns is RECEPTANCE else -values / omega**2
    return Tap(omega, np.array(forces), np.array(motions), receptance.astype(np.complex128))


def _direction(text: str, place: str) -> Float:
    if text.removeprefix("+") not in _DIRECTIONS:
        raise FileFormatError("unknown direction", where=place, value=repr(text), limit=", ".join(_DIRECTIONS))
    return _DIRECTIONS[text.removeprefix("+")]
