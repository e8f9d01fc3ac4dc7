"""Recipe payload: derivatives, recovery from an independent model, the twin's hose pack, poor sets and bad input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError, InputError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import BodyMass, TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import greedy
from counterflex.identify.payload import hose_pack
from counterflex.identify.payload.data import shared_mass, with_added_mass
from counterflex.identify.payload.proposal import working_postures
from counterflex.identify.payload.recipe import RECIPE
from counterflex.identify.payload.residuals import Knowledge, SensorEffects, SensorReadings, parameters, sensor_of
from counterflex.identify.recipe import Identification
from counterflex.sensing.carrier import carrier_pose, mass_behind
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.sensor_motion import measure as swing
from counterflex.twin.laboratory.sensor_poses import measure
from counterflex.twin.plant.force_sensor import force_sensor
from derivative_check import convergence_order
from flange_wrench import SensorMotion, idle_wrench

CELL = "examples/cells/kr300_d16_small.toml"
SIGMA = np.r_[np.full(3, 0.2), np.full(3, 0.02)]


@cache
def cell() -> Cell:
    return read_cell(CELL)


@cache
def model() -> CellModel:
    return model_of(cell())


@cache
def orientations(count: int, seed: int = 0) -> Float:
    columns = RECIPE.propose(model(), count, {"seed": seed}).columns
    return np.stack([columns[f"q{i}_rad"] for i in range(1, 7)], axis=1)


def true_sensor(**changes: Any) -> FlangeSensor:
    T = pose.make(rotation.exp(np.array([0.01, -0.015, 0.02])))
    plain = FlangeSensor("sensor", T, 82.0, np.array([0.11, 0.012, 0.13]), w_bias=np.array([25.0, -14, 31, 3, -5, 2]))
    return replace(plain, **changes)


def shown(sensor: FlangeSensor, q: Float, *, seed: int = 0, drift: bool = False) -> dict[str, Float]:
    """Readings by the sensor's own equation, the arm bent by the true mass, with noise."""
    nominal_com = pose.transform(sensor.T_seg_sensor, sensor.p_sensor_com)
    chain = with_added_mass(model().chain, "sensor", sensor.mass_kg, nominal_com)
    R = carrier_pose(chain, "sensor", q)[:, :3, :3] @ sensor.T_seg_sensor[:3, :3]
    rng = np.random.default_rng(seed)
    out = {"q": q}
    if drift:
        out["time_s"] = 40.0 * np.arange(len(q)) + rng.uniform(0.0, 10.0, len(q))
        out["temperature_c"] = 22.0 + 1.5 * np.sin(out["time_s"] / 300.0)
        w = idle_wrench(sensor, R, time_s=out["time_s"], temperature_c=out["temperature_c"])
    else:
        w = idle_wrench(sensor, R)
    return {**out, "w_sensor": w + SIGMA * rng.standard_normal(w.shape)}


def dataset(arrays: Mapping[str, Float], name: str = "poses") -> Dataset:
    return of_arrays(name, "sensor_poses", arrays, {"w_sensor": SIGMA})


def run(data: Dataset, holdout: Dataset | None = None, **settings: Any) -> Identification:
    return RECIPE.identify(model(), [data], [] if holdout is None else [holdout], settings, silent)


def random_block(rows: int, moving: bool) -> SensorReadings:
    rng = np.random.default_rng(1)
    R = rotation.from_quat_wxyz(rng.standard_normal((rows, 4)))
    swing = rng.standard_normal((3, rows, 3)) if moving else np.zeros((3, rows, 3))
    return SensorReadings(
        name="block",
        group=np.arange(rows, dtype=np.int64),
        sigma=np.ones((rows, 6)),
        w_sensor=rng.standard_normal((rows, 6)),
        R_base_sensor=R,
        R_rest=R,
        gamma=R.swapaxes(1, 2) @ np.array([0.0, 0.0, -9.80665]) - swing[0],
        omega=swing[1],
        alpha=swing[2],
        time_s=np.linspace(0.0, 900.0, rows),
        warmer_k=np.linspace(-2.0, 3.0, rows),
    )


