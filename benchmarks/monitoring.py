"""Process monitoring on made-up signals: how often each thing is seen, how soon, and how often it errs.

Trials of :mod:`counterflex_lab.monitor_trial`, tooth by tooth, with all off that a workshop does not know.
The default prints one cut with all that can go wrong; ``--grid`` counts false and missed alarms over speeds, teeth and
widths of cut, with stock that becomes thinner or thicker; ``--others`` does so for kinds of cut that nothing was tuned
on: run-out, variable pitch, interrupted cuts, fast entries, sensors at other rates. Seeds from ``--first`` on. Where
monitoring says before the cut that one broken tooth does not show, its trials count as said, not as missed.

    python benchmarks/monitoring.py --seeds 60
    python benchmarks/monitoring.py --grid --seeds 10
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.units import MM, UM
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.hidden_tooth import hidden_tooth
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex_lab.monitor_trial import EXPONENT, Cut, Incident, mean_force, run_trial

SLOT_M: Final = 0.12
LONG_M: Final = 1.5
SETTINGS: Final = MonitorSettings(force_limit_n=2000.0, exponent=EXPONENT)
CASES: Final = (
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
SPEEDS: Final = (
    (10_000, 3), (15_000, 2), (13_000, 3), (8_000, 4), (15_000, 3), (20_000, 3), (6_000, 2), (18_000, 1), (12_000, 4),
    (9_000, 6),
)  # fmt: skip
WIDTHS: Final = (1.0, 0.3)
OTHERS: Final = {
    "run-out 20 um": Cut(runout_m=20.0 * UM),
    "run-out 20 um, quarter width": Cut(runout_m=20.0 * UM, width_share=0.25, speed_rpm=8_000.0, teeth=4),
    "variable pitch, 5 degrees": Cut(teeth=4, speed_rpm=9_500.0, width_share=0.5, pitch_rad=np.radians(5.0)),
    "variable pitch, two teeth": Cut(teeth=2, speed_rpm=17_000.0, pitch_rad=np.radians(8.0)),
    "conventional milling": Cut(is_climb=False, width_share=0.3, speed_rpm=11_000.0),
    "five teeth": Cut(teeth=5, speed_rpm=7_300.0, width_share=0.4),
    "eight teeth": Cut(teeth=8, speed_rpm=5_200.0, width_share=0.2),
    "interrupted, three gaps": Cut(gaps=3, ramp_m=3.0 * MM),
    "fast entry": Cut(ramp_m=1.0 * MM, feed_tooth_m=100.0 * UM),
    "fast entry, half width": Cut(ramp_m=1.0 * MM, feed_tooth_m=100.0 * UM, width_share=0.5, speed_rpm=10_000.0),
    "500 Hz exactly": Cut(speed_rpm=10_000.0, width_share=0.3),
    "sensor at 2 kHz": Cut(sample_s=0.5e-3),
    "sensor at 500 Hz": Cut(sample_s=2e-3, width_share=0.5),
    "heavy cut, 900 N": Cut(force_n=900.0, speed_rpm=4_800.0, teeth=4),
}


def incidents(cut: Cut) -> dict[str, Incident]:
    """Return what happens in a cut of the grid; chatter with 0.3 of its mean force."""
    out = {
        "sound": Incident(),
        "20 % thinner": Incident(thinner_share=0.2),
        "30 % thinner": Incident(thinner_share=0.3),
        "25 % thicker": Incident(thinner_share=-0.25),
        "a tooth breaks": Incident(Event.BREAKAGE, size=1),
        "chatter": Incident(Event.CHATTER, size=0.3 * float(np.linalg.norm(mean_force(cut)))),
    }
    if cut.teeth == 1:
        del out["a tooth breaks"]
    return {name: replace(one, at_m=0.04 + 0.6 * cut.feed_m_s) for name, one in out.items()}


def counts(cut: Cut, incident: Incident, seeds: Sequence[int]) -> tuple[int, Counter[str], float]:
    """Trials in which the incident is seen by its name, false events by name, share of the cut where it can be seen."""
    settings = replace(SETTINGS, sample_s=cut.sample_s)
    seen, false, could = 0, Counter[str](), []
    length = max(SLOT_M, 1.2 * cut.feed_m_s + 0.07)
    for seed in seeds:
        out = run_trial(settings, length, incident, seed, cut)
        right = incident.event is not None and out.events.get(incident.event, -1.0) > incident.at_m - 3.0 * MM
        seen += right
        for event in out.events:
            # Chatter above 70 Hz is seen by the slow detector as well, up to half the rate of the telegrams.
            low = event == Event.LOW_CHATTER and incident.event == Event.CHATTER
            if event != incident.event and not low:
                false[event.name.lower().replace("_", " ")] += 1
        could.append(out.seen[incident.event] if incident.event is not None else 1.0)
    return seen, false, float(np.mean(could))


def grid(cuts: dict[str, Cut], seeds: Sequence[int]) -> None:
    """Print a row for each cut, then totals."""
    missed, errors, trials, wanted, announced = (Counter[str]() for _ in range(5))
    print(f"{'cut':32} {'a tooth breaks':>15} {'chatter':>9}   false alarms, of {len(seeds)} each")
    for name, cut in cuts.items():
        cells, wrong = {}, []
        hidden = hidden_tooth(cut.turn_per_s, cut.teeth, cut.sample_s)
        for what, incident in incidents(cut).items():
            seen, false, _ = counts(cut, incident, seeds)
            trials[what] += len(seeds)
            if incident.event is not None:
                cells[what] = f"{seen} of {len(seeds)}"
                if what == "a tooth breaks" and hidden is not None and hidden.mostly:
                    cells[what] = f"said, {cells[what]}"
                    announced[what] += len(seeds)
                else:
                    missed[what] += len(seeds) - seen
                    wanted[what] += len(seeds)
            for event, n in false.items():
                wrong.append(f"{event} {n} ({what})")
                errors[f"{event}, {what}"] += n
        print(
            f"{name:32} {cells.get('a tooth breaks', '-'):>15} {cells['chatter']:>9}   {', '.join(wrong) or 'none'}",
            flush=True,
        )
    for what, n in wanted.items():
        before = f"; said before the cut to be hidden in {announced[what]} more" if announced[what] else ""
        print(f"{what}: missed in {missed[what]} of {n}{before}")
    for key, n in sorted(errors.items()):
        print(f"false: {key}: {n} of {trials[key.split(', ')[1]]}")


def one_cut(seeds: Sequence[int]) -> None:
    """Print a slot with all that can go wrong, and wear."""
    print(
        f"noise: {SETTINGS.z:.2f} standard deviations, {SETTINGS.false_alarms_per_h:g} false alarms an hour; model:"
        f" {100.0 * SETTINGS.model_error:.0f} %; wear: decision interval {SETTINGS.cusum:.2f}"
    )
    sound = [run_trial(SETTINGS, SLOT_M, Incident(), seed).events for seed in seeds]
    print(f"{'sound slot of 120 mm':28s} false alarms in {sum(bool(e) for e in sound)} of {len(sound)}")
    for name, incident in CASES:
        event = incident.event
        if event is None:
            continue
        after = []
        for seed in seeds:
            found = run_trial(SETTINGS, SLOT_M, incident, seed).events
            if event in found:
                after.append((found[event] - incident.at_m) / MM)
        middle = f"{np.median(after):5.1f} mm" if after else "      -"
        print(f"{name:28s} seen in {len(after)} of {len(seeds)}, after {middle} (median)")
    few = list(seeds)[: max(1, len(seeds) // 5)]
    for rise in (0.0, 0.1, 0.3):
        trials = [run_trial(SETTINGS, LONG_M, Incident(Event.WEAR, 0.0, rise), seed) for seed in few]
        at = [trial.events[Event.WEAR] for trial in trials if Event.WEAR in trial.events]
        trend = np.array([trial.trend_per_m for trial in trials])
        said = f"after {np.median(at):.2f} m (median)" if at else ""
        print(
            f"{f'wear, {100 * rise:.0f} % more force per m':28s} seen in {len(at)} of {len(few)} {said}, trend"
            f" {100.0 * trend.mean():+.1f} +- {100.0 * trend.std():.1f} % per m"
        )


def main() -> None:
    """Print the tables asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=60, help="trials per row")
    parser.add_argument("--first", type=int, default=10_000, help="first seed")
    parser.add_argument("--grid", action="store_true", help="false and missed alarms over speeds, teeth and widths")
    parser.add_argument("--others", action="store_true", help="the same for kinds of cut that nothing was tuned on")
    parser.add_argument("--quick", action="store_true", help="a smoke run: one seed, two cuts")
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    if chosen.quick:
        grid({"500 Hz exactly": OTHERS["500 Hz exactly"], "two teeth": Cut(speed_rpm=15_000.0, teeth=2)}, seeds[:1])
    elif chosen.grid:
        cuts = {
            f"{rpm} rpm, {z} teeth, width {w:g} D": Cut(speed_rpm=float(rpm), teeth=z, width_share=w)
            for rpm, z in SPEEDS
            for w in WIDTHS
        }
        grid(cuts, seeds)
    elif chosen.others:
        grid(OTHERS, seeds)
    else:
        one_cut(seeds)


if __name__ == "__main__":
    main()
