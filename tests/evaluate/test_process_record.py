"""What a run's record keeps of process events: all counted, few kept, however long the run."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.process_record import FIRST_EVENTS, LAST_EVENTS, ProcessRecord
from counterflex.runtime.monitoring.events import EVENTS, Event
from counterflex.runtime.record_ring import WIDTH, column


def rows(first: int, count: int) -> Float:
    """Records in each of which chatter begins, and in every third an overload too."""
    out = np.zeros((count, WIDTH))
    cycle = np.arange(first, first + count)
    out[:, column("cycle")] = cycle
    out[:, 1] = 4e6 * cycle
    bits = (1 << Event.CHATTER) | (1 << Event.OVERLOAD) * (cycle % 3 == 0)
    out[:, column("event_new")] = bits
    out[:, column("speed_asked")] = 1.0
    out[:, column("path_m")] = 1e-4 * cycle
    return out


def test_every_event_is_counted_and_few_are_kept() -> None:
    kept = ProcessRecord()
    seen = sum(len(kept.add(rows(1000 * k, 1000))) for k in range(30))
    found = kept.figures()
    assert found.counts == {Event.OVERLOAD: 10_000, Event.CHATTER: 30_000}
    assert seen == 40_000
    assert len(found.events) == FIRST_EVENTS + LAST_EVENTS
    cycles = [event.cycle for event in found.events]
    assert cycles == sorted(cycles)
    assert cycles[0] == 0
    assert cycles[-1] == 29_999


@pytest.mark.parametrize("count", [0, 1, FIRST_EVENTS - 10, FIRST_EVENTS, FIRST_EVENTS + 20])
def test_few_events_are_all_kept_once(count: int) -> None:
    kept = ProcessRecord()
    one = rows(1, count)
    one[:, column("event_new")] = 1 << Event.CHATTER
    kept.add(one)
    assert [event.cycle for event in kept.figures().events] == list(range(1, count + 1))


def test_a_trend_is_stated_with_the_range_of_student() -> None:
    kept = ProcessRecord()
    one = rows(1, 1)
    trend = [column(name) for name in ("wear_trend", "wear_trend_sigma", "wear_degrees")]
    one[0, column("cut_m")] = 0.2
    kept.add(one)
    short = kept.figures().wear
    assert short is not None
    assert not short.known
    one[0, trend] = 0.1, 0.02, 3.5
    kept.add(one)
    long = kept.figures().wear
    assert long is not None
    assert long.known
    assert long.range_per_m == pytest.approx(0.02 * stats.t.ppf(0.975, 3.5))


def test_an_event_that_does_not_exist_is_refused() -> None:
    one = rows(1, 1)
    one[0, column("event_new")] = 1 << EVENTS
    with pytest.raises(InputError, match="event that does not exist"):
        ProcessRecord().add(one)