@pytest.mark.parametrize(("degree", "moving"), [(0, False), (0, True), (1, True), (2, False)])
def test_derivatives_converge_with_order_two(degree: int, moving: bool) -> None:
    known = Knowledge()
    free = parameters(true_sensor(), known, SensorEffects(degree, True, True, True))
    sizes = np.array([p.prior_sigma for p in free])
    x = free.nominal + 0.3 * sizes * np.random.default_rng(2).standard_normal(len(free))
    assert np.all(convergence_order(random_block(6, moving), x, 0.2 * sizes) > 1.9)


def test_residuals_are_the_sensors_own_equation() -> None:
    block = random_block(8, True)
    free = parameters(true_sensor(), Knowledge(), SensorEffects(1, True, True, True))
    x = free.nominal + 0.1 * np.random.default_rng(3).standard_normal(len(free))
    x[10:13] = 0.02, -0.01, 0.03
    sensor = sensor_of(replace(true_sensor(), T_seg_sensor=np.eye(4)), x, 20.0)
    turn = rotation.exp(x[10:13])
    R = block.R_base_sensor @ turn
    acceleration = block.R_base_sensor.swapaxes(1, 2) @ np.array([0.0, 0.0, -9.80665]) - block.gamma
    motion = SensorMotion(acceleration @ turn, block.omega @ turn, block.alpha @ turn)
    w = idle_wrench(sensor, R, time_s=block.time_s, temperature_c=20.0 + block.warmer_k, motion=motion)
    np.testing.assert_allclose(block.evaluate(x), block.w_sensor - w, atol=1e-9)


def test_weight_zero_and_mounting_come_back() -> None:
    found = run(dataset(shown(true_sensor(), orientations(16))), hose="none")
    fit, truth = found.fits["payload"], true_sensor()
    expected = np.r_[truth.w_bias, truth.mass_kg, truth.p_sensor_com, 0.01, -0.015, 0.02]
    error = (fit.values[:13] - expected) / fit.sigma[:13]
    assert np.max(np.abs(error)) < 4.0
    assert np.sqrt(np.mean(error**2)) < 1.6
    assert fit.sigma_of("mass") < 0.05
    assert all(state == "determined" for state in fit.seen[:13])
    headline = {f.name: f for f in found.headline}
    assert headline["holdout_mean_n"].value < 0.6
    assert headline["holdout_mean_n"].nominal is not None
    assert headline["holdout_mean_n"].nominal > 20.0


@pytest.mark.long
def test_intervals_cover_the_truth() -> None:
    inside = []
    truth = true_sensor()
    expected = np.r_[truth.w_bias, truth.mass_kg, truth.p_sensor_com, 0.01, -0.015, 0.02]
    arrays = shown(truth, orientations(10))
    clean = arrays["w_sensor"] - SIGMA * np.random.default_rng(0).standard_normal(arrays["w_sensor"].shape)
    from counterflex.identify.payload.data import readings, sensor_before
    from counterflex.identify.solver.solve import solve

    chain = with_added_mass(model().chain, "sensor", 82.0, pose.transform(truth.T_seg_sensor, truth.p_sensor_com))
    before = sensor_before(model())
    free = parameters(before, Knowledge(), SensorEffects())
    for seed in range(40):
        noisy = clean + SIGMA * np.random.default_rng(100 + seed).standard_normal(clean.shape)
        data = dataset({"q": arrays["q"], "w_sensor": noisy})
        block = readings(data, chain, before, reference_c=20.0, start_s=0.0, window_s=0.1)
        fit = solve(free, [block])
        inside.append(np.abs(fit.values[:13] - expected) < 1.96 * fit.sigma[:13])
    assert 0.90 < np.mean(inside) < 0.995


def test_drift_and_temperature_are_told_apart_when_the_data_allow() -> None:
    truth = true_sensor(w_drift_per_s=np.full(6, 1e-3), w_kelvin=np.r_[np.full(3, 0.8), np.full(3, 0.1)])
    arrays = shown(truth, orientations(24), drift=True)
    found = run(dataset(arrays), hose="none")
    fit = found.fits["payload"]
    for name, expected in (("drift.fx", 1e-3), ("temperature.fz", 0.8), ("temperature.mx", 0.1)):
        assert abs(fit.value(name) - expected) < 4.0 * fit.sigma_of(name)
        assert fit.seen[fit.parameters.index(name)] == "determined"
    held = run(dataset(arrays), hose="none", drift=False, temperature=False)
    assert held.headline[0].value > 2.0 * found.headline[0].value


