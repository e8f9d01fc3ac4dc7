"""The monitor's memory stands as in logs that do not say their layout; the hash of a loop is over the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.records import as_words, count_of, records
from counterflex.runtime.monitoring.monitor import Monitor
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.records import MEMORY, PLAN_ROW
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.runtime.state.planned import PLAN

# First word of each array of then: fast samples 0, results 7, their bits 37, state 41, its counters 149, speed 172,
# work space 174, memory of the fast samples 190, its counters 274.
PLACES = {
    "fast.residual": 1,
    "fast.slower": 6,
    "results.force": 7,
    "results.ratio": 7 + 9,
    "results.limit": 7 + 16,
    "results.speed": 7 + 29,
    "outcome.on": 37,
    "outcome.slowed": 37 + 3,
    "force": 41,
    "highest": 41 + 16,
    "directions": 41 + 18,
    "rate": 41 + 25,
    "idle_fast": 41 + 28,
    "reference.turn_variance": 41 + 33,
    "wear.cut": 41 + 34,
    "wear.cusum": 41 + 38,
    "wear.classes": 41 + 39,
    "wear.neighbours.pairs": 41 + 90,
    "peak": 41 + 91,
    "velocity": 41 + 95,
    "swing_acceleration": 41 + 103,
    "slow": 41 + 107,
    "lasted": 149,
    "gone": 149 + 6,
    "hold_cause": 149 + 13,
    "tool": 149 + 17,
    "placed": 149 + 22,
    "speed": 172,
    "now.frame": 174,
    "now.ratio": 174 + 15,
    "samples.high_pass": 190,
    "samples.lines": 190 + 9,
    "samples.frequency": 190 + 60,
    "samples.settled": 274,
    "samples.separate": 274 + 4,
}


@pytest.mark.parametrize("name", PLACES)
def test_words_stand_where_older_logs_have_them(name: str) -> None:
    memory = records(MEMORY)
    part: np.ndarray = memory
    for field in name.split("."):
        part = part[field]
    as_words(part)[0] = 1
    assert np.flatnonzero(as_words(memory)).tolist() == [PLACES[name]]
    assert count_of(MEMORY) == 279


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
