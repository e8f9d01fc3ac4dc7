"""Coarse bodies and limits of the preflight in a cell file: what they become in SI, and what is refused."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.robot.model import catalog

ROBOT = catalog.load("kuka_kr300_r2500_ultra")
CELL = Path(__file__).resolve().parents[1] / "data" / "cells" / "small.toml"


def tables(text: str) -> CellTables:
    return parse(CellTables, tomllib.loads(CELL.read_text(encoding="utf-8") + text), where="cell.toml")


def test_bodies_in_si() -> None:
    bodies, removed = tables(
        '[[cell.body]]\nname = "fixture"\nshape = "box"\nframe = "part"\nz_mm = 50\nsize_mm = [300, 200, 100]\n'
        '[[cell.body]]\nname = "spindle"\nshape = "capsule"\nframe = "flange"\nx_mm = 100\nb_deg = 90\n'
        'radius_mm = 90\nlength_mm = 400\n[[cell.body]]\nname = "table"\nshape = "none"\n'
    ).cell.bodies()
    fixture, spindle = bodies
    assert fixture.size_m == pytest.approx((0.15, 0.1, 0.05))
    assert fixture.T_frame_body[:3, 3] == pytest.approx([0.0, 0.0, 0.05])
    assert (fixture.surrounds, spindle.surrounds, spindle.assumed) == (True, False, False)
    assert spindle.size_m == pytest.approx((0.09, 0.2))
    assert spindle.T_frame_body[:3, 3] == pytest.approx([0.3, 0.0, 0.0])  # it runs along z of its pose
    assert np.abs(spindle.T_frame_body[:3, 2]) == pytest.approx([1.0, 0.0, 0.0])
    assert removed == ["table"]


def test_limits_in_si() -> None:
    file = tables(
        "[controller]\nleast_block_ms = 45\nlook_ahead_blocks = 20\n[limits]\njoint_speed_deg_s = [1, 2, 3, 4, 5, 6]\n"
        "joint_acceleration_deg_s2 = [10, 20, 30, 40, 50, 60]\ncable_axis6_deg = 270\nclearance_mm = 30\n"
    )
    bounds = file.limits.preflight(file.controller, ROBOT)
    assert bounds.joint_speeds_rad_s == pytest.approx(np.arange(1, 7) * DEG)
    assert bounds.joint_accelerations_rad_s2 == pytest.approx(10 * np.arange(1, 7) * DEG)
    assert bounds.cables_rad == {5: pytest.approx(270 * DEG)}
    assert (bounds.clearance_m, bounds.least_block_s, bounds.look_ahead) == (0.03, 0.045, 20)


def test_what_is_left_out_is_not_made_up() -> None:
    file = tables("")
    bounds = file.limits.preflight(file.controller, ROBOT)
    assert bounds.joint_speeds_rad_s is ROBOT.joint_speeds_rad_s  # the catalogue's
    assert bounds.joint_accelerations_rad_s2 is None
    assert (bounds.cables_rad, bounds.look_ahead) == ({}, None)
    assert bounds.least_block_s == file.controller.cycle_s
    unknown = replace(ROBOT, joint_speeds_rad_s=None)
    assert file.limits.preflight(file.controller, unknown).joint_speeds_rad_s is None
    known = file.limits.preflight(file.controller, catalog.load("kuka_kr210_r2700_2"))
    assert known.joint_accelerations_rad_s2 is not None
    assert known.joint_accelerations_rad_s2[1] == pytest.approx(72.358 * DEG)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[cell.body]]\nname = "a"\nshape = "box"\nradius_mm = 3', ["shape box has size_mm", "radius_mm"]),
        ('[[cell.body]]\nname = "a"\nshape = "capsule"\nradius_mm = 3', ["radius_mm and length_mm"]),
        ('[[cell.body]]\nname = "a"\nshape = "none"\nradius_mm = 3', ["no size"]),
        ('[[cell.body]]\nname = "a"\nshape = "ball"\nradius_mm = 3', ["shape"]),
        ('[[cell.body]]\nname = "a"\nshape = "box"\nframe = "axis1"\nsize_mm = [1, 1, 1]', ["frame"]),
        ('[[cell.body]]\nname = "a"\nshape = "box"\nsize_mm = [1, 0, 1]', ["size_mm"]),
        (2 * '[[cell.body]]\nname = "a"\nshape = "box"\nsize_mm = [1, 1, 1]\n', ["two bodies are named 'a'"]),
        ("[limits]\njoint_speed_deg_s = [100, 100]", ["joint_speed_deg_s"]),
        ("[limits]\nclearance_mm = -1", ["clearance_mm"]),
        ("[controller]\nlook_ahead_blocks = 0", ["look_ahead_blocks"]),
    ],
)
def test_mistakes_are_named(text: str, words: list[str]) -> None:
    with pytest.raises(FileFormatError) as fault:
        tables(text)
    assert all(word in str(fault.value) for word in words), str(fault.value)
