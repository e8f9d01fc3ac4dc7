"""Lost motion is found again for each command: rounds that swing apart are not taken."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan import static_correction as room
from counterflex.plan.inputs import CompensationInputs, solve_joints
from counterflex.plan.undisturbed_cut import undisturbed_cut

GROOVE = "G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60"


@pytest.mark.parametrize(
    ("rounds_um", "kept_um"), [((100, 200, 150, 160), 160), ((100, 120, 60, 200), 120), ((100, 90, 180, 10), 90)]
)
def test_the_round_that_changed_least_is_kept(
    rounds_um: tuple[int, ...],
    kept_um: int,
    path_of: Callable[..., ToolPath],
    cell_of: Callable[..., Cell],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path, cell = path_of(GROOVE), cell_of()
    setting = setting_of(cell)
    line = path.motion + 1
    inputs = CompensationInputs(path, line, cell.stock(), setting, solve_joints(path, line, setting).q)
    loaded = room.loaded_robot(inputs, undisturbed_cut(inputs, silent))

    def correction(rounds: tuple[int, ...]) -> Float:
        left = list(rounds)

        def lost(*_: object) -> Float:
            return np.full((len(path), 3), (left.pop(0) if len(left) > 1 else left[0]) * UM)

        monkeypatch.setattr(room, "lost_motion", lost)
        return room.static_correction(loaded, silent)[0]

    np.testing.assert_allclose(correction(rounds_um), correction((kept_um,)), atol=1e-12)
