"""Force of the holder by the controller's cycle, from logs whose loop waited before and between telegrams."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.runtime.record_ring import WIDTH, column
from counterflex_lab.reproduce.holder import by_cycle

FIRST_MS = 48_000


def log(elapsed: list[int]) -> Float:
    """Records of cycles: so many of the controller's passed before each, 0 where the loop only waited."""
    rows = np.zeros((len(elapsed), WIDTH))
    counter, seen = FIRST_MS - 4, False
    for k, step in enumerate(elapsed):
        seen = seen or step > 0
        counter += 4 * step
        rows[k, column("elapsed")] = step
        rows[k, column("counter_ms")] = counter if seen else -1
        rows[k, column("wrench_fz")] = counter - FIRST_MS if step else 1e6
    return rows


def test_cycles_without_a_telegram_have_no_place_in_the_course() -> None:
    """The loop waits before the first telegram and in between; one telegram is lost."""
    force, stated = by_cycle(log([0, 0, 0, 1, 1, 0, 2, 1, 0]), 6)
    np.testing.assert_array_equal(force[:, 2], [0.0, 4.0, np.nan, 12.0, 16.0, np.nan])
    assert np.isfinite(stated).all(axis=1).tolist() == np.isfinite(force).all(axis=1).tolist()


def test_a_log_without_a_telegram_has_no_force_at_all() -> None:
    assert np.isnan(by_cycle(log([0, 0]), 3)[0]).all()
