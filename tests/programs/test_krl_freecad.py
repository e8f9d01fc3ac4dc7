"""What FreeCAD's Robot workbench exports as KRL: read, edited in place, and what its program leaves open.

The fixture is its own output, see examples/freecad/README.md.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, RPM
from counterflex.integrations.kuka.language.in_place import write_krl_in_place
from counterflex.integrations.kuka.language.program import KrlProgram
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

FILE = Path(__file__).parents[2] / "examples" / "freecad" / "groove.src"
SOURCE = FILE.read_bytes().decode()
TARGETS_MM = [[-12, 15, 60], [-12, 15, 42], [-12, 15, 34], [72, 15, 34], [72, 15, 60]]
ADDED = (
    "HALT ; change to tool T1, then press start\nBAS(#TOOL,1)\nBAS(#BASE,1)\n"
    "HALT ; start the spindle, 13000 rpm, then press start\n"
)
CELL = KrlCell(
    where="cell.toml", tool_number=1, base_number=1, tools=[1], tool_of_data={}, T_flange_tcp=np.eye(4),
    T_base_part=np.eye(4), functions=MachineFunctions("krl", {3: [], 5: [], 6: []}),
)  # fmt: skip


def prepared() -> str:
    """The export with the four lines that docs/krl.md asks for."""
    place = SOURCE.index("$VEL.CP")
    return SOURCE[:place] + ADDED + SOURCE[place:]


def test_targets_and_feeds_are_those_of_the_waypoints() -> None:
    made = read_krl(SOURCE, name="groove.src")
    np.testing.assert_allclose([m.p_end / MM for m in made.motions], TARGETS_MM, atol=1e-9)
    assert made.motions[0].kind == "rapid"  # from a place that is not known
    assert [m.feed_m_s for m in made.motions[1:]] == pytest.approx([0.25, 0.05, 0.025, 0.25])
    assert made.Rs_part_tcp is not None
    np.testing.assert_allclose(made.Rs_part_tcp[0], np.diag([1.0, -1.0, -1.0]) @ np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


def test_frames_and_spindle_are_left_open_and_asked_for() -> None:
    """The exporter knows neither: the reader says which line is missing, and with it the program is whole."""
    with pytest.raises(ProgramError, match=r"which \$TOOL .* expected \$TOOL=TOOL_DATA\[1\]"):
        read_krl(SOURCE, name="groove.src", cell=CELL)
    made = read_krl(prepared(), name="groove.src", cell=CELL)
    assert [round(m.spindle_rad_s / RPM) for m in made.motions] == [13000] * 5
    assert [m.tool for m in made.motions] == [1] * 5


def corrected(program: KrlProgram, size_m: float) -> CompensatedPath:
    """Everything behind the first motion moved across the groove."""
    path = tool_path(program, step_m=0.5 * MM)
    shift = np.where(path.motion[:, None] > 0, np.array([0.0, size_m, 0.0]), 0.0)
    return CompensatedPath.from_correction(path, shift)


def test_nothing_but_targets_is_touched() -> None:
    made = read_krl(prepared(), name="groove.src", cell=CELL)
    assert write_krl_in_place(made, corrected(made, 0.0)).files == {"groove.src": prepared()}
    text = write_krl_in_place(made, corrected(made, 3e-4), cycle_s=1e-4).files["groove.src"]
    number = re.compile(r"-?\d+\.?\d*")
    lines = iter(number.sub("#", line) for line in text.split("\n"))
    assert all(any(number.sub("#", line) == other for other in lines) for line in prepared().split("\n"))
    back = read_krl(text, name="groove.src", cell=CELL)
    np.testing.assert_allclose(back.motions[-1].p_end / MM, [72.0, 15.3, 60.0], atol=1e-4)