def test_inertia_comes_from_a_motion() -> None:
    """Readings of a moving arm by Newton's law on the rigid path; the acceleration is found from the joint angles."""
    truth = true_sensor(inertia_kg_m2=np.array([2.4, 3.1, 1.6, 0.2, -0.3, 0.1]), T_seg_sensor=np.eye(4))
    t = np.arange(0.0, 5.0, 0.004)
    q = np.tile(orientations(3)[0], (len(t), 1))
    for axis, rate in ((1, 2.0), (2, 2.6), (3, 5.0), (4, 4.1), (5, 6.3)):
        q[:, axis] += 0.12 * np.sin(rate * t + axis)
    com = pose.transform(truth.T_seg_sensor, truth.p_sensor_com)
    T = carrier_pose(with_added_mass(model().chain, "sensor", 82.0, com), "sensor", q)
    R = T[:, :3, :3]
    by_time = [np.gradient(v, t, axis=0, edge_order=2) for v in (R, T[:, :3, 3])]
    spin = np.swapaxes(R, 1, 2) @ by_time[0]
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    second = np.gradient(by_time[1], t, axis=0, edge_order=2)
    acceleration = (np.swapaxes(R, 1, 2) @ second[:, :, None])[:, :, 0]
    motion = SensorMotion(acceleration, omega, np.gradient(omega, t, axis=0, edge_order=2))
    w = idle_wrench(truth, R, motion=motion) + SIGMA * np.random.default_rng(0).standard_normal((len(t), 6))
    moved = of_arrays("swing", "sensor_motion", {"q": q, "w_sensor": w, "time_s": t}, {"w_sensor": SIGMA})
    still = dataset(shown(truth, orientations(10)))
    settings = {"hose": "none", "drift": False}
    found = RECIPE.identify(model(), [still, moved], [dataset(shown(truth, orientations(8, 3)))], settings, silent)
    fit = found.fits["payload"]
    for entry, expected in zip(("xx", "yy", "zz", "xy", "xz", "yz"), truth.inertia_kg_m2, strict=True):
        assert abs(fit.value(f"inertia.{entry}") - expected) < max(4.0 * fit.sigma_of(f"inertia.{entry}"), 0.03)


@pytest.mark.parametrize(("count", "window_s"), [(900, 0.1), (1501, 0.06), (2000, 0.25)])
def test_no_window_reaches_into_another_group(count: int, window_s: float) -> None:
    step = 4e-3
    t = step * np.arange(count, dtype=np.float64)
    q = np.radians([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]) + 0.4 * np.sin(2.0 * t[:, None] + np.arange(6))
    w = np.tile(np.arange(count, dtype=np.float64)[:, None], 6)  # a reading tells its own place
    data = of_arrays("swing", "sensor_motion", {"q": q, "w_sensor": w, "time_s": t}, {"w_sensor": SIGMA})
    from counterflex.identify.payload.data import readings, sensor_before

    before = sensor_before(model())
    block = readings(data, model().chain, before, reference_c=20.0, start_s=0.0, window_s=window_s)
    width = 2 * round(0.5 * window_s / step) + 1
    middle = np.rint(block.w_sensor[:, 0]).astype(int)
    first, last = middle - width // 2, middle + width // 2
    for group in np.unique(block.group):
        mine = block.group == group
        inside = set(np.concatenate([np.arange(a, b + 1) for a, b in zip(first[mine], last[mine], strict=True)]))
        others = np.concatenate([np.arange(a, b + 1) for a, b in zip(first[~mine], last[~mine], strict=True)])
        assert inside.isdisjoint(others)
    shared = np.diff(middle) < width
    assert np.count_nonzero(shared & (np.diff(block.group) == 0)) > 0.5 * len(block.group)


