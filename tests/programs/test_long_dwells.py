"""A dwell of minutes is said: in many controls P is in milliseconds."""

from __future__ import annotations

import pytest

from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.long_dwells import long_dwells

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
    (said,) = long_dwells(read_gcode(f"{HEAD}{block}\nM2\n"))
    assert all(word in said for word in words)


@pytest.mark.parametrize("block", ["G4 P60", "G4 P0.5", "G82 X1 Y1 Z-2 R1 P2"])
def test_usual_dwells_are_not(block: str) -> None:
    assert long_dwells(read_gcode(f"{HEAD}{block}\nM2\n")) == []
