"""Process monitoring on made-up signals, tooth by tooth: seen where it is there, silent where it is not; held out."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.units import MM
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.validation.monitor_trial import EXPONENT, Incident, run_trial

SETTINGS = MonitorSettings(force_limit_n=2000.0, exponent=EXPONENT)
SEEDS = range(500, 508)
SLOT = 0.12


def met(incident: Incident, cut_m: float = SLOT) -> list[dict[Event, float]]:
    return [run_trial(SETTINGS, cut_m, incident, seed).events for seed in SEEDS]


def test_a_sound_cut_is_left_alone() -> None:
    assert all(not events for events in met(Incident()))


@pytest.mark.parametrize(
    ("incident", "within_m"),
    [
        (Incident(Event.MISSING_CUT, size=10.0 * MM), 6.0 * MM),
        (Incident(Event.OVERLOAD, size=1.0), 9.0 * MM),
        (Incident(Event.BREAKAGE, size=2), 3.0 * MM),
        (Incident(Event.BREAKAGE, size=3), 3.0 * MM),
        (Incident(Event.LOW_CHATTER, size=120.0), 25.0 * MM),
    ],
)
def test_what_goes_wrong_is_seen_soon(incident: Incident, within_m: float) -> None:
    """Every one of these is far from its threshold, so that none may be missed."""
    assert incident.event is not None
    apart = 1.2 * MM  # signal and plan, in place and in time
    for events in met(incident):
        assert -apart < events[incident.event] - incident.at_m < within_m


def test_chatter_and_a_single_tooth_are_seen_more_often_than_not() -> None:
    """A line of chatter may fall on a harmonic of the spindle; uneven stock may hide one tooth of three."""
    for incident in (Incident(Event.CHATTER, size=120.0), Incident(Event.BREAKAGE, size=1)):
        assert incident.event is not None
        assert sum(incident.event in events for events in met(incident)) >= len(SEEDS) // 2


def test_wear_is_reported_with_its_trend() -> None:
    found = [run_trial(SETTINGS, 0.9, Incident(Event.WEAR, 0.0, 0.4), seed) for seed in list(SEEDS)[:3]]
    sound = [run_trial(SETTINGS, 0.9, Incident(), seed) for seed in list(SEEDS)[:3]]
    assert all(Event.WEAR in out.events for out in found)
    assert not any(out.events for out in sound)
    np.testing.assert_allclose([out.trend_per_m for out in found], 0.4, atol=0.12)
    np.testing.assert_allclose([out.trend_per_m for out in sound], 0.0, atol=0.03)
