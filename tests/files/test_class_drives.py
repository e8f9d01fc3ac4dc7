"""Drives, friction and play by the class of a robot, and what replaces them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.cell_facts import drive_facts
from counterflex.app.cost_of_unknown_stiffness import assumed
from counterflex.app.cut_points import CutPoints
from counterflex.app.inputs import setting_of
from counterflex.app.unknowns import sources
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.lowest_mode import assumed_masses, can_move, mode_of
from counterflex.plan.modes import lowest_mode
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.model import catalog
from counterflex.robot.model.class_prior import DrivePrior

FILE = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
SERVO = "[[robot.servo]]\naxis = {axis}\nspeed_gain_nm_s = 91000\nposition_gain_per_s = 9\nintegral_time_ms = 31\n"
STIFF = "".join(
    f'[[robot.elastic]]\nsegment = "axis{i}"\nrz_urad_per_knm = 100\nsource = "test"\n' for i in range(1, 7)
)
PLAY = "[[robot.play]]\naxis = {axis}\ndead_band_half_urad = 11\nfriction_nm = [77]\nslip_urad = [33]\n"


def cell_with(tmp_path: Path, more: str = "") -> Cell:
    file = tmp_path / "cell.toml"
    file.write_text(FILE.read_text(encoding="utf-8") + "\n" + more, encoding="utf-8")
    return read_cell(file)


def test_a_cell_without_tables_is_planned_with_the_class(tmp_path: Path) -> None:
    cell = cell_with(tmp_path)
    given = cell.class_drives
    assert given is not None
    assert (given.prior.payload_kg, given.prior.reach_m) == (300.0, 2.496)
    assert (cell.chain.servo, cell.chain.play) == (None, None)
    chain = setting_of(cell).chain
    assert chain.servo is not None
    assert chain.play is not None
    for axis in range(6):
        servo, lost = chain.servo[axis], chain.play[axis]
        assert servo is not None
        assert lost is not None
        assert servo.speed_gain_nm_s == pytest.approx(given.prior.servo(axis).speed_gain_nm_s)
        assert lost.friction_nm == pytest.approx(given.prior.play(axis).friction_nm)
    said = assumed(cell)["assumed_drives"]
    assert said["servo"]["axes"] == said["play"]["axes"] == [1, 2, 3, 4, 5, 6]
    assert "typical" in said["from"]
    assert said["servo"]["factor_of_90_percent"]["speed_gain_nm_s"] == 4.0


@pytest.mark.parametrize("axis", [1, 5])
def test_a_prior_that_a_table_replaces_changes_nothing_of_that_axis(
    tmp_path: Path, axis: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_with(tmp_path, SERVO.format(axis=axis) + PLAY.format(axis=axis))
    given = cell.class_drives
    assert given is not None
    q = np.linspace(0.0, 0.02, 60)[:, None] * np.ones(6)
    load, time = 400.0 * np.sin(300.0 * q), np.linspace(0.0, 1.0, 60)

    def lost() -> tuple[np.ndarray, np.ndarray]:
        chain = given.given_to(cell.chain)
        assert chain.servo is not None
        return servo_error(chain.servo, q, load, time), play.torsion(chain, q, np.zeros((60, 6)))[0]

    before = lost()
    real_servo, real_play = DrivePrior.servo, DrivePrior.play
    monkeypatch.setattr(DrivePrior, "servo", lambda self, a: replace(real_servo(self, a), speed_gain_nm_s=3.0e4))
    monkeypatch.setattr(DrivePrior, "play", lambda self, a, s=1.0: replace(real_play(self, a, s), half_band_rad=3e-4))
    after = lost()
    others = [a for a in range(6) if a != axis - 1]
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one[:, axis - 1], other[:, axis - 1])
        assert np.any(one[:, others] != other[:, others])


def test_a_cell_whose_tables_are_whole_is_planned_as_its_file_says(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, "".join(SERVO.format(axis=a) + PLAY.format(axis=a) for a in range(1, 7)))
    assert cell.class_drives is None
    assert cell.planning_chain is cell.chain
    assert assumed(cell) == {}


def test_a_measured_mode_wins_over_the_drives_of_the_class(tmp_path: Path) -> None:
    """A tap test holds the drives: loop gains of the class beside it would make another mode of it."""
    stated = "[dynamics]\nmode_hz = 6.0\ndamping_ratio = 0.02\n"
    cell = cell_with(tmp_path, stated)
    chain = setting_of(cell).chain
    assert chain.servo is None
    assert chain.play is not None
    assert assumed(cell)["assumed_drives"]["servo"] == {}
    facts = {fact.name: fact.source for fact in drive_facts(cell)}
    assert facts == {
        "Play and friction of the axes, A1, A2, A3, A4, A5, A6": "ASSUMED: typical of the robot's class, not measured",
        "Loop gains of the drives": "cell file",  # not known, left out
    }
    both = cell_with(tmp_path, stated + SERVO.format(axis=1))
    assert setting_of(both).chain.servo == both.chain.servo


def robot_of(tmp_path: Path, name: str, stated: str = "") -> Cell:
    """A robot of the catalogue with a spindle of a third of its payload."""
    file = tmp_path / "robot.toml"
    file.write_text(
        f'format = "counterflex-cell"\nversion = 1\nname = "judged"\n[robot]\ncatalog = "{name}"\n{stated}'
        f'[tcp]\nz_mm = 250\n[[end_effector]]\nname = "spindle"\nmass_kg = {payload_of(name) / 3.0}\n',
        encoding="utf-8",
    )
    return read_cell(file, assume_class=True)


def payload_of(name: str) -> float:
    return catalog.entry(name).payload_kg or 0.0


@pytest.mark.parametrize("name", [name for name in catalog.names() if payload_of(name) >= 20.0])
@pytest.mark.parametrize("stated", ["", STIFF])
def test_every_robot_of_the_catalogue_rings_as_modal_tests_find(tmp_path: Path, name: str, stated: str) -> None:
    """In postures of its whole range, with the springs of its class and with those of a far stiffer arm."""
    cell = robot_of(tmp_path, name, stated)
    given = cell.class_drives
    assert given is not None
    assert len(given.servo_axes) == len(given.play_axes) == 6
    lower, upper = cell.robot.joint_limits_rad.T
    ratios = []
    for q in np.random.default_rng(7).uniform(lower, upper, (6, 6)):
        held, driven = mode_of(cell.chain, q, None), mode_of(cell.planning_chain, q, None)
        assert 0.85 * held.hz < driven.hz < held.hz  # motors that yield make it slower, by little
        assert 0.02 < driven.damping_ratio < 0.25
        chain = cell.planning_chain if can_move(cell.chain) else assumed_masses(cell.planning_chain, q)
        M, stiffness = matrices(chain, q)[:2]
        assert chain.servo is not None
        ratios.append(lowest_mode(M, stiffness, 0.0, chain.servo).damping_ratio)  # of the drives alone
    assert 0.03 < np.median(ratios) < 0.1


def test_without_stiffness_there_is_no_mode_that_loop_gains_could_follow() -> None:
    file = FILE.with_name("irb6640_d16.toml")
    for assume, servo in ((False, ()), (True, tuple(range(6)))):
        given = read_cell(file, assume_class=assume).class_drives
        assert given is not None
        assert (given.servo_axes, given.play_axes) == (servo, tuple(range(6)))


def test_unknowns_say_what_is_typical_of_the_class(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, PLAY.format(axis=2))
    points = CutPoints(
        np.full((1, 6), 0.3), np.ones((1, 6)), np.zeros((1, 3)), np.ones(1), "a test", np.zeros(1, dtype=np.int64)
    )
    said = {one.name: one.known_from for one in sources(cell, points)}
    assert said["loop gains of the drives"] == said["play and friction of A1, A3, A4, A5, A6"] == "typical of the class"


def test_a_robot_outside_every_class_keeps_rigid_drives() -> None:
    cell = read_cell(FILE.with_name("ur10_ipa_tmac.toml"))
    assert cell.class_drives is None
    assert cell.planning_chain is cell.chain
