"""The time left is told within a factor of two from a quarter of the work on, with the weights of the jobs' parts."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from counterflex.app.proof import prove
from counterflex.core.meter import Meter
from counterflex.core.progress import in_parts
from counterflex.identify.kinematics import recipe as kinematics
from counterflex.identify.stiffness import recipe as stiffness
from counterflex.plan.inputs import CORRECTION, JOINTS, MENDED, TRIAL, UNCOMPENSATED, UNDISTURBED, work_of

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
    "identify stiffness, 160 pulls, three regions tried": (
        stiffness.WORK,
        {"checking the data": 0.06, "compliances": 0.18, "regions of stiffness": 0.59, "held out": 0.32},
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
        prove._work(4.4, [1], 3, 2, exact=True),
        {"planning": 1.9, "planning, seed 1": 1.5, "starting the simulated cells": 10.0, "machining": 3.0,
         "judging": 0.5},
    ),
    "compensate, the test part of 100 s": (
        work_of(8896, 99.6, moves=True, mends=True, predicts=True),
        {JOINTS: 0.03, UNDISTURBED: 0.66, CORRECTION: 1.15, TRIAL: 2.60, MENDED: 2.07, UNCOMPENSATED: 2.23},
    ),
    "compensate, the test part at a fifth of its feed": (
        work_of(8896, 447.9, moves=True, mends=True, predicts=True),
        {JOINTS: 0.05, UNDISTURBED: 0.50, CORRECTION: 1.05, TRIAL: 12.89, MENDED: 13.05, UNCOMPENSATED: 13.96},
    ),
    "compensate, a slow groove": (
        work_of(374, 28.1, moves=True, mends=False, predicts=True),
        {JOINTS: 0.003, UNDISTURBED: 0.08, CORRECTION: 0.52, TRIAL: 0.70, UNCOMPENSATED: 0.71},
    ),
    "compensate, a slow groove, kernels loaded": (
        work_of(374, 28.1, moves=True, mends=False, predicts=True),
        {JOINTS: 0.003, UNDISTURBED: 0.01, CORRECTION: 0.07, TRIAL: 0.67, UNCOMPENSATED: 0.66},
    ),
    "compensate, a surface of 3000 moves by a robot without masses": (
        work_of(9138, 62.6, moves=False, mends=False, predicts=True),
        {JOINTS: 0.22, UNDISTURBED: 0.24, CORRECTION: 0.39, TRIAL: 0.31, UNCOMPENSATED: 0.29},
    ),
    "compensate, a surface of 10 000 moves by a robot without masses": (
        work_of(30154, 203.8, moves=False, mends=False, predicts=True),
        {JOINTS: 0.22, UNDISTURBED: 0.55, CORRECTION: 1.18, TRIAL: 0.92, UNCOMPENSATED: 0.97},
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
                left = meter.remaining_s()
                assert left is not None
                assert 0.5 <= left / (total - clock.now) <= 2.0
                return
