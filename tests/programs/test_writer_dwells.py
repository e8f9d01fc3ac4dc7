"""Dwells: nothing sideways before them, and along the tool axis what the force needed is taken back."""

from __future__ import annotations

import re

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.machine_in_place import GcodeText
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

SETTINGS = KrlSettings(name="hole", start_axes_rad=(0.0,) * 6)
SPINDLE = MachineFunctions("krl", {3: (), 5: ()}).lines
DOWN = np.diag([1.0, -1.0, -1.0])
HEAD = "G21 G17 G90 G94\nM3 S6000\nG0 X20 Y20 Z60\nG0 Z42\n"
BY_HAND = HEAD + "G1 Z30 F300\nG4 P0.5\nG0 Z60\nM2\n"
CYCLE = HEAD + "G82 Z30 R42 P0.5 F300\nG80\nG0 Z60\nM2\n"
SIDE, UP = [0.2 * MM, -0.1 * MM, -0.6 * MM], [0.2 * MM, -0.1 * MM, 0.0]


def job(text: str, at_the_dwell: list[float]) -> tuple[Program, ToolPath, Float]:
    """A plunge with a correction, and the one that is planned at the dwell below it and on the way out."""
    program = read_gcode(text, name="hole.ngc")
    path = tool_path(program, step_m=1e-3)
    shift = np.zeros((len(path), 3))
    dwell = np.array([motion.kind == "dwell" for motion in program.motions])[path.motion]
    shift[(path.kind == FEED) & ~dwell] = SIDE
    shift[dwell] = at_the_dwell
    return program, path, shift


def written(text: str, at_the_dwell: list[float]) -> GcodeText:
    program, path, shift = job(text, at_the_dwell)
    return write_gcode(program, CompensatedPath.from_correction(path, shift), header=False)


@pytest.mark.parametrize("text", [BY_HAND, CYCLE], ids=["by hand", "cycle"])
def test_the_depth_is_taken_back_before_the_dwell(text: str) -> None:
    result = written(text, UP)
    lines = result.text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("G4"))
    assert lines[at - 1] == "G1 Z30.0000"
    assert result.largest_dwell_error_m < 1e-9
    back = read_gcode(result.text, name="back.ngc")
    dwell = next(motion for motion in back.motions if motion.kind == "dwell")
    assert dwell.p_start == pytest.approx([0.0202, 0.0199, 0.030], abs=1e-9)
    deepest = min(float(motion.p_end[2]) for motion in back.motions)
    assert deepest == pytest.approx(0.0294, abs=1e-9)


def test_a_dwell_without_a_change_is_as_it_was() -> None:
    lines = written(BY_HAND, SIDE).text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("G4"))
    assert lines[at - 1].startswith("G1 Z29.4000")
    assert sum(line.startswith("G1") for line in lines) == 2  # to the side above the part, and down


def test_a_dwell_never_begins_with_a_sideways_move() -> None:
    """What is planned at the dwell lies beside: the position of the motion before is kept, and its error said."""
    result = written(BY_HAND, [0.0, 0.0, 0.0])
    lines = result.text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("G4"))
    assert "Z29.4" in lines[at - 1]
    assert result.largest_dwell_error_m == pytest.approx(np.linalg.norm(SIDE), rel=1e-6)


def test_in_inverse_time_the_depth_is_taken_back_at_the_feed_before() -> None:
    """Under G93 every block that feeds needs a time of its own: 12 mm at F25 are 300 mm/min, so 0.6 mm need F500."""
    text = BY_HAND.replace("G94", "G93").replace("F300", "F25")
    result = written(text, UP)
    lines = result.text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("G4"))
    assert lines[at - 1] == "G1 Z30.0000 F500.0000"
    assert result.largest_dwell_error_m < 1e-9
    back = read_gcode(result.text, name="back.ngc")
    dwell = next(i for i, motion in enumerate(back.motions) if motion.kind == "dwell")
    assert back.motions[dwell - 1].feed_m_s == pytest.approx(300.0 * MM / 60.0, rel=1e-6)


@pytest.mark.parametrize("text", [BY_HAND, CYCLE], ids=["by hand", "cycle"])
def test_the_robot_goes_straight_up_before_it_waits(text: str) -> None:
    program, path, shift = job(text, UP)
    poses = CompensatedPath.from_correction(path, shift).poses(np.broadcast_to(DOWN, (len(path), 3, 3)))
    lines = KrlWriter(program, path, poses, SETTINGS, block_lines=SPINDLE).text().files["hole.src"]
    listed = lines.splitlines()
    at = next(i for i, line in enumerate(listed) if line == "WAIT SEC 0.500")
    points = [re.match(r"LIN \{X (\S+),Y (\S+),Z (\S+),A", line) for line in listed[at - 2 : at]]
    found = [tuple(map(float, point.groups())) for point in points if point is not None]
    assert found == [(20.2, 19.9, 29.4), (20.2, 19.9, 30.0)]
    assert not listed[at - 1].endswith("C_DIS")
