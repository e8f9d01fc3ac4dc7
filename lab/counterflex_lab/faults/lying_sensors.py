"""Sensors that say what is not so while the correction acts: force (R15) and tracker (R18)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.core.units import MM, MS
from counterflex.protocols.processes.control_array import Request
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import ForceMode, ForceOffset, Lost, OnlineSettings
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.devices import COUNTS, RsiContext
from counterflex_lab.faults.aftermath import STANDING, settled, steady, words
from counterflex_lab.faults.demonstration import PERIOD_S, sensor_reading
from counterflex_lab.faults.rig import Rig, rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario
from counterflex_lab.faults.tracked_tool import SimulatedTracker

_AFTER: Final = 700
_FOLLOWED_M: Final = 0.1 * MM
"""How far a correction may go with something that is not so, before it is not believed."""
_REPORT_WITHIN: Final = 50
"""Cycles within which something must be said."""
_RAIL_N: Final = (2**31 - 1) / COUNTS


def _tracker(
    effort: Effort,
    *,
    lie: Callable[[SimulatedTracker], None],
    cycles: int = 0,
    goes_on: bool = False,
    set_back: bool = False,
    settings: OnlineSettings | None = None,
    named: Cause | None = None,
) -> Outcome:
    """The tracker lies from some cycle on; with ``cycles`` so many, and then no more.

    Args:
        effort: How much it may take.
        lie: Makes it lie.
        cycles: See above; 0: to the end.
        goes_on: Nothing but going on is right.
        set_back: Its clock is set back: that is noticed once, said, and its samples are used again.
        settings: Of the loop; None: the measured force and the tracker's integrator.
        named: Cause that must be said.
    """
    with rigged(effort, sensors="both", force=steady, context=RsiContext(), settings=settings) as rig:
        after, tracker = settled(rig, STANDING), _tracker_of(rig)
        lie(tracker)
        if cycles:
            rig.run(cycles)
            tracker.silent = tracker.frozen = False
            tracker.status, tracker.change, tracker.stamp = 0, None, None
        rig.run(_AFTER - cycles)
    reported = any("TRACKER" in cause.name or cause in _OF_A_TRACKER for cause in after.causes)
    reported = reported and (named is None or named in after.causes)
    right = rig.state == State.ACTIVE if goes_on else reported
    noticed = not set_back or (reported and rig.session.set_back == 1)
    return after.safe(after.followed_m <= _FOLLOWED_M and right and noticed)


def _tracker_of(rig: Rig) -> SimulatedTracker:
    if rig.tracker is None:
        raise SimulationError("there is no tracker")
    return rig.tracker


_OF_A_TRACKER: Final = (Cause.DIVERGENCE, Cause.WRONG_FRAME)


def _moved(x_mm: float, y_mm: float, z_mm: float) -> Callable[[Float], Float]:
    def change(T: Float) -> Float:
        out = T.copy()
        out[:3, 3] += np.array([x_mm, y_mm, z_mm]) * MM
        return out

    return change


def _jumps(x_mm: float, y_mm: float, z_mm: float) -> Callable[[SimulatedTracker], None]:
    def lie(tracker: SimulatedTracker) -> None:
        tracker.change = _moved(x_mm, y_mm, z_mm)

    return lie


def _silent(tracker: SimulatedTracker) -> None:
    tracker.silent = True


def _frozen(tracker: SimulatedTracker) -> None:
    tracker.frozen = True


def _stuck(tracker: SimulatedTracker) -> None:
    tracker.stuck = True


def _status(bits: int) -> Callable[[SimulatedTracker], None]:
    def lie(tracker: SimulatedTracker) -> None:
        tracker.status = bits

    return lie


def _spoilt(T: Float) -> Float:
    out = T.copy()
    out[1, 3] = np.nan
    return out


def _not_a_number(tracker: SimulatedTracker) -> None:
    tracker.change = _spoilt


def _stamps(late_s: tuple[float, ...]) -> Callable[[SimulatedTracker], None]:
    """Time stamps that are off, one value after the other."""

    def lie(tracker: SimulatedTracker) -> None:
        count = iter(range(10**9))
        tracker.stamp = lambda ns: max(0, ns + round(late_s[next(count) % len(late_s)] / 1e-9))

    return lie


def _unseen(effort: Effort) -> Outcome:
    """The beam is broken before the loop is armed: it is not armed and says why; it is when the target is seen."""
    with rigged(effort, sensors="both") as rig:
        tracker = _tracker_of(rig)
        tracker.status = BEAM_BROKEN
        rig.control[Request.ARM] = 1
        rig.run(300)
        state, cause = rig.state, rig.seen.reported[-1]
        tracker.status = 0
        rig.run(300)
    return Outcome(
        state < State.ARMED and cause != Cause.NONE and rig.state == State.ARMED,
        f"{state.name.lower()} ({words(cause)}); seen again: {rig.state.name.lower()}",
    )


def _force(effort: Effort, *, lie: Callable[[], Callable[[Float], Float]], causes: tuple[Cause, ...]) -> Outcome:
    """The force sensor lies from some cycle on."""
    with rigged(effort, force=steady, context=RsiContext()) as rig:
        after = settled(rig, STANDING)
        rig.sensed = lie()
        rig.run(_AFTER)
    return after.safe(after.followed_m <= _FOLLOWED_M and any(cause in causes for cause in after.causes))


def _rail() -> Callable[[Float], Float]:
    return lambda w: np.r_[w[0], _RAIL_N, w[2:]]


def _same() -> Callable[[Float], Float]:
    recent: list[Float] = []

    def sensed(w: Float) -> Float:
        recent.append(w.copy())
        return recent[0]

    return sensed


_REPORTED: Final = (Cause.FORCE_OFFSET, Cause.FORCE_SATURATED)


def _units(effort: Effort) -> Outcome:
    """The sensor's counts are of another unit than its document says, from the beginning."""
    reports = []
    for factor in (1e3, 4.448):
        with rigged(effort, force=steady) as rig:
            rig.idle = np.array([0.0, 0.0, 5.0])
            rig.sensed = lambda w, f=factor: np.clip(w * f, -_RAIL_N, _RAIL_N)
            rig.control[Request.ARM] = 1
            rig.run(400)
            reports.append((factor, rig.state, rig.seen.reported[-1]))
    return Outcome(
        all(state < State.ARMED and cause in _REPORTED for _, state, cause in reports),
        "; ".join(f"times {f:g}: {s.name.lower()} ({words(c)})" for f, s, c in reports),
    )


