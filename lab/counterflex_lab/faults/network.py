"""Faults of the network between controller and loop: R3 to R7."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.runtime.state.supervisor import State
from counterflex.twin.network.impairment import Burst, Impairment, Stall
from counterflex_lab.faults.demonstration import PERIOD_S, force_only
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

OLDEST: Final = 4
"""Cycles that a correction in force may be old."""
LARGEST_STEP_M: Final = 0.40e-3
"""Largest step that the robot may see."""
_MOVING: Final = 125
"""Cycles after which the force changes and the correction begins to move as fast as it may."""
_ROUNDING: Final = 1e-6
"""A telegram's numbers have four decimal places of a millimetre, and three coordinates."""
_GOES_ON: Final = WatchSettings(hold_late=30, fault_late=30, share_late=0.5)


def described(path: list[str], most: int = 6) -> str:
    """States in a row, shortened."""
    return ", ".join(path[:most]) + (f", ... ({len(path)} in all)" if len(path) > most else "")


def standing_from(rig: Rig, first: int) -> int:
    """First cycle from ``first`` on after which the correction at the robot stands still, ramps to zero, or is zero.

    A ramp to zero is the slow, limited reaction that follows a hold; what counts is when following the target ended.
    """
    acts = [k for k in range(first, len(rig.seen.state)) if rig.seen.state[k] == State.ACTIVE]
    return acts[-1] + 1 if acts else first


def _random(loss: float, share: float) -> Scenario:
    """Independent losses: how old corrections become where nothing holds, and what the loop does as it is set."""

    def run(effort: Effort) -> Outcome:
        made = Impairment(loss=loss)
        cycles = effort.pick(30_000, 1_500)
        with Rig(
            made, made, seed=effort.seed, sensors=effort.sensors, watch=_GOES_ON, settings=force_only(lost_cycles=9)
        ) as rig:
            begin = rig.activate().cycle_count
            rig.run(cycles)
            age = np.array(rig.seen.age[begin:])
            free = float(rig.seen.steps()[begin - 1 :].max()) / rig.step_limit_m
        with Rig(made, made, seed=effort.seed, sensors=effort.sensors) as rig:
            begin = rig.activate().cycle_count
            rig.run(effort.pick(2_500, 500))
            step = float(rig.seen.steps()[begin - 1 :].max())
            path = rig.seen.path(begin)
        older = int(np.sum(age > OLDEST))
        most = (1.0 - share) * cycles
        most += 3.0 * np.sqrt(most) if effort.quick else 0.0  # a small sample shows chance
        young = 1.0 - older / cycles
        return Outcome(
            older <= most and free <= age.max() + 1.0 + _ROUNDING / 80e-6 and step <= LARGEST_STEP_M,
            f"{np.mean(age == 0):.2%} of {cycles} cycles answered in time, correction at most {OLDEST} cycles old in "
            f"{young:.4%}, oldest {age.max()}, largest step {free:.1f} times the loop's; as set: {described(path, 4)}",
            step,
            None,
            {"at_most_4_cycles_old_share": young, "oldest_cycles": float(age.max()), "cycles": float(cycles)},
        )

    return Scenario(
        "R3",
        f"random-{100 * loss:g}",
        f"{loss:.0%} of telegrams and of answers lost, each by itself; without any hold, then as set by default",
        f"correction in force at most {OLDEST} cycles old in {share:.2%} of cycles; as set: steps up to "
        f"{LARGEST_STEP_M * 1e3:.2f} mm",
        run,
    )


def _hold_outcome(
    requirement: str, name: str, injected: str, made: Impairment, back: Impairment | None, within_s: float
) -> Scenario:
    """Losses under which the loop must stop correcting, as it is set by default."""

    def run(effort: Effort) -> Outcome:
        cycles = effort.pick(2_500, 700)
        with Rig(made, back, seed=effort.seed, sensors=effort.sensors) as rig:
            begin = rig.activate().cycle_count
            rig.run(cycles)
            stopped = standing_from(rig, begin)
            path = rig.seen.path(begin)
            step = float(rig.seen.steps()[begin - 1 :].max())
            again = sum(part == "active" for part in path) - 1
        safe_s = (stopped - begin) * PERIOD_S
        holds = any(part.startswith(("hold", "fault")) for part in path)
        passed = holds and again == 0 and step <= LARGEST_STEP_M and safe_s <= within_s
        return Outcome(passed, f"{described(path)}; active again {again} times", step, safe_s)

    return Scenario(requirement, name, injected, f"stops within {within_s:g} s and stays so", run)


