"""A cut that ends in the material: deflection is taken back before the tool lifts, unless it is not worth a stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.progress import silent
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import CompensationInputs, settling_rows, solve_joints, with_settling
from counterflex.plan.static_correction import loaded_robot, static_correction
from counterflex.plan.undisturbed_cut import undisturbed_cut

BLIND = "G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X30 F1500\nG0 Z60"


@pytest.mark.parametrize(("swing_um", "kept"), [(0.0, False), (2000.0, True)])
def test_the_correction_is_taken_back_only_where_more_is_relieved_than_a_stop_would_shake(
    swing_um: float, kept: bool, path_of: Callable[..., ToolPath], cell_of: Callable[..., Cell]
) -> None:
    path, cell = with_settling(path_of(BLIND)), cell_of()
    setting = replace(setting_of(cell), swing_m=swing_um * UM)
    line = path.motion + 1
    inputs = CompensationInputs(path, line, cell.stock(), setting, solve_joints(path, line, setting).q)
    loaded = loaded_robot(inputs, undisturbed_cut(inputs, silent))
    (stop,) = np.flatnonzero(settling_rows(path))
    assert np.array_equal(path.p_part_tcp[stop], path.p_part_tcp[stop - 1])
    assert 20.0 * UM < np.linalg.norm(loaded.deflection_part[stop - 1, :3]) < 2000.0 * UM
    correction = static_correction(loaded, silent)[1].correction_part
    assert np.linalg.norm(correction[stop - 1]) > 20.0 * UM
    np.testing.assert_array_equal(correction[stop], correction[stop - 1] if kept else np.zeros(3))
    assert not np.any(correction[stop + 1 :])
