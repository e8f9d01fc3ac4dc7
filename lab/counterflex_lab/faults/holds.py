"""Holds that last, the log, the zero, the job: nothing goes on uncorrected or unknown: R14 to R17, R23, R32."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError
from counterflex.core.units import MM
from counterflex.programs.compensated import job_number
from counterflex.protocols.processes.control_array import Kept, Request, Tally
from counterflex.protocols.session.session import SessionChecks
from counterflex.runtime.record_ring import MOST, RecordRing
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.devices import OnlineLimits, RsiContext, RsiFiles, parse_config
from counterflex_lab.faults.aftermath import MOVING, Aftermath, described, settled, words
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.rig import Rig, rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_LEAST_M: Final = 0.1 * MM
_JOBS: Final = ("0123456789abcdef", "fedcba9876543210")


def _steady(_: float) -> Float:
    return np.array([0.0, 450.0, 0.0])


def _in_cut(effort: Effort, **given: Any) -> Rig:
    """A rig whose controller stops by itself, in a cut of one force."""
    return rigged(effort, force=_steady, context=RsiContext(), **given)


def _silent(effort: Effort, *, cycles: int, holds_feed: bool) -> Outcome:
    """The force sensor says nothing for some cycles, 0: any more."""
    with _in_cut(effort, holds_feed=holds_feed) as rig:
        after, run_before = settled(rig), rig.run_cycles
        correction = rig.robot.correction[:3].copy()
        rig.sense = False
        way = []
        for k in range(700):
            rig.sense = 0 < cycles <= k
            rig.cycle()
            missing = float(np.linalg.norm(rig.robot.correction[:3] - correction))
            way.append((rig.run_cycles - run_before, missing, rig.robot.feed_hold))
    stopped, hold, happened = rig.robot.stopped, after.first(State.HOLD), described(after.path)
    if cycles:
        passed = rig.state == State.ACTIVE and hold is not None
        happened += f"; {after.step_m / MM:.3f} mm at most in a cycle"
    elif holds_feed:
        ramped = after.first(State.RAMP_OUT)
        uncorrected = way[-1][0] - way[ramped or 0][0]
        feed_held = all(feed_hold for _, _, feed_hold in way[ramped or 0 :])
        passed = ramped is not None and uncorrected == 0 and feed_held and stopped == "Stop"
        happened = (
            f"{described(after.path, 5)}; feed held to the end, {uncorrected} cycles gone on without the correction"
        )
        happened += f"; robot: {stopped}"
    else:
        lost = max(missing for _, missing, _ in way[3:])
        ended = (rig.state, rig.loop.cause) == (State.FAULT, Cause.HELD_TOO_LONG)
        passed = ended and stopped == "Stop" and lost < _LEAST_M
        happened += f"; the robot went on for {way[-1][0] * PERIOD_S:.2f} s, its correction changed"
        happened += f" by {lost / MM:.3f} mm; robot: {stopped}"
    return after.outcome(passed, happened, safe_s=after.first_s(State.HOLD))


def _stopped(effort: Effort, *, holds_feed: bool) -> Outcome:
    """The operator's stop in the cut: never without the correction while the robot moves, and an end in any case."""
    with _in_cut(effort, holds_feed=holds_feed) as rig:
        after, lost = settled(rig), 0.0
        rig.control[Request.STOP] = 1
        for _ in range(700):
            before, run_before = rig.robot.correction[:3].copy(), rig.run_cycles
            rig.cycle()
            if rig.run_cycles != run_before:
                lost += float(np.linalg.norm(rig.robot.correction[:3] - before))
    state, stopped = rig.state, rig.robot.stopped
    ended = state <= State.READY if holds_feed else (state, rig.loop.cause) == (State.FAULT, Cause.HELD_TOO_LONG)
    happened = f"while the robot moved its correction changed by {lost / MM:.3f} mm; robot: {stopped}"
    passed = ended and stopped == "Stop" and lost < _LEAST_M
    return after.outcome(passed, f"{described(after.path)}; {happened}", safe_s=after.first_s(State.HOLD))


def _log(effort: Effort, *, holds: bool) -> Outcome:
    """Nobody takes the records: before arming, then while the correction acts."""
    ring = RecordRing()
    try:
        checks = SessionChecks(hold_without_log=holds)
        with rigged(effort, force=_steady, ring=ring, checks=checks) as rig:
            rig.control[Request.ARM] = 1
            rig.run(300)
            refused, why = rig.state, Cause(int(rig.loop.given.soft))
            rig.control[Kept.TAKEN] = ring.count
            rig.activate()
            for _ in range(MOVING):
                rig.control[Kept.TAKEN] = ring.count
                rig.cycle()
            after = Aftermath(rig)
            rig.run(MOST + 10)
    finally:
        ring.close()
    first = after.first(State.HOLD)
    return after.outcome(
        refused < State.ARMED and why == Cause.LOG_LOST and rig.state == (State.HOLD if holds else State.ACTIVE),
        f"not armed ({words(why)}); then {described(after.path)}"
        + (f", {first * PERIOD_S:.1f} s after the recorder stood still" if first else ""),
    )


