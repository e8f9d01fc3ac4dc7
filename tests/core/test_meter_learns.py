"""The time left learns what parts cost here: weights that are wrong by a factor of three, on a virtual clock."""

from __future__ import annotations

import math
from collections.abc import Mapping
from random import Random

import pytest

from counterflex.core.meter import Meter
from counterflex.core.progress import Progress, in_parts, saying, share_of

WEIGHTS = {"read": 1.0, "check": 2.0, "fit": 3.0, "hold out": 3.0, "write": 1.0}


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def ratios(costs_s: Mapping[str, float], *, learns: bool = True, share: float = 0.25) -> list[float]:
    """Time left as told over the true one, from a share of the time to nine tenths of it.

    Args:
        costs_s: What the parts take.
        learns: The meter is told where parts end.
        share: From here on.
    """
    clock = Clock()
    meter = Meter("job", clock)
    parts = in_parts(meter if learns else meter.report, WEIGHTS)
    total, found = sum(costs_s.values()), []
    for name, cost_s in costs_s.items():
        for step in range(1, 41):
            clock.now_s += cost_s / 40.0
            parts[name](step / 40.0)
            if share * total <= clock.now_s <= 0.9 * total:
                left = meter.remaining_s()
                assert left is not None
                found.append(left / (total - clock.now_s))
    return found


@pytest.mark.parametrize("factor", [3.0, 1.0 / 3.0])
@pytest.mark.parametrize("wrong", ["read", "check", "fit"])
def test_a_part_wrong_by_three_is_learned_once_it_runs(wrong: str, factor: float) -> None:
    costs = {name: w * (factor if name == wrong else 1.0) for name, w in WEIGHTS.items()}
    before = sum(list(costs.values())[: list(costs).index(wrong)])
    # Nobody can know before it has run a little, nor from one part alone what the next will cost.
    known = before + 0.2 * costs[wrong] if wrong != "read" else costs["read"] + 0.15 * costs["check"]
    found = ratios(costs, share=max(0.25, known / sum(costs.values())))
    assert min(found) > 0.5
    assert max(found) < 2.0


def test_the_slow_reading_of_a_slow_disk_does_not_spoil_the_rest() -> None:
    costs = {**WEIGHTS, "read": 3.0}
    assert max(ratios(costs, share=0.3)) < 1.8


def test_learning_is_better_over_many_machines() -> None:
    """Factors of all parts drawn with two standard deviations at three: what is told is off less than without."""
    random = Random(1)
    off: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(150):
        costs = {name: w * 3.0 ** (0.5 * random.gauss(0.0, 1.0)) for name, w in WEIGHTS.items()}
        for learns, found in off.items():
            found += [abs(math.log(ratio)) for ratio in ratios(costs, learns=learns)]
    inside = {learns: sum(x < math.log(2.0) for x in found) / len(found) for learns, found in off.items()}
    assert inside[True] > 0.9
    assert sum(off[True]) < 0.85 * sum(off[False])


def test_starting_is_no_measure_of_going_on() -> None:
    """Kernels are loaded before the first of 40 equal pulls: 5 s, then 0.1 s each."""
    clock = Clock()
    meter = Meter("measuring", clock)
    clock.now_s += 5.0
    for pull in range(40):
        clock.now_s += 0.1
        meter(share_of_pulls := (pull + 1) / 40)
        left = meter.remaining_s()
        assert left is None or 0.5 <= left / max(4.0 * (1.0 - share_of_pulls), 1e-9) <= 2.0 or pull == 39
        assert (left is None) == (pull == 0)


@pytest.mark.parametrize("skipped", ["read", "check"])
def test_a_skipped_part_teaches_nothing(skipped: str) -> None:
    found = ratios({**WEIGHTS, skipped: 0.001})
    assert min(found) > 0.5
    assert max(found) < 2.0


def test_parts_of_parts_reach_the_meter_through_what_names_them() -> None:
    meter = Meter("job", Clock())
    outer = in_parts(meter, {"a": 1.0, "b": 3.0})
    in_parts(saying(outer["b"], "all the same"), {"x": 1.0, "y": 2.0})["x"](1.0)
    in_parts(share_of(outer["a"], 0.0, 0.5), {"u": 1.0, "v": 1.0})
    assert meter._ends == pytest.approx([0.0625, 0.125, 0.25, 0.5, 1.0])
    assert meter.fraction == pytest.approx(0.5)
    assert meter.what == "all the same"


def test_who_listens_plainly_hears_the_same() -> None:
    seen: list[float] = []

    def told(fraction: float, what: str = "") -> None:
        seen.append(fraction)

    listener: Progress = told
    in_parts(listener, WEIGHTS)["read"](1.0)
    assert seen == pytest.approx([0.1])
