"""A controller that shows what is not so (R19), and a program whose Enable flickers (R37)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.devices import RsiContext
from counterflex_lab.faults.aftermath import aftermath, steady
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_SETTLED: Final = 250
_AFTER: Final = 700
_FOLLOWED_M: Final = 0.1 * MM
_HOLD_WITHIN_S: Final = 0.5
_Shown = Callable[[Report], Report]


def _false_report(shown: _Shown) -> Callable[[Effort], Outcome]:
    """From some cycle on the controller shows what is not so."""

    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors, force=steady, context=RsiContext()) as rig:
            rig.activate().run(_SETTLED)
            begin = rig.cycle_count
            rig.shown = shown
            rig.run(_AFTER)
            after = aftermath(rig, begin)
        ended = after.hold_s is not None and after.hold_s <= _HOLD_WITHIN_S
        return after.outcome(after.followed_m <= _FOLLOWED_M and ended and len(after.causes) > 0)

    return run


def _false_from_start(shown: _Shown) -> Callable[[Effort], Outcome]:
    """It shows what is not so from the beginning, as where the base or the tool is another one: it must not correct."""

    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors, force=steady, context=RsiContext()) as rig:
            rig.shown = shown
            rig.control[0] = 1
            for _ in range(400):
                rig.enable = rig.enable or rig.state == State.ARMED
                rig.cycle()
            begin = rig.cycle_count
            rig.feed = True
            rig.run(_AFTER)
            largest = max(float(np.linalg.norm(c)) for c in rig.seen.correction_m)
            after = aftermath(rig, begin)
        return replace(after, without=0).outcome(largest <= 2.0 * _FOLLOWED_M and len(after.causes) > 0)

    return run


def _turned(report: Report) -> Report:
    T: Float = report.T_part_actual.copy()
    T[:3, 3] = rotation.about_z(np.pi / 2) @ T[:3, 3]
    return replace(report, T_part_actual=T)


def _negated(report: Report) -> Report:
    """The robot's answer to the correction has the wrong sign."""
    T: Float = report.T_part_actual.copy()
    T[:3, 3] = 2.0 * report.T_part_nominal[:3, 3] - T[:3, 3]
    return replace(report, T_part_actual=T)


def _off(x_mm: float) -> _Shown:
    def shown(report: Report) -> Report:
        T: Float = report.T_part_actual.copy()
        T[0, 3] += x_mm * MM
        return replace(report, T_part_actual=T)

    return shown


def _axis(number: int, by_deg: float) -> _Shown:
    def shown(report: Report) -> Report:
        command, actual = report.q_command.copy(), report.q_actual.copy()
        command[number] += by_deg * DEG
        actual[number] += by_deg * DEG
        return replace(report, q_command=command, q_actual=actual)

    return shown


def _flickers(pattern: Callable[[int, np.random.Generator], bool], *, goes_on: bool) -> Callable[[Effort], Outcome]:
    """Enable as a pattern says, from some cycle on."""

    def run(effort: Effort) -> Outcome:
        rng = np.random.default_rng([effort.seed, 11])
        with Rig(seed=effort.seed, sensors=effort.sensors, force=steady, context=RsiContext()) as rig:
            rig.activate().run(_SETTLED)
            begin = rig.cycle_count
            for k in range(_AFTER):
                rig.enable = pattern(k, rng)
                rig.cycle()
            after = aftermath(rig, begin)
            active = rig.state == State.ACTIVE
        return after.outcome(active if goes_on else bool(after.causes))

    return run


def _for_good(k: int, _: np.random.Generator) -> bool:
    return k < 0


SCENARIOS: Final = (
    *(
        Scenario("R19", name, injected, required, _false_report(shown))
        for name, injected, required, shown in (
            (
                "rist-turned",
                "from now on the reported position (RIst) is turned by 90 deg about z",
                "held within 0.5 s and named; the correction stays, or the feed is held",
                _turned,
            ),
            ("rist-negated", "the reported answer to the correction has the wrong sign", "the same", _negated),
            ("rist-off", "the reported position is off by 30 mm", "the same", _off(30.0)),
            ("axis-2-off", "axis 2 is off by 20 deg, the pose of the same telegram is not", "the same", _axis(1, 20.0)),
            ("axis-6-off", "axis 6 by 5 deg", "the same", _axis(5, 5.0)),
        )
    ),
    *(
        Scenario("R19", name, injected, "never corrected by more than 0.2 mm, and why", _false_from_start(shown))
        for name, injected, shown in (
            ("rist-turned-before", "RIst is turned from the beginning", _turned),
            ("axis-2-off-before", "axis 2 is off by 20 deg from the beginning", _axis(1, 20.0)),
        )
    ),
    Scenario(
        "R37",
        "enable-one-cycle",
        "Enable is low for one cycle in the cut",
        "the cut goes on corrected",
        _flickers(lambda k, _: k != 0, goes_on=True),
    ),
    Scenario(
        "R37",
        "enable-flickers",
        "Enable is low in every second cycle, by chance",
        "the cut goes on corrected, or the feed is held and it is said",
        _flickers(lambda _, rng: bool(rng.random() < 0.5), goes_on=False),
    ),
    Scenario(
        "R37",
        "enable-off",
        "Enable is low from now on, the program and the cut go on",
        "the feed is held while the correction is away, and it is said",
        _flickers(_for_good, goes_on=False),
    ),
)