def test_a_set_that_turns_only_about_the_vertical_says_so() -> None:
    q = np.tile(orientations(12)[0], (6, 1))
    q[:, 0] += np.linspace(-0.5, 0.5, 6)
    with pytest.raises(InputError, match=r"too few different orientations.*got 1 in 6 rows"):
        run(dataset(shown(true_sensor(), q)))


def test_what_three_orientations_cannot_see_stays_at_its_prior_and_is_named() -> None:
    few = run(dataset(shown(true_sensor(), orientations(3))), dataset(shown(true_sensor(), orientations(12)), "later"))
    assert any("no redundancy" in r for r in few.remarks)
    many = run(dataset(shown(true_sensor(), orientations(16))), hose="none")
    assert few.fits["payload"].sigma_of("mounting.x") > many.fits["payload"].sigma_of("mounting.x")


@cache
def twin_run(hose: str, share: float = 1.0) -> tuple[Identification, float]:
    truth = truth_of(cell(), 3)
    equipment = laboratory(5)
    parts = []
    for count, seed in ((40, 0), (30, 7)):
        columns = {f"q{i + 1}_rad": orientations(count, seed)[:, i] for i in range(6)}
        day = replace(equipment, session=str(seed))
        measured = measure(truth, day, columns, {"hose_share": share}, silent)
        parts.append(of_arrays(f"day{seed}", "sensor_poses", measured.channels, measured.sigma, group=measured.group))
    found = RECIPE.identify(model(), parts[:1], parts[1:], {"hose": hose}, silent)
    mass = sum(b.mass_kg for b in truth.bodies[[b.name for b in truth.bodies].index("sensor") + 1 :])
    return found, mass


@pytest.mark.long
def test_the_twins_sensor_is_found_through_its_faults() -> None:
    found, mass = twin_run("auto")
    fit = found.fits["payload"]
    hanging = mass + 0.5 * 2.5  # half of the hose rests on the tool
    assert abs(fit.value("mass") - hanging) < 3.0 * fit.sigma_of("mass")
    true_turn = rotation.log(force_sensor(truth_of(cell(), 3), 5).T_seg_sensor[:3, :3])
    assert np.all(np.abs(fit.values[10:13] - true_turn) < 3.5 * fit.sigma[10:13])
    force = found.headline[0]
    assert force.nominal is not None
    assert force.value < 0.25 * force.nominal
    assert force.value < 5.0
    assert found.headline[2].value < 1.2
    assert any("degree 1 is used, with the rotation of the sensor in axis4" in r for r in found.remarks)


@pytest.mark.long
def test_the_check_while_typing_finds_the_outlier_of_the_whole_fit_and_compares_no_hose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    columns = {f"q{k + 1}_rad": value for k, value in enumerate(orientations(24).T)}
    m = measure(truth_of(cell(), 1), laboratory(1), columns, {}, silent)
    w_sensor = m.channels["w_sensor"].copy()
    w_sensor[7, 1] += 80.0
    data = of_arrays("typed", "sensor_poses", {**m.channels, "w_sensor": w_sensor}, m.sigma, group=m.group)
    whole = run(data, data)
    monkeypatch.setattr(hose_pack, "cross_validate", None)  # what takes the time
    quick = run(data, data, **RECIPE.quick)
    assert [one.row for one in quick.fits["payload"].outliers] == [7]
    assert [one.row for one in whole.fits["payload"].outliers] == [7]


def left_at_work(**settings: Any) -> float:
    """Force that is left without process where programs work, mean over postures not used, N."""
    truth, equipment = truth_of(cell(), 4), laboratory(4)
    proposal = RECIPE.propose(model(), 24, {"seed": 4, **settings})
    fitted = np.stack([proposal.columns[f"q{i}_rad"] for i in range(1, 7)], axis=1)
    data = []
    for name, q in (("fit", fitted), ("work", working_postures(model(), 6, 99, 0.3))):
        columns = {f"q{i + 1}_rad": q[:, i] for i in range(6)}
        m = measure(truth, replace(equipment, session=name), columns, {}, silent)
        data.append(of_arrays(name, "sensor_poses", m.channels, m.sigma, group=m.group))
    found = RECIPE.identify(model(), data[:1], data[1:], {**settings, "as_stated": True}, silent)
    return found.headline[0].value


