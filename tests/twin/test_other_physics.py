"""Other kinds of physics in a truth: each by its own law, each absent where the file does not have it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, ModelError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.plant.controller import moving_mean
from counterflex.twin.plant.gear_curves import apply_gears, gear_parameters, gear_torque, wind_up
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.draw_other import MATCH_M
from counterflex.twin.truth.family import FAMILIES, OTHER, WIDE
from counterflex.twin.truth.file import from_dict, to_dict
from counterflex.twin.truth.other import ControllerKind, GearCurve, OtherPhysics
from counterflex.twin.truth.truth import CuttingTruth, Truth

CELL = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
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
    for kind in ("gears", "controller"):
        there = sum(bool(getattr(truth.other, kind)) for truth in drawn)
        assert 0.5 * COUNT < there < 0.95 * COUNT


def test_a_file_keeps_every_kind_and_a_kind_is_off_without_its_table(drawn: list[Truth]) -> None:
    truth = next(t for t in drawn if all(vars(t.other).values()))
    data = to_dict(truth)
    again = from_dict(data, "truth.toml").other
    assert to_dict(replace(truth, other=again)) == data
    for kind in vars(truth.other):
        rest = from_dict({k: v for k, v in data.items() if k != kind}, "truth.toml").other
        assert not getattr(rest, kind)
        assert all(getattr(rest, other) for other in vars(rest) if other != kind)
    with pytest.raises(FileFormatError, match="rounding"):
        from_dict({**data, "controller": {**data["controller"], "rounding": 1.0}}, "truth.toml")


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
        plant.move(POSTURE + 0.01, load, move_s=0.1, rest_s=0.05)
        tips.append(plant.p_base_tcp.copy())
    assert tips[1] == pytest.approx(tips[0], abs=1e-9)


@pytest.mark.parametrize(
    "bad", [{"torque_nm": (200.0, 100.0)}, {"share": (0.0, 1.0, 1.0)}, {"hysteresis_share": 1.0}, {"axis": 6}]
)
def test_a_gear_that_cannot_be_is_refused(bad: dict[str, object]) -> None:
    with pytest.raises((ModelError, ValueError)):
        replace(CURVE, **bad)  # type: ignore[arg-type]


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