def _plan() -> LoopPlan:
    """The path of the demonstration's robot, with the force that acts there."""
    x = np.linspace(0.04, 0.12, 801)
    w = np.zeros((801, 6))
    w[:, :3] = steady(0.0)
    return LoopPlan(np.stack([x, 0.0 * x, 0.0 * x], axis=1), (x - x[0]) / 0.025, w, np.ones(801), np.zeros((801, 6)))


def _off(effort: Effort, *, n: float, mode: ForceMode) -> Outcome:
    """The force that the sensor shows is off by so much in the cut; what was planned is known."""
    settings = OnlineSettings(force=mode, force_offset=ForceOffset.HOLD)
    add = sensor_reading() @ np.r_[0.0, n, 0.0, 0.0, 0.0, 0.0]
    with rigged(effort, force=steady, settings=settings, plan=_plan(), context=RsiContext()) as rig:
        after = settled(rig, 150)
        rig.sensed = lambda w: w + add
        rig.run(200)
    said = [k + 1 for k, cause in enumerate(rig.seen.reported[after.begin :]) if cause == Cause.FORCE_OFFSET]
    when = f"told after {said[0] * PERIOD_S:.3f} s" if said else "never told"
    passed = bool(said) and said[0] <= _REPORT_WITHIN and after.hold_s is not None
    return after.safe(passed, said=f"{when}; ")


_REQUIRED: Final = "not followed by more than 0.1 mm, named; never the cut without its correction"


def _tracked(name: str, injected: str, required: str, lie: Callable[[SimulatedTracker], None], **how: Any) -> Scenario:
    return Scenario("R18", name, injected, required, partial(_tracker, lie=lie, **how), sensors=("both",))


