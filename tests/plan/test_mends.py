"""A trial that leaves much is mended again, cut by cut, as long as that helps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan import compensate as room
from counterflex.plan.inputs import MENDED, TRIAL, UNCOMPENSATED, CompensationInputs, solve_joints
from counterflex.plan.static_correction import Command, loaded_robot, static_correction
from counterflex.plan.undisturbed_cut import undisturbed_cut

TWO_CUTS = "G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60\nG0 X-12 Y38\nG0 Z36\nG1 X52 F1500\nG0 Z60"


@pytest.mark.parametrize(
    ("left_of_first", "left_by_each", "trials", "left"),
    [(0.05, 0.5, 2, 0.5), (0.6, 0.7, 4, 0.343), (0.6, 0.1, 2, 0.1), (0.6, 1.5, 2, 1.0)],
    ids=["little", "much", "much, then little", "worse"],
)
def test_only_the_cut_that_leaves_much_is_mended_again(
    left_of_first: float,
    left_by_each: float,
    trials: int,
    left: float,
    path_of: Callable[..., ToolPath],
    cell_of: Callable[..., Cell],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first cut leaves ``left_of_first`` of its deflection, the second 5 %; a mending leaves ``left_by_each``."""
    path, cell = path_of(TWO_CUTS), cell_of()
    setting = setting_of(cell)
    line = path.motion + 1
    inputs = CompensationInputs(path, line, cell.stock(), setting, solve_joints(path, line, setting).q)
    loaded = loaded_robot(inputs, undisturbed_cut(inputs, silent))
    displacement, static = static_correction(loaded, silent)
    first = path.p_part_tcp[:, 1] < 0.03
    share = np.where(first, left_of_first, 0.05)[:, None]
    mended: list[Float] = []
    commanded: list[Float] = []

    def tried(_: object, command: Command, __: object) -> room.Trial:
        commanded.append(command.correction_part)
        mended.append(share * loaded.deflection_part * left_by_each ** len(mended))
        return room.Trial(mended[-1], loaded.cut.contact)

    monkeypatch.setattr(room, "chattering", lambda loaded, *_: np.zeros(len(loaded.inputs.path), dtype=np.bool_))
    monkeypatch.setattr(room, "_tried", tried)
    command, trial = room.dynamic_trial(
        loaded, displacement, static, dict.fromkeys((TRIAL, MENDED, UNCOMPENSATED), silent)
    )
    remaining = trial.deviation_part
    assert len(mended) == trials
    np.testing.assert_allclose(remaining[first], (left * mended[0])[first], atol=1e-15)
    contact = loaded.cut.contact
    for cut in (first & contact, ~first & contact):  # what is commanded is what was in the trial that left least there
        best = int(np.argmin([np.linalg.norm(one[cut]) for one in mended]))
        np.testing.assert_allclose(command.correction_part[cut], commanded[best][cut], atol=1e-12)


def test_a_trial_that_is_better_at_one_place_of_a_cut_alone_is_taken_there(
    path_of: Callable[..., ToolPath], cell_of: Callable[..., Cell], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mending halves what the first half of a groove leaves and doubles that of the second."""
    path, cell = path_of(TWO_CUTS), cell_of()
    setting = setting_of(cell)
    line = path.motion + 1
    inputs = CompensationInputs(path, line, cell.stock(), setting, solve_joints(path, line, setting).q)
    loaded = loaded_robot(inputs, undisturbed_cut(inputs, silent))
    displacement, static = static_correction(loaded, silent)
    x = path.p_part_tcp[:, 0]
    by_each = np.where(x < 0.02, 0.5, 2.0)[:, None]
    mended: list[Float] = []
    commanded: list[Float] = []

    def tried(_: object, command: Command, __: object) -> room.Trial:
        commanded.append(command.correction_part)
        mended.append(0.05 * loaded.deflection_part * by_each ** len(mended))
        return room.Trial(mended[-1], loaded.cut.contact)

    monkeypatch.setattr(room, "chattering", lambda loaded, *_: np.zeros(len(loaded.inputs.path), dtype=np.bool_))
    monkeypatch.setattr(room, "_tried", tried)
    command, trial = room.dynamic_trial(
        loaded, displacement, static, dict.fromkeys((TRIAL, MENDED, UNCOMPENSATED), silent)
    )
    contact = loaded.cut.contact
    for place, best in ((contact & (x < 0.012), 1), (contact & (x > 0.028), 0)):
        assert np.any(place)
        np.testing.assert_allclose(command.correction_part[place], commanded[best][place], atol=1e-12)
        np.testing.assert_allclose(trial.deviation_part[place], mended[best][place], atol=1e-15)