@pytest.mark.long
def test_the_rest_goes_by_the_arm_and_is_measured_where_programs_work() -> None:
    in_base, in_arm, near = (
        left_at_work(near_share=0.0, hose_from="base"),
        left_at_work(near_share=0.0, hose_from="axis4"),
        left_at_work(hose_from="axis4"),
    )
    assert in_arm < 0.8 * in_base
    assert near < 0.5 * in_arm
    assert near < 2.0


@pytest.mark.long
def test_hose_pack_rest_is_kept_only_where_it_helps() -> None:
    with_hose, _ = twin_run("auto")
    without, _ = twin_run("none")
    assert any(f.name == "offset_degree" and f.value >= 1.0 for f in with_hose.figures)
    assert with_hose.headline[0].value < 0.8 * without.headline[0].value
    clean = run(dataset(shown(true_sensor(), orientations(24))))
    assert any(f.name == "offset_degree" and f.value == 0.0 for f in clean.figures)


@pytest.mark.long
def test_a_swing_of_the_twin_shows_the_spindles_inertia() -> None:
    """Drives, play and elastic arm move the sensor a little otherwise than the joint angles say."""
    plant, equipment = truth_of(cell(), 3), laboratory(5)
    parts = []
    for kind, take, count, seed in (
        ("sensor_poses", measure, 12, 0),
        ("sensor_motion", swing, 1, 0),
        ("sensor_poses", measure, 8, 7),
    ):
        columns = {f"q{i + 1}_rad": orientations(12, seed)[:count, i] for i in range(6)}
        m = take(plant, replace(equipment, session=f"{kind}{seed}"), columns, {"hose_share": 0.0}, silent)
        parts.append(of_arrays(f"{kind}{seed}", kind, m.channels, m.sigma, group=m.group))
    fit = RECIPE.identify(model(), parts[:2], parts[2:], {"hose": "none"}, silent).fits["payload"]
    spindle = next(b for b in plant.bodies if b.name == "spindle")
    for entry, true in zip(("xx", "yy", "zz", "xy", "xz", "yz"), spindle.inertia_kg_m2, strict=True):
        assert abs(fit.value(f"inertia.{entry}") - true) < 0.15
    assert fit.sigma_of("inertia.yy") < 0.2


@pytest.mark.long
def test_the_cell_file_gets_sum_and_table() -> None:
    found, _ = twin_run("auto")
    table = next(c for c in found.changes if isinstance(c, TableValues))
    assert table.table == "sensor"
    assert len(table.values["bias_n"]) == 3  # type: ignore[arg-type]
    assert len(table.values["offset"]) in (9, 34)  # type: ignore[arg-type]
    mass = next(c for c in found.changes if isinstance(c, BodyMass))
    assert mass.segment == "spindle"
    assert any("its distribution among the bodies" in r for r in found.remarks)


def test_shared_mass_adds_up() -> None:
    chain = model().chain
    for total in (90.0, 30.0):
        com = np.array([0.1, 0.02, 0.09])
        heavier = with_added_mass(chain, "sensor", total, com)
        mass, found = mass_behind(heavier, "sensor")
        assert mass == pytest.approx(total)
        np.testing.assert_allclose(found, com, atol=1e-12)
    assert shared_mass(chain, "spindle", 10.0, np.zeros(3)) == {}


Change = Any


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("sign of 'w_sensor'", lambda w: -w),
        ("forces and moments are exchanged", lambda w: w[:, [3, 4, 5, 0, 1, 2]]),
        ("kN", lambda w: w * np.r_[np.full(3, 1e-3), np.ones(3)]),
        ("left-handed|sign of", lambda w: w * np.array([1.0, -1, 1, -1, 1, -1])),
        ("columns fx and fy of 'w_sensor' are swapped", lambda w: w[:, [1, 0, 2, 3, 4, 5]]),
        ("rows of 'w_sensor'", lambda w: w[::-1].copy()),
    ],
)
def test_mistakes_are_named_not_fitted_away(what: str, change: Change) -> None:
    arrays = shown(true_sensor(), orientations(10))
    arrays["w_sensor"] = change(arrays["w_sensor"])
    with pytest.raises(InputError, match=what):
        run(dataset(arrays))


