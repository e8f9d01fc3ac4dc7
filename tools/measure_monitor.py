"""Measure process monitoring on made-up signals: how often each thing is seen, how soon, how often it errs.

Trials of :mod:`counterflex.validation.monitor_trial`: a slot, tooth by tooth, 1 kHz, with everything off that is not
known in a workshop. Seeds from ``--first`` on; the thresholds follow from stated rates and were not fitted to any seed.

    python tools/measure_monitor.py --seeds 100
"""

from __future__ import annotations

import argparse

import numpy as np

from counterflex.core.units import MM
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.validation.monitor_trial import EXPONENT, Incident, run_trial

SLOT_M = 0.12
LONG_M = 1.5
CASES = (
    ("no stock for 10 mm", Incident(Event.MISSING_CUT, size=10.0 * MM)),
    ("force 1.5 times the plan's", Incident(Event.OVERLOAD, size=0.5)),
    ("force 2 times the plan's", Incident(Event.OVERLOAD, size=1.0)),
    ("one tooth of three breaks", Incident(Event.BREAKAGE, size=1)),
    ("two teeth of three break", Incident(Event.BREAKAGE, size=2)),
    ("all teeth break", Incident(Event.BREAKAGE, size=3)),
    ("chatter, 60 N", Incident(Event.CHATTER, size=60.0)),
    ("chatter, 120 N", Incident(Event.CHATTER, size=120.0)),
    ("the arm swings on, 60 N", Incident(Event.LOW_CHATTER, size=60.0)),
    ("the arm swings on, 100 N", Incident(Event.LOW_CHATTER, size=100.0)),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100, help="trials per row")
    parser.add_argument("--first", type=int, default=10_000, help="first seed")
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    settings = MonitorSettings(force_limit_n=2000.0, exponent=EXPONENT)
    print(
        f"noise: {settings.z:.2f} standard deviations, {settings.false_alarms_per_h:g} false alarms an hour; model:"
        f" {100.0 * settings.model_error:.0f} %; wear: decision interval {settings.cusum:.2f}"
    )
    sound = [run_trial(settings, SLOT_M, Incident(), seed).events for seed in seeds]
    print(f"{'sound slot of 120 mm':28s} false alarms in {sum(bool(e) for e in sound)} of {len(sound)}")
    for name, incident in CASES:
        event = incident.event
        if event is None:
            continue
        after = []
        for seed in seeds:
            found = run_trial(settings, SLOT_M, incident, seed).events
            if event in found:
                after.append((found[event] - incident.at_m) / MM)
        middle = f"{np.median(after):5.1f} mm" if after else "      -"
        print(f"{name:28s} seen in {len(after)} of {len(seeds)}, after {middle} (median)")
    few = list(seeds)[: max(4, chosen.seeds // 5)]
    for rise in (0.0, 0.1, 0.3):
        trials = [run_trial(settings, LONG_M, Incident(Event.WEAR, 0.0, rise), seed) for seed in few]
        at = [trial.events[Event.WEAR] for trial in trials if Event.WEAR in trial.events]
        trend = np.array([trial.trend_per_m for trial in trials])
        said = f"after {np.median(at):.2f} m (median)" if at else ""
        print(
            f"{f'wear, {100 * rise:.0f} % more force per m':28s} seen in {len(at)} of {len(few)} {said}, trend"
            f" {100.0 * trend.mean():+.1f} +- {100.0 * trend.std():.1f} % per m"
        )


if __name__ == "__main__":
    main()
