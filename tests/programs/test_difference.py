"""The difference of two versions of a program."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.integrations.kuka.language.in_place import write_krl_in_place
from counterflex.integrations.kuka.language.program import KrlProgram
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.difference import differences, largest_first, summary
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode

GCODE = "G21 G90 G17\nT1 M6\nG0 X0 Y0 Z5\nG1 Z0 F600\nG1 X40\nG3 X50 Y10 J10\nG1 Y40\nG4 P1\nG0 Z5\nM30\n"
KRL = "DEF p( )\nPTP {X 0,Y 0,Z 5,A 0,B 0,C 180}\n$VEL.CP=0.02\nLIN {Z 0}\nLIN {X 40}\nLIN {Y 40}\nPTP {Z 5}\nEND\n"


def test_a_program_and_itself() -> None:
    program = read_gcode(GCODE)
    changes = differences(program, program)
    assert len(changes) == len(program.motions)
    assert not any(change.changed for change in changes)
    assert summary(program, program, changes)["points_added"] == 0


@pytest.mark.parametrize("language", ["gcode", "krl"])
def test_what_was_added_to_every_motion_is_found_again(language: str) -> None:
    """A shift that swings along the path: ends as the writer was told, its points counted, the worst line named."""
    program = read_gcode(GCODE) if language == "gcode" else read_krl(KRL)
    path = tool_path(program, step_m=0.5 * MM)
    fed = np.isin(path.motion, [k for k, motion in enumerate(program.motions) if motion.kind in ("feed", "arc")])
    shift = np.where(fed[:, None], np.array([0.0, 0.1, 0.3]) * MM, 0.0) * np.sin(np.arange(len(path)) / 9.0)[:, None]
    shift[0] = 0.0
    compensated = CompensatedPath.from_correction(path, shift)
    if not isinstance(program, KrlProgram):
        text = write_gcode(program, compensated)
        after, added = read_gcode(text.text), text.vertices_added
    else:
        written = write_krl_in_place(program, compensated, cycle_s=1e-4)
        after, added = read_krl(written.files["program.src"]), written.vertices_added
    changes = differences(program, after)
    assert sum(change.added for change in changes) == added > 10
    for k, change in enumerate(changes):
        if change.kind == "dwell":
            continue  # stays where the motion before it ends
        row = int(np.flatnonzero(path.motion == k)[-1])
        np.testing.assert_allclose(change.shift_m, compensated.correction_part[row], atol=0.2 * UM)
    worst = next(largest_first(changes))
    assert worst.largest_m == pytest.approx(0.3 * MM, rel=0.1)
    assert sum(change.changed for change in changes) == summary(program, after, changes)["changed"]


def test_orientations_of_a_robot() -> None:
    after = read_krl(KRL.replace("LIN {X 40}", "LIN {X 40,A 0.5}"))
    turns = [change.turn_rad[2] for change in differences(read_krl(KRL), after)]
    np.testing.assert_allclose(np.degrees(turns), [0.0, 0.0, 0.5, 0.5, 0.5], atol=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        (GCODE, GCODE.replace("G4 P1\n", ""), "rapids and waits differ"),
        (GCODE, GCODE.replace("G1 Y40\n", ""), "fewer motions"),
        (GCODE, GCODE.replace("G4 P1\n", "G4 P1\nG1 Y50\n"), "where the first has none"),
    ],
)
def test_other_programs_are_refused(before: str, after: str, says: str) -> None:
    with pytest.raises(InputError) as fault:
        differences(read_gcode(before), read_gcode(after))
    assert says in str(fault.value)


def test_other_languages_are_refused() -> None:
    with pytest.raises(InputError, match="one language"):
        differences(read_gcode(GCODE), read_krl(KRL))
