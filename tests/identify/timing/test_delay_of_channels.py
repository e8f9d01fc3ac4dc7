"""Delays found from records with known dead time, lag, clock and elasticity; coverage with correlated residuals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError, InputError
from counterflex.core.units import MS
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.solver.jackknife import long_run
from counterflex.identify.timing import recipe as timing
from counterflex.identify.timing.checks import check_delay, lag_of
from counterflex.identify.timing.delay import Pair, build, find_delay
from counterflex.identify.timing.pairs import pairs
from counterflex.identify.timing.residuals import Order
from counterflex.identify.timing.stamped import Stamped, stamped
from counterflex.signals.lag import Lag
from derivative_check import convergence_order
from recorder_clock import RecorderClock

ROOT = Path(__file__).resolve().parents[3]
STEP = 4.0 * MS


def times(n: int) -> Float:
    out: Float = STEP * np.arange(n, dtype=np.float64)
    return out


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return model_of(read_cell(ROOT / "examples/cells/kr300_d16_flat.toml"))


@pytest.fixture(scope="module")
def kuka() -> Dataset:
    return read_dataset(ROOT / "examples/data/kuka_kr300_r2500_trajectories/timing.toml")


def chirp(t: Float) -> Float:
    return np.asarray(0.02 * np.sin(2.0 * np.pi * (0.3 * t + 0.1 * t**2)))


def correlated(rng: np.random.Generator, n: int, size: float, a: float) -> Float:
    out = np.zeros(n)
    for k in range(1, n):
        out[k] = a * out[k - 1] + rng.standard_normal()
    return np.asarray(out * size * np.sqrt(1.0 - a * a))


def pair_of(
    rng: np.random.Generator,
    *,
    delay: float,
    lag: float = 0.0,
    clock: RecorderClock | None = None,
    noise: float = 2e-5,
    a: float = 0.0,
    lost: float = 0.0,
    n: int = 2000,
) -> Pair:
    """A reference and what follows it, by closed form but for the lag, which is computed twenty times finer."""
    t = times(n)
    fine = times(20 * n) / 20.0
    follow = chirp(fine) if lag == 0.0 else Lag(lag).sensitivity(chirp(fine)[:, None], STEP / 20.0)[0][:, 0]
    keep = rng.random(n) >= lost
    at = t[keep] + 0.3 * STEP
    values = np.interp(at - delay, fine, follow) + correlated(rng, len(at), noise, a)
    stamps = at if clock is None else clock.stamps(at)
    reference = Stamped("q_command", t, chirp(t)[:, None], np.full((n, 1), noise), "controller", (), "")
    name = "controller" if clock is None else "other"
    answer = Stamped("q_motor", stamps, values[:, None], np.full((len(at), 1), noise), name, (), "")
    return Pair("drive", reference, answer, ("1",), ("q_motor 1 rad",), lag=lag > 0.0)


@pytest.mark.parametrize("order", ["none", "first", "second"])
def test_jacobian_is_the_derivative(order: Order) -> None:
    rng = np.random.default_rng(1)
    pair = replace(pair_of(rng, delay=0.013, lag=0.03, clock=RecorderClock(0.2, 1e-4), n=400), inertia=True)
    parameters, block, start, _ = build(pair, order, 0.2)
    size = {"delay": 1.0 * MS, "drift": 1e-2, "lag": 0.2 * MS, "damping": 0.01}
    steps = np.array([size.get(p.name.removeprefix("drive."), 0.1 * p.scale) for p in parameters])
    order_found = convergence_order(block, start, steps)
    assert np.all(order_found > 1.8)


@pytest.mark.parametrize("seed", range(4))
def test_samples_at_uneven_instants_are_taken_at_their_stamps(seed: int) -> None:
    """Answers 1 to 7 ms apart, as instruments without a clock send them; by their numbers they are off."""
    rng = np.random.default_rng(100 + seed)
    pair = pair_of(rng, delay=0.0113, noise=1e-6)
    n = len(pair.answer.time_s)
    at = np.sort(pair.answer.time_s + rng.uniform(-1.5e-3, 1.5e-3, n))
    at += 0.1 * np.sin(0.7 * at)  # and whole stretches faster or slower
    keep = (at > 0.05) & (at < pair.answer.time_s[-1] - 0.05)
    values = chirp(at[keep] - 0.0113) + 1e-6 * rng.standard_normal(np.count_nonzero(keep))
    answer = replace(
        pair.answer, time_s=at[keep], values=values[:, None], sigma=np.full((np.count_nonzero(keep), 1), 1e-6)
    )
    found = find_delay(replace(pair, answer=answer))
    assert found.value("delay") == pytest.approx(0.0113, abs=4.0 * found.sigma("delay") + 5e-6)
    assert found.sigma("delay") < 50e-6


def test_a_reference_at_uneven_instants_is_taken_at_its_stamps() -> None:
    rng = np.random.default_rng(110)
    pair = pair_of(rng, delay=0.0113, noise=1e-6)
    at = np.sort(pair.reference.time_s + rng.uniform(-1.5e-3, 1.5e-3, len(pair.reference.time_s)))
    reference = replace(pair.reference, time_s=at, values=chirp(at)[:, None])
    found = find_delay(replace(pair, reference=reference))
    assert found.value("delay") == pytest.approx(0.0113, abs=4.0 * found.sigma("delay") + 5e-6)
    assert found.sigma("delay") < 20e-6


@pytest.mark.parametrize("seed", range(4))
def test_jitter_of_the_stamps_widens_the_interval_and_does_not_shift_the_delay(seed: int) -> None:
    rng = np.random.default_rng(200 + seed)
    pair = pair_of(rng, delay=0.0113, noise=2e-6)
    stamps = pair.answer.time_s + 0.4e-3 * rng.standard_normal(len(pair.answer.time_s))
    found = find_delay(replace(pair, answer=replace(pair.answer, time_s=np.sort(stamps))))
    plain = find_delay(pair)
    assert found.value("delay") == pytest.approx(0.0113, abs=4.0 * found.sigma("delay"))
    assert 2.0 * plain.sigma("delay") < found.sigma("delay") < 0.1e-3


@pytest.mark.parametrize("delay", [0.0, 0.00273, 0.0415, -0.0068])
def test_a_delay_that_is_no_whole_number_of_samples(delay: float) -> None:
    found = find_delay(pair_of(np.random.default_rng(5), delay=delay, noise=2e-5))
    assert found.value("delay") == pytest.approx(delay, abs=3.5 * found.sigma("delay"))
    assert found.sigma("delay") < 0.1 * MS


def test_dead_time_and_lag_are_told_apart_and_bring_the_bandwidth() -> None:
    found = find_delay(pair_of(np.random.default_rng(6), delay=0.016, lag=0.045))
    assert found.order == "first"
    assert found.value("delay") == pytest.approx(0.016, abs=3.5 * found.sigma("delay"))
    assert found.value("lag") == pytest.approx(0.045, abs=3.5 * found.sigma("lag"))
    assert lag_of(found).bandwidth_hz == pytest.approx(3.54, rel=0.05)
    identified, nominal = found.held_out.rms()
    assert identified < 0.1 * nominal


def test_another_clock_with_offset_drift_and_lost_samples() -> None:
    clock = RecorderClock(-1.7342, 40e-6)
    found = find_delay(pair_of(np.random.default_rng(7), delay=0.005, clock=clock, lost=0.02))
    middle = found.block.middle_s
    instant = float(clock.instants(np.array([middle]))[0])
    assert found.value("delay") == pytest.approx(middle - instant + 0.005, abs=3.5 * found.sigma("delay"))
    assert found.value("drift") == pytest.approx(40e-6, abs=3.5 * found.sigma("drift"))


def test_outliers_do_not_move_the_delay() -> None:
    pair = pair_of(np.random.default_rng(8), delay=0.01)
    values = pair.answer.values.copy()
    values[100::150] += 0.5
    found = find_delay(replace(pair, answer=replace(pair.answer, values=values)))
    assert found.value("delay") == pytest.approx(0.01, abs=3.5 * found.sigma("delay"))


@pytest.mark.long
def test_intervals_cover_the_delay_although_residuals_are_correlated() -> None:
    inside, naive = 0, 0
    rounds = 40
    for seed in range(rounds):
        pair = pair_of(np.random.default_rng(1000 + seed), delay=0.0123, a=0.9, n=600)
        found = find_delay(pair)
        off = abs(found.value("delay") - 0.0123)
        inside += off < 1.96 * found.sigma("delay")
        white = 2e-5 / np.sqrt(np.sum(found.block.jacobian(found.fit.values)[:, 0, 0] ** 2) * 4e-10)
        naive += off < 1.96 * white
    assert inside >= 0.87 * rounds
    assert naive < 0.75 * rounds  # what taking the samples as independent would have promised


def test_long_run_variance_of_an_autoregression() -> None:
    rng = np.random.default_rng(2)
    found = [float(long_run(correlated(rng, 2000, 1.0, 0.8)[:, None])[0, 0]) for _ in range(20)]
    assert np.mean(found) == pytest.approx((1.0 + 0.8) / (1.0 - 0.8), rel=0.1)


def test_elastic_torsion_and_delay_are_told_apart(cell: CellModel) -> None:
    rng = np.random.default_rng(11)
    t = times(2500)
    q = 0.3 * np.sin(1.1 * t)[:, None] * np.ones(2) + np.array([0.0, 0.2]) * np.sin(2.3 * t)[:, None]
    tau = 3000.0 * np.cos(q + 0.4) + 800.0 * np.gradient(np.gradient(q, STEP, axis=0), STEP, axis=0)
    soft, late = np.array([1.0e-7, 6.0e-8]), 0.0021
    link = CubicSpline(t, q - soft * tau)(t - late)
    data = of_arrays(
        "r",
        "record",
        {"time_s": t, "q_motor": q, "q_link": link + 1e-6 * rng.standard_normal(q.shape), "tau_motor": tau},
        {"q_motor": 1e-6, "q_link": 1e-6, "tau_motor": 1.0},
    )
    (pair,) = pairs(cell, data)
    found = find_delay(pair)
    for i in range(2):
        assert found.value(f"delay{i + 1}") == pytest.approx(late, abs=0.02 * MS)
        sigma = found.sigma(f"compliance{i + 1}")
        assert found.value(f"compliance{i + 1}") == pytest.approx(soft[i], abs=3.5 * sigma)
        assert sigma < 0.1 * soft[i]


def test_recorded_robot_has_a_delay_between_its_encoders_and_not_that_much_elasticity(
    cell: CellModel, kuka: Dataset
) -> None:
    result = timing.RECIPE.identify(cell, [kuka], [], {})
    assert result.headline[0].value < 0.1 * (result.headline[0].nominal or 0.0)
    fit = result.fits["link_encoder"]
    for axis, stiffness in zip("123", ((7.5e6, 3.5e7), (6.0e6, 1.6e7), (5.5e6, 1.3e7)), strict=True):
        delay, sigma = fit.value(f"link_encoder.delay{axis}"), fit.sigma_of(f"link_encoder.delay{axis}")
        assert 0.02 * MS < sigma < 0.15 * MS
        assert 2.8 * MS - 2.0 * sigma < delay < 2.95 * MS + 2.0 * sigma
        assert stiffness[0] < 1.0 / fit.value(f"link_encoder.compliance{axis}") < stiffness[1]
    (change,) = result.changes
    assert getattr(change, "table", "") == "timing.link_encoder"


def changed(data: Dataset, name: str, values: Float) -> Dataset:
    channels = dict(data.channels)
    channels[name] = replace(channels[name], values=values)
    return replace(data, channels=channels)


def test_exchanged_encoders_are_named(cell: CellModel, kuka: Dataset) -> None:
    wrong = changed(changed(kuka, "q_motor", kuka.values("q_link")), "q_link", kuka.values("q_motor"))
    with pytest.raises(InputError, match="Exchange the columns of q_motor and q_link"):
        timing.RECIPE.identify(cell, [wrong], [], {})


def test_a_torque_turned_round_is_named(cell: CellModel, kuka: Dataset) -> None:
    settings = {k: v for k, v in kuka.settings.items() if k != "rotor_inertia_kg_m2"}
    wrong = replace(changed(kuka, "tau_motor", -kuka.values("tau_motor")), settings=settings)
    with pytest.raises(InputError, match="sign of 'tau_motor'"):
        timing.RECIPE.identify(cell, [wrong], [], {})
    said = timing.RECIPE.identify(cell, [wrong], [], {"as_stated": True})
    assert any("used as stated" in remark for remark in said.remarks)


@pytest.mark.parametrize("factor", [np.pi / 180.0, 180.0 / np.pi, -1.0])
def test_degrees_for_radians_and_a_sign_are_named(cell: CellModel, kuka: Dataset, factor: float) -> None:
    wrong = changed(kuka, "q_link", factor * kuka.values("q_link"))
    with pytest.raises(InputError, match="sign is turned round" if factor < 0.0 else "is in .* stated as"):
        timing.RECIPE.identify(cell, [wrong], [], {})


def test_damaged_stamps_are_named(kuka: Dataset) -> None:
    t = kuka.values("time_s")
    back, twice, rounded, nan = t.copy(), t.copy(), np.round(t, 2), kuka.values("q_link").copy()
    back[700] = 0.0
    nan[40] = np.nan
    with pytest.raises(FileFormatError, match="runs backwards"):
        stamped(changed(kuka, "time_s", back), "q_link")
    with pytest.raises(FileFormatError, match="repeat although"):
        stamped(changed(kuka, "time_s", rounded), "q_link")
    with pytest.raises(FileFormatError, match="not a number"):
        stamped(changed(kuka, "q_link", nan), "q_link")
    with pytest.raises(FileFormatError, match="too short"):
        stamped(kuka.rows(np.arange(len(kuka)) < 20), "q_link")
    twice[300] = twice[299]
    values = kuka.values("q_link").copy()
    values[300] = values[299]
    again = stamped(changed(changed(kuka, "time_s", twice), "q_link", values), "q_link")
    assert len(again.time_s) == len(kuka) - 1
    assert "were skipped" in again.remarks[0]
    rebuilt = stamped(replace(changed(kuka, "time_s", rounded), settings={"cycle_s": STEP}), "q_link")
    assert rebuilt.step_s == pytest.approx(STEP)


def test_an_answer_that_leads_is_refused() -> None:
    found = find_delay(pair_of(np.random.default_rng(9), delay=-0.02))
    with pytest.raises(InputError, match="although it should follow"):
        check_delay(found)


def test_a_record_without_two_channels_that_belong_together(cell: CellModel) -> None:
    t = times(100)
    with pytest.raises(CounterflexError, match="no channels that follow each other"):
        pairs(cell, of_arrays("r", "record", {"time_s": t, "temperature_c": t}))


def test_proposed_chirp_is_slow_enough_and_says_what_to_expect(cell: CellModel) -> None:
    proposal = timing.RECIPE.propose(cell, 8, {})
    tip = np.stack([proposal.columns[f"{a}_m"] for a in "xyz"], axis=1)
    t = proposal.columns["time_s"]
    acceleration = np.gradient(np.gradient(tip, t, axis=0), t, axis=0)
    assert np.max(np.abs(acceleration)) < 0.5
    assert 0.0 < proposal.expected["tracker.delay"] < 2.0 * MS
    with pytest.raises(InputError, match="length of the record"):
        timing.RECIPE.propose(cell, 1, {})
