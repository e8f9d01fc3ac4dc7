"""Faults that only a comparison shows: a robot that corrects by less, other frames, another plan, another session.

Nothing fails here and every telegram is whole: R19 (robot and frames), R32 (plan), R9 (session), R15 and R16 (force).
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.protocols.processes.control_array import Request, Shown
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.devices import RsiContext
from counterflex_lab.faults.aftermath import STANDING, Aftermath, described, settled, steady, words
from counterflex_lab.faults.demonstration import PERIOD_S, sensor_reading
from counterflex_lab.faults.rig import PATIENT, Rig, rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_BEGUN_M: Final = 1e-5
_TOLD_S: Final = 1.0
_WRONG_S: Final = 0.12
"""Half of what a robot that does nothing with the correction took before."""
_FEED_M_S: Final = 0.025
_TIMEOUT: Final = 12
"""Cycles until a controller with Timeout 10 has stopped by itself, and two of the rig."""
_ONCE: Final = 380
"""Cycles until the robot's path begins anew."""


def _makes(answer: Callable[[Float], Float]) -> Callable[[Report], Report]:
    """A robot that makes something else of the correction, and reports it."""

    def shown(report: Report) -> Report:
        T: Float = report.T_part_actual.copy()
        nominal = report.T_part_nominal[:3, 3]
        T[:3, 3] = nominal + answer(T[:3, 3] - nominal)
        return replace(report, T_part_actual=T)

    return shown


def _clamped(c: Float) -> Float:
    return c * min(1.0, 0.5 * MM / max(1e-9, float(np.linalg.norm(c))))


def _first(found: int, k: int, so: bool) -> int:
    """First cycle in which it was so, -1 before."""
    return k if so and found < 0 else found


def _answers(effort: Effort, *, answer: Callable[[Float], Float], end: str, within_s: float) -> Outcome:
    """The robot answers so from the beginning."""
    with rigged(effort, force=steady, context=RsiContext()) as rig:
        rig.shown = _makes(answer)
        rig.activate()
        begun, reported, ended, missing_m, true_m, sent_m = -1, -1, -1, 0.0, 0.0, 0.0
        for k in range(_ONCE):
            rig.cycle()
            c = rig.loop.correction[:3]
            begun = _first(begun, k, float(np.linalg.norm(c)) > _BEGUN_M)
            reported = _first(reported, k, rig.seen.reported[-1] in (Cause.ANSWER_SHORT, Cause.WRONG_FRAME))
            ended = _first(ended, k, rig.state != State.ACTIVE)
            if rig.state == State.ACTIVE:
                sent_m = float(np.linalg.norm(c))
                missing_m = rig.control[Shown.MISSING_MOST_NM] * 1e-9
                true_m = float(np.linalg.norm(c - answer(c)))
    state, cause = rig.state, rig.loop.cause
    after = ((reported - begun) * PERIOD_S, (ended - begun) * PERIOD_S)
    happened = "went on" if ended < 0 else f"{state.name.lower()} ({words(cause)}) after {after[1]:.3f} s"
    happened += f" at {sent_m / MM:.2f} mm; " if ended >= 0 else "; "
    happened += "said: nothing" if reported < 0 else f"said after {after[0]:.3f} s: {missing_m / MM:.2f} mm missing"
    happened += f", true {true_m / MM:.2f} mm"
    passed = {
        "right": reported < 0 and ended < 0,
        "told": reported >= 0 and after[0] <= within_s and ended < 0 and abs(missing_m - true_m) < 0.2 * true_m,
        "fault": reported >= 0 and after[0] <= within_s and (state, cause) == (State.FAULT, Cause.ANSWER_SHORT),
        "wrong": ended >= 0 and after[1] <= within_s and (state, cause) == (State.FAULT, Cause.WRONG_FRAME),
    }[end]
    return Outcome(passed, happened, None, after[1] if ended >= 0 else None)