def _broken() -> int:
    raise OutputError("the sensor's driver failed")


def _internal(effort: Effort) -> Outcome:
    """Reading a sensor raises what nobody has thought of."""
    with _in_cut(effort) as rig:
        after = settled(rig)
        rig.force_link.drain = _broken
        rig.run(60)
    fault, stopped, trouble = after.first(State.FAULT), rig.robot.stopped, rig.session.trouble
    return after.outcome(
        fault is not None and fault <= 2 and stopped == "Stop" and trouble != "",
        f"{described(after.path)}; robot: {stopped}; said: {trouble}",
        safe_s=after.first_s(State.FAULT),
    )


def _tare(effort: Effort) -> Outcome:
    """The sensor shows 25 N without a cut; then the load is put right."""
    with rigged(effort) as rig:
        rig.idle = np.array([0.0, 0.0, 25.0])
        rig.control[Request.ARM] = 1
        rig.run(400)
        refused, cause = rig.state, Cause(int(rig.loop.given.soft))
        shown = rig.control[Tally.IDLE_MN] * 1e-3
        rig.idle = np.array([0.0, 0.0, 5.0])
        after = Aftermath(rig)
        rig.run(150)
    armed = after.first(State.ARMED)
    return Outcome(
        refused < State.ARMED and cause == Cause.FORCE_OFFSET and abs(shown - 25.0) < 1.0 and armed is not None,
        f"not armed ({words(cause)}, {shown:.1f} N said); "
        + ("never armed" if armed is None else f"armed {armed * PERIOD_S:.2f} s after the load was put right"),
    )


def _job(effort: Effort) -> Outcome:
    """The robot program says another job's number, then the right one."""
    text = RsiFiles("counterflex", "192.168.1.10", 49152, "ImFree", OnlineLimits(2.0, 0.3, 1.5, 4)).ethernet()
    config = parse_config(text.encode(), "made")
    ours, other = (job_number(job) for job in _JOBS)
    ends = []
    with rigged(effort, config=config, checks=SessionChecks(job=ours)) as rig:
        for scale in (other, ours):
            rig.force_scale = float(scale)
            rig.control[Request.ARM] = 1
            rig.enable = False
            rig.run(200)
            armed = rig.state
            rig.enable = True
            rig.run(5)
            ends.append((armed, rig.state, rig.loop.cause))
    wrong, right = ends
    return Outcome(
        wrong == (State.ARMED, State.READY, Cause.WRONG_JOB) and right[:2] == (State.ARMED, State.ACTIVE),
        f"armed, {wrong[1].name.lower()} ({words(wrong[2])}); with the right one {right[1].name.lower()}",
    )


SCENARIOS: Final = (
    Scenario(
        "R14",
        "driver-fails",
        "reading the force sensor raises an error that nobody has thought of",
        "fault within 2 cycles, the robot is told to stop, the operator what failed",
        _internal,
    ),
    Scenario(
        "R16",
        "force-silent-60ms",
        "no force for 60 ms; the robot holds its feed",
        "hold; then active again, from where the correction stood",
        partial(_silent, cycles=15, holds_feed=True),
    ),
    Scenario(
        "R16",
        "force-silent",
        "no force any more; the robot holds its feed",
        "hold, ramped out while the robot stands, feed held to the end, then told to stop",
        partial(_silent, cycles=0, holds_feed=True),
    ),
    Scenario(
        "R16",
        "no-feed-hold",
        "no force any more; the robot goes on although a feed hold is asked for",
        "never without its correction: told to stop with the correction as it is (0.1 mm)",
        partial(_silent, cycles=0, holds_feed=False),
    ),
    Scenario(
        "R16",
        "stop-in-the-cut",
        "the operator's stop in the cut; the robot holds its feed",
        "ramped out where it stands, then told to stop; 0.1 mm while it moves",
        partial(_stopped, holds_feed=True),
    ),
    Scenario(
        "R16",
        "stop-disobeyed",
        "the operator's stop in the cut; the robot goes on although a feed hold is asked for",
        "never without its correction: told to stop with the correction as it is (0.1 mm)",
        partial(_stopped, holds_feed=False),
    ),
    Scenario(
        "R17",
        "wrong-load",
        "25 N without a cut; then 5 N",
        "not armed, and said; armed as soon as the load is right, without anything being started again",
        _tare,
    ),
    Scenario(
        "R23",
        "log-lost-warn",
        "nobody takes the records, before arming and while the correction acts; without_log = warn",
        "not armed; goes on",
        partial(_log, holds=False),
    ),
    Scenario(
        "R23",
        "log-lost-hold",
        "the same with without_log = hold",
        "not armed; holds when the first record is lost",
        partial(_log, holds=True),
    ),
    Scenario(
        "R32",
        "other-job",
        "the robot program says the number of another job",
        "not active; with the right number it is",
        _job,
    ),
)
