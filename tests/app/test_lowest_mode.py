"""The lowest mode of a cell file: measured, computed, or by assumed masses, and its interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.lowest_mode import estimate, lowest_mode
from counterflex.app.unknown_stiffness import corner_of_blank
from counterflex.core.errors import CounterflexError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.elastic_motion import inertia, matrices
from counterflex.plan.modes import lowest_mode as of_matrices
from counterflex.robot.model.description import Servo

ROOT = Path(__file__).resolve().parents[2]
SMALL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"


@pytest.fixture(scope="module")
def with_table(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Cell]:
    def read(lines: str) -> Cell:
        file = tmp_path_factory.mktemp("cell") / "cell.toml"
        file.write_text(SMALL.read_text() + lines)
        return read_cell(file)

    return read


def test_a_shipped_cell_has_the_mode_of_its_masses(with_table: Callable[[str], Cell]) -> None:
    cell = with_table("")
    q = corner_of_blank(cell)
    found = estimate(cell, q)
    M, K = inertia(cell.chain, q[None])[0], matrices(cell.chain, q)[1]
    least = math.sqrt(1.0 / np.linalg.eigvals(M / K[:, None]).real.max())
    assert found.mode.omega_rad_s == pytest.approx(least, rel=1e-6)
    assert lowest_mode(cell) == found.mode
    assert 0.75 * found.mode.hz < found.low_hz < 0.95 * found.mode.hz < 1.05 * found.mode.hz < found.high_hz
    assert "masses and stiffness" in found.text


def test_a_tap_test_is_believed(with_table: Callable[[str], Cell]) -> None:
    cell = with_table("\n[dynamics]\nmode_hz = 12.0\n")
    assert lowest_mode(cell).hz == pytest.approx(12.0)


def test_damping_without_its_mode_is_refused(with_table: Callable[[str], Cell]) -> None:
    with pytest.raises(CounterflexError, match="mode_hz"):
        with_table("\n[dynamics]\ndamping_ratio = 0.05\n")


def test_assumed_masses_say_so_and_are_less_certain() -> None:
    file = ROOT / "examples" / "cells" / "irb6640_d16.toml"
    cell = read_cell(file, assume_class=True)
    q = corner_of_blank(cell)
    found, known = estimate(cell, q), estimate(read_cell(SMALL), corner_of_blank(read_cell(SMALL)))
    assert 4.0 < found.mode.hz < 36.0
    assert found.high_hz / found.low_hz > 1.2 * known.high_hz / known.low_hz
    assert "assumed masses" in found.text


def test_yielding_drives_make_it_slower() -> None:
    """What the interval leaves out is on one side."""
    cell = read_cell(SMALL)
    M, K = matrices(cell.chain, corner_of_blank(cell))[:2]
    rigid = of_matrices(M, K, 1e-3, (None,) * 6)
    assert of_matrices(M, K, 1e-3, (Servo(3e4, 15.0, 0.05),) * 6).omega_rad_s < rigid.omega_rad_s
