"""What parts showed is taken back by the plan: as much as was measured, within limits, and known to the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.app.run.loop import loop_plan
from counterflex.core.errors import ModelError
from counterflex.core.progress import silent
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.inputs import CompensationInputs, CorrectionLimits
from counterflex.plan.measured_correction import ENTRY_LEAD_S, LEAD_S, earlier, lead_s, leaving_share, with_measured
from counterflex.plan.plan import Plan
from counterflex.plan.static_correction import LoadedRobot, loaded_robot
from counterflex.plan.undisturbed_cut import undisturbed_cut

GROOVE = "G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60"


@pytest.fixture(scope="module")
def cell(cell_of: Callable[..., Cell]) -> Cell:
    return cell_of()


@pytest.fixture(scope="module")
def made(path_of: Callable[..., ToolPath], cell: Cell) -> tuple[Plan, LoadedRobot]:
    path = path_of(GROOVE)
    lines = np.arange(1, int(path.motion.max()) + 2)
    plan = make_plan(path, lines, cell.stock(), setting_of(cell), predict=False)
    inputs = CompensationInputs(plan.path, plan.line, cell.stock(), setting_of(cell), plan.q)
    return plan, loaded_robot(inputs, undisturbed_cut(inputs, silent))


def shown(plan: Plan) -> np.ndarray:
    """An even error while cutting: 80 um to the left, 50 um too deep."""
    return np.where((plan.path.kind == FEED)[:, None], np.array([0.0, 80.0, -50.0]) * UM, 0.0)


def test_an_even_error_is_taken_back_whole_inside_the_cut(made: tuple[Plan, LoadedRobot]) -> None:
    plan, loaded = made
    error = shown(plan)
    found = with_measured(plan, loaded, error, np.zeros_like(error), 500 * UM)
    x = plan.path.p_part_tcp[:, 0]
    inner = (plan.path.kind == FEED) & (x > 10 * MM) & (x < 30 * MM)  # clear of the smoothing at the ends
    np.testing.assert_allclose((found.correction_part - plan.correction_part)[inner], -error[inner], atol=1 * UM)
    assert found.measured_part is not None
    np.testing.assert_allclose(found.measured_part, found.correction_part - plan.correction_part, atol=1e-15)
    again = with_measured(found, loaded, error, np.zeros_like(error), 500 * UM)
    assert again.measured_part is not None
    np.testing.assert_allclose(again.measured_part, 2.0 * found.measured_part, atol=1e-12)


def test_nothing_measured_changes_nothing(made: tuple[Plan, LoadedRobot]) -> None:
    plan, loaded = made
    none = np.zeros_like(plan.correction_part)
    np.testing.assert_array_equal(with_measured(plan, loaded, none, none, UM).correction_part, plan.correction_part)


def test_changes_beyond_their_limits_are_refused(made: tuple[Plan, LoadedRobot]) -> None:
    plan, loaded = made
    error = shown(plan)
    with pytest.raises(
        ModelError, match=r"line \d+: what the part shows .* 9[0-9] um; expected <= 60 um \(--limit-um\)"
    ):
        with_measured(plan, loaded, error, error, 60 * UM)
    tight = replace(
        loaded.inputs.setting, limits=CorrectionLimits(correction_m=0.5 * np.max(np.abs(plan.correction_part)))
    )
    bound = replace(loaded, inputs=replace(loaded.inputs, setting=tight))
    with pytest.raises(ModelError, match="beyond its bound"):
        with_measured(plan, bound, error, error, 500 * UM)


def test_the_loop_does_not_take_back_what_parts_showed(made: tuple[Plan, LoadedRobot], cell: Cell) -> None:
    plan, loaded = made
    error = shown(plan)
    found = with_measured(plan, loaded, error, np.zeros_like(error), 500 * UM)
    before, after = loop_plan(plan, cell, compensated=True), loop_plan(found, cell, compensated=True)
    # the same correction of the model counts as contained, and the program is looked for where it now runs
    np.testing.assert_allclose(after.contained, before.contained, atol=1e-12)
    np.testing.assert_array_equal(after.p_part, plan.path.p_part_tcp + found.correction_part)


def test_a_displacement_is_sent_early_within_its_run() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    run = (time >= 1.0).astype(np.int64)
    ramp = np.column_stack([time, 2.0 * time, 0.0 * time])
    lead = np.full(len(time), LEAD_S)
    ahead = earlier(ramp, time, run, lead)
    inside = (time < 1.0 - 0.01 - LEAD_S) | ((time >= 1.0) & (time < 1.99 - LEAD_S))
    np.testing.assert_allclose(ahead[inside], earlier(ramp, time, 0 * run, lead)[inside], atol=1e-12)
    np.testing.assert_allclose(ahead[inside, 0], time[inside] + LEAD_S, atol=1e-12)
    assert ahead[99, 0] == pytest.approx(0.99)  # nothing comes over from the next run


def test_the_lead_is_longer_while_the_tool_enters_the_cut_and_time_never_runs_back() -> None:
    time = np.arange(0.0, 8.0, 0.01)
    run = (time >= 4.0).astype(np.int64)
    contact = ((time > 1.0) & (time < 3.5)) | ((time > 4.0) & (time < 5.0)) | ((time > 6.0) & (time < 7.0))
    lead = lead_s(time, run, contact)
    for meets in (1.0, 4.0, 6.0):  # once in the first run, and twice in the second, after a second of air
        np.testing.assert_allclose(lead[(time > meets) & (time < meets + 0.69)], ENTRY_LEAD_S)
    for rest in ((0.0, 0.69), (2.2, 3.99), (5.2, 5.69), (7.2, 8.0)):
        np.testing.assert_allclose(lead[(time > rest[0]) & (time < rest[1])], LEAD_S)
    for number in (0, 1):
        assert np.all(np.diff((time + lead)[run == number]) > 0.0)
    np.testing.assert_allclose(lead_s(time, run, np.zeros_like(contact)), LEAD_S)


def test_an_exit_begins_half_a_second_before_contact_ends_and_each_cut_has_its_own() -> None:
    time = np.arange(0.0, 8.0, 0.01)
    run = (time >= 4.0).astype(np.int64)
    contact = ((time > 1.0) & (time < 3.0)) | ((time > 4.0) & (time < 5.0)) | ((time > 6.0) & (time < 7.0))
    share = leaving_share(time, run, contact)
    for leaves in (3.0, 5.0, 7.0):
        np.testing.assert_allclose(share[(time > leaves - 0.24) & (time < leaves + 0.28)], 1.0)
        assert 0.4 < share[np.argmin(np.abs(time - leaves + 0.375))] < 0.6
        np.testing.assert_allclose(share[(time > leaves - 0.99) & (time < leaves - 0.52)], 0.0)
    np.testing.assert_allclose(leaving_share(time, run, np.zeros_like(contact)), 0.0)
