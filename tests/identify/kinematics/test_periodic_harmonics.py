"""Periodic errors of drives: few harmonics of any order, judged on data held out, faded beyond what was measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.core.units import URAD
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.arm_geometry import ArmGeometry, ArmLayout
from counterflex.identify.geometry.known_frames import known_drive_errors
from counterflex.identify.kinematics.recipe import RECIPE
from counterflex.identify.recipe import Identification

CELL = model_of(read_cell("examples/cells/kr300_d10_ball.toml"))
TRUE = {(0, 2): 80.0, (0, 202): 60.0, (1, 121): 70.0, (2, 17): 90.0}
"""Amplitudes in urad by axis and periods per turn."""
SIGMA_M, SIGMA_RAD = 30e-6, 30e-6
OPTIONS = {"sag": "off", "folds": 2}


@cache
def _poses(count: int, seed: int, errors: bool = True) -> Dataset:
    rng = np.random.default_rng(seed)
    near = np.radians([0.0, -95.0, 110.0, 10.0, 60.0, 0.0])
    q: Float = near + np.radians([60.0, 20.0, 20.0, 90.0, 40.0, 120.0]) * rng.uniform(-1.0, 1.0, (count, 6))
    links = q.copy()
    for (axis, order), size in TRUE.items() if errors else ():
        links[:, axis] += size * URAD * np.sin(order * q[:, axis])
    T = ArmGeometry(CELL.nominal_chain, ArmLayout({}, {}, {}, {}), links).poses(np.zeros(0))
    Z = pose.make(rotation.exp(np.array([0.3, -2.0, 1.0])), np.array([4.0, -2.0, 1.5]))
    noise = np.concatenate([SIGMA_M * rng.normal(size=(count, 3)), SIGMA_RAD * rng.normal(size=(count, 3))], axis=1)
    T = pose.displaced(pose.inverse(Z) @ T @ pose.make(p=np.array([0.05, 0.0, -0.1])), noise)
    return of_arrays(
        f"poses {seed}",
        "tracker_poses",
        {"q": q, "p_tracker_target": T[:, :3, 3], "R_tracker_target": T[:, :3, :3]},
        {"p_tracker_target": SIGMA_M, "R_tracker_target": SIGMA_RAD},
    )


def _found(data: Dataset, holdout: Dataset, **options: object) -> Identification:
    return RECIPE.identify(CELL, [data], [holdout], {**OPTIONS, **options}, silent)


def _harmonics(found: Identification) -> set[tuple[int, int]]:
    names = [n for n in found.fits["kinematics"].parameters.names if n.startswith("drive") and ".sin" in n]
    return {(int(n[5]) - 1, int(n.split("sin")[1])) for n in names}


@pytest.mark.long
def test_few_harmonics_are_found_beyond_a_hundred_per_turn() -> None:
    with_them = _found(_poses(220, 1), _poses(80, 2))
    without = _found(_poses(220, 1), _poses(80, 2), periodic="off")
    assert set(TRUE) <= _harmonics(with_them)
    assert len(_harmonics(with_them)) <= len(TRUE) + 1
    assert with_them.headline[0].value < 0.5 * without.headline[0].value
    assert with_them.headline[0].value < 0.07


def test_a_robot_without_periodic_errors_gets_none() -> None:
    assert not _harmonics(_found(_poses(220, 1, False), _poses(80, 2, False)))


def test_harmonics_that_the_held_out_session_does_not_bear_out_are_told_and_dropped() -> None:
    """A second session in which the drives do not err: what the first one holds makes it worse."""
    other = _poses(80, 3, False)
    found = _found(_poses(220, 1), other)
    assert not _harmonics(found)
    assert any("were not kept" in r for r in found.remarks)


def test_beyond_the_measured_angles_the_errors_fade() -> None:
    found = _found(_poses(220, 1), _poses(80, 2))
    (table,) = [c.values for c in found.changes if isinstance(c, TableValues) and c.table == "drive_error"]
    q = _poses(220, 1).values("q")
    low, high = np.array(table["measured_deg"]).T
    assert np.all(low <= np.degrees(q.min(axis=0)))
    assert np.all(np.degrees(q.max(axis=0)) <= high)
    assert np.all(high - low < np.degrees(np.ptp(q, axis=0)) + 3.0)
    errors = known_drive_errors(replace(CELL, tables={"drive_error": dict(table)}))
    inside = np.radians(0.5 * (low + high))
    past = inside.copy()
    past[0] = np.radians(high[0] + 11.0)
    assert errors.link_angles(past)[0] == past[0]
    assert errors.outside(inside) == ()
    assert errors.outside(past) == (0,)
    # The edge is smooth, and the inverse holds across it.
    across = np.tile(inside, (200, 1))
    across[:, 0] = np.radians(np.linspace(high[0] - 5.0, high[0] + 15.0, 200))
    np.testing.assert_allclose(errors.controller_angles(errors.link_angles(across)), across, atol=1e-12)
