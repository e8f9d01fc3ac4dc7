"""Whole programs on the simulated cell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Bool
from counterflex.core.errors import InputError, Interrupted, SimulationError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.twin.plant.controller import Controller
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.record import Record
from counterflex.twin.plant.simulate import simulate, touched_part_frame
from counterflex.twin.truth.perturb import perturbed
from counterflex.twin.truth.truth import Truth

DATUM = np.array([[0.0, -0.05, 0], [0.2, -0.05, 0], [0.2, 0.05, 0], [0.0, 0.05, 0]])
TOOL = Cutter(16e-3, flutes=3)


def groove(depth: float = 4e-3, length: float = 0.03, *, spindle: float = 13000.0, height: float = 0.05) -> ToolPath:
    p = np.array(
        [
            [-0.012, 0, height], [-0.012, 0, 0.002], [-0.012, 0, -depth], [length + 0.012, 0, -depth],
            [length + 0.012, 0, height],
        ]
    )  # fmt: skip
    kind = np.array([RAPID, RAPID, FEED, FEED, RAPID])
    feed = np.array([0.25, 0.25, 0.025, 0.025, 0.25])
    n = len(p)
    time = np.cumsum(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1) / feed)
    return ToolPath(
        p, np.tile([0.0, 0, 1], (n, 1)), kind, feed, np.full(n, spindle * 2 * math.pi / 60), time, np.arange(n) * 10,
        np.ones(n, dtype=np.int64),
    )  # fmt: skip


def blank(length: float = 0.03) -> HeightMap:
    return HeightMap.from_box((0.0, -0.016, -0.012), (length, 0.016, 0.0), 2e-4)


@pytest.fixture(scope="module")
def record(truth: Truth, controller: Controller) -> Record:
    return simulate(groove(), truth=truth, controller=controller, stock=blank(), cutter=TOOL, datum_points_part=DATUM)


def plateau(r: Record) -> Bool:
    x = r.p_part_command[:, 0]
    out: Bool = (x > 0.012) & (x < 0.020) & (r.p_part_command[:, 2] < -3e-3)
    return out


def test_a_groove_bends_the_robot_and_shows_on_the_part(record: Record) -> None:
    mid = plateau(record)
    force, moved = record.force_part[mid].mean(axis=0), (record.p_part_tcp - record.p_part_command)[mid].mean(axis=0)
    assert 150.0 < force[1] < 300.0
    assert 0.4e-3 < moved[1] < 1.5e-3
    assert moved @ force > 0.0
    stock = record.stock
    column = stock.z[:, stock.z.shape[1] // 2]
    cut = stock.y_m()[column < -2e-3]
    assert 0.5 * (cut.min() + cut.max()) == pytest.approx(moved[1], abs=1.5e-4)
    assert cut.max() - cut.min() + stock.cell_m == pytest.approx(16e-3, abs=3e-4)
    assert column.min() == pytest.approx(record.p_part_tcp[mid, 2].mean(), abs=3e-5)


def test_deflection_is_that_of_the_static_robot_under_the_recorded_force(
    record: Record, truth: Truth, controller: Controller
) -> None:
    """Friction and play account for the difference; the measured part frame for the offset without force."""
    k = int(np.flatnonzero(plateau(record))[20])
    plant = Plant(truth)
    R = record.T_base_part[:3, :3]
    w = np.concatenate([R @ record.force_part[k], R @ record.moment_part[k]])
    loaded = pose.inverse(record.T_base_part) @ plant.equilibrium(record.q_ref[k], w)
    assert np.linalg.norm(loaded[:3, 3] - record.p_part_tcp[k]) < 0.17e-3


def test_record_is_consistent(record: Record) -> None:
    n = len(record.time_s)
    assert np.all(np.diff(record.time_s) > 0.0)
    for name in (
        "row",
        "motion",
        "kind",
        "p_part_command",
        "p_part_tcp",
        "tilt_part",
        "force_part",
        "depth_m",
        "q_ref",
    ):
        assert len(getattr(record, name)) == n
        assert np.all(np.isfinite(getattr(record, name)))
    assert set(record.motion) <= {0, 10, 20, 30, 40}
    assert np.array_equal(record.engaged, record.depth_m > 0.0)
    assert np.all(record.force_peak_n + 1e-9 >= np.linalg.norm(record.force_part, axis=1))
    assert np.all(record.force_part[~record.engaged] == 0.0)
    assert np.abs(record.tilt_part).max() < 10e-3
    assert np.abs(record.q_motor - record.q_ref).max() < 1e-3


def test_force_rises_from_nothing_and_returns_to_it(record: Record) -> None:
    engaged = np.flatnonzero(record.engaged)
    first, last = engaged[0], engaged[-1]
    assert record.p_part_tcp[first, 0] == pytest.approx(-8e-3, abs=0.5e-3)
    assert record.p_part_tcp[last, 0] > 0.03 - 1e-3
    assert np.linalg.norm(record.force_part[first]) < 60.0
    assert np.linalg.norm(record.force_part[last]) < 60.0


def test_same_truth_same_result(record: Record, truth: Truth, controller: Controller) -> None:
    again = simulate(groove(), truth=truth, controller=controller, stock=blank(), cutter=TOOL, datum_points_part=DATUM)
    np.testing.assert_array_equal(again.p_part_tcp, record.p_part_tcp)
    np.testing.assert_array_equal(again.stock.z, record.stock.z)


def test_skipping_air_changes_nothing_that_is_cut(truth: Truth, controller: Controller) -> None:
    path = groove(height=0.25)
    results = [
        simulate(path, truth=truth, controller=controller, stock=blank(), cutter=TOOL, skip_air=skip)
        for skip in (True, False)
    ]
    skipped, whole = results
    assert len(skipped.time_s) < 0.85 * len(whole.time_s)
    common = np.isin(whole.time_s, skipped.time_s)
    gap = np.linalg.norm(whole.p_part_tcp[common] - skipped.p_part_tcp, axis=1)
    assert gap[skipped.engaged].max() < 40e-6
    middle = plateau(skipped)
    assert gap[middle].max() < 25e-6


def test_touching_datum_points_takes_the_constant_error_out(truth: Truth, controller: Controller) -> None:
    true = perturbed(truth, 2)
    plant = Plant(true)
    T_base_part, residual = touched_part_frame(plant, controller, DATUM)
    moved = pose.difference(controller.T_base_part, T_base_part)
    assert 1e-3 < np.linalg.norm(moved[:3]) < 8e-3
    assert np.abs(residual).max() < 0.3e-3
    up = np.tile([0.0, 0.0, 1.0], (len(DATUM), 1))
    for q, datum in zip(controller.joints(DATUM, up), DATUM, strict=True):
        seen = pose.transform(pose.inverse(T_base_part), plant.equilibrium(q)[:3, 3])
        assert np.linalg.norm(seen - datum) < 0.4e-3


def test_an_ideal_robot_follows_the_program(truth: Truth, controller: Controller) -> None:
    """Stiffness times 1e4, no weight, no friction: the tool is where the controller sends it."""
    drives = tuple(
        replace(d, dead_band_rad=0.0, motor_friction_nm=0.0, link_friction_nm=(0.0, 0.0, 0.0)) for d in truth.drives
    )
    bodies = tuple(replace(b, compliance=b.compliance * 1e-4, damping_s=1e-3) for b in truth.bodies)
    ideal = replace(truth, bodies=bodies, drives=drives, gravity_base=np.zeros(3), counterbalance=None)
    r = simulate(groove(), truth=ideal, controller=controller, stock=blank(), cutter=TOOL)
    mid = plateau(r)
    assert np.linalg.norm(r.p_part_tcp - r.p_part_command, axis=1)[mid].max() < 20e-6


def test_turning_the_whole_cell_about_the_vertical_changes_nothing(truth: Truth, controller: Controller) -> None:
    """Axis 1 moved by 20 deg and the part with it."""
    angle = math.radians(20.0)
    turned = replace(controller, T_base_part=pose.make(rotation.about_z(angle)) @ controller.T_base_part)
    short = groove(length=0.012)
    a = simulate(short, truth=truth, controller=controller, stock=blank(0.012), cutter=TOOL)
    b = simulate(short, truth=truth, controller=turned, stock=blank(0.012), cutter=TOOL)
    sag = (a.p_part_tcp - b.p_part_tcp)[a.engaged]
    assert np.abs(sag).max() < 20e-6


def test_interruption_passes_through(truth: Truth, controller: Controller) -> None:
    def stop(fraction: float, what: str = "") -> None:
        if fraction > 0.05:
            raise Interrupted("stopped")

    with pytest.raises(Interrupted):
        simulate(
            groove(length=0.03), truth=truth, controller=controller, stock=blank(), cutter=TOOL, progress=stop,
        )  # fmt: skip


def test_bad_programs_are_refused(truth: Truth, controller: Controller) -> None:
    path = groove()
    with pytest.raises(InputError, match="several tools"):
        simulate(
            replace(path, tool=np.array([1, 1, 1, 2, 2])),
            truth=truth,
            controller=controller,
            stock=blank(),
            cutter=TOOL,
        )
    with pytest.raises(InputError, match="cycle"):
        simulate(path, truth=truth, controller=controller, stock=blank(), cutter=TOOL, step_s=3e-3)
    with pytest.raises(SimulationError, match="spindle off"):
        simulate(groove(spindle=0.0), truth=truth, controller=controller, stock=blank(), cutter=TOOL)


def test_half_the_step_gives_the_same_part(truth: Truth, controller: Controller) -> None:
    short, stock = groove(length=0.012), blank(0.012)
    coarse, fine = (
        simulate(short, truth=truth, controller=controller, stock=stock, cutter=TOOL, step_s=step)
        for step in (0.5e-3, 0.25e-3)
    )
    largest = np.linalg.norm(
        fine.p_part_tcp - fine.p_part_tcp[0] - fine.p_part_command + fine.p_part_command[0], axis=1
    )
    gap = np.linalg.norm(coarse.p_part_tcp - fine.p_part_tcp, axis=1)
    assert gap[fine.engaged].max() < 0.02 * largest[fine.engaged].max()
