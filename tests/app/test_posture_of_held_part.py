"""Posture of a robot that holds the part: the survey finds the angles and deflections that the plan computes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.app.posture import PostureOf
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.inputs import part_compliance
from counterflex.plan.posture.choose import Freedom
from counterflex.plan.posture.survey_kernel import POWER
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.robot.model.opw import BRANCHES

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(EXAMPLES / "cells" / "kr300_held_part.toml")


@pytest.fixture(scope="module")
def chosen(cell: Cell) -> PostureOf:
    return PostureOf.of(EXAMPLES / "programs" / "groove.ngc", cell, freedom=Freedom(rotations=12))


def test_the_survey_has_the_cost_of_the_plan_and_its_angles(chosen: PostureOf) -> None:
    best, way = chosen.chosen.best, chosen.chosen.way
    weight = chosen.task.cut.weight_m
    expected = np.average(best.deflection_m**POWER, weights=weight) ** (1.0 / POWER)
    turn, slot = int(way.index[0]), BRANCHES.index(best.branch)
    assert chosen.chosen.costs_m[turn, slot] == pytest.approx(float(expected), rel=1e-3)
    rows = chosen.chosen.rows
    np.testing.assert_allclose(np.cos(way.q - best.q[rows]), 1.0, atol=1e-9)
    assert best.rotation_rad == pytest.approx(turn * 30.0 * DEG)


def test_the_present_posture_is_judged_and_the_best_is_no_worse(chosen: PostureOf) -> None:
    present, best = chosen.chosen.present, chosen.chosen.best
    assert present is not None
    assert 0.0 < best.share_m <= present.share_m * 1.001


def test_modes_of_a_held_part_yield_as_part_and_tool_do(cell: Cell, chosen: PostureOf) -> None:
    """At rest all modes together are the compliance between tool and part, at any point of the part."""
    setting, path, q = setting_of(cell, part_may_be_held=True), chosen.task.path, chosen.chosen.best.q
    relative = setting.relative_motion(path)
    C = part_compliance(setting, relative, q)
    for row in (0, len(path) // 2, len(path) - 1):
        static = robot_modes(cell.chain, q[row], relative.to_part[row], None, 0.1).response(np.array([0.0]))[0].real
        left_out = C[row, :3, :3] - static
        assert np.linalg.eigvalsh(left_out).min() > -1e-9 * np.abs(C[row, :3, :3]).max()
        assert np.abs(left_out).max() < 0.1 * np.abs(C[row, :3, :3]).max()
