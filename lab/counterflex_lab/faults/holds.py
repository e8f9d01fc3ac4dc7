"""What must not go on uncorrected or unknown: holds that last, the log, the zero, the job: R14 to R17, R23, R32."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

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
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.network import LARGEST_STEP_M, described
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario
from counterflex_lab.faults.sessions import SETTLED, first_cycle

_LEAST_M: Final = 0.1 * MM
_JOBS: Final = ("0123456789abcdef", "fedcba9876543210")


def _steady(_: float) -> Float:
    return np.array([0.0, 450.0, 0.0])


def _silent(cycles: int, *, holds_feed: bool) -> Callable[[Effort], Outcome]:
    """The force sensor says nothing for some cycles, 0: any more."""

    def run(effort: Effort) -> Outcome:
        with Rig(
            seed=effort.seed, sensors=effort.sensors, force=_steady, holds_feed=holds_feed, context=RsiContext()
        ) as rig:
            rig.activate().run(SETTLED)
            begin, run_before = rig.cycle_count, rig.run_cycles
            correction = rig.robot.correction[:3].copy()
            rig.sense = False
            way = []
            for k in range(700):
                rig.sense = 0 < cycles <= k
                rig.cycle()
                missing = float(np.linalg.norm(rig.robot.correction[:3] - correction))
                way.append((rig.run_cycles - run_before, missing, rig.robot.feed_hold))
            path, stopped = rig.seen.path(begin), rig.robot.stopped
            step = float(rig.seen.steps()[begin - 1 :].max())
            hold = first_cycle(rig, State.HOLD, begin)
            after = first_cycle(rig, State.RAMP_OUT, begin)
            state, cause = rig.state, rig.loop.cause
        if cycles:
            passed = state == State.ACTIVE and step <= LARGEST_STEP_M and hold is not None
            happened = f"{described(path)}; {step / MM:.3f} mm at most in a cycle"
        elif holds_feed:
            ramped = 0 if after is None else after
            uncorrected = way[-1][0] - way[ramped][0]
            feed_held = all(feed_hold for _, _, feed_hold in way[ramped:])
            passed = after is not None and uncorrected == 0 and feed_held and stopped == "Stop"
            happened = (
                f"{described(path, 5)}; feed held to the end, {uncorrected} cycles gone on without the correction; "
                f"robot: {stopped}"
            )
        else:
            lost = max(missing for _, missing, _ in way[3:])
            passed = state == State.FAULT and cause == Cause.HELD_TOO_LONG and stopped == "Stop" and lost < _LEAST_M
            happened = f"{described(path)}; the robot went on for {way[-1][0] * PERIOD_S:.2f} s, its correction changed"
            happened += f" by {lost / MM:.3f} mm; robot: {stopped}"
        return Outcome(passed and step <= LARGEST_STEP_M, happened, step, None if hold is None else hold * PERIOD_S)

    return run


def _stopped(*, holds_feed: bool) -> Callable[[Effort], Outcome]:
    """The operator's stop in the cut: never without the correction while the robot moves, and an end in any case."""

    def run(effort: Effort) -> Outcome:
        with Rig(
            seed=effort.seed, sensors=effort.sensors, force=_steady, holds_feed=holds_feed, context=RsiContext()
        ) as rig:
            rig.activate().run(SETTLED)
            begin, lost = rig.cycle_count, 0.0
            rig.control[Request.STOP] = 1
            for _ in range(700):
                before, run_before = rig.robot.correction[:3].copy(), rig.run_cycles
                rig.cycle()
                if rig.run_cycles != run_before:
                    lost += float(np.linalg.norm(rig.robot.correction[:3] - before))
            path, stopped = rig.seen.path(begin), rig.robot.stopped
            step = float(rig.seen.steps()[begin - 1 :].max())
            hold = first_cycle(rig, State.HOLD, begin)
            state, cause = rig.state, rig.loop.cause
        ended = state <= State.READY if holds_feed else (state, cause) == (State.FAULT, Cause.HELD_TOO_LONG)
        return Outcome(
            ended and stopped == "Stop" and lost < _LEAST_M and step <= LARGEST_STEP_M,
            f"{described(path)}; while the robot moved its correction changed by {lost / MM:.3f} mm; robot: {stopped}",
            step,
            None if hold is None else hold * PERIOD_S,
        )

    return run


