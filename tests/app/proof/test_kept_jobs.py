"""A run folder keeps a program of several files so that it can be read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.app.proof.simulate import ORIGINAL, PROGRAM, keep_inputs, kept
from counterflex.files.cell.cell import read_cell
from counterflex.integrations.kuka.language.read.reader import read_krl_file

CELL = Path(__file__).parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
START = "DEF job( )\n$BASE=BASE_DATA[1]\n$TOOL=TOOL_DATA[1]\n$VEL.CP=0.02\nPART( )\nLIN XP\nEND\n"
PART = "DEF PART( )\nLIN {{X {x},Y 0,Z 10,A 0,B 0,C 180}}\nEND\n"
DATA = "DEFDAT job\nDECL E6POS XP={X 9,Y 0,Z 10,A 0,B 0,C 180}\nENDDAT\n"


def test_parts_are_kept_beside_the_program_that_calls_them(tmp_path: Path) -> None:
    """Program and original have parts of the same names, which must not meet."""
    for folder, x in (("before", 1), ("after", 2)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "job.src").write_text(START)
        (tmp_path / folder / "job.dat").write_text(DATA)
        (tmp_path / folder / "PART.src").write_text(PART.format(x=x))
    run = tmp_path / "run"
    run.mkdir()
    keep_inputs(read_cell(CELL), tmp_path / "after" / "job.src", tmp_path / "before" / "job.src", run)
    for name, x in ((ORIGINAL, 1), (PROGRAM, 2)):
        made = read_krl_file(kept(run, name))
        np.testing.assert_allclose([motion.p_end[0] * 1e3 for motion in made.motions], [x, 9])


def test_a_program_of_one_file_stays_in_the_run_folder(tmp_path: Path) -> None:
    (tmp_path / "a.src").write_text("DEF a( )\nLIN {X 0,Y 0,Z 0,A 0,B 0,C 180}\nEND\n")
    (tmp_path / "unrelated.src").write_text("DEF unrelated( )\nEND\n")
    run = tmp_path / "run"
    run.mkdir()
    keep_inputs(read_cell(CELL), tmp_path / "a.src", tmp_path / "a.src", run)
    assert kept(run, PROGRAM) == run / "program.src"
