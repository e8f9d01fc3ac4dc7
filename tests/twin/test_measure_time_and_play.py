"""Records, reversals and load steps of the simulated laboratory: what they show, late as they should be."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.core.units import MRAD, URAD
from counterflex.signals.lag import Lag
from counterflex.twin.laboratory import (
    record as measure_record,
    reversals as measure_reversals,
    servo_steps as measure_servo_steps,
)
from counterflex.twin.laboratory.instrument_clocks import InstrumentClocks
from counterflex.twin.laboratory.laboratory import Laboratory, laboratory
from counterflex.twin.truth.truth import Truth

POSE = np.radians([10.0, -80.0, 100.0, 15.0, 40.0, -20.0])


@pytest.fixture(scope="module")
def lab() -> Laboratory:
    return laboratory(3)


def swing(truth: Truth) -> dict[str, np.ndarray]:
    t = 0.004 * np.arange(501)
    q = np.repeat(POSE[None], len(t), axis=0)
    q[:, 0] += 5.0 * MRAD * np.sin(3.0 * t) ** 2
    tip = np.array([truth.rigid_tcp(row)[:3, 3] for row in q])
    columns = {"time_s": t, **{f"{a}_m": tip[:, i] for i, a in enumerate("xyz")}}
    return columns | {f"q{i + 1}_rad": q[:, i] for i in range(6)}


def test_clocks_are_the_laboratorys_own_and_repeat(lab: Laboratory) -> None:
    assert InstrumentClocks.of(lab) == InstrumentClocks.of(laboratory(3))
    assert InstrumentClocks.of(lab) != InstrumentClocks.of(laboratory(4))


def test_the_controller_shows_what_was_a_dead_time_before(truth: Truth, lab: Laboratory) -> None:
    request = swing(truth)
    seen = measure_record.measure(truth, lab, request, {})
    t = seen.channels["time_s"][:, 0]
    late = t - InstrumentClocks.of(lab).feedback.dead_time_s
    was = np.interp(late, t, seen.channels["q_motor"][:, 0])
    q = np.repeat(POSE[None], len(t), axis=0)
    q[:, 0] = was
    expected = np.array([truth.rigid_tcp(row)[:3, 3] for row in q])
    assert np.max(np.abs((seen.channels["p_base_tcp"] - expected)[30:, :2])) < 30e-6
    assert np.all(np.diff(seen.channels["time_tracker_s"][:, 0]) > 0.0)


def test_a_correction_goes_through_dead_time_and_lag(truth: Truth, lab: Laboratory) -> None:
    request = swing(truth)
    seen = measure_record.measure(truth, lab, request, {"through": "correction"})
    times = InstrumentClocks.of(lab)
    lagged = Lag(times.correction.lag_s).sensitivity(request["q1_rad"][:, None], 0.004)[0][:, 0]
    t = seen.channels["time_s"][:, 0]
    expected = np.interp(t - times.correction.dead_time_s, request["time_s"], lagged)
    assert np.max(np.abs(seen.channels["q_motor"][:, 0] - expected)) < 150.0 * URAD
    assert "p_base_command" not in seen.channels
    with pytest.raises(InputError, match="through"):
        measure_record.measure(truth, lab, request, {"through": "air"})


def reversal(axis: int) -> dict[str, np.ndarray]:
    columns = {f"q{i + 1}_rad": POSE[i : i + 1] for i in range(6)}
    return columns | {
        "axis": np.array([axis + 1.0]),
        "amplitude_rad": np.array([0.5 * MRAD]),
        "speed_rad_s": np.array([2.0 * MRAD]),
    }


def test_reversals_open_a_loop_of_play_and_friction(truth: Truth, lab: Laboratory) -> None:
    seen = measure_reversals.measure(truth, lab, reversal(0), {"seen_by": "link"})
    t, q = seen.channels["time_s"][:, 0], seen.channels["q_motor"][:, 0]
    slack = seen.channels["q_link"][:, 0] - q
    speed = np.gradient(q, t)
    late = InstrumentClocks.of(lab).link_dead_time_s
    slack = slack + late * speed
    stiffness = 1.0 / max(b.compliance[5] for b in truth.bodies if b.joint == 0)
    drive = truth.drives[0]
    width = drive.dead_band_rad + sum(drive.link_friction_nm) / stiffness
    ends = slack[np.abs(speed) > 1.8 * MRAD]
    assert 0.5 * (np.quantile(ends, 0.95) - np.quantile(ends, 0.05)) == pytest.approx(width, rel=0.4)
    moving = np.ptp(seen.channels["q_motor"], axis=0)
    assert int(np.argmax(moving)) == 0
    assert np.median(np.abs(slack)) < 100.0 * URAD


def test_a_tracker_sees_the_tool_move_with_the_axis(truth: Truth, lab: Laboratory) -> None:
    seen = measure_reversals.measure(truth, lab, reversal(0), {})
    p, q = seen.channels["p_tracker_target"], seen.channels["q_motor"][:, 0]
    lever = float(np.hypot(*truth.rigid_tcp(POSE)[:2, 3]))
    path = np.linalg.norm(p[int(np.argmax(q))] - p[int(np.argmin(q))])
    assert path == pytest.approx(lever * np.ptp(q), rel=0.2)
    with pytest.raises(InputError, match="seen_by"):
        measure_reversals.measure(truth, lab, reversal(0), {"seen_by": "eye"})


def test_motors_give_way_when_a_load_is_cut_and_come_back(truth: Truth, lab: Laboratory) -> None:
    request = {f"q{i + 1}_rad": POSE[i : i + 1] for i in range(6)}
    request |= {"fx_n": np.zeros(1), "fy_n": np.array([500.0]), "fz_n": np.zeros(1)}
    seen = measure_servo_steps.measure(truth, lab, request, {})
    error = (seen.channels["q_motor"] - seen.channels["q_command"])[:, 0]
    before = error[:45]
    assert np.max(np.abs(before - before.mean())) < 5.0 * URAD
    assert np.max(np.abs(error - before.mean())) > 30.0 * URAD
    assert np.abs(error[-10:].mean() - before.mean()) < 15.0 * URAD
    force = seen.channels["f_tcp_base"][:, 1]
    assert force[0] == pytest.approx(500.0, rel=0.01)
    assert force[-1] == 0.0
    with pytest.raises(InputError, match="lacks a column; got fx_n"):
        measure_servo_steps.measure(truth, lab, {k: v for k, v in request.items() if k != "fx_n"}, {})