def _log(*, holds: bool) -> Callable[[Effort], Outcome]:
    """Nobody takes the records: before arming, then while the correction acts."""

    def run(effort: Effort) -> Outcome:
        ring = RecordRing()
        try:
            checks = SessionChecks(hold_without_log=holds)
            with Rig(seed=effort.seed, sensors=effort.sensors, force=_steady, ring=ring, checks=checks) as rig:
                rig.control[Request.ARM] = 1
                rig.run(300)
                refused, why = rig.state, Cause(int(rig.loop.given.soft))
                rig.control[Kept.TAKEN] = ring.count
                rig.activate()
                for _ in range(SETTLED):
                    rig.control[Kept.TAKEN] = ring.count
                    rig.cycle()
                begin = rig.cycle_count
                rig.run(MOST + 10)
                path, state = rig.seen.path(begin), rig.state
                step = float(rig.seen.steps()[begin - 1 :].max())
                first = first_cycle(rig, State.HOLD, begin)
        finally:
            ring.close()
        expected = State.HOLD if holds else State.ACTIVE
        return Outcome(
            refused < State.ARMED and why == Cause.LOG_LOST and state == expected and step <= LARGEST_STEP_M,
            f"not armed ({why.name.lower().replace('_', ' ')}); then {described(path)}"
            + (f", {first * PERIOD_S:.1f} s after the recorder stood still" if first else ""),
            step,
        )

    return run


def _internal(effort: Effort) -> Outcome:
    """Reading a sensor raises what nobody has thought of."""

    def broken() -> int:
        raise OutputError("the sensor's driver failed")

    with Rig(seed=effort.seed, sensors=effort.sensors, force=_steady, context=RsiContext()) as rig:
        rig.activate().run(SETTLED)
        begin = rig.cycle_count
        rig.force_link.drain = broken
        rig.run(60)
        fault = first_cycle(rig, State.FAULT, begin)
        path, stopped, trouble = rig.seen.path(begin), rig.robot.stopped, rig.session.trouble
        step = float(rig.seen.steps()[begin - 1 :].max())
    return Outcome(
        fault is not None and fault <= 2 and stopped == "Stop" and trouble != "" and step <= LARGEST_STEP_M,
        f"{described(path)}; robot: {stopped}; said: {trouble}",
        step,
        None if fault is None else fault * PERIOD_S,
    )


def _tare(effort: Effort) -> Outcome:
    """The sensor shows 25 N without a cut; then the load is put right."""
    with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
        rig.idle = np.array([0.0, 0.0, 25.0])
        rig.control[Request.ARM] = 1
        rig.run(400)
        refused = rig.state
        cause = Cause(int(rig.loop.given.soft))
        shown = rig.control[Tally.IDLE_MN] * 1e-3
        rig.idle = np.array([0.0, 0.0, 5.0])
        begin = rig.cycle_count
        rig.run(150)
        armed = first_cycle(rig, State.ARMED, begin)
    return Outcome(
        refused < State.ARMED and cause == Cause.FORCE_OFFSET and abs(shown - 25.0) < 1.0 and armed is not None,
        f"not armed ({cause.name.lower().replace('_', ' ')}, {shown:.1f} N said); "
        + ("never armed" if armed is None else f"armed {armed * PERIOD_S:.2f} s after the load was put right"),
    )


def _job(effort: Effort) -> Outcome:
    """The robot program says another job's number, then the right one."""
    text = RsiFiles("counterflex", "192.168.1.10", 49152, "ImFree", OnlineLimits(2.0, 0.3, 1.5, 4)).ethernet()
    config = parse_config(text.encode(), "made")
    ours, other = (job_number(job) for job in _JOBS)
    ends = []
    with Rig(seed=effort.seed, sensors=effort.sensors, config=config, checks=SessionChecks(job=ours)) as rig:
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
        f"armed, {wrong[1].name.lower()} ({wrong[2].name.lower().replace('_', ' ')}); with the right one "
        f"{right[1].name.lower()}",
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
        _silent(15, holds_feed=True),
    ),
    Scenario(
        "R16",
        "force-silent",
        "no force any more; the robot holds its feed",
        "hold, ramped out while the robot stands, feed held to the end, then told to stop",
        _silent(0, holds_feed=True),
    ),
    Scenario(
        "R16",
        "no-feed-hold",
        "no force any more; the robot goes on although a feed hold is asked for",
        "never without its correction: told to stop with the correction as it is (0.1 mm)",
        _silent(0, holds_feed=False),
    ),
    Scenario(
        "R16",
        "stop-in-the-cut",
        "the operator's stop in the cut; the robot holds its feed",
        "ramped out where it stands, then told to stop; 0.1 mm while it moves",
        _stopped(holds_feed=True),
    ),
    Scenario(
        "R16",
        "stop-disobeyed",
        "the operator's stop in the cut; the robot goes on although a feed hold is asked for",
        "never without its correction: told to stop with the correction as it is (0.1 mm)",
        _stopped(holds_feed=False),
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
        _log(holds=False),
    ),
    Scenario(
        "R23",
        "log-lost-hold",
        "the same with without_log = hold",
        "not armed; holds when the first record is lost",
        _log(holds=True),
    ),
    Scenario(
        "R32",
        "other-job",
        "the robot program says the number of another job",
        "not active; with the right number it is",
        _job,
    ),
)
