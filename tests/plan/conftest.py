"""What the tests of this room share: a cutter, a law, paths from short programs, a small cell."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell import KIND, VERSION, Cell, resolve
from counterflex.files.cell_schema import CellTables
from counterflex.files.schema import parse
from counterflex.path.toolpath import ToolPath
from counterflex.programs.gcode_reader import read_gcode
from counterflex.programs.to_path import tool_path

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


CELL: dict[str, Any] = {
    "format": KIND,
    "version": VERSION,
    "name": "test cell",
    "robot": {"catalog": "kuka_kr300_r2500_ultra"},
    "end_effector": [
        {
            "name": "spindle",
            "z_mm": 80.0,
            "mass_kg": 75.0,
            "com_x_mm": 120.0,
            "com_z_mm": 70.0,
            "rx_urad_per_knm": 5263.0,
            "ry_urad_per_knm": 14925.0,
            "rz_urad_per_knm": 10989.0,
        }
    ],
    "tcp": {"x_mm": 240.0, "z_mm": 70.0, "b_deg": 90.0},
    "part": {
        "x_mm": 1350.0,
        "y_mm": -30.0,
        "z_mm": 1000.0,
        "measured_with": "robot",
        "datum_points_mm": [[0, 0, 40], [40, 0, 40], [40, 30, 40], [0, 30, 40]],
        "stock": {"box_min_mm": [0, 0, 0], "box_max_mm": [40, 30, 40], "cell_mm": 0.25},
    },
    "tools": [{"number": 1, "diameter_mm": 16.0, "flutes": 3, "flute_length_mm": 35.0}],
    "material": {
        "kc11_n_mm2": 780.0,
        "mc": 0.25,
        "kr_over_kc": 0.35,
        "ka_over_kc": 0.15,
    },
    "posture": {"rotation_about_tool_deg": 180.0},
}


@pytest.fixture(scope="session")
def cell_of() -> CellOf:
    def make(**changes: dict[str, Any]) -> Cell:
        """The test cell, with keys of its tables replaced."""
        data = copy.deepcopy(CELL)
        for key, values in changes.items():
            data.setdefault(key, {}).update(values)
        return resolve(parse(CellTables, data, where="test"), Path("cell.toml"))

    return make


@pytest.fixture(scope="session")
def stiffness() -> Any:
    """Compliance of a milling robot at the tool, as 390, 390 and 800 N/mm (Haehn2020: 546 N bend it 1.4 mm)."""

    def make(n: int) -> Any:
        return np.tile(np.diag([1 / 390e3, 1 / 390e3, 1 / 800e3, 0.0, 0.0, 0.0]), (n, 1, 1))

    return make