def test_good_data_raise_no_suspicion() -> None:
    assert not any("suggest" in r for r in run(dataset(shown(true_sensor(), orientations(16))), hose="none").remarks)


def test_not_a_number_is_named_with_its_line() -> None:
    arrays = shown(true_sensor(), orientations(12))
    arrays["w_sensor"][4, 2] = np.nan
    with pytest.raises(FileFormatError, match=r":5: .*'w_sensor'.*not a number"):
        run(dataset(arrays))


def test_missing_orientation_and_sigma_are_named() -> None:
    arrays = shown(true_sensor(), orientations(12))
    with pytest.raises(FileFormatError, match=r"orientation of the sensor.*channel q"):
        run(dataset({"w_sensor": arrays["w_sensor"]}))
    with pytest.raises(FileFormatError, match=r"no standard deviation.*sigma ="):
        RECIPE.identify(model(), [of_arrays("poses", "sensor_poses", arrays)], [], {}, silent)


def test_rotation_of_the_flange_serves_as_well() -> None:
    q = orientations(16)
    arrays = shown(true_sensor(), q)
    chain = model().chain
    R_base_seg = carrier_pose(chain, "sensor", q)[:, :3, :3]  # measured from outside: sag included
    found = run(dataset({"R_base_flange": R_base_seg, "w_sensor": arrays["w_sensor"]}), hose="none")
    assert abs(found.fits["payload"].value("mass") - 82.0) < 0.5


def test_proposal_is_within_limits_and_beats_chance() -> None:
    proposal = RECIPE.propose(model(), 12, {"seed": 1})
    q = np.stack([proposal.columns[f"q{i}_rad"] for i in range(1, 7)], axis=1)
    limits = model().chain.joint_limits_rad
    margin = model().joint_margin_rad
    assert np.all(q >= limits[:, 0] + margin - 1e-12)
    assert np.all(q <= limits[:, 1] - margin + 1e-12)
    J = np.random.default_rng(0).standard_normal((80, 3, 7))
    rows, covariance = greedy(J, 6)
    assert len(set(rows.tolist())) == 6
    np.testing.assert_allclose(covariance, np.linalg.inv(np.eye(7) + np.einsum("nij,nik->jk", J[rows], J[rows])))
    random = [np.linalg.slogdet(np.eye(7) + np.einsum("nij,nik->jk", J[s], J[s]))[1] for s in _draws(80, 6)]
    assert -np.linalg.slogdet(covariance)[1] > max(random)


def test_expected_deviations_are_those_of_the_fit() -> None:
    proposal = RECIPE.propose(model(), 16, {"seed": 0, "force_n": 0.2, "moment_nm": 0.02, "hose": "none"})
    q = np.stack([proposal.columns[f"q{i}_rad"] for i in range(1, 7)], axis=1)
    fit = run(dataset(shown(true_sensor(), q)), hose="none").fits["payload"]
    for name in ("mass", "bias.fx", "com.z", "mounting.y"):
        assert proposal.expected[name] == pytest.approx(fit.sigma_of(name), rel=0.5)


def test_too_few_or_impossible_proposals_are_refused() -> None:
    with pytest.raises(InputError, match="orientations to propose"):
        RECIPE.propose(model(), 2, {})
    with pytest.raises(InputError, match="height"):
        RECIPE.propose(model(), 5, {"height_m": 9.0})
    with pytest.raises(CounterflexError, match="hose"):
        run(dataset(shown(true_sensor(), orientations(12))), hose="maybe")
    with pytest.raises(InputError, match=r"hose_from.*base, axis1"):
        run(dataset(shown(true_sensor(), orientations(12))), hose_from="roof")
    with pytest.raises(InputError, match="near_share"):
        RECIPE.propose(model(), 12, {"near_share": 1.5})


def _draws(n: int, k: int) -> list[Any]:
    rng = np.random.default_rng(4)
    return [rng.choice(n, k, replace=False) for _ in range(50)]
