"""Process monitoring on made-up signals, tooth by tooth: seen where it is there, silent where it is not; held out."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.units import MM, UM
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex_lab.monitor_trial import EXPONENT, Cut, Incident, run_trial

SETTINGS = MonitorSettings(force_limit_n=2000.0, exponent=EXPONENT)
SEEDS = range(500, 508)
SLOT = 0.12


def met(incident: Incident, cut_m: float = SLOT) -> list[dict[Event, float]]:
    return [run_trial(SETTINGS, cut_m, incident, seed).events for seed in SEEDS]


def test_a_sound_cut_is_left_alone() -> None:
    assert all(not events for events in met(Incident()))


@pytest.mark.by_turn
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


@pytest.mark.long
def test_chatter_and_a_single_tooth_are_seen_more_often_than_not() -> None:
    """A line of chatter may fall on a harmonic of the spindle; uneven stock may hide one tooth of three."""
    for incident in (Incident(Event.CHATTER, size=120.0), Incident(Event.BREAKAGE, size=1)):
        assert incident.event is not None
        assert sum(incident.event in events for events in met(incident)) >= len(SEEDS) // 2


@pytest.mark.long
def test_wear_is_reported_with_its_trend() -> None:
    found = [run_trial(SETTINGS, 0.9, Incident(Event.WEAR, 0.0, 0.4), seed) for seed in list(SEEDS)[:3]]
    sound = [run_trial(SETTINGS, 0.9, Incident(), seed) for seed in list(SEEDS)[:3]]
    assert all(Event.WEAR in out.events for out in found)
    assert not any(out.events for out in sound)
    np.testing.assert_allclose([out.trend_per_m for out in found], 0.4, atol=0.12)
    np.testing.assert_allclose([out.trend_per_m for out in sound], 0.0, atol=0.03)


EDGE = [Cut(speed_rpm=10_000.0), Cut(speed_rpm=15_000.0, teeth=2), Cut(speed_rpm=7_500.0, teeth=4)]
SIDE = Cut(speed_rpm=8_000.0, teeth=4, width_share=0.3)


@pytest.mark.parametrize("cut", EDGE, ids=["10 000 rpm, 3 teeth", "15 000 rpm, 2 teeth", "7 500 rpm, 4 teeth"])
def test_tooth_passing_at_the_edge_of_the_band_is_no_chatter(cut: Cut) -> None:
    for seed in list(SEEDS)[:2]:
        assert Event.CHATTER not in run_trial(SETTINGS, SLOT, Incident(), seed, cut).events


def test_a_fast_entry_is_no_chatter() -> None:
    """1 mm of way into a slot at 65 mm/s: the whole alternating force within 15 ms."""
    cut = Cut(ramp_m=1.0 * MM, feed_tooth_m=1e-4)
    for seed in list(SEEDS)[:4]:
        assert not run_trial(SETTINGS, SLOT, Incident(), seed, cut).events


@pytest.mark.parametrize("cut", [Cut(), SIDE], ids=["slot", "side cut"])
def test_thinner_stock_is_no_breakage_and_a_lost_tooth_is_one(cut: Cut) -> None:
    """Stock 20 and 30 % thinner takes more of the force than a tooth of three or four does."""
    for seed in list(SEEDS)[:3]:
        for thinner in (0.2, 0.3):
            thin = run_trial(SETTINGS, SLOT, Incident(thinner_share=thinner), seed, cut)
            assert Event.BREAKAGE not in thin.events
    broken = [run_trial(SETTINGS, SLOT, Incident(Event.BREAKAGE, size=1), seed, cut).events for seed in list(SEEDS)[:5]]
    assert sum(Event.BREAKAGE in events for events in broken) >= 4


CONVENTIONAL = Cut(is_climb=False, width_share=0.3, speed_rpm=11_000.0)
BESIDE = [
    CONVENTIONAL,
    Cut(width_share=0.3, speed_rpm=11_000.0),
    Cut(teeth=4, speed_rpm=8_570.0, width_share=0.5),
    Cut(teeth=2, speed_rpm=15_050.0, width_share=0.3),
]


@pytest.mark.by_turn
@pytest.mark.parametrize("cut", BESIDE, ids=["conventional", "climb", "7 samples a turn", "4 samples a turn"])
def test_thinner_stock_is_no_breakage_where_the_slip_brings_lines_together(cut: Cut) -> None:
    """11 000 rpm less 0.8 %: 5.5 samples a turn, so that orders k and 11 - k fold to one place under load."""
    for seed in range(700, 704):
        for thinner in (0.2, 0.3):
            incident = Incident(thinner_share=thinner)
            assert Event.BREAKAGE not in run_trial(SETTINGS, SLOT, incident, seed, cut).events


@pytest.mark.parametrize(
    ("cut", "least"),
    [(Cut(gaps=3, ramp_m=3.0 * MM), 3), (Cut(runout_m=20.0 * UM, width_share=0.25, speed_rpm=8_000.0, teeth=4), 2)],
    ids=["lost in a gap", "large run-out"],
)
def test_a_tooth_is_missed_against_the_pattern_of_the_cut_before(cut: Cut, least: int) -> None:
    """A gap of the stock lies between pattern and loss; a run-out of half the feed is a pattern and no event."""
    lost = Incident(Event.BREAKAGE, size=1)
    found = [run_trial(SETTINGS, SLOT, lost, seed, cut).events.get(Event.BREAKAGE, 0.0) for seed in range(700, 705)]
    assert sum(at > lost.at_m - 3.0 * MM for at in found) >= least
    assert not any(Event.BREAKAGE in run_trial(SETTINGS, SLOT, Incident(), seed, cut).events for seed in (700, 701))
