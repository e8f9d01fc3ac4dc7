"""Other kinds of physics in a truth: each by its own law, each absent where the file does not have it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.inputs import Job, read_job
from counterflex.app.proof.simulate import controller, machine
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, ModelError
from counterflex.cutting.cutter import Cutter
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.laboratory import pulls
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.live.live_cell import true_answer
from counterflex.twin.plant.bristle_friction import apply_bristles, bristle_parameters, bristle_torque
from counterflex.twin.plant.controller import as_it_is, moving_mean
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex.twin.plant.mjcf import coordinates
from counterflex.twin.plant.other_forces import (
    apply_couplings,
    apply_gears,
    coupling_parameters,
    gear_parameters,
    gear_torque,
    wind_up,
)
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.process import as_ground
from counterflex.twin.plant.record import Record
from counterflex.twin.plant.slow_move import move
from counterflex.twin.truth.differences import differences
from counterflex.twin.truth.draw_other import MATCH_M
from counterflex.twin.truth.family import FAMILIES, OTHER, WIDE
from counterflex.twin.truth.file import from_dict, to_dict
from counterflex.twin.truth.other import (
    BristleFriction,
    ControllerKind,
    Coupling,
    GearCurve,
    HosePack,
    OtherPhysics,
    Thermal,
    ToolOff,
)
from counterflex.twin.truth.truth import CuttingTruth, Truth

CELL = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
GROOVE = Path(__file__).parents[2] / "examples" / "programs" / "groove.ngc"
POSTURE = np.radians([0.0, -60.0, 100.0, 10.0, 40.0, 20.0])
COUNT = 40


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(CELL)


@pytest.fixture(scope="module")
def nominal(cell: Cell) -> Truth:
    return truth_of(cell, None)


@pytest.fixture(scope="module")
def drawn(cell: Cell) -> list[Truth]:
    return [truth_of(cell, seed, OTHER) for seed in range(COUNT)]


def test_truths_of_the_other_families_have_no_other_kinds(cell: Cell, nominal: Truth) -> None:
    assert not nominal.other
    for family in FAMILIES.values():
        assert family.other or not any(truth_of(cell, seed, family).other for seed in range(5))


def test_some_truths_have_a_kind_and_some_have_not(drawn: list[Truth]) -> None:
    for kind in vars(OtherPhysics()):
        there = sum(bool(getattr(truth.other, kind)) for truth in drawn)
        assert 0.5 * COUNT < there < 0.95 * COUNT, kind


def test_a_file_keeps_every_kind_and_a_kind_is_off_without_its_table(drawn: list[Truth]) -> None:
    truth = replace(drawn[0], other=_every_kind(drawn))
    data = to_dict(truth)
    again = from_dict(data, "truth.toml").other
    assert to_dict(replace(truth, other=again)) == data
    for kind in vars(truth.other):
        rest = from_dict({k: v for k, v in data.items() if k != kind}, "truth.toml").other
        assert not getattr(rest, kind)
        assert all(getattr(rest, other) for other in vars(rest) if other != kind)
    with pytest.raises(FileFormatError, match="rounding"):
        from_dict({**data, "controller": {**data["controller"], "rounding": 1.0}}, "truth.toml")


def _every_kind(drawn: list[Truth]) -> OtherPhysics:
    """Each kind from the first truth that has it."""
    kinds = vars(OtherPhysics())
    return OtherPhysics(**{k: next(v for t in drawn if (v := getattr(t.other, k))) for k in kinds})


# cutting


def _per_length(cutting: CuttingTruth, h: float) -> Float:
    k, m = np.array(cutting.k_pa), np.array(cutting.exponent)
    ploughing = -np.expm1(-h / cutting.edge_onset_m)
    out: Float = k * cutting.h_ref_m**m * h ** (1.0 - m) + np.array(cutting.edge_n_m) * ploughing
    return out


def test_another_force_law_is_equal_at_one_chip_and_other_at_the_rest(cell: Cell, drawn: list[Truth]) -> None:
    laws = [truth.cutting for truth in drawn]
    straight = [law for law in laws if law.exponent == (0.0, 0.0, 0.0)]
    curved = [law for law in laws if law.exponent not in ((0.0, 0.0, 0.0), (0.25, 0.25, 0.25))]
    assert len(straight) > 0.2 * COUNT
    assert len(curved) > 0.2 * COUNT
    plain = replace(OTHER, other=False)
    for seed, law in enumerate(laws):
        kienzle = truth_of(cell, seed, plain).cutting
        assert _per_length(law, MATCH_M) == pytest.approx(_per_length(kienzle, MATCH_M), rel=1e-9)
    for law in straight:  # Altintas: a straight line of thickness
        low, mid, high = (_per_length(law, h) for h in (0.02e-3, 0.06e-3, 0.10e-3))
        assert mid == pytest.approx(0.5 * (low + high), rel=1e-9)
        assert law.edge_n_m[1] / law.edge_n_m[0] != pytest.approx(1.0, rel=0.01)  # as the mild law's edge force is


# gears

CURVE = GearCurve(
    axis=1, torque_nm=(100.0, 900.0), share=(0.5, 1.0, 1.25), hysteresis_nm=20.0, hysteresis_share=0.1,
    hysteresis_rad=50e-6,
)  # fmt: skip
STIFFNESS = 2.0e6


def test_a_gear_has_three_stiffnesses_and_is_odd() -> None:
    row, band = gear_parameters((CURVE,))[1], 30.0e-6
    knee_1, knee_2 = 100.0 / 1.0e6, 100.0 / 1.0e6 + 800.0 / 2.0e6
    for x, torque in ((0.0, 0.0), (knee_1, 100.0), (knee_2, 900.0), (knee_2 + 1e-4, 900.0 + 250.0)):
        assert gear_torque(band + x, STIFFNESS, band, row) == pytest.approx(-torque)
        assert gear_torque(-band - x, STIFFNESS, band, row) == pytest.approx(torque)
        assert wind_up(torque, STIFFNESS, row) == pytest.approx(x)
        assert wind_up(-torque, STIFFNESS, row) == pytest.approx(-x)


def test_the_hysteresis_of_a_gear_is_as_wide_as_stated_and_wider_under_load() -> None:
    """Loaded and unloaded between the same wind-ups, the torques differ by twice the limit at that load."""
    curves, torsion, slip, angle = gear_parameters((CURVE,)), np.full(6, -1), np.zeros(6), np.zeros(6)
    torsion[1] = 0
    stiffness, band = np.full(6, STIFFNESS), np.zeros(6)
    there = np.linspace(-0.6e-3, 0.6e-3, 2001)

    def run(angles: np.ndarray) -> np.ndarray:
        out = []
        for x in angles:
            force = np.zeros(1)
            apply_gears(np.array([x]), torsion, stiffness, band, curves, slip, angle, force)
            out.append(force[0] - STIFFNESS * x)
        return np.array(out)

    run(there)
    back = run(there[::-1])[::-1]
    there_again = run(there)
    for x, load in ((0.0, 0.0), (0.3e-3, 500.0)):
        i = int(np.argmin(np.abs(there - x)))
        assert back[i] - there_again[i] == pytest.approx(2.0 * (20.0 + 0.1 * load), rel=0.02)


def test_a_plant_finds_its_equilibrium_on_a_curved_gear_and_stays_there(nominal: Truth) -> None:
    gears = tuple(replace(CURVE, axis=axis, torque_nm=(60.0, 600.0)) for axis in range(6) if _springs(nominal, axis))
    truth = replace(nominal, other=OtherPhysics(gears=gears))
    plant = Plant(truth)
    at_rest = plant.equilibrium(POSTURE)[:3, 3]
    for _ in range(400):
        plant.step(POSTURE, np.zeros(6), np.zeros(6))
    assert plant.p_base_tcp == pytest.approx(at_rest, abs=1e-7)
    load = np.array([0.0, 200.0, -300.0, 0.0, 0.0, 0.0])
    pushed = plant.equilibrium(POSTURE, load)[:3, 3] - at_rest
    straight = Plant(nominal)
    reference = straight.equilibrium(POSTURE, load)[:3, 3] - straight.equilibrium(POSTURE)[:3, 3]
    assert np.linalg.norm(pushed - reference) > 0.02 * np.linalg.norm(reference)


def _springs(truth: Truth, axis: int) -> bool:
    return any(body.joint == axis and body.compliance[5] > 0.0 for body in truth.bodies)


def test_a_straight_curve_without_hysteresis_is_the_spring_it_replaces(nominal: Truth) -> None:
    same = tuple(
        replace(CURVE, axis=axis, share=(1.0, 1.0, 1.0), hysteresis_nm=0.0, hysteresis_share=0.0)
        for axis in range(6)
        if _springs(nominal, axis)
    )
    load = np.array([100.0, 200.0, -300.0, 0.0, 0.0, 0.0])
    tips = []
    for truth in (nominal, replace(nominal, other=OtherPhysics(gears=same))):
        plant = Plant(truth)
        plant.reset(POSTURE)
        move(plant, POSTURE + 0.01, load, move_s=0.1, rest_s=0.05)
        tips.append(plant.p_base_tcp.copy())
    assert tips[1] == pytest.approx(tips[0], abs=1e-9)


@pytest.mark.parametrize(
    "bad", [{"torque_nm": (200.0, 100.0)}, {"share": (0.0, 1.0, 1.0)}, {"hysteresis_share": 1.0}, {"axis": 6}]
)
def test_a_gear_that_cannot_be_is_refused(bad: dict[str, object]) -> None:
    with pytest.raises((ModelError, ValueError)):
        replace(CURVE, **bad)  # type: ignore[arg-type]


# friction

BRISTLES = BristleFriction(
    axis=1, coulomb_nm=300.0, stiction_share=1.4, stribeck_rad_s=0.05, bristle_rad=40e-6, viscous_nm_s=200.0,
    load_nm=15e3, cold_share=0.3, warming_s=1800.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("speed", "load", "warm", "torque"),
    [
        (1e-5, 0.0, 1.0, 300.0 * 1.4),
        (0.5, 0.0, 1.0, 300.0 + 100.0),
        (0.05, 0.0, 1.0, 300.0 * (1.0 + 0.4 / np.e) + 10.0),
        (0.5, 5e3, 1.0, 300.0 * 4.0 / 3.0 + 100.0),
        (0.5, 0.0, 1.3, 390.0 + 100.0),
    ],
)
def test_sliding_bristles_hold_by_stiction_speed_load_and_temperature(
    speed: float, load: float, warm: float, torque: float
) -> None:
    rows, state, link = bristle_parameters((BRISTLES,)), np.zeros(6), np.zeros(6)
    motor, torsion = np.zeros(6, dtype=np.int64), np.full(6, -1)
    for sign in (1.0, -1.0):
        q = np.linspace(0.0, sign * 20.0 * BRISTLES.bristle_rad, 400)
        link[1] = q[0]
        for angle in q:
            force = np.zeros(1)
            apply_bristles(
                np.array([angle]), np.array([sign * speed]), motor, torsion, np.ones(6), np.full(6, load),
                np.full(6, warm), rows, state, link, force,
            )  # fmt: skip
        assert force[0] == pytest.approx(-sign * torque, rel=1e-3)


def test_bristles_are_springs_at_first_and_the_same_in_one_step_or_many() -> None:
    stiffness, limit = 1e6, 100.0
    assert bristle_torque(0.0, 1e-7, stiffness, limit) == pytest.approx(-0.1, rel=1e-3)
    one = bristle_torque(20.0, 150e-6, stiffness, limit)
    many = 20.0
    for _ in range(30):
        many = bristle_torque(many, 5e-6, stiffness, limit)
    assert many == pytest.approx(one, rel=1e-12)


def test_a_robot_on_bristles_stands_still_and_its_drive_feels_cold_grease(nominal: Truth) -> None:
    """At steady speed of axis 1 the drive of a cold joint gives the friction of the cold share more."""
    felt = []
    speed, steps = 0.3, 800
    for share in (0.0, 1.0):
        frictions = tuple(replace(BRISTLES, axis=axis, load_nm=1e9, cold_share=share) for axis in range(6))
        plant = Plant(replace(nominal, other=OtherPhysics(frictions=frictions)))
        at_rest = plant.equilibrium(POSTURE)[:3, 3]
        for _ in range(400):
            plant.step(POSTURE, np.zeros(6), np.zeros(6))
        assert plant.p_base_tcp == pytest.approx(at_rest, abs=5e-7)
        qd = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
        plant.reset(POSTURE, None, qd)
        torque = np.empty(steps)
        for k in range(steps):
            plant.step(POSTURE + qd * k * plant.step_s, qd, np.zeros(6))
            torque[k] = plant.drive_torque[0]
        felt.append(float(torque[steps // 2 :].mean()))
    assert felt[1] - felt[0] == pytest.approx(BRISTLES.coulomb_nm, rel=0.05)


# couplings


def test_coupled_springs_are_symmetric_and_follow_the_posture(nominal: Truth) -> None:
    pair = Coupling(("axis2", "link_arm"), (3, 4), 0.3, axis=2, phase_rad=0.4)
    own = Coupling(("axis1", "axis1"), (3, 3), 0.2)
    truth = replace(nominal, other=OtherPhysics(couplings=(pair, own)))
    c = coordinates(truth)
    place, value = coupling_parameters(truth, c)
    k = c.stiffness
    i, j, n = place[0, 0], place[0, 1], len(k)
    q = np.zeros(n)
    q[c.motor[2]] = 1.1
    matrix = np.empty((n, n))
    for column in range(n):
        if column == c.motor[2]:
            matrix[:, column] = 0.0
            continue
        force, bent = np.zeros(n), q.copy()
        bent[column] = 1e-4
        apply_couplings(bent, place, value, force)
        matrix[:, column] = -force / 1e-4
    assert matrix == pytest.approx(matrix.T)
    assert matrix[i, j] == pytest.approx(0.3 * np.sqrt(k[i] * k[j]) * np.cos(1.1 - 0.4))
    assert matrix[place[1, 0], place[1, 0]] == pytest.approx(0.2 * k[place[1, 0]])
    assert np.count_nonzero(matrix) == 3


def test_a_coupled_arm_yields_as_the_inverse_of_its_stiffness_matrix_and_reciprocally(nominal: Truth) -> None:
    """Deflection under small loads: symmetric (Maxwell and Betti), and another one than without couplings."""
    couplings = (Coupling(("link_arm", "arm"), (5, 4), 0.5), Coupling(("axis1", "axis2"), (3, 4), -0.6))
    out = []
    for truth in (nominal, replace(nominal, other=OtherPhysics(couplings=couplings))):
        plant = Plant(replace(truth, gravity_base=np.zeros(3), counterbalance=None), friction=False)
        at_rest = plant.equilibrium(POSTURE)[:3, 3]
        loads = 20.0 * np.eye(6)[:3]
        out.append(np.array([plant.equilibrium(POSTURE, load)[:3, 3] - at_rest for load in loads]) / 20.0)
    plain, coupled = out
    assert coupled == pytest.approx(coupled.T, abs=1e-3 * np.abs(coupled).max())
    assert np.abs(coupled - plain).max() > 0.02 * np.abs(plain).max()


def test_couplings_that_would_make_a_spring_unstable_are_refused(nominal: Truth) -> None:
    pair = Coupling(("axis2", "axis3"), (3, 3), 0.6)
    with pytest.raises(ModelError, match="axis2, rx"):
        OtherPhysics(couplings=(pair, replace(pair, directions=(3, 4))))
    with pytest.raises(ModelError, match="torsion of a gear"):
        replace(nominal, other=OtherPhysics(couplings=(replace(pair, directions=(3, 5)),)))


# heat and tools


def test_the_tip_moves_as_spindle_arm_and_tool_grow_since_the_part_was_touched(nominal: Truth) -> None:
    heat = Thermal(before_s=600.0, spindle_m=50e-6, spindle_s=900.0, arm_m=(30e-6, -20e-6, 40e-6), arm_s=3600.0)
    plant = Plant(replace(nominal, other=OtherPhysics(thermal=heat, tools=(ToolOff(3, 25e-6, -40e-6),))))
    plain = Plant(nominal).equilibrium(POSTURE)
    assert plant.equilibrium(POSTURE) == pytest.approx(plain, abs=1e-12)  # the touch is the reference
    for time_s, tool, longer in ((0.0, 1, 0.0), (300.0, 3, 25e-6)):
        plant.program_time(time_s, tool)
        tip = plant.equilibrium(POSTURE)
        since = 600.0 + time_s
        grown = longer + 50e-6 * (1.0 - np.exp(-since / 900.0))
        moved = np.array(heat.arm_m) * (1.0 - np.exp(-since / 3600.0)) + grown * plain[:3, 2]
        assert tip[:3, 3] - plain[:3, 3] == pytest.approx(moved, abs=1e-9)
    for _ in range(20):  # and it goes on growing while the robot works
        plant.step(POSTURE, np.zeros(6), np.zeros(6))
    assert plant.time_s == pytest.approx(0.01)


def test_a_ground_tool_keeps_its_kind() -> None:
    thinner = ToolOff(1, 0.0, -60e-6)
    flat = as_ground(Cutter(diameter_m=16e-3), thinner)
    ball = as_ground(Cutter(diameter_m=16e-3, corner_radius_m=8e-3), thinner)
    assert flat.radius_m == ball.radius_m == pytest.approx(7.97e-3)
    assert flat.is_flat
    assert ball.is_ball
    assert as_ground(Cutter(diameter_m=16e-3, corner_radius_m=8e-3), replace(thinner, diameter_m=60e-6)).is_ball


# hose

HOSE = HosePack(
    "axis4", (0.15, 0.05, 0.10), (0.05, 0.0, 0.12), mass_kg=0.0, slack_m=0.2, pull_n_m=150.0, bending_nm=0.0
)


def test_the_pull_of_a_hose_is_the_slope_of_its_energy_and_spares_the_axes_below_it(nominal: Truth) -> None:
    truth = replace(nominal, other=OtherPhysics(hose=HOSE))
    plant = Plant(truth)

    def energy(q: Float) -> float:
        plant.reset(q)
        far = pose.transform(plant.body_pose("axis4"), np.array(HOSE.p_arm_clamp))
        near = pose.transform(plant.body_pose(truth.bodies[-1].name), np.array(HOSE.p_tool_clamp))
        return 0.5 * HOSE.pull_n_m * max(0.0, float(np.linalg.norm(far - near)) - HOSE.slack_m) ** 2

    weight = Plant(nominal)
    weight.reset(POSTURE)
    plant.reset(POSTURE)
    hung = plant.drive_torque - weight.drive_torque  # what the drives hold against the hose
    assert energy(POSTURE) > 0.1
    for axis in range(6):
        step = 1e-4 * np.eye(6)[axis]
        slope = (energy(POSTURE + step) - energy(POSTURE - step)) / 2e-4
        assert hung[axis] == pytest.approx(slope, abs=0.05 + 0.02 * abs(slope))
    assert np.abs(hung[4:]).max() > 1.0


# what the laboratory sees


def test_the_laboratory_measures_the_other_kinds(nominal: Truth, drawn: list[Truth]) -> None:
    every = replace(nominal, other=_every_kind(drawn))
    request = {f"q{axis + 1}_rad": np.full(1, POSTURE[axis]) for axis in range(6)}
    request |= {"fx_n": np.array([0.0]), "fy_n": np.array([300.0]), "fz_n": np.array([-200.0])}
    shown = []
    for truth in (nominal, replace(every, other=replace(every.other, hose=None)), every):
        pulled = pulls.measure(truth, laboratory(1), request, {"axes": "base", "history": "relaxed"})
        felt = force_sensor(truth, 1).true_wrench(_resting(truth), truth.gravity_base)
        shown.append((pulled.channels["d_tcp_base"][0], felt))
    assert np.linalg.norm(shown[1][0] - shown[0][0]) > 0.03 * np.linalg.norm(shown[0][0])
    assert np.linalg.norm(shown[2][1] - shown[1][1]) > 1.0  # another hose


def _resting(truth: Truth) -> Plant:
    plant = Plant(truth)
    plant.reset(POSTURE)
    return plant


# controller


def test_smoothing_keeps_straight_motion_and_ends_and_cuts_corners() -> None:
    """A corner between speeds of -v and +v is missed by ``v T / 4`` (1 - 1 / n^2) for a mean over T of n samples."""
    t = np.arange(-100, 101) * 4.0e-3
    q = np.stack([t, np.abs(t)], axis=1)
    out = moving_mean(q, 9)
    assert out[[0, -1]] == pytest.approx(q[[0, -1]], abs=5 * 4e-3)
    assert out[20:-20, 0] == pytest.approx(q[20:-20, 0], abs=1e-12)
    assert out[100, 1] == pytest.approx(9 * 4.0e-3 / 4.0 * (1.0 - 1.0 / 81.0), rel=1e-9)
    assert moving_mean(q, 1) is q
    standing = np.repeat(q[:1], 50, axis=0)
    assert np.array_equal(moving_mean(standing, 9), standing)


def test_a_controller_kind_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="smoothing"):
        ControllerKind(smoothing_s=-1.0)


def test_the_values_of_the_family_are_off_by_less_than_the_wide_ones_and_its_drives_by_more() -> None:
    assert WIDE.compliance_sigma > OTHER.compliance_sigma
    assert OTHER.servo_sigma >= 0.30


def test_a_report_lists_the_kinds_that_are_there_and_only_those(nominal: Truth, drawn: list[Truth]) -> None:
    def kinds(truth: Truth) -> list[str]:
        return [row.name for row in differences(nominal, truth) if row.group == "other kinds"]

    assert kinds(nominal) == []
    listed = kinds(replace(nominal, other=_every_kind(drawn)))
    for what in ("hysteresis", "standstill", "springs", "smoothing", "spindle", "hose", "tool 1"):
        assert any(what in name for name in listed), what


# in a run


@pytest.fixture(scope="module")
def plain_run(cell: Cell, nominal: Truth) -> tuple[Job, Record]:
    job = read_job(GROOVE, cell)
    return job, machine(job, cell, nominal)


def _run(cell: Cell, nominal: Truth, job: Job, **kinds: object) -> Record:
    return machine(job, cell, replace(nominal, other=OtherPhysics(**kinds)))  # type: ignore[arg-type]


def test_a_warm_spindle_and_a_long_thin_tool_cut_deeper_and_narrower(
    cell: Cell, nominal: Truth, plain_run: tuple[Job, Record]
) -> None:
    job, plain = plain_run
    heat = Thermal(before_s=600.0, spindle_m=60e-6, spindle_s=600.0, arm_m=(0.0, 0.0, 0.0), arm_s=3600.0)
    grown = 60e-6 * (1.0 - np.exp(-1.0))
    cutting = plain.engaged
    warm = _run(cell, nominal, job, thermal=heat)
    assert (plain.p_part_tcp - warm.p_part_tcp)[cutting, 2].mean() == pytest.approx(grown, abs=4e-6)
    off = _run(cell, nominal, job, tools=(ToolOff(1, 40e-6, -100e-6),))
    assert (plain.p_part_tcp - off.p_part_tcp)[cutting, 2].mean() == pytest.approx(40e-6, abs=4e-6)
    ground = float(plain.stock.z.min()) + 3e-3  # well above the floor of the groove, well below the top
    assert np.count_nonzero(off.stock.z < ground) < np.count_nonzero(plain.stock.z < ground)


def test_the_drives_get_what_the_controller_makes_of_the_program(
    cell: Cell, nominal: Truth, plain_run: tuple[Job, Record]
) -> None:
    job, plain = plain_run
    smooth = _run(cell, nominal, job, controller=ControllerKind(smoothing_s=40e-3))
    away = np.abs(smooth.q_ref - plain.q_ref).max(axis=1)
    assert away.max() > 5e-5
    assert np.median(away) < 1e-6
    running = as_it_is(controller(cell), ControllerKind(blending_share=1.8))
    assert running.blending_m == pytest.approx(1.8 * controller(cell).blending_m)


def test_a_correction_waits_for_the_dead_cycles_of_the_true_controller(nominal: Truth) -> None:
    other = replace(nominal, other=OtherPhysics(controller=ControllerKind(dead_cycles=2)))
    assert true_answer(None, other, 4e-3).dead_s == pytest.approx(PathAnswer().dead_s + 8e-3)
    assert true_answer(PathAnswer(dead_s=0.0), nominal, 4e-3).dead_s == 0.0
