"""Lost motion is found again for each command: averaged rounds find it where plain ones swing apart."""

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
LOST_UM = 90.0


@pytest.mark.parametrize("answer", [0.0, -1.0, -2.0])
def test_what_a_command_makes_the_axes_lose_is_in_it(
    answer: float,
    path_of: Callable[..., ToolPath],
    cell_of: Callable[..., Cell],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The axes lose 90 um and ``answer`` times what is taken back: 90 / (1 - answer) um is the one that fits itself.

    Taken back in full, an answer of -2 swings apart: 90, -90, 270 um.
    """
    path, cell = path_of(GROOVE), cell_of()
    setting = setting_of(cell)
    line = path.motion + 1
    inputs = CompensationInputs(path, line, cell.stock(), setting, solve_joints(path, line, setting).q)
    loaded = room.loaded_robot(inputs, undisturbed_cut(inputs, silent))
    monkeypatch.setattr(room, "lost_motion", lambda *_: np.zeros((len(path), 3)))
    without = room.static_correction(loaded, silent)[0]
    programmed, taken_back = room.LoadedRobot.command_against, [np.zeros((len(path), 3))]

    def command_against(loaded: room.LoadedRobot, displacement: Float) -> room.Command:
        taken_back.append((displacement - without)[:, :3])
        return programmed(loaded, displacement)

    monkeypatch.setattr(room.LoadedRobot, "command_against", command_against)
    monkeypatch.setattr(room, "lost_motion", lambda *_: LOST_UM * UM + answer * taken_back[-1])
    found = (room.static_correction(loaded, silent)[0] - without)[loaded.cut.contact, :3]
    np.testing.assert_allclose(np.median(found, axis=0), LOST_UM * UM / (1.0 - answer), rtol=0.06)
