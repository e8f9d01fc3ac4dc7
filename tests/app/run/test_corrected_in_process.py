"""Effects of the loop on the simulated cell, cycle by cycle in one process: pairs of the same truth and seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.inputs import Job, read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.app.run.loop import loop_plan
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.sensing import SensorTable, flange_sensor
from counterflex.files.plan_file import read_plan
from counterflex.geometry import pose
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.design.axis_pid import design
from counterflex.runtime.design.tracker_plant import TrackerPlant
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.sensing.spindle_inertia import SpindleInertia
from counterflex.runtime.settings import Delays, ForceMode, OnlineSettings, Output, Pilot
from counterflex.runtime.state.supervisor import State
from counterflex.signals.filters import Smoothing
from counterflex.signals.limiter import MotionLimit
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.live.live_cell import LiveCell, Report
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex.twin.truth.truth import Truth

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
WIDE = MotionLimit(4e-3, 0.08, 5.0)


@dataclass(frozen=True)
class Setup:
    """A cell, a program, the truth and the plan of the original program."""

    cell: Cell
    job: Job
    truth: Truth
    plan: LoopPlan


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    folder = tmp_path_factory.mktemp("plan")
    file, program = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"
    cell = read_cell(file)
    compensate(program, file, folder / "plan", report=False, programmed_feed=True)
    plan = loop_plan(read_plan(folder / "plan" / "plan.parquet")[0], cell, compensated=False)
    return Setup(cell, read_job(program, cell), truth_of(cell, 1), plan)


@dataclass
class Milled:
    """What happened while it milled, one row per cycle after the start.

    Attributes:
        p: (n, 3) m, deviation of the tool from the commanded point, part axes.
        force_error: (n, 3) N, force given to the loop less the true mean force.
        loop: As it was left.
        active: Share of the cycles in which it corrected.
    """

    p: Float
    force_error: Float
    loop: Loop
    active: float


def mill(
    setup: Setup,
    chosen: OnlineSettings,
    *,
    answer: PathAnswer | None = None,
    cycles: int = 650,
    plan: LoopPlan | None = None,
    sensor: bool = True,
    tracker: Callable[[int], float | None] | None = None,
    change: Callable[[Truth], Truth] = lambda truth: truth,
    reported: bool = False,
    **live: Any,
) -> Milled:
    """Mill with the loop in the same process; the tracker says the age of its sample in a cycle, or None."""
    truth = change(setup.truth)
    cell = LiveCell(
        setup.job.machined,
        truth=truth,
        controller=simulate.controller(setup.cell),
        stock=setup.cell.stock(),
        cutter=setup.cell.cutter(1),
        datum_points_part=setup.cell.datum_points_part,
        answer=answer,
        **live,
    )
    cell.skip_to_contact()
    device = force_sensor(truth, 0, "sensor", hose_share=0.0)
    bias = device.w_bias.tolist()
    weighed = flange_sensor(SensorTable(segment="sensor", bias_n=bias[:3], bias_nm=bias[3:]), setup.cell.chain)
    assert weighed is not None
    reading = SensorWrench(setup.cell.chain, weighed, setup.cell.T_base_part)
    loop = Loop(setup.cell.chain, chosen, setup.cell.T_base_part, plan)
    inertia = None
    if chosen.inertia_hz > 0.0:
        inertia = SpindleInertia(setup.cell.chain, weighed, setup.cell.T_base_part, chosen.inertia_hz, chosen.period_s)
    has = (Source.FORCE if sensor else Source.NOTHING) | (Source.TRACKER if tracker else Source.NOTHING)
    rng = np.random.default_rng(5)
    samples: list[Float] = []

    def on_step(i: int) -> None:
        if i % 2:
            w = device.reading(device.true_wrench(cell.plant, truth.gravity_base), cell.time_s, 20.0)
            samples.append(w + rng.standard_normal(6) * np.r_[np.ones(3), np.full(3, 0.1)])

    cell.on_step = on_step  # type: ignore[method-assign]
    zero, sent, past = np.zeros(6), (np.zeros(6), np.zeros(6)), []
    out, errors, active = [], [], 0
    for k in range(cycles):
        if k == 100:
            cell.start()
        report: Report = cell.advance(*sent)
        w = reading(report.q_command, np.mean(samples[-4:], axis=0), 0.0).copy()
        if 30 <= k < 80:
            zero += w / 50.0
        w = w - zero if k >= 80 else np.zeros(6)
        if inertia is not None:
            stand = np.concatenate([report.T_part_actual[:3, :3].reshape(-1), report.T_part_actual[:3, 3]])
            w = inertia(stand, w, loop.compliance, 1)
        past.append(pose.inverse(cell.T_base_part) @ cell.plant.tcp_pose())
        late = None if tracker is None else tracker(k)
        shown = None if late is None else past[max(0, k - round(late / chosen.period_s))].copy()
        if shown is not None:
            shown[:3, 3] += 15e-6 * rng.standard_normal(3)
        loop.feed(
            CycleInputs(
                T_part_tcp=report.T_part_nominal,
                q=report.q_command,
                w_tcp_part=w if sensor else None,
                force_age=0 if sensor else 1000,
                T_part_actual=shown,
                T_part_reported=report.T_part_actual if reported else None,
                tracker_late_s=late,
                arm=k == 90,
                enable=k > 95,
                sources=has,
            )
        )
        loop.run()
        sent = (
            (np.zeros(6), loop.axes.copy()) if chosen.output == Output.AXES else (loop.correction.copy(), np.zeros(6))
        )
        if k >= 100:
            out.append(past[-1][:3, 3] - report.T_part_nominal[:3, 3])
            sums = cell._process.sums
            errors.append(w[:3] - sums[:3] / max(sums[8], 1.0))
            active += loop.state == State.ACTIVE
        if report.finished:
            break
    return Milled(np.array(out), np.array(errors), loop, active / len(out))


def test_light_filters_are_stable_with_the_inertia_taken_out(setup: Setup) -> None:
    """A robot that answers at 15 Hz, force filtered at 12 Hz: the loop swings up with m a, and does not without."""
    light = OnlineSettings(
        force=ForceMode.MEASURED,
        smoothing=Smoothing(12.0, 4, 4e-3),
        translation=WIDE,
        hard_factor=2.0,
        normal_only=False,
    )
    fast = PathAnswer(8e-3, 15.0, 0.7)
    left_in = mill(setup, light, answer=fast)
    taken_out = mill(setup, replace(light, inertia_hz=25.0), answer=fast)
    rest = slice(350, 500)
    assert np.std(left_in.p[rest, 1]) > 0.4e-3
    assert np.std(taken_out.p[rest, 1]) < 0.15e-3
    assert np.std(taken_out.force_error[rest, 1]) < 0.25 * np.std(left_in.force_error[rest, 1])


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_fused_with_tracker_or_late_photogrammetry_beats_force_and_plan(setup: Setup, late: float) -> None:
    """Same truth: force and plan leave the model's error; 250 Hz at once, or 10 Hz and 200 ms late, take it out."""
    delays = Delays(dead_s=16e-3, tracker_s=0.0)
    fused = OnlineSettings(
        force=ForceMode.FUSED,
        pilot=Pilot(lead_s=delays.correction_s),
        delays=delays,
        translation=WIDE,
        hard_factor=2.0,
    )
    blind = mill(setup, fused, plan=setup.plan, cycles=900)
    every = 25 if late > 0.0 else 1
    seeing = mill(setup, fused, plan=setup.plan, cycles=900, tracker=lambda k: late if k % every == 0 else None)
    left, rest = (np.linalg.norm(m.p[600:790, 1:], axis=1) for m in (blind, seeing))
    assert np.sqrt(np.mean(rest**2)) < 0.5 * np.sqrt(np.mean(left**2))
    assert seeing.loop.result.uncertain < 0.2 * blind.loop.result.uncertain


def test_a_pid_per_axis_makes_the_correction_quicker(setup: Setup) -> None:
    """A controller that answers with 3 Hz, force measured, same truth: corrected sooner, nothing swings."""
    delays = Delays(dead_s=12e-3, natural_per_s=2.0 * np.pi * 3.0)
    alone = OnlineSettings(
        force=ForceMode.MEASURED, output=Output.AXES, delays=delays, translation=WIDE, hard_factor=2.0
    )
    plant = TrackerPlant(4e-3, delays.dead_s, delays.natural_per_s, delays.damping, 2.0 * np.pi * 10.0, 0.1, 0.06)
    helped = replace(alone, axis_pid=(design(plant).gains,) * 6)
    slow = PathAnswer(12e-3, 3.0, 0.7)
    before, after = (mill(setup, s, plan=setup.plan, answer=slow, reported=True).p[:, 1:] for s in (alone, helped))
    entry, middle = slice(100, 300), slice(400, 550)
    assert rms(after[entry]) < 0.92 * rms(before[entry])
    assert rms(after[middle]) < rms(before[middle]) + 0.03e-3


def rms(p: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(p**2, axis=1))))