class _Ringing:
    """Reported pose that rings from when the robot stands."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._stood = rig, 0

    def __call__(self, report: Report) -> Report:
        self._stood += int(self._rig.stands)
        t = self._stood * PERIOD_S
        T: Float = report.T_part_actual.copy()
        size = 0.25 * MM * np.exp(-t / 0.15) * (t > 0.0)
        T[:3, 3] += size * np.array([np.cos(35.0 * t), 0.7, -0.5])
        return replace(report, T_part_actual=T)


def _rings(effort: Effort) -> Outcome:
    """The force falls silent; the robot holds its feed and its reported pose rings, along its motion and across."""
    with rigged(effort, force=lambda t: 0.5 * steady(t), context=RsiContext()) as rig:
        after = settled(rig, STANDING)
        rig.shown = _Ringing(rig)
        for k in range(700):
            rig.sense = k > 60
            rig.cycle()
    passed = rig.state == State.ACTIVE and after.causes == (Cause.FORCE_STALE,)
    return after.outcome(passed, f"{described(after.path)}; said: {', '.join(map(words, after.causes))}")


def _moved(offset_m: float, report: Report) -> Report:
    nominal, actual = report.T_part_nominal.copy(), report.T_part_actual.copy()
    nominal[1, 3] += offset_m
    actual[1, 3] += offset_m
    return replace(report, T_part_nominal=nominal, T_part_actual=actual)


def _base(effort: Effort, *, offset_mm: float, refused: bool) -> Outcome:
    """BASE of the program is off: all its poses are, its axis angles are not."""
    with rigged(effort) as rig:
        rig.shown = partial(_moved, offset_mm * MM)
        rig.control[Request.ARM] = 1
        rig.run(400)
    state, cause, learnt_mm = rig.state, rig.seen.reported[-1], rig.control[Shown.FRAME_NM] * 1e-6
    not_armed = state < State.ARMED and cause in (Cause.FRAME_OFFSET, Cause.WRONG_FRAME)
    right = not_armed if refused else state == State.ARMED
    happened = f"{state.name.lower()} ({words(cause)}); {learnt_mm:.3f} mm told"
    return Outcome(abs(learnt_mm - offset_mm) < 0.01 and right, happened)


def _plan(depth_m: float = 0.0, feed: float = 1.0, force: float = 1.0) -> LoopPlan:
    """The path of the demonstration's robot with the force that acts there: deeper, for another feed or material."""
    x = np.linspace(0.04, 0.12, 801)
    w = np.zeros((801, 6))
    w[:, :3] = force * steady(0.0)
    p = np.stack([x, 0.0 * x, np.full_like(x, -depth_m)], axis=1)
    return LoopPlan(p, (x - x[0]) / (_FEED_M_S * feed), w, np.ones(801), np.zeros((801, 6)))


def _other_plan(effort: Effort, *, expected: Cause, holds: bool, **plan: float) -> Outcome:
    settings = OnlineSettings(force=ForceMode.MEASURED)
    with rigged(effort, force=steady, settings=settings, plan=_plan(**plan), context=RsiContext()) as rig:
        after = Aftermath(rig.activate())
        rig.run(_ONCE)
    first = next((k for k, cause in enumerate(rig.seen.reported[after.begin :]) if cause == expected), -1)
    when = f"said after {first * PERIOD_S:.2f} s: {words(expected)}" if first >= 0 else "never said"
    passed = first >= 0 and first * PERIOD_S <= _TOLD_S and (after.hold_s is not None) == holds
    return after.safe(passed, said=f"{when}; ")


def _spikes(effort: Effort) -> Outcome:
    """Readings of 1500 N more, 2.5 % of them by chance."""
    rng = np.random.default_rng([effort.seed, 17])
    spike = sensor_reading() @ np.r_[0.0, 1500.0, 0.0, 0.0, 0.0, 0.0]
    with rigged(effort, force=steady, context=RsiContext()) as rig:
        after = settled(rig, STANDING)
        rig.sensed = lambda w: w + spike * float(rng.random() < 0.025)
        rig.run(700)
    corrections, spikes = after.corrections_m, int(rig.control[Shown.FORCE_SPIKES])
    moved = float(np.linalg.norm(corrections - corrections[0], axis=1).max())
    return Outcome(
        rig.state == State.ACTIVE and moved < 0.02 * MM and spikes > 0,
        f"{rig.state.name.lower()}; followed by {moved / MM:.3f} mm; {spikes} cycles with spikes left out and told",
    )


def _slow_sensor(effort: Effort) -> Outcome:
    """A force sensor that sends 100 readings a second, the least that is allowed."""
    with rigged(effort, force=steady, context=RsiContext()) as rig:
        rig.control[Request.ARM] = 1
        for k in range(1200):
            rig.enable = rig.enable or rig.state == State.ARMED
            rig.feed = rig.feed or rig.state == State.ACTIVE
            rig.sense = (2 * k) % 5 < 2  # every second or third cycle: 10 ms
            rig.cycle()
    active, said = sum(one == State.ACTIVE for one in rig.seen.state), words(rig.seen.reported[-1])
    return Outcome(rig.state == State.ACTIVE and active > 500, f"{rig.state.name.lower()} ({said}), {active} cycles")


