"""The cell run cycle by cycle: the same part as in one go, and corrections that act as stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lti, step

from counterflex.app.inputs import Job, read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.devices.path_answer import AnswerState, PathAnswer
from counterflex.twin.live.live_cell import LiveCell

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")


@pytest.fixture(scope="module")
def job(cell: Cell) -> Job:
    return read_job(EXAMPLES / "programs" / "groove.ngc", cell)


def live(cell: Cell, job: Job, answer: PathAnswer) -> LiveCell:
    made = LiveCell(
        job.machined,
        truth=truth_of(cell, 1),
        controller=simulate.controller(cell),
        stock=cell.stock(),
        cutter=cell.cutter(1),
        datum_points_part=cell.datum_points_part,
        answer=answer,
    )
    made.skip_to_contact()
    return made


def test_without_correction_it_is_the_simulation_in_one_go(cell: Cell, job: Job) -> None:
    made = live(cell, job, PathAnswer())
    made.start()
    while not made.advance(np.zeros(6)).finished:
        pass
    one, other = made.record(), simulate.machine(job, cell, truth_of(cell, 1))
    places = {tuple(np.round(p, 7)): i for i, p in enumerate(other.p_part_command)}
    pairs = [(i, places[key]) for i, p in enumerate(one.p_part_command) if (key := tuple(np.round(p, 7))) in places]
    cut = [(i, j) for i, j in pairs if other.engaged[j]]
    assert len(cut) > 500
    rows, same = np.array(cut).T
    apart = np.linalg.norm(one.p_part_tcp[rows] - other.p_part_tcp[same], axis=1)
    assert float(apart.max()) < 10e-6
    assert float(np.abs(one.force_part[rows] - other.force_part[same]).max()) < 5.0


def test_a_correction_moves_the_tool_by_as_much_in_the_part_frame(cell: Cell, job: Job) -> None:
    made = live(cell, job, PathAnswer(dead_s=0.0, natural_hz=0.0))
    for _ in range(120):
        before = made.advance(np.zeros(6))
    start = made.plant.p_base_tcp.copy()
    wanted = np.array([0.3e-3, -0.2e-3, 0.1e-3, 0.0, 0.0, 0.0])
    for _ in range(250):
        after = made.advance(wanted)
    shown = after.T_part_actual[:3, 3] - before.T_part_actual[:3, 3]
    np.testing.assert_allclose(shown, wanted[:3], atol=15e-6)
    np.testing.assert_array_equal(after.T_part_nominal, before.T_part_nominal)
    moved = made.T_base_part[:3, :3].T @ (made.plant.p_base_tcp - start)
    np.testing.assert_allclose(moved, wanted[:3], atol=0.1e-3)  # play and friction keep a part of it


@pytest.mark.parametrize(("hz", "damping"), [(5.0, 0.7), (3.0, 1.0), (8.0, 0.3)])
def test_the_answer_is_a_dead_time_and_a_second_order_lag(hz: float, damping: float) -> None:
    answer, period = AnswerState(PathAnswer(12e-3, hz, damping), 4e-3, 1), 4e-3
    found = np.array([answer(np.ones(1))[0] for _ in range(200)])
    w = 2.0 * np.pi * hz
    times, expected = step(lti([w * w], [1.0, 2.0 * damping * w, w * w]), T=np.arange(300) * period)
    np.testing.assert_allclose(found[3:], expected[1:198], atol=1e-6)
    assert times[1] == period
    np.testing.assert_array_equal(found[:3], 0.0)
