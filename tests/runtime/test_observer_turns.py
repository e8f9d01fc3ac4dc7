"""The observer of a tracker where the feed turns: it corrects across the feed, and is not fed by what it has sent."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import counterflex
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import Delays, ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.supervisor import State

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
T = 0.004
FEED = 0.02
RADIUS = 0.015
CYCLES = round(2.0 * np.pi * RADIUS / FEED / T)  # once round
OFF = np.array([150e-6, -100e-6, 80e-6])


def on_circle(time_s: Float) -> Float:
    turn = FEED * time_s / RADIUS
    return np.stack([RADIUS * np.sin(turn), RADIUS * (1.0 - np.cos(turn)), 0.0 * turn], axis=-1)


def course(*, along_feed: bool) -> tuple[Float, Float, Float, Float]:
    """What remains along the feed, across it and along the tool, and what was corrected along the feed, (n,) each.

    The robot is of second order, and late.
    """
    time_s: Float = np.asarray(np.arange(0, round(1.1 * CYCLES)) * T, dtype=np.float64)
    p, n = on_circle(time_s), len(time_s)
    plan = LoopPlan(p, time_s, np.zeros((n, 6)), np.zeros(n), np.zeros((n, 6)))
    settings = OnlineSettings(force=ForceMode.NONE, tracker=TrackerMode.OBSERVER, normal_only=not along_feed)
    loop = Loop(CELL.chain, settings, CELL.T_base_part, plan)
    delays = Delays()
    w, damping, dead = delays.natural_per_s, delays.damping, round(delays.dead_s / T)
    made, rate, sent = np.zeros(3), np.zeros(3), [np.zeros(3)] * (dead + 1)
    seen, remaining = pose.make(R, p[0] + OFF), []
    for k in range(CYCLES):
        nominal = pose.make(R, p[max(0, k - 3)])
        loop.feed(CycleInputs(T_part_tcp=nominal, q=Q, T_part_actual=seen, arm=k == 1, enable=k >= 2))
        loop.run()
        sent.append(loop.correction[:3].copy())
        rate = rate + T * (w * w * (sent[-1 - dead] - made) - 2.0 * damping * w * rate)
        made = made + T * rate
        seen = pose.make(R, nominal[:3, 3] + made + OFF)  # a cycle old when it is read
        remaining.append(made + OFF)
    assert loop.state == State.ACTIVE
    left = np.array(remaining)
    turn = FEED * time_s[:CYCLES] / RADIUS
    feed = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    side = np.stack([-np.sin(turn), np.cos(turn), 0.0 * turn], axis=1)
    return np.sum(left * feed, axis=1), np.sum(left * side, axis=1), left[:, 2], np.sum((left - OFF) * feed, axis=1)


def test_a_tool_that_is_off_all_the_way_is_corrected_across_the_feed_while_it_turns() -> None:
    _, across, axial, corrected_along = course(along_feed=False)
    settled = slice(CYCLES // 4, None)
    assert np.abs(axial[settled]).max() < 3e-6
    # what is across the feed turns by FEED / RADIUS rad/s; the robot's answer is late by Delays.correction_s
    late = float(np.hypot(OFF[0], OFF[1])) * FEED / RADIUS * Delays().correction_s
    assert np.abs(across[settled]).max() < 2.0 * late
    assert np.abs(corrected_along[settled]).max() < 2.0 * late


def test_with_the_feed_all_of_it_is_corrected() -> None:
    for left in course(along_feed=True)[:3]:
        assert np.abs(left[CYCLES // 4 :]).max() < 6e-6
