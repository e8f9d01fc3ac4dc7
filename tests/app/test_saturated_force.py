"""R15: a force sensor beyond its range holds the loop on the first sample; it goes on after 50 clean cycles."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.app.fault_scenarios.rig import Rig
from counterflex.core.arrays import Float

BEYOND_N = 9000.0
CLEAN = 50
HELD = "hold (force saturated)"


@pytest.mark.parametrize("cycles", [1, 20])
def test_a_saturated_sensor_holds_in_the_same_cycle_until_it_is_clean(cycles: int) -> None:
    saturated = False

    def force(time_s: float) -> Float:
        return np.array([0.0, BEYOND_N if saturated else 200.0, 0.0])

    with Rig(force=force, holds_feed=False) as rig:
        rig.activate().run(200)
        assert rig.seen.path()[-1] == "active"
        before = rig.seen.correction_m[-1]
        assert np.linalg.norm(before) > 1e-4
        saturated = True
        for _ in range(cycles):
            rig.cycle()
            assert rig.seen.path()[-1] == HELD
        saturated = False
        rig.run(CLEAN - 2)
        assert rig.seen.path()[-1] == HELD
        held = np.array(rig.seen.correction_m[2 - CLEAN :])
        assert not np.any(held - held[0])
        assert np.linalg.norm(held[0] - before) < rig.step_limit_m
        rig.run(10)
        assert rig.seen.path()[-1] == "active"
        assert rig.seen.steps()[-cycles - CLEAN :].max() < rig.step_limit_m
