"""Faults of the network between controller and loop: R3 to R7."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.runtime.state.supervisor import State
from counterflex.twin.network.impairment import Burst, Impairment, Stall
from counterflex_lab.faults.aftermath import LARGEST_STEP_M, Aftermath, described
from counterflex_lab.faults.demonstration import PERIOD_S, force_only
from counterflex_lab.faults.rig import Rig, rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

OLDEST: Final = 4
"""Cycles that a correction in force may be old."""
_MOVING: Final = 125
"""Cycles after which the force changes and the correction begins to move as fast as it may."""
_STOPS_S: Final = 0.504
_ROUNDING: Final = 1e-6
"""A telegram's numbers have four decimal places of a millimetre, and three coordinates."""
_GOES_ON: Final = WatchSettings(hold_late=30, fault_late=30, share_late=0.5)


def _run(rig: Rig, cycles: int) -> Aftermath:
    """Correct for some cycles on the bad line, from the first of them on."""
    after = Aftermath(rig.activate())
    rig.run(cycles)
    return after


def _ages(rig: Rig, after: Aftermath) -> np.ndarray:
    return np.array(rig.seen.age[after.begin :])


def _random(effort: Effort, *, loss: float, share: float) -> Outcome:
    """Independent losses: how old corrections become where nothing holds, and what the loop does as it is set."""
    made, cycles = Impairment(loss=loss), effort.pick(30_000, 1_500)
    with rigged(effort, made, made, watch=_GOES_ON, settings=force_only(lost_cycles=9)) as rig:
        unheld = _run(rig, cycles)
        age, free = _ages(rig, unheld), unheld.step_m / rig.step_limit_m
    with rigged(effort, made, made) as rig:
        after = _run(rig, effort.pick(2_500, 500))
    older = int(np.sum(age > OLDEST))
    most = (1.0 - share) * cycles
    most += 3.0 * np.sqrt(most) if effort.quick else 0.0  # a small sample shows chance
    young = 1.0 - older / cycles
    return after.outcome(
        older <= most and free <= age.max() + 1.0 + _ROUNDING / 80e-6,
        f"{np.mean(age == 0):.2%} of {cycles} cycles answered in time, correction at most {OLDEST} cycles old in "
        f"{young:.4%}, oldest {age.max()}, largest step {free:.1f} times the loop's; as set: "
        f"{described(after.path, 4)}",
        at_most_4_cycles_old_share=young,
        oldest_cycles=float(age.max()),
        cycles=float(cycles),
    )


def _random_losses(loss: float, share: float) -> Scenario:
    return Scenario(
        "R3",
        f"random-{100 * loss:g}",
        f"{loss:.0%} of telegrams and of answers lost, each by itself; without any hold, then as set by default",
        f"correction in force at most {OLDEST} cycles old in {share:.2%} of cycles; as set: steps up to "
        f"{LARGEST_STEP_M * 1e3:.2f} mm",
        partial(_random, loss=loss, share=share),
    )


def _pattern(effort: Effort, *, pattern: str) -> Outcome:
    """Losses under which the loop must stop correcting, as it is set by default."""
    with rigged(effort, Impairment(pattern=pattern)) as rig:
        after = _run(rig, effort.pick(2_500, 700))
    holds = any(part.startswith(("hold", "fault")) for part in after.path)
    passed = holds and after.again == 0 and after.standing * PERIOD_S <= _STOPS_S
    happened = f"{described(after.path)}; active again {after.again} times"
    return after.outcome(passed, happened, safe_s=after.standing * PERIOD_S)


def _burst(effort: Effort, *, mean: float) -> Outcome:
    """Bursts: after each one that is long enough it holds at once; in the long run it must not limp on."""
    made, runs = Impairment(burst=Burst(0.05, mean)), effort.pick(12, 3)
    seen, missed = [], 0
    for k in range(runs):
        with rigged(effort, made, made, seed=1000 * effort.seed + k) as rig:
            after = _run(rig, 1_500)
            acted = np.array([s == State.ACTIVE for s in rig.seen.state[after.begin :]])
            missed += int(np.sum(acted & (_ages(rig, after) > 10)))
            seen.append(after)
    paths, times = [after.path for after in seen], [after.standing * PERIOD_S for after in seen]
    step_m = max(after.step_m for after in seen)
    ended = sum(path[-1] != "active" for path in paths)
    faults = sum(any(part.startswith("fault") for part in path) for path in paths)
    return Outcome(
        ended == runs and missed == 0 and step_m <= LARGEST_STEP_M,
        f"{ended} of {runs} runs stopped, {faults} of them by a fault, the last one after "
        f"{max(times):.2f} s; e.g. {described(paths[0], 4)}",
        step_m,
        float(np.median(times)),
        {"runs": float(runs), "active_with_older_than_10_cycles": float(missed)},
    )