def _elsewhere(effort: Effort) -> Outcome:
    """The controller is started again and sends from another port of its computer."""
    with (
        rigged(effort, force=steady, context=RsiContext(timeout=PATIENT)) as rig,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        settled(rig, STANDING)
        other.bind(("127.0.0.1", 0))
        other.setblocking(False)
        before = rig.robot_socket
        rig.restart_robot(1000)
        rig.enable = False
        rig.robot_socket = other
        cycles = 0
        while not rig.session.another_port and cycles < 60:
            rig.cycle()
            cycles += 1
        port, state, cause, own = rig.session.another_port, rig.state, rig.loop.cause, other.getsockname()[1]
        rig.robot_socket = before
    return Outcome(
        port == own and state == State.FAULT and cycles <= _TIMEOUT,
        f"{state.name.lower()} ({words(cause)}); said after {cycles} cycles: the controller sends from another port",
        None,
        cycles * PERIOD_S,
    )


def _refused(effort: Effort) -> Outcome:
    """The controller refuses every answer, because it expects another SENTYPE."""
    with rigged(effort, context=RsiContext(timeout=PATIENT)) as rig:
        rig.robot.config = replace(rig.config, sentype="Other")
        rig.control[Request.ARM] = 1
        rig.run(400)
        state, cause, refused = rig.state, rig.seen.reported[-1], rig.robot.late
    return Outcome(
        state < State.ARMED and cause == Cause.TELEGRAMS_LATE,
        f"{state.name.lower()} ({words(cause)}); {refused} answers refused",
    )


_FORCE: Final = ("force",)
SCENARIOS: Final = (
    *(
        Scenario(
            "R19",
            f"answer-{name}",
            injected,
            required,
            partial(_answers, answer=answer, end=end, within_s=within_s),
            sensors=_FORCE,
        )
        for name, injected, required, answer, end, within_s in (
            ("right", "nothing: the robot makes the correction", "goes on, nothing is said", np.copy, "right", 0.0),
            ("none", "the robot leaves the correction out", "fault within 0.12 s", np.zeros_like, "wrong", _WRONG_S),
            ("negated", "the robot makes the opposite of the correction", "the same", np.negative, "wrong", _WRONG_S),
            (
                "half",
                "the robot makes half of the correction",
                "told within 1 s; a fault beyond missing_mm (0.3 mm)",
                lambda c: 0.5 * c,
                "fault",
                _TOLD_S,
            ),
            ("clamped", "the robot makes 0.5 mm of the correction at most", "the same", _clamped, "told", _TOLD_S),
            (
                "three-quarters",
                "the robot makes 3/4 of the correction",
                "told within 1 s with its size (20 %), goes on",
                lambda c: 0.75 * c,
                "told",
                _TOLD_S,
            ),
        )
    ),
    Scenario(
        "R16",
        "hold-rings",
        "no force for 0.24 s; the robot stops and its reported pose rings by 0.25 mm",
        "held for the force alone, then active again",
        _rings,
        sensors=_FORCE,
    ),
    Scenario(
        "R19",
        "base-3mm",
        "BASE of the program is 3 mm off",
        "not armed; its size told",
        partial(_base, offset_mm=3.0, refused=True),
    ),
    Scenario(
        "R19", "base-0.5mm", "the same by 0.5 mm", "armed; its size told", partial(_base, offset_mm=0.5, refused=False)
    ),
    Scenario(
        "R32",
        "plan-deeper",
        "the plan is 2 mm deeper than the program",
        "held within 1 s of the contact, named",
        partial(_other_plan, expected=Cause.OFF_PATH, holds=True, depth_m=2.0 * MM),
    ),
    Scenario(
        "R32",
        "plan-0.7mm-deeper",
        "the same by 0.7 mm",
        "told within 1 s, goes on",
        partial(_other_plan, expected=Cause.OFF_PATH, holds=False, depth_m=0.7 * MM),
    ),
    Scenario(
        "R32",
        "plan-slower",
        "the plan is for half of the feed",
        "held within 1 s, named",
        partial(_other_plan, expected=Cause.FEED_DIFFERS, holds=True, feed=0.5),
    ),
    Scenario(
        "R32",
        "plan-faster",
        "the plan is for twice the feed",
        "told within 1 s, goes on",
        partial(_other_plan, expected=Cause.FEED_DIFFERS, holds=False, feed=2.0),
    ),
    Scenario(
        "R32",
        "plan-other-force",
        "the plan expects twice the force",
        "told within 1 s, goes on",
        partial(_other_plan, expected=Cause.FORCE_OFF_PLAN, holds=False, force=2.5),
    ),
    Scenario(
        "R15",
        "force-spikes",
        "2.5 % of the force sensor's readings are 1500 N more",
        "not followed by more than 0.02 mm, told",
        _spikes,
        sensors=_FORCE,
    ),
    Scenario(
        "R15",
        "force-100hz",
        "the force sensor sends 100 readings a second",
        "armed, active",
        _slow_sensor,
        sensors=_FORCE,
    ),
    Scenario(
        "R9",
        "another-port",
        "the controller is started again and sends from another port, while the correction acts",
        "said, and the run ends, within the controller's own timeout",
        _elsewhere,
        sensors=_FORCE,
    ),
    Scenario(
        "R19",
        "answers-refused",
        "the controller refuses every answer: it expects another SENTYPE",
        "not armed, and said",
        _refused,
    ),
)