def _burst(mean: float) -> Scenario:
    """Bursts: after each one that is long enough it holds at once; in the long run it must not limp on."""

    def run(effort: Effort) -> Outcome:
        made = Impairment(burst=Burst(0.05, mean))
        runs, cycles = effort.pick(12, 3), 1_500
        steps, times, missed, paths = [], [], 0, []
        for k in range(runs):
            with Rig(made, made, seed=1000 * effort.seed + k, sensors=effort.sensors) as rig:
                begin = rig.activate().cycle_count
                rig.run(cycles)
                seen = rig.seen
                steps.append(float(seen.steps()[begin - 1 :].max()))
                stopped = standing_from(rig, begin)
                times.append((stopped - begin) * PERIOD_S)
                paths.append(seen.path(begin))
                acted = np.array([s == State.ACTIVE for s in seen.state[begin:]])
                missed += int(np.sum(acted & (np.array(seen.age[begin:]) > 10)))
        ended = sum(path[-1] != "active" for path in paths)
        faults = sum(any(part.startswith("fault") for part in path) for path in paths)
        return Outcome(
            ended == runs and missed == 0 and max(steps) <= LARGEST_STEP_M,
            f"{ended} of {runs} runs stopped, {faults} of them by a fault, the last one after "
            f"{max(times):.2f} s; e.g. {described(paths[0], 4)}",
            max(steps),
            float(np.median(times)),
            {"runs": float(runs), "active_with_older_than_10_cycles": float(missed)},
        )

    return Scenario(
        "R4",
        f"bursts-{mean:g}",
        f"5 % of telegrams and of answers lost in bursts, {mean:g} cycles long on average",
        "hold after 3 missed, fault after 10; never active with one older than 10 cycles; stops, does not limp",
        run,
    )


def _delay(effort: Effort) -> Outcome:
    """One second of 10 ms delay: once as the loop is set, once without a hold, so that the queue can be seen."""
    first, count = 300, 250
    made = Impairment(delay_s=10e-3, first=first, end=first + count)
    with Rig(made, seed=effort.seed, sensors=effort.sensors) as rig:
        begin = rig.activate().cycle_count
        rig.run(first + count + 50)
        stopped = standing_from(rig, begin + first)
        path = rig.seen.path(begin)
        step = float(rig.seen.steps()[begin - 1 :].max())
    watch = WatchSettings(hold_late=10**6, fault_late=10**6, share_late=0.999, clock=False)
    with Rig(made, seed=effort.seed, sensors=effort.sensors, watch=watch) as rig:
        begin = rig.activate().cycle_count
        rig.run(first + count + 50)
        age = np.array(rig.seen.age[begin:])
        late = rig.robot.late
    back = int(np.argmax(age[first + count :] == 0))
    return Outcome(
        back <= 1 and late == count and step <= LARGEST_STEP_M,
        f"{described(path)}; without a hold {late} answers late by the controller's count, fresh again {back} cycles "
        "after the end",
        step,
        (stopped - begin - first) * PERIOD_S,
        {"late": float(late), "cycles_until_fresh": float(back)},
    )


def _jitter(effort: Effort) -> Outcome:
    """Jitter of 2 to 12 ms on both ways, as the loop is set by default."""
    made = Impairment(delay_s=2e-3, jitter_s=10e-3)
    with Rig(made, made, seed=effort.seed, sensors=effort.sensors) as rig:
        begin = rig.activate().cycle_count
        rig.run(effort.pick(2_500, 500))
        stopped = standing_from(rig, begin)
        path = rig.seen.path(begin)
        step = float(rig.seen.steps()[begin - 1 :].max())
        again = sum(part == "active" for part in path) - 1
    return Outcome(
        again == 0 and rig.state != State.ACTIVE and step <= LARGEST_STEP_M,
        described(path),
        step,
        (stopped - begin) * PERIOD_S,
    )