def _bursts(mean: float) -> Scenario:
    return Scenario(
        "R4",
        f"bursts-{mean:g}",
        f"5 % of telegrams and of answers lost in bursts, {mean:g} cycles long on average",
        "hold after 3 missed, fault after 10; never active with one older than 10 cycles; stops, does not limp",
        partial(_burst, mean=mean),
    )


def _delay(effort: Effort) -> Outcome:
    """One second of 10 ms delay: once as the loop is set, once without a hold, so that the queue can be seen."""
    first, count = 300, 250
    made = Impairment(delay_s=10e-3, first=first, end=first + count)
    with rigged(effort, made) as rig:
        after = _run(rig, first + count + 50)
    watch = WatchSettings(hold_late=10**6, fault_late=10**6, share_late=0.999, clock=False)
    with rigged(effort, made, watch=watch) as rig:
        age = _ages(rig, _run(rig, first + count + 50))
        late = rig.robot.late
    back = int(np.argmax(age[first + count :] == 0))
    return after.outcome(
        back <= 1 and late == count,
        f"{described(after.path)}; without a hold {late} answers late by the controller's count, fresh again {back} "
        "cycles after the end",
        safe_s=max(after.standing - first, 0) * PERIOD_S,
        late=float(late),
        cycles_until_fresh=float(back),
    )


def _jitter(effort: Effort) -> Outcome:
    """Jitter of 2 to 12 ms on both ways, as the loop is set by default."""
    made = Impairment(delay_s=2e-3, jitter_s=10e-3)
    with rigged(effort, made, made) as rig:
        after = _run(rig, effort.pick(2_500, 500))
    passed = after.again == 0 and rig.state != State.ACTIVE
    return after.outcome(passed, described(after.path), safe_s=after.standing * PERIOD_S)


def _copies(effort: Effort) -> Outcome:
    """Repeated telegrams change nothing: the corrections are those of a good network, bit for bit."""
    outcomes = []
    for way in (None, Impairment(duplicate=0.5, reorder_s=9e-3)):
        with rigged(effort, way) as rig:
            after = _run(rig, effort.pick(2_500, 500))
            outcomes.append(np.array(rig.seen.correction_m))
    same, old = bool(np.array_equal(outcomes[0], outcomes[1])), rig.link.counters.old
    happened = f"{old} copies passed over, corrections {'the same bit for bit' if same else 'DIFFERENT'}"
    return Outcome(same and old > 0 and rig.state == State.ACTIVE, happened, after.step_m)


def _overtaken(effort: Effort) -> Outcome:
    """Telegrams that are overtaken are never answered; the correction keeps its steps."""
    made = Impairment(reorder=0.03, reorder_s=6e-3)
    with rigged(effort, made, watch=_GOES_ON) as rig:
        after = _run(rig, effort.pick(2_500, 1_000))
    old, oldest = rig.link.counters.old, max(rig.seen.age[after.begin :])
    return after.outcome(
        rig.state == State.ACTIVE and old > 0 and oldest <= OLDEST,
        f"{old} overtaken telegrams passed over, {rig.robot.late} cycles without an answer, oldest correction {oldest} "
        "cycles",
    )


def _gap(effort: Effort) -> Outcome:
    """Telegrams lost in a row while the correction moves as fast as it may."""
    largest, worst = 0.0, 0.0
    for lost in range(1, 13, effort.pick(1, 3)):
        for start in range(2, effort.pick(30, 4), effort.pick(4, 1)):
            made = Impairment(stalls=(Stall(_MOVING + start, lost, lost=True),))
            with rigged(effort, made) as rig:
                step = _run(rig, _MOVING + start + lost + 20).step_m
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
    _random_losses(0.01, 0.9999),
    _random_losses(0.05, 0.9999),
    _random_losses(0.10, 0.999),
    _bursts(3.0),
    _bursts(8.0),
    *(
        Scenario("R5", name, injected, f"stops within {_STOPS_S} s and stays so", partial(_pattern, pattern=pattern))
        for name, injected, pattern in (
            ("alternating", "every second telegram lost", "10"),
            ("scattered-15", "3 of 20 telegrams lost, apart", "11101111110111111011"),
        )
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
