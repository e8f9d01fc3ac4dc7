"""Measured or stated dynamics of the tool tip: a frequency response, or modal parameters, as CSV.

A response has the columns ``direction, frequency_hz, real_um_per_n, imaginary_um_per_n``, modal parameters
``direction, frequency_hz, damping_ratio, stiffness_n_per_um``. Directions are x, y and z of the TCP frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Complex, Float, Int
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.units import UM
from counterflex.cutting.stability.modes import DIMENSIONS, TipModes, modes_along
from counterflex.cutting.stability.response import Response
from counterflex.files.dataset.manifest import FileTable
from counterflex.files.dataset.table import TextTable, read_table

AXES: Final = "xyz"
RESPONSE: Final = ("frequency_hz", "real_um_per_n", "imaginary_um_per_n")
MODAL: Final = ("frequency_hz", "damping_ratio", "stiffness_n_per_um")
FREQUENCY_HZ: Final = (0.1, 1e5)
LEAST_POINTS: Final = 8
SOFTEST_UM_PER_N: Final = 1e3
"""Receptance above which the unit is doubted: 1 mm per N."""


def read_response(path: str | Path) -> Response:
    """Read a measured frequency response of the tool tip.

    Returns:
        The response in the TCP frame; directions without rows are rigid.

    Raises:
        FileFormatError: Missing file or column, a cell that is no number, an unknown direction, frequencies that do
            not rise or differ between the directions, a receptance out of range, or one of another sign convention.
    """
    table, axis, (frequency, real, imaginary) = _columns(Path(path), RESPONSE)
    grid: Float | None = None
    receptance: Complex = np.zeros((0, DIMENSIONS, DIMENSIONS), dtype=np.complex128)
    for k in np.unique(axis):
        rows = np.flatnonzero(axis == k)
        f, g = frequency[rows], real[rows] + 1j * imaginary[rows]
        _check_frequencies(table, rows, f)
        if grid is None:
            grid, receptance = f, np.zeros((len(f), DIMENSIONS, DIMENSIONS), dtype=np.complex128)
        if len(f) != len(grid) or np.any(np.abs(f - grid) > 1e-6 * grid):
            raise FileFormatError(
                f"direction {AXES[k]} has other frequencies than the one before",
                where=str(path),
                hint="Measure or resample all directions at the same frequencies",
            )
        _check_receptance(table, rows, g)
        receptance[:, k, k] = g * UM
    assert grid is not None
    return Response(2.0 * np.pi * grid, receptance)


def read_modal(path: str | Path) -> TipModes:
    """Read modal parameters of the tool tip.

    Args:
        path: CSV, one row for each mode.

    Returns:
        The modes in the TCP frame.

    Raises:
        FileFormatError: Missing file or column, a cell that is no number, an unknown direction, or a number out of
            range.
    """
    table, axis, (frequency, damping, stiffness) = _columns(Path(path), MODAL)
    for name, values, low, high in (
        ("frequency_hz", frequency, *FREQUENCY_HZ),
        ("damping_ratio", damping, 1e-4, 0.7),
        ("stiffness_n_per_um", stiffness, 1e-2, 1e5),
    ):
        outside = np.flatnonzero((values < low) | (values > high))
        if len(outside):
            row = int(outside[0])
            raise FileFormatError(
                f"{name} is out of range",
                where=_place(table, row),
                value=f"{values[row]:g}",
                limit=f"{low:g} to {high:g}",
            )
    try:
        return modes_along(frequency, damping, stiffness / UM, np.eye(DIMENSIONS)[axis])
    except CounterflexError as fault:
        raise FileFormatError(fault.what, where=str(path), value=fault.value, limit=fault.limit) from fault


def _columns(path: Path, names: tuple[str, ...]) -> tuple[TextTable, Int, list[Float]]:
    """The table, the axis 0..2 of each row, and the columns."""
    table = read_table(path, FileTable(path=str(path)))
    folded = [name.strip().lower() for name in table.header]
    lacking = [name for name in ("direction", *names) if name not in folded]
    if lacking:
        raise FileFormatError(
            f"the table has no column {lacking[0]}",
            where=f"{path}:1",
            value=", ".join(table.header)[:120],
            limit=", ".join(("direction", *names)),
        )
    words = [word.strip().lower() for word in table.words(folded.index("direction"))]
    for row, word in enumerate(words):
        if word not in tuple(AXES):
            raise FileFormatError(
                "unknown direction", where=_place(table, row), value=repr(word[:20]), limit="x, y or z of the TCP frame"
            )
    columns = []
    for name in names:
        values, missing = table.numbers(folded.index(name))
        if np.any(missing):
            raise FileFormatError(f"{name} has no value", where=_place(table, int(np.argmax(missing))))
        columns.append(values)
    return table, np.array([AXES.index(word) for word in words], dtype=np.int64), columns


def _place(table: TextTable, row: int) -> str:
    return f"{table.path}:{int(table.lines[row])}"


def _check_frequencies(table: TextTable, rows: Int, f: Float) -> None:
    low, high = FREQUENCY_HZ
    outside = np.flatnonzero((f < low) | (f > high))
    if len(outside):
        row = int(outside[0])
        raise FileFormatError(
            "frequency_hz is out of range",
            where=_place(table, int(rows[row])),
            value=f"{f[row]:g}",
            limit=f"{low:g} to {high:g}",
        )
    back = np.flatnonzero(np.diff(f) <= 0.0)
    if len(back):
        row = int(rows[back[0] + 1])
        raise FileFormatError("frequencies of a direction do not rise", where=_place(table, row))
    if len(f) < LEAST_POINTS:
        raise FileFormatError(
            "a response has too few points",
            where=_place(table, int(rows[0])),
            value=len(f),
            limit=f"at least {LEAST_POINTS}",
        )


def _check_receptance(table: TextTable, rows: Int, g: Complex) -> None:
    worst = int(np.argmax(np.abs(g)))
    if not 0.0 < np.abs(g[worst]) <= SOFTEST_UM_PER_N:
        raise FileFormatError(
            "the receptance is out of range",
            where=_place(table, int(rows[worst])),
            value=f"{np.abs(g[worst]):g} um/N",
            limit=f"above 0, at most {SOFTEST_UM_PER_N:g} um/N",
            hint="Displacement over force, in um/N",
        )
    at = int(np.argmax(np.abs(g.imag)))
    if g.imag[at] > 0.0:
        raise FileFormatError(
            "the imaginary part is positive at the resonance",
            where=_place(table, int(rows[at])),
            value=f"{g.imag[at]:g} um/N",
            limit="negative: displacement over force with exp(+i w t)",
            hint="Change the sign of the imaginary column; accelerance must be divided by -w^2 first",
        )
