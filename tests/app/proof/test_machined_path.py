"""What is machined is the program as written: the stop at which a correction is taken back is planning's alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job
from counterflex.app.proof import prove, simulate
from counterflex.app.proof.truth import truth_of
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.inputs import SETTLING_S
from counterflex.programs.gcode.read.reader import read_gcode


def test_planning_adds_one_stop_where_feed_turns_into_rapid(program: Callable[..., Path], small: Path) -> None:
    job = read_job(program(), read_cell(small))
    last = int(np.flatnonzero((job.machined.kind[:-1] == FEED) & (job.machined.kind[1:] == RAPID))[0])
    assert len(job.path) == len(job.machined) + 1
    assert job.path.p_part_tcp[last + 1] == pytest.approx(job.machined.p_part_tcp[last], abs=0.0)
    assert job.path.time_s[-1] - job.machined.time_s[-1] == pytest.approx(SETTLING_S, abs=1e-12)


def test_the_simulated_cell_runs_the_program_without_that_stop(
    program: Callable[..., Path], small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run: list[ToolPath] = []

    class Seen(Exception):
        pass

    def simulated(path: ToolPath, **_: object) -> None:
        run.append(path)
        raise Seen

    cell = read_cell(small)
    job = read_job(program(), cell)
    monkeypatch.setattr(simulate, "simulate", simulated)
    with pytest.raises(Seen):
        simulate.machine(job, cell, truth_of(cell, 1))
    assert run[0] is job.machined


def test_programs_that_cut_nothing_are_told_so(program: Callable[..., Path], small: Path, tmp_path: Path) -> None:
    head, tail = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X10 Y10 Z", "\nM5\nM2\n"
    far = program(head + "90\nG1 X20 F1500" + tail)
    cell = read_cell(small)
    with pytest.raises(InputError, match="never comes near the blank"):
        simulate.machine(read_job(far, cell), cell, truth_of(cell, 1))
    near = program(head + "45\nG1 X20 F1500" + tail)
    with pytest.raises(InputError, match="removes no material from the blank"):
        prove.prove(near, small, tmp_path)


def test_a_cut_that_ends_in_the_material_is_left_uncorrected(small: Path, program: Callable[..., Path]) -> None:
    """The last feed block before the tool lifts ends at the programmed point, the one before it does not."""
    text = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X20 F1500\nG0 Z60\nM5\nM2\n"
    file = program(text)
    found = compensate(file, read_cell(small), predict=False)
    feeds = [m for m in read_gcode(found.files[file.name], name="written").motions if m.kind == "feed"]
    assert np.linalg.norm(feeds[-1].p_end - np.array([20.0, 15.0, 36.0]) * MM) < 1e-9
    assert np.linalg.norm(feeds[-2].p_end - np.array([20.0, 15.0, 36.0]) * MM) > 0.1 * MM
