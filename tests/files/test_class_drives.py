"""Drives, friction and play by the class of a robot, and what replaces them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.cost_of_unknown_stiffness import assumed
from counterflex.app.inputs import setting_of
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.model.drive_prior import DrivePrior

FILE = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
SERVO = "[[robot.servo]]\naxis = {axis}\nspeed_gain_nm_s = 91000\nposition_gain_per_s = 9\nintegral_time_ms = 31\n"
PLAY = "[[robot.play]]\naxis = {axis}\ndead_band_half_urad = 11\nfriction_nm = [77]\nslip_urad = [33]\n"


def cell_with(tmp_path: Path, more: str = "") -> Cell:
    file = tmp_path / "cell.toml"
    file.write_text(FILE.read_text(encoding="utf-8") + "\n" + more, encoding="utf-8")
    return read_cell(file)


def test_a_cell_without_tables_is_planned_with_the_class(tmp_path: Path) -> None:
    cell = cell_with(tmp_path)
    prior = DrivePrior(300.0, 2.496)
    assert (cell.chain.servo, cell.chain.play) == (None, None)
    chain = setting_of(cell).chain
    assert chain.servo is not None
    assert chain.play is not None
    for axis in range(6):
        servo, lost = chain.servo[axis], chain.play[axis]
        assert servo is not None
        assert lost is not None
        assert servo.speed_gain_nm_s == pytest.approx(prior.servo(axis).speed_gain_nm_s)
        assert lost.friction_nm == pytest.approx(prior.play(axis).friction_nm)
    said = assumed(cell)["assumed_drives"]
    assert said["loop_axes"] == said["play_axes"] == [1, 2, 3, 4, 5, 6]
    assert said["factor_of_90_percent"]["speed_gain_nm_s"] == 4.0


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
    assert assumed(cell)["assumed_drives"]["loop_axes"] == []
    both = cell_with(tmp_path, stated + SERVO.format(axis=1))
    assert setting_of(both).chain.servo == both.chain.servo


def test_a_robot_outside_every_class_keeps_rigid_drives() -> None:
    cell = read_cell(FILE.with_name("ur10_ipa_tmac.toml"))
    assert cell.class_drives is None
    assert cell.planning_chain is cell.chain
