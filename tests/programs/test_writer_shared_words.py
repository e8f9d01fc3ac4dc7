"""Blocks that do two things, and cycles written out: what was written does what the source did."""

from __future__ import annotations

import re

import numpy as np
import pytest

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.program import Program

STORED = MillingMachine(parameters={5161: 5.0, 5162: 6.0, 5163: 90.0})


def read(*lines: str) -> Program:
    text = "\n".join(["G21 G90 G17 F600", "M3 S1000", "G0 X0 Y0 Z20", *lines, "M2", ""])
    return read_gcode(text, name="part.ngc", machine=STORED)


def written(program: Program) -> list[str]:
    """Lines of the program with 0.1 mm along y, and a little more along z, added to every feed."""
    path = tool_path(program)
    shift = np.zeros((len(path), 3))
    shift[path.kind == FEED] = (0.0, 1e-4, 2e-4)
    return write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text.split("\n")


def acts(program: Program) -> list[tuple[str, float]]:
    """What a program does but for moving, and the length of the moves between, rounded to half a millimetre."""
    out: list[tuple[str, float]] = []
    for block in program.blocks:
        out += [(f"M{word.value:g}", 0.0) for word in block.words if word.letter == "M"]
        out += [("P", word.value) for word in block.words if word.letter == "P" and _output(block.text)]
        for motion in program.motions[block.first_motion : block.first_motion + block.motion_count]:
            if motion.kind == "dwell":
                out += [("dwell", motion.duration_s)] * (motion.duration_s > 0.0)
    return out


def _output(text: str) -> bool:
    return re.search(r"M6[2-5]", text) is not None


@pytest.mark.parametrize(
    "block",
    [
        "G4 P0.5 G1 Z-2",
        "M62 P1 G1 Z-2",
        "M62 P1 G81 X5 Y5 Z-5 R2",
        "M63 P3 G85 X5 Y5 Z-5 R2 L2",
        "M67 E1 Q0.5 G81 X5 Y5 Z-5 R2",
        "G64 P0.05 G81 X5 Y5 Z-5 R2",
        "G4 P0.5 G81 X5 Y5 Z-5 R2",
    ],
)
def test_words_of_other_codes_stay_in_a_block_that_is_written_anew(block: str) -> None:
    program = read("G1 X1", block, "G80", "G1 X0")
    back = read_gcode("\n".join(written(program)))
    assert acts(back) == acts(program)
    for motion in program.motions:
        if motion.kind == "feed":
            nearest = min(float(np.linalg.norm(other.p_end - motion.p_end)) for other in back.motions)
            assert nearest < 3e-4
    if "G64" in block:
        assert any(line.startswith("G64 P0.05") for line in written(program))


@pytest.mark.parametrize("modal", ["G81 X5 Y5 Z-5 R2", "G3 X10 Y0 R40", "G1 X3"])
@pytest.mark.parametrize("home", ["G28", "G28 Z30"])
def test_a_way_home_gets_no_motion_code_of_the_cycle_before_it(modal: str, home: str) -> None:
    program = read("G1 X1", modal, "G80 G1 X2", modal, home, "G0 X1")
    back = read_gcode("\n".join(written(program)), machine=STORED)
    assert back.motions[-1].p_start == pytest.approx(program.motions[-1].p_start, abs=3e-4)
    assert back.motions[-1].p_end == pytest.approx(program.motions[-1].p_end, abs=1e-9)


@pytest.mark.parametrize("control", ["G64", "G64 P0.1", "(nothing said)"])
def test_a_cycle_that_is_written_out_stops_at_its_corners(control: str) -> None:
    """LinuxCNC runs cycles in exact path mode; single moves would be blended, the hole not as deep, left sideways."""
    program = read(control, "G81 X5 Y5 Z-5 R2", "X10", "G80")
    back = read_gcode("\n".join(written(program)))
    ways = [m for m in program.motions if program.blocks[m.block].cycle]
    stops = [m.p_start for m in back.motions if m.kind == "dwell"]
    assert len(stops) == len(ways) == 7
    for way, stop in zip(ways, stops, strict=True):
        assert stop == pytest.approx(way.p_end, abs=3e-4)


@pytest.mark.parametrize("control", ["G61", "G61.1"])
def test_no_stops_where_the_program_stops_anyway(control: str) -> None:
    assert "G4 P0" not in written(read(control, "G81 X5 Y5 Z-5 R2", "X10", "G80"))


@pytest.mark.parametrize("block", ["M62 P1 G82 X1 Z-1 R1", "M62 P2 G2 X5 Y0 R5", "G4 P1 G3 I3", "G64 P1 G2 I3"])
def test_a_word_that_two_codes_take_is_refused(block: str) -> None:
    """LinuxCNC gives it to both: the number of the output becomes the dwell of the hole, or the turns of the arc."""
    with pytest.raises(ProgramError, match="both take the word P"):
        read(block)


@pytest.mark.parametrize("change", ["G18", "G92 Z3", "G20", "G52 Z1"])
def test_a_series_of_cycles_ends_where_its_height_means_another_place(change: str) -> None:
    with pytest.raises(ProgramError, match="series of cycles"):
        read("G98 G81 X1 Y1 Z-5 R2", change, "G98 G81 X1 Y2 Z-5 R2")
    read("G98 G81 X1 Y1 Z-5 R2", "G55", "G98 X2")


@pytest.mark.parametrize("way", [["G81 X5 Y5 Z-5 R2"], ["G83 X5 Y5 Z-5 R2 Q3"], ["G0 X5 Y5 Z2", "G1 Z-5", "G0 Z20"]])
def test_a_robot_reaches_the_bottom_of_a_hole_before_it_turns_back(way: list[str]) -> None:
    """A blended corner (C_DIS) would turn back before it."""
    program = read(*way, "G80 G0 X50", "G1 Z19 X60", "X70 Y3")
    lines = moves(program)
    bottom = [line for line in lines if "Z -5.0000" in line]
    assert bottom
    assert all("C_DIS" not in line for line in bottom)
    assert "C_DIS" in next(line for line in lines if "X 60.0000" in line)


def test_a_robot_goes_sideways_only_where_a_cycle_does() -> None:
    lines = moves(read("G99 G81 X5 Y5 Z-5 R2", "X10", "G80"))
    assert all("C_DIS" not in line for line in lines[1:] if "Z 2.0000" in line)


def moves(program: Program) -> list[str]:
    path = tool_path(program)
    down = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (len(path), 3, 3))
    settings = KrlSettings(name="part", start_axes_rad=(0.0, -1.5, 1.6, 0.1, 0.5, -0.2))
    poses = CompensatedPath.nominal(path).poses(down)
    text = KrlWriter(program, path, poses, settings, block_lines=lambda _: []).text()
    return [line for line in text.files["part.src"].splitlines() if line.startswith("LIN")]
