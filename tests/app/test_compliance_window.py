"""A cell that yields as no milling robot does is refused by its worst posture, on either side of the window."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compliance_window import LEAST_M_PER_N, MOST_M_PER_N, require_plausible, softest
from counterflex.core.errors import ModelError
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell, read_cell


@pytest.fixture(scope="module")
def cell(small: Path) -> Cell:
    return read_cell(small)


def yielding(cell: Cell, factor: float) -> Cell:
    return replace(cell, chain=replace(cell.chain, compliance=factor * cell.chain.compliance))


@pytest.mark.parametrize("bound", [LEAST_M_PER_N, MOST_M_PER_N])
def test_one_posture_outside_is_enough(cell: Cell, bound: float) -> None:
    """All compliances scaled so that the window's end lies between two of the three postures, or just beyond all."""
    size = np.sort(softest(cell))
    assert size[0] < 0.999 * size[1] < 0.998 * size[2]
    at = [0.999 * size[0], *np.sqrt(size[1:] * size[:-1]), 1.001 * size[2]]
    for inside_from, reached in enumerate(at):
        changed = yielding(cell, bound / reached)
        count = inside_from if bound == LEAST_M_PER_N else 3 - inside_from  # postures outside
        if count == 0:
            require_plausible(changed)
            continue
        worst = bound / reached * (size[0] if bound == LEAST_M_PER_N else size[2])
        with pytest.raises(ModelError) as told:
            require_plausible(changed)
        assert told.value.value == f"{worst / UM:.3g} um/N"
