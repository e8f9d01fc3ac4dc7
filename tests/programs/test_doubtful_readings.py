"""What may have been meant otherwise is said: a dwell of minutes (milliseconds?), lines that begin with a slash."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.stated.two_readings import doubtful_readings

HEAD = "G21 G90 F600 S1000 M3\nG0 X0 Y0 Z5\n"


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ("G4 P500", ["G4 P500 in line 3 waits 500 s (8.3 min)", "P0.5"]),
        ("G82 X1 Y1 Z-2 R1 P200\nX2", ["G82 P200 in line 3 waits 200 s (3.3 min), 2 times", "P0.2"]),
        ("G81 X1 Y1 Z-2 R1\nG4 P300", ["G4 P300 in line 4", "P0.3"]),
        ("G89 X1 Y1 Z-2 R1 P1000 L3", ["G89 P1000 in line 3", "3 times"]),
    ],
)
def test_long_dwells_are_said_with_the_other_reading(block: str, words: list[str]) -> None:
    (said,) = doubtful_readings(read_gcode(f"{HEAD}{block}\nM2\n"))
    assert all(word in said for word in words)


@pytest.mark.parametrize("block", ["G4 P60", "G4 P0.5", "G82 X1 Y1 Z-2 R1 P2"])
def test_usual_dwells_are_not(block: str) -> None:
    assert doubtful_readings(read_gcode(f"{HEAD}{block}\nM2\n")) == []


def test_lines_that_the_switch_skips_are_said() -> None:
    one = doubtful_readings(read_gcode(f"{HEAD}/G1 X5\nG1 X6\nM2\n"))
    assert [said[:33] for said in one] == ["line 3 begins with / and is read "]
    two = doubtful_readings(read_gcode(f"{HEAD}/G1 X5\n/M8\n/G1 X6\nM2\n"))
    assert two[0].startswith("line 3 and 1 more begin with / and are read")


@pytest.mark.parametrize("block", ["/G1 X20", "/G2 X20 Y0 R30", "/G81 X5 Y5 Z-5 R2"])
def test_every_line_of_a_block_that_is_skipped_is_skipped(block: str) -> None:
    program = read_gcode(f"{HEAD}{block}\nG80\nM2\n")
    path = tool_path(program)
    shift = np.zeros((len(path), 3))
    feed = path.kind == FEED
    shift[feed, 1] = 1e-4 * np.sin(1e3 * path.p_part_tcp[feed, 0] + 400.0 * path.p_part_tcp[feed, 2])
    text = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text
    lines = text.split("\n")
    assert sum(line.startswith("/") for line in lines) > 3
    assert read_gcode(text, block_delete=True).motions[-1].p_end == pytest.approx([0.0, 0.0, 0.005])
