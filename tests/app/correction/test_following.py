"""The response of the tool has windows of its own where it enters and leaves the cut."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from counterflex.app.correction import following
from counterflex.app.correction.following import following_of


def test_entries_and_exits_have_a_gain_and_a_delay_of_their_own() -> None:
    time = np.arange(0.0, 8.0, 0.01)
    contact = (time > 2.0) & (time < 6.0)
    loaded: Any = SimpleNamespace(
        inputs=SimpleNamespace(path=SimpleNamespace(time_s=time)),
        feed_run=np.zeros(len(time), dtype=np.int64),
        cut=SimpleNamespace(contact=contact),
    )
    ways = following_of(loaded)
    assert ways.gain.shape == ways.delay_s.shape == (8, len(time), 3)
    np.testing.assert_array_equal(ways.gain[:3, 400], following.GAIN * np.eye(3))
    entry, plateau, leaves = (int(np.argmin(np.abs(time - at))) for at in (2.3, 4.0, 5.9))
    for row, inside in ((entry, (True, False)), (plateau, (False, False)), (leaves, (False, True))):
        for window, share in enumerate(inside):
            np.testing.assert_allclose(ways.gain[3 + window, row], share * following.WINDOW_GAIN, atol=1e-12)
            size = (following.ENTRY_DELAY_S, following.EXIT_DELAY_S)[window]
            np.testing.assert_allclose(ways.delay_s[6 + window, row], share * size, atol=1e-12)
    np.testing.assert_allclose(ways.delay_s[5], following.DELAY_S)
    assert not np.any(ways.delay_s[:5])
    assert not np.any(ways.gain[5:])
