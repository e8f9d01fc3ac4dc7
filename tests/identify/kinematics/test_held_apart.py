"""Whole regions and whole files held out: what cannot be judged so is said, not left out silently."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.geometry.arm_parameters import arm_model
from counterflex.identify.kinematics.held_out import region_errors
from counterflex.identify.kinematics.recipe import RECIPE
from counterflex.identify.kinematics.setup import set_up
from counterflex.identify.kinematics.stages import priors_of
from counterflex.identify.recipe import Identification
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import inverse

CELL = model_of(read_cell("examples/cells/kr300_d10_ball.toml"))
TARGET = pose.make(rotation.exp(np.array([0.1, 0.2, -0.1])), np.array([0.05, 0.02, 0.1]))
OPTIONS = {"periodic": "off", "sag": "off", "folds": 3}


def station(place: Float, name: str, seed: int, **settings: str) -> Dataset:
    q = measurable(CELL, 30, np.random.default_rng(seed), around_part=0.5)
    tracker = pose.make(rotation.exp(np.array([0.02, -0.03, 0.8])), place)
    T = pose.inverse(tracker) @ forward(CELL.nominal_chain, q) @ TARGET
    noise = 2e-5 * np.random.default_rng(seed + 1).standard_normal((len(q), 3))
    return of_arrays(
        name, "tracker_poses", {"q": q, "p_tracker_target": T[:, :3, 3] + noise, "R_tracker_target": T[:, :3, :3]},
        {"p_tracker_target": 2e-5, "R_tracker_target": 5e-5}, settings=settings,
    )  # fmt: skip


def names(found: Identification) -> set[str]:
    return {f.name for f in found.figures}


def figure(found: Identification, name: str) -> float:
    return next(f.value for f in found.figures if f.name == name)


EAST, WEST = np.array([4.0, 1.0, 0.8]), np.array([-1.0, 4.0, 0.8])


@pytest.mark.long
def test_frames_that_only_the_part_held_out_fixes_are_found_anew_and_not_taken_from_the_whole_fit() -> None:
    """Two trackers of their own: what starts from the whole fit would have seen the file that it judges."""
    apart = [station(EAST, "east", 1), station(WEST, "west", 3, tracker="west")]
    found = RECIPE.identify(CELL, apart, [], OPTIONS, silent)
    assert {"region_mean_mm", "file_mean_mm"} <= names(found)
    assert sum("Frames that only one of the whole files fixes were identified again" in r for r in found.remarks) == 1
    setup = set_up(CELL, arm_model(CELL, priors_of(RECIPE.settings), sag="off"), apart)
    fit = solve(setup.parameters, setup.blocks)
    # A fit whose frames are wrong to start from must not matter: they are found from the file itself.
    off = fit.values.copy()
    off[[setup.parameters.index(n) for n in setup.needed if "west" in n][:3]] += 3e-3
    figures, _ = region_errors(setup, replace(fit, values=off))
    moved = {f.name: f.value for f in figures}
    assert moved["file_mean_mm"] == pytest.approx(figure(found, "file_mean_mm"), abs=2e-3)


def test_a_file_too_small_to_find_its_tracker_from_is_not_judged_and_it_is_said() -> None:
    few = station(WEST, "west", 3, tracker="west")
    small = few.rows(np.arange(len(few)) < 6)
    found = RECIPE.identify(CELL, [station(EAST, "east", 1), small], [], OPTIONS, silent)
    assert "file_mean_mm" not in names(found)
    assert sum("No error is given for whole files held out" in r for r in found.remarks) == 1


def test_files_of_one_tracker_are_held_out_and_nothing_is_said() -> None:
    found = RECIPE.identify(CELL, [station(EAST, "a", 1), station(EAST, "b", 3)], [], OPTIONS, silent)
    assert {"region_mean_mm", "file_mean_mm"} <= names(found)
    assert not any("held out" in r and "No error is given" in r for r in found.remarks)


def test_a_tracker_of_a_program_of_one_orientation_is_placed_by_positions() -> None:
    """The orientation that the tracker shows is off by 1.5 mrad, which is no error of any position."""
    train = station(EAST, "poses", 1)
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.linspace(-0.2, 0.2, 5), np.linspace(-0.1, 0.1, 3)), axis=-1).reshape(-1, 2)
    near = measurable(CELL, 1, np.random.default_rng(5), around_part=0.2)[0]
    middle = forward(CELL.nominal_chain, near)
    middle[:2, 3] *= 0.85  # towards the foot: all of it within reach
    q = []
    for x, y in grid:
        target = middle.copy()
        target[:2, 3] += [x, y]
        q.append(inverse(CELL.nominal_chain, target, near).q)
    tracker = pose.make(rotation.exp(np.array([0.02, -0.03, 1.9])), WEST)
    T = pose.inverse(tracker) @ forward(CELL.nominal_chain, np.array(q)) @ TARGET
    turned = T[:, :3, :3] @ rotation.exp(np.array([1e-3, 1e-3, -5e-4]))
    program = of_arrays(
        "program", "tracker_poses",
        {"q": np.array(q), "p_tracker_target": T[:, :3, 3] + 2e-5 * rng.standard_normal((len(q), 3)),
         "R_tracker_target": turned},
        {"p_tracker_target": 2e-5, "R_tracker_target": 5e-5}, settings={"tracker": "west"},
    )  # fmt: skip
    found = RECIPE.identify(CELL, [train], [program], OPTIONS, silent)
    assert found.headline[0].value < 2.5 * 0.02