def _fused(lost: Lost) -> OnlineSettings:
    """One estimator of force and tracker."""
    return OnlineSettings(force=ForceMode.FUSED, normal_only=False, tracker_lost=lost)


_OFF: Final = _jumps(0.3, 0.4, 0.0)
SCENARIOS: Final = (
    _tracked("tracker-jump-1m", "the tracker is off by 1 m from now on", _REQUIRED, _jumps(0.0, 1000.0, 0.0)),
    _tracked("tracker-jump-2mm", "the same by 2 mm", _REQUIRED, _jumps(0.0, 2.0, 0.0)),
    _tracked("tracker-jump-0.5mm", "the same by 0.5 mm", _REQUIRED, _OFF),
    _tracked(
        "tracker-one-outlier",
        "a single sample is off by 1 m",
        "not followed, goes on",
        _jumps(0.0, 1000.0, 0.0),
        cycles=1,
        goes_on=True,
    ),
    *(
        _tracked(f"tracker-{name}-{lost.name.lower()}", injected, _REQUIRED, lie, settings=_fused(lost))
        for lost in Lost
        for name, injected, lie in (
            ("fused-0.5mm", f"the same by 0.5 mm; force = fused, tracker_lost = {lost.name.lower()}", _OFF),
            ("fused-silent", "the same, the tracker says nothing any more", _silent),
            ("fused-frozen", "the same, it sends the last pose again and again", _frozen),
        )
    ),
    _tracked("tracker-silent", "the tracker says nothing any more", _REQUIRED, _silent),
    _tracked("tracker-frozen", "it sends the last pose again and again, with new times", _REQUIRED, _frozen),
    _tracked(
        "tracker-stuck",
        "it sends its last pose with noise",
        "named as frozen; not followed by more than 0.1 mm",
        _stuck,
        named=Cause.TRACKER_FROZEN,
    ),
    _tracked("tracker-occluded", "its beam is broken", _REQUIRED, _status(BEAM_BROKEN)),
    _tracked(
        "tracker-occluded-60ms",
        "its beam is broken for 60 ms",
        "goes on afterwards, no step",
        _status(BEAM_BROKEN),
        cycles=15,
        goes_on=True,
    ),
    _tracked("tracker-doubts", "it doubts its own values", _REQUIRED, _status(INACCURATE)),
    _tracked("tracker-nan", "its poses hold no number", _REQUIRED, _not_a_number),
    _tracked(
        "tracker-stamps",
        "its time stamps are a second ahead, then back, by turns",
        _REQUIRED,
        _stamps((1.0, 0.0, -1.0, 30.0)),
    ),
    _tracked(
        "tracker-late",
        "its clock is set back by 100 ms",
        "noticed and named, goes on by the new time; not followed by more than 0.1 mm",
        _stamps((-100.0 * MS,)),
        goes_on=True,
        set_back=True,
    ),
    Scenario(
        "R18",
        "tracker-unseen",
        "its beam is broken before the loop is armed",
        "not armed, and why; armed when the target is seen",
        _unseen,
        sensors=("both",),
    ),
    Scenario(
        "R15",
        "force-rail",
        "the force sensor's counts stand at the end of their range, without a bit in its status",
        "not followed by more than 0.1 mm, named; never the cut without its correction",
        partial(_force, lie=_rail, causes=(Cause.FORCE_SATURATED,)),
    ),
    Scenario(
        "R15",
        "force-frozen",
        "the force sensor sends the same values again and again",
        "the same",
        partial(_force, lie=_same, causes=(Cause.FORCE_STALE, Cause.FORCE_INVALID)),
    ),
    *(
        Scenario(
            "R17",
            f"force-off-{mode.name.lower()}{n:+g}",
            f"the force is off by {n:g} N in the cut, from now on; force = {mode.name.lower()}, 300 N are planned",
            "feed hold, named within 0.2 s",
            partial(_off, n=n, mode=mode),
        )
        for mode in (ForceMode.MEASURED, ForceMode.PILOT)
        for n in (150.0, -150.0)
    ),
    Scenario(
        "R17",
        "force-units",
        "the sensor's counts are mN, or pounds taken for N: 5 N of weight show as 5000 and 22",
        "not armed, and said",
        _units,
    ),
)
