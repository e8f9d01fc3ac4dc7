"""Loop gains recovered from load steps made with the planner's own servo model; modes from closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MS, URAD
from counterflex.files.cell.cell import read_cell
from counterflex.identify.data.changes import AxisServo, TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.servo import recipe as servo
from counterflex.identify.servo.data import load_steps, lowest_mode
from counterflex.identify.servo.residuals import Release, ServoResiduals, exchange_probability, motor_error
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.model.description import Servo
from derivative_check import convergence_order

ROOT = Path(__file__).resolve().parents[3]
STEP = 4.0 * MS
TRUE = tuple(Servo(k, 22.0, 0.07) for k in (1.5e5, 1.8e5, 1.0e5, 1.0e4, 1.1e4, 5e3))


def times(n: int) -> Float:
    out: Float = STEP * np.arange(n, dtype=np.float64)
    return out


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return model_of(read_cell(ROOT / "examples/cells/kr300_d16_flat.toml"))


def torque_of(step: Float, t: Float) -> Float:
    """Torque of the motors (n, 6): the load goes in 4 ms and the arm rings at 8 Hz."""
    after = np.clip(t - 0.2, 0.0, None)
    ring = np.where(t > 0.2, np.exp(-4.0 * after) * np.cos(2.0 * np.pi * 8.0 * after), 1.0)
    return np.asarray(
        step * ((1.0 - np.clip(after / 0.004, 0.0, 1.0))[:, None] + 0.3 * ring[:, None] * (t > 0.2)[:, None])
    )


def campaign(seed: int = 0, count: int = 5) -> Dataset:
    rng = np.random.default_rng(seed)
    t = times(300)
    rows: dict[str, list[Float]] = {k: [] for k in ("time_s", "q_command", "q_motor", "tau_motor", "f_tcp_base")}
    for _ in range(count):
        q = np.repeat(rng.uniform(-1.0, 1.0, 6)[None], len(t), axis=0)
        tau = 300.0 + torque_of(rng.uniform(-1.0, 1.0, 6) * np.array([800, 800, 600, 100, 100, 60.0]), t)
        error = servo_error(TRUE, q, -tau, t)
        rows["time_s"].append(t)
        rows["q_command"].append(q)
        rows["q_motor"].append(q + error + 0.5 * URAD * rng.standard_normal(q.shape))
        rows["tau_motor"].append(tau + 2.0 * rng.standard_normal(q.shape))
        rows["f_tcp_base"].append(np.where(t[:, None] <= 0.2, 500.0, 0.0) * np.array([0.6, 0.0, -0.8]))
    arrays = {key: np.concatenate(value) for key, value in rows.items()}
    return of_arrays(
        "steps",
        "servo_steps",
        arrays,
        {"q_motor": 0.5 * URAD, "tau_motor": 2.0},
        group=np.repeat(np.arange(count), 300),
    )


def test_the_loop_is_the_planners() -> None:
    rng = np.random.default_rng(1)
    tau = np.concatenate([[0.0], np.cumsum(rng.standard_normal(199))])
    t = times(200)
    known = servo_error((TRUE[0],), np.zeros((200, 1)), -tau[:, None], t)[:, 0]
    found, _ = motor_error(TRUE[0].speed_gain_nm_s, 22.0, 0.07, tau, STEP)
    assert found == pytest.approx(known, abs=1e-12 * np.max(np.abs(known)) + 1e-18, rel=1e-9)


def test_jacobian_is_the_derivative_and_gains_act_alike() -> None:
    rng = np.random.default_rng(2)
    tau = np.concatenate([np.zeros(10), 500.0 * np.ones(190)]) + 0.0
    block = ServoResiduals(0, (Release(0, STEP, tau, 1e-6 * rng.standard_normal(200), np.full(200, 1e-6)),))
    x = np.array([1.5e5, 25.0, 0.06])
    assert np.all(convergence_order(block, x, 0.05 * x) > 1.8)
    other = np.array([1.5e5, 1.0 / 0.06, 1.0 / 25.0])
    assert block.predict(other) == pytest.approx(block.predict(x), rel=1e-9, abs=1e-15)


def test_gains_are_recovered_and_other_steps_predicted(cell: CellModel) -> None:
    result = servo.RECIPE.identify(cell, [campaign()], [campaign(seed=5, count=2)], {})
    assert result.headline[0].value < 0.1 * (result.headline[0].nominal or 0.0)
    for axis in range(6):
        fit, name = result.fits[f"axis {axis + 1}"], f"axis{axis + 1}"
        gain = fit.value(f"{name}.speed_gain")
        assert gain == pytest.approx(
            TRUE[axis].speed_gain_nm_s, abs=4.0 * fit.sigma_of(f"{name}.speed_gain") + 0.003 * gain
        )
        rates = sorted([fit.value(f"{name}.position_gain"), 1.0 / fit.value(f"{name}.integral_time")])
        assert sum(rates) == pytest.approx(22.0 + 1.0 / 0.07, rel=0.05)
    gains = [c for c in result.changes if isinstance(c, AxisServo)]
    assert [c.axis for c in gains] == list(range(6))


def test_the_scale_of_the_torque_is_in_the_standard_deviation_of_the_gain(cell: CellModel) -> None:
    data = campaign(count=2)
    narrow = {f.name: f.value for f in servo.RECIPE.identify(cell, [data], [], {"torque_share": 0.0}).figures}
    wide = {f.name: f.value for f in servo.RECIPE.identify(cell, [data], [], {"torque_share": 0.05}).figures}
    key = "axis1_speed_gain"
    assert wide[f"{key}_nm_s"] == narrow[f"{key}_nm_s"]
    assert wide[f"{key}_sigma_nm_s"] == pytest.approx(
        np.hypot(narrow[f"{key}_sigma_nm_s"], 0.05 * narrow[f"{key}_nm_s"]), rel=1e-9
    )


@pytest.mark.parametrize(("hz", "zeta"), [(8.0, 0.05), (11.5, 0.15)])
def test_lowest_mode_and_damping(hz: float, zeta: float) -> None:
    rng = np.random.default_rng(3)
    t = 0.008 * np.arange(120)
    w = 2.0 * np.pi * hz

    def ring(f: float, z: float) -> Float:
        return np.asarray(np.exp(-z * 2 * np.pi * f * t) * np.cos(2 * np.pi * f * np.sqrt(1 - z * z) * t))

    signal = np.stack([ring(hz, zeta) + 0.5 * ring(2.4 * hz, 0.1), 0.4 * ring(hz, zeta) + np.exp(-15.0 * t)], axis=1)
    found = lowest_mode(1e-4 * signal + 1e-6 * rng.standard_normal(signal.shape), 0.008)
    assert found.frequency_hz == pytest.approx(w / (2.0 * np.pi), rel=0.01)
    assert found.damping == pytest.approx(zeta, abs=0.01)


def test_the_mode_goes_into_the_cell_file(cell: CellModel) -> None:
    data = campaign()
    t = np.tile(times(300), 5)
    after = np.clip(t - 0.2, 0.0, None)
    tip = 1e-3 * np.exp(-0.06 * 50.0 * after) * np.cos(50.0 * after) * (t > 0.2)
    arrays = {k: c.values for k, c in data.channels.items()} | {"p_tracker_target": np.repeat(tip[:, None], 3, axis=1)}
    whole = of_arrays(
        "s",
        "servo_steps",
        arrays,
        {"q_motor": 0.5 * URAD, "tau_motor": 2.0, "p_tracker_target": 1e-5},
        group=data.group,
    )
    result = servo.RECIPE.identify(cell, [whole], [], {})
    (table,) = [c for c in result.changes if isinstance(c, TableValues)]
    assert table.table == "dynamics"
    assert table.values["mode_hz"] == pytest.approx(50.0 / (2.0 * np.pi), rel=0.01)
    assert table.values["damping_ratio"] == pytest.approx(0.06, rel=0.05)


def changed(data: Dataset, name: str, values: Float) -> Dataset:
    channels = dict(data.channels)
    channels[name] = replace(channels[name], values=values)
    return replace(data, channels=channels)


def test_bad_input_is_named(cell: CellModel) -> None:
    data = campaign()
    with pytest.raises(InputError, match="sign of 'tau_motor'"):
        servo.RECIPE.identify(cell, [changed(data, "tau_motor", -data.values("tau_motor"))], [], {})
    with pytest.raises(InputError, match="far from their commands"):
        load_steps([changed(data, "q_motor", np.degrees(data.values("q_motor")))])
    with pytest.raises(FileFormatError, match="even times"):
        load_steps([data.rows(np.arange(len(data)) != 100)])
    with pytest.raises(InputError, match="no load is released"):
        load_steps([changed(data, "f_tcp_base", np.full((len(data), 3), 100.0))])
    with pytest.raises(InputError, match="too few rows"):
        load_steps([data.rows(np.arange(len(data)) < 30)])
    bad = data.values("q_motor").copy()
    bad[7, 2] = np.nan
    with pytest.raises(FileFormatError, match="not a number"):
        load_steps([changed(data, "q_motor", bad)])


def test_proposal_moves_every_motor(cell: CellModel) -> None:
    proposal = servo.RECIPE.propose(cell, 6, {"seed": 0})
    force = np.stack([proposal.columns[f"f{a}_n"] for a in "xyz"], axis=1)
    assert np.linalg.norm(force, axis=1) == pytest.approx(np.full(6, 500.0))
    assert np.all(force[:, 2] <= 0.0)
    assert all(0.0 < proposal.expected[f"axis{a}.speed_gain"] < 5e4 for a in range(1, 7))
    with pytest.raises(InputError, match="load steps to propose"):
        servo.RECIPE.propose(cell, 1, {})


def test_exchange_of_alike_rates_is_as_probable_as_what_was_known_says() -> None:
    """Law: both readings together are certain; equal priors leave them even; gains known to a tenth decide."""
    vague = Parameters.of(
        [
            Parameter("axis1.position_gain", "1/s", 20.0, 1.0, log=True),
            Parameter("axis1.integral_time", "s", 1.0 / 20.0, 1.0, log=True),
        ]
    )
    x, y = np.array([25.0, 1.0 / 14.0]), np.array([14.0, 1.0 / 25.0])
    assert exchange_probability(vague, x, 0, 1) == pytest.approx(0.5)
    known = Parameters.of([replace(p, nominal=n, prior_sigma=0.1) for p, n in zip(vague, (22.0, 0.07), strict=True)])
    assert exchange_probability(known, x, 0, 1) + exchange_probability(known, y, 0, 1) == pytest.approx(1.0)
    assert exchange_probability(known, x, 0, 1) < 1e-6


def record(sign: float = 1.0, shift_s: float = 0.02, **more: Float) -> Dataset:
    """Motors that follow a slow chirp of their commands, late."""
    t = times(1500)
    start, way = np.array([0.0, -1.2, 1.4, 0.1, 0.6, 0.0]), 0.02 * np.array([1.0, -0.8, 0.6, 0.9, -0.7, 0.5])

    def command(at: Float) -> Float:
        return np.asarray(start + way * np.sin(2.0 * np.pi * (0.3 * at + 0.1 * at**2))[:, None])

    noise = URAD * np.random.default_rng(3).standard_normal((len(t), 6))
    arrays = {"time_s": t, "q_command": command(t), "q_motor": sign * command(t - shift_s) + noise, **more}
    return of_arrays("chirp", "record", arrays, {"q_command": URAD, "q_motor": URAD})


@pytest.mark.long
def test_a_lag_used_as_stated_says_so(cell: CellModel) -> None:
    """What was found about a record was computed and thrown away."""
    turned = record(sign=-1.0)
    with pytest.raises(InputError, match="moves against"):
        servo.RECIPE.identify(cell, [turned], [], {})
    told = servo.RECIPE.identify(cell, [turned], [], {"as_stated": True}).remarks
    assert any("moves against" in text and "used as stated" in text for text in told)


def test_of_two_records_the_better_known_lag_is_written(cell: CellModel) -> None:
    """The last one was, and its fit stood in the place of the first."""
    good, vague = record(), record(shift_s=0.024)
    rough = replace(
        vague,
        channels={
            **vague.channels,
            "q_motor": replace(
                vague.channel("q_motor"),
                values=vague.values("q_motor") + 2e-3 * np.random.default_rng(4).standard_normal((1500, 6)),
            ),
        },
    )
    result = servo.RECIPE.identify(cell, [good, rough], [], {})
    (table,) = [c for c in result.changes if isinstance(c, TableValues) and c.table == "timing.drive"]
    times_ms = table.values["dead_time_ms"]
    assert isinstance(times_ms, list)
    assert len(result.fits) == 2
    assert float(np.mean(np.array(times_ms, dtype=np.float64))) == pytest.approx(20.0, abs=0.5)


def test_data_that_tell_nothing_are_named(cell: CellModel) -> None:
    """A record without a command, a hold-out without load steps, reversals that tell no friction: all passed over."""
    blind = replace(record(), channels={k: c for k, c in record().channels.items() if k != "q_command"})
    with pytest.raises(InputError, match="tells no lag"):
        servo.RECIPE.identify(cell, [blind], [], {})
    told = servo.RECIPE.identify(cell, [campaign(count=2)], [record()], {}).remarks
    assert any("chirp" in text and "held out" in text for text in told)
    bare = replace(cell, robot=replace(cell.robot, play=None))
    for with_torque, says in ((False, "tau_motor"), (True, "identify play")):
        told = servo.RECIPE.identify(bare, [campaign(count=2), reversals(with_torque)], [], {}).remarks
        assert any(text.startswith("axis 1") and says in text for text in told)


def reversals(with_torque: bool) -> Dataset:
    t = 0.1 * np.arange(120, dtype=np.float64)
    q = np.tile([0.0, -1.2, 1.4, 0.1, 0.6, 0.0], (120, 1))
    q[:, 0] += np.interp(t, [0.0, 2.0, 6.0, 10.0, 11.9], [0.0, -1e-3, 1e-3, -1e-3, 0.0])
    arrays = {"time_s": t, "q_motor": q, "q_link": q}
    if with_torque:
        arrays["tau_motor"] = 50.0 * np.sign(np.gradient(q, t, axis=0))
    return of_arrays("turns", "reversals", arrays, {"q_link": URAD}, group=np.zeros(120, dtype=np.int64))