def _copies(effort: Effort) -> Outcome:
    """Repeated telegrams change nothing: the corrections are those of a good network, bit for bit."""
    made = Impairment(duplicate=0.5, reorder_s=9e-3)
    cycles = effort.pick(2_500, 500)
    outcomes = []
    for way in (None, made):
        with Rig(way, seed=effort.seed, sensors=effort.sensors) as rig:
            begin = rig.activate().cycle_count
            rig.run(cycles)
            outcomes.append(np.array(rig.seen.correction_m))
            old = rig.link.counters.old
            step = float(rig.seen.steps()[begin - 1 :].max())
            state = rig.state
    same = bool(np.array_equal(outcomes[0], outcomes[1]))
    return Outcome(
        same and old > 0 and state == State.ACTIVE,
        f"{old} copies passed over, corrections {'the same bit for bit' if same else 'DIFFERENT'}",
        step,
    )


def _overtaken(effort: Effort) -> Outcome:
    """Telegrams that are overtaken are never answered; the correction keeps its steps."""
    made = Impairment(reorder=0.03, reorder_s=6e-3)
    with Rig(made, seed=effort.seed, sensors=effort.sensors, watch=_GOES_ON) as rig:
        begin = rig.activate().cycle_count
        rig.run(effort.pick(2_500, 1_000))
        old, refused = rig.link.counters.old, rig.robot.late
        step = float(rig.seen.steps()[begin - 1 :].max())
        state = rig.state
        oldest = max(rig.seen.age[begin:])
    return Outcome(
        state == State.ACTIVE and old > 0 and oldest <= OLDEST and step <= LARGEST_STEP_M,
        f"{old} overtaken telegrams passed over, {refused} cycles without an answer, oldest correction {oldest} cycles",
        step,
    )


def _gap(effort: Effort) -> Outcome:
    """Telegrams lost in a row while the correction moves as fast as it may."""
    largest, worst = 0.0, 0.0
    for lost in range(1, 13, effort.pick(1, 3)):
        for start in range(2, effort.pick(30, 4), effort.pick(4, 1)):
            made = Impairment(stalls=(Stall(_MOVING + start, lost, lost=True),))
            with Rig(made, seed=effort.seed, sensors=effort.sensors) as rig:
                begin = rig.activate().cycle_count
                rig.run(_MOVING + start + lost + 20)
                step = float(rig.seen.steps()[begin - 1 :].max())
                largest = max(largest, step)
                worst = max(worst, step / (min(lost + 1, 4) * rig.step_limit_m))
    return Outcome(
        worst <= 1.0 + _ROUNDING / 80e-6,
        f"1 to 12 telegrams lost in a row, at any moment: largest step {worst:.1%} of the elapsed cycles' (4 at most)",
        largest,
        None,
        {"of_limit_share": worst},
    )


SCENARIOS: Final = (
    _random(0.01, 0.9999),
    _random(0.05, 0.9999),
    _random(0.10, 0.999),
    _burst(3.0),
    _burst(8.0),
    _hold_outcome("R5", "alternating", "every second telegram lost", Impairment(pattern="10"), None, 0.504),
    _hold_outcome(
        "R5", "scattered-15", "3 of 20 telegrams lost, apart", Impairment(pattern="11101111110111111011"), None, 0.504
    ),
    Scenario(
        "R6",
        "delay",
        "telegrams delayed by 10 ms for one second",
        "stops; answers the newest only, late ones counted, fresh again within 1 cycle",
        _delay,
    ),
    Scenario(
        "R6", "jitter", "2 to 12 ms of delay on both ways, each by chance", "stops, does not limp; no queue", _jitter
    ),
    Scenario("R7", "copies", "half of the telegrams come twice", "ignored, counted, output unchanged", _copies),
    Scenario("R7", "overtaken", "3 % of the telegrams overtaken by the next", "never answered, counted", _overtaken),
    Scenario(
        "R8", "gaps", "1 to 12 telegrams lost in a row", "the step is that of the elapsed cycles, 4 at most", _gap
    ),
)
