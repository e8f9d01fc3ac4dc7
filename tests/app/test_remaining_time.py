"""The time left is told within a factor of two from a quarter of the work on, with the weights of the jobs' parts."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from counterflex.app import compensate, prove
from counterflex.core.meter import Meter
from counterflex.core.progress import in_parts
from counterflex.identify import kinematics, stiffness

# Seconds that the parts took on two busy cores: of the UR10 and the first two parts of a proof by the jobs' own clocks,
# in earlier runs; of the others processor time as tools/measure_progress.py prints it, at a load of 4 to 5.
MEASURED: dict[str, tuple[Mapping[str, float], Mapping[str, float]]] = {
    "identify kinematics, a published UR10": (
        kinematics.WORK,
        {"checking the data": 2.0, "geometry": 3.7, "sag and play": 0.1, "periodic errors": 12.7, "held out": 25.8,
         "sessions and regions held out": 27.8},
    ),
    "identify kinematics, 400 poses of the simulated cell": (
        kinematics.WORK,
        {"checking the data": 0.25, "geometry": 0.65, "sag and play": 0.01, "periodic errors": 0.83, "held out": 1.37,
         "sessions and regions held out": 1.42},
    ),
    "identify stiffness, 160 pulls": (
        stiffness.WORK,
        {"checking the data": 0.06, "compliances": 0.15, "regions of stiffness": 0.43, "held out": 0.16},
    ),
    "identify stiffness, 40 pulls": (
        stiffness.WORK,
        {"checking the data": 0.08, "compliances": 0.12, "regions of stiffness": 0.06, "held out": 0.15},
    ),
    "prove, a groove": (
        prove._work(4.4, 1, 3, 2, told=True),
        {"planning": 1.9, "planning, seed 1": 1.5, "starting the simulated cells": 10.0, "machining": 3.0,
         "judging": 0.5},
    ),
    "compensate, the test part": (
        compensate.WORK,
        {"reading the program": 0.01, "planning": 7.17, "writing the program": 0.36},
    ),
}  # fmt: skip


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("name", MEASURED)
@pytest.mark.parametrize("share", [0.25, 0.4, 0.6, 0.8])
def test_the_time_left_is_told_within_a_factor_of_two(name: str, share: float) -> None:
    work, took = MEASURED[name]
    assert set(work) == set(took)  # a part that is named otherwise would be left out
    clock = Clock()
    meter = Meter(name, clock)
    parts = in_parts(meter, work)
    total = sum(took.values())
    for part in work:
        for step in range(1, 51):
            clock.now += took[part] / 50.0
            parts[part](step / 50.0)
            if clock.now >= share * total:
                left = meter.left_s()
                assert left is not None
                assert 0.5 <= left / (total - clock.now) <= 2.0
                return
