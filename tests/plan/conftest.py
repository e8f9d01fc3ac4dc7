"""What the tests of this room share: a cutter, a law, paths from short programs, a small cell."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.path.toolpath import ToolPath
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.reader import read_gcode

CELL = Path(__file__).resolve().parents[1] / "data" / "cells" / "small.toml"
HEAD = "G21 G17 G90 G94\nT1 M6\nM3 S13000\n"

PathOf = Callable[..., ToolPath]
CellOf = Callable[..., Cell]


@pytest.fixture(scope="session")
def law() -> KienzleLaw:
    return KienzleLaw.from_k11(
        780e6,
        0.25,
        kr11_pa=273e6,
        mr=0.3,
        ka11_pa=117e6,
        ma=0.2,
        h_min_m=1e-6,
        h_max_m=1e-3,
        source="test",
        status="test",
    )


@pytest.fixture(scope="session")
def cutter() -> Cutter:
    return Cutter(diameter_m=0.016, flutes=3, helix_rad=0.5, flute_length_m=0.035)


@pytest.fixture(scope="session")
def block() -> Callable[..., HeightMap]:
    def make(low: tuple[float, float], high: tuple[float, float], cell_mm: float = 0.2) -> HeightMap:
        """A block from z = -20 mm to 0; corners in mm."""
        return HeightMap.from_box((low[0] * MM, low[1] * MM, -20 * MM), (high[0] * MM, high[1] * MM, 0.0), cell_mm * MM)

    return make


@pytest.fixture(scope="session")
def path_of() -> PathOf:
    def make(body: str, *, head: str = HEAD, step_mm: float = 0.5) -> ToolPath:
        """A program's path; it begins at its own first point, not at zero."""
        program = read_gcode(head + body + "\nM2\n", name="test.ngc")
        path = tool_path(program, step_m=step_mm * MM, rapid_speed_m_s=0.25)
        path.p_part_tcp[0] = path.p_part_tcp[1]
        return path

    return make


@pytest.fixture(scope="session")
def cell_of() -> CellOf:
    def make(**changes: dict[str, Any]) -> Cell:
        """The test cell, with keys of its tables replaced; of the material all where it is of another law."""
        data = tomllib.loads(CELL.read_text(encoding="utf-8"))
        for key, values in changes.items():
            data[key] = values if "law" in values else data.get(key, {}) | values
        return resolve(parse(CellTables, data, where="test"), CELL)

    return make


@pytest.fixture(scope="session")
def stiffness() -> Any:
    """Compliance of a milling robot at the tool, as 390, 390 and 800 N/mm (Haehn2020: 546 N bend it 1.4 mm)."""

    def make(n: int) -> Any:
        return np.tile(np.diag([1 / 390e3, 1 / 390e3, 1 / 800e3, 0.0, 0.0, 0.0]), (n, 1, 1))

    return make
