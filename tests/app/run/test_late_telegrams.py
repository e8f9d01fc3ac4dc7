"""Telegrams that a network holds up and hands over one behind the other: a short hold at most, then the cut goes on."""

from __future__ import annotations

import pytest

from counterflex.twin.network.impairment import Delivery, Impairment, Schedule
from counterflex_lab.faults.aftermath import LARGEST_STEP_M
from counterflex_lab.faults.rig import Rig


class _Late(Schedule):
    """The first telegrams come late by so much, the others at once."""

    def __init__(self, late_s: tuple[float, ...]) -> None:
        super().__init__(Impairment())
        self._late_s = late_s

    def decide(self, n: int) -> tuple[Delivery, ...]:
        return (Delivery(self._late_s[n] if n < len(self._late_s) else 0.0),)


@pytest.mark.parametrize(
    "late_ms", [(10.0, 6.1, 2.2), (10.0, 6.5, 3.0), (9.0,), (22.0, 18.5, 15.0, 11.5, 8.0, 4.5, 1.0)]
)
def test_late_telegrams_in_order_are_survived(late_ms: tuple[float, ...]) -> None:
    """The clock watch took the first late one for the computer's clock, and every good one behind it for a jump."""
    with Rig(seed=1) as rig:
        begin = rig.activate().run(200).cycle_count
        rig.ways = (_Late(tuple(1e-3 * ms for ms in late_ms)), rig.ways[1])
        rig._sent = [0, 0]
        rig.run(300)
        path = rig.seen.path(begin)
        assert path[0] == path[-1] == "active"
        assert len(path) in (1, 3)
        assert rig.session.watch.now.clock_jumps == 0
        assert rig.seen.steps()[begin - 1 :].max() <= LARGEST_STEP_M
