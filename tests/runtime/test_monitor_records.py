"""The hash of a loop is over the numbers of its monitor as in older logs."""

from __future__ import annotations

import numpy as np

from counterflex.core.records import count_of, records
from counterflex.runtime.monitoring.monitor import Monitor
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.records import PLAN_ROW
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.runtime.state.planned import PLAN


def test_a_loops_hash_is_over_the_arrays_of_older_logs() -> None:
    """Reals, whole numbers, limits of the speed, plan; without what samples and energies are kept over."""
    override = OverrideSettings(tolerance_m=1e-4, least=0.3, change_per_s=0.5)
    monitor = Monitor(MonitorSettings(), override, records(PLAN, 5), None, 5e-3, 2e-3)
    numbers = list(monitor.numbers())
    assert [(n.dtype.str, n.shape) for n in numbers] == [
        ("<f8", (21,)),
        ("<i8", (14,)),
        ("<f8", (3,)),
        ("<f8", (5, 13)),
    ]
    np.testing.assert_array_equal(numbers[2], [0.3, 0.5 * 4e-3, 2e-3])
    assert numbers[0][16] == 5e-3
    assert count_of(PLAN_ROW) == 13
