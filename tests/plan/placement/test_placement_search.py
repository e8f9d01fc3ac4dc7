"""The place of the part: thinned path, judgement of a candidate, search, Pareto set."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.inputs import AS_IT_IS
from counterflex.app.placement import placement
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.plan.placement.candidate import (
    CHATTER,
    REFUSALS,
    Candidate,
    Site,
    judge,
    pareto,
    site_of,
    thinned,
    worth,
)
from counterflex.plan.placement.search import CandidatePoses, JudgedPlacements, PlacementBounds, placed, search
from counterflex.plan.posture.deflection_kernel import deflection_sizes
from counterflex.plan.posture.held import PostureTask
from counterflex.plan.posture.survey import base_points
from counterflex.plan.posture.survey_kernel import OUT_OF_REACH, POWER
from counterflex.plan.relative_motion import tool_carried
from counterflex.plan.stability.stretches import stretches_of
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.description import Play

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"


@pytest.fixture(scope="module")
def task() -> PostureTask:
    return placement.task_of(GROOVE, read_cell(CELL), AS_IT_IS, "both")[2]


@pytest.fixture(scope="module")
def site(task: PostureTask) -> Site:
    """Few rotations, no bodies: what is not under test costs nothing."""
    stretches = stretches_of(task.path, read_cell(CELL).stock(), task.setting.cutter_of)
    return replace(site_of(task, stretches, rotations=8), around=None)


def test_a_thinned_path_has_the_length_the_extent_and_the_mean_force_of_the_whole(task: PostureTask) -> None:
    few, rows = thinned(task.cut)
    assert len(few) < 60 < len(task.cut)
    assert few.weight_m.sum() == pytest.approx(task.cut.weight_m.sum(), rel=1e-12)
    assert np.array_equal(few.p_part.min(axis=0), task.cut.p_part.min(axis=0))
    assert np.array_equal(few.p_part.max(axis=0), task.cut.p_part.max(axis=0))
    assert np.all(np.diff(rows) > 0)

    def mean_force(path: object) -> float:
        force = np.linalg.norm(path.w_tcp_part[:, :3], axis=1)  # type: ignore[attr-defined]
        return float(np.average(force**POWER, weights=path.weight_m) ** (1 / POWER))  # type: ignore[attr-defined]

    assert mean_force(few) == pytest.approx(mean_force(task.cut), rel=0.1)


def test_the_deflection_of_a_candidate_is_that_of_its_angles(site: Site) -> None:
    free = replace(site, freedom=replace(site.freedom, weights=replace(site.freedom.weights, winding=0.0)))
    done = judge(free, site.robot.T_base_part)
    assert done.q is not None
    points = base_points(site.cut, site.robot.T_base_part, np.array([0, len(site.cut) - 1]))
    size = np.empty(len(done.q))
    deflection_sizes(site.robot.chain.compact, done.q, points.w, points.normals, size, 0, len(size))
    expected = np.average(size**POWER, weights=site.cut.weight_m) ** (1 / POWER)
    assert done.deflection_m == pytest.approx(float(expected), rel=1e-3)  # linear beside finite turns of the springs


def test_a_turn_of_the_whole_cell_about_axis_1_changes_no_deflection(site: Site) -> None:
    turn = placed(np.array([0.0, 0.0, 0.0, 20.0 * DEG]), np.zeros(3), np.eye(3))
    free = replace(site, freedom=replace(site.freedom, weights=replace(site.freedom.weights, winding=0.0)))
    here, there = judge(free, site.robot.T_base_part), judge(free, turn @ site.robot.T_base_part)
    assert there.deflection_m == pytest.approx(here.deflection_m, rel=1e-9)
    assert there.error_m == pytest.approx(here.error_m, rel=1e-6)
    assert there.least_damping == pytest.approx(here.least_damping, abs=1e-9)


def test_where_the_controller_counts_axis_5_from_changes_no_margin(site: Site) -> None:
    """The same arm whose axis 5 shows 90 deg more: zero, limits and closed form move together."""
    more = 90.0 * DEG

    def counted(chain: ElasticChain) -> ElasticChain:
        drive = int(np.flatnonzero(chain.joint == 4)[0])
        offset, limits = chain.offset.copy(), chain.joint_limits_rad.copy()
        offset[drive] -= chain.sign[drive] * more
        limits[4] += more
        assert chain.opw is not None
        zeros = np.array(chain.opw.offsets_rad)
        zeros[4] += chain.opw.signs[4] * more
        opw = replace(chain.opw, offsets_rad=tuple(zeros.tolist()))
        return replace(chain, offset=offset, joint_limits_rad=limits, opw=opw)

    robot = replace(site.robot, chain=counted(site.robot.chain), controller_chain=counted(site.robot.controller_chain))
    here, there = judge(site, site.robot.T_base_part), judge(replace(site, robot=robot), robot.T_base_part)
    assert there.q is not None
    assert here.q is not None
    assert there.q[:, 4] == pytest.approx(here.q[:, 4] + more)
    assert there.margin_rad == pytest.approx(here.margin_rad)


def test_a_pose_turns_about_the_middle_of_the_program() -> None:
    middle, R = np.array([0.1, 0.05, 0.04]), np.eye(3)
    for angle in (0.0, 1.0, 3.0):
        T = placed(np.array([1.2, -0.3, 0.8, angle]), middle, R)
        assert (T[:3, :3] @ middle + T[:3, 3])[:2] == pytest.approx([1.2, -0.3])
        assert T[2, 3] == pytest.approx(0.8)


def test_what_is_out_of_reach_is_refused_for_that(site: Site) -> None:
    done = judge(site, placed(np.array([9.0, 0.0, 1.0, 0.0]), np.zeros(3), np.eye(3)))
    assert (done.refused, done.passed) == (REFUSALS[OUT_OF_REACH], 0.0)
    assert done.deflection_m == np.inf


@pytest.mark.long
def test_the_search_is_as_good_as_all_places_of_a_grid(site: Site) -> None:
    low, high = (1.2, -0.03, 0.6, 0.0), (1.8, -0.03, 1.1, 0.0)
    middle, R = np.zeros(3), np.eye(3)
    judged = search(site, PlacementBounds(low, high), lambda place: CandidatePoses(placed(place, middle, R)), 192)
    best = judged.candidates[judged.ranked()[0]].error_m
    grid = [
        judge(site, placed(np.array([x, low[1], z, 0.0]), middle, R)).error_m
        for x in np.linspace(low[0], high[0], 13)
        for z in np.linspace(low[2], high[2], 11)
    ]
    assert best <= 1.001 * min(grid)
    assert best < 0.9 * float(np.median(grid))
    assert np.all((judged.places >= low) & (judged.places <= high))
    assert len(judged.candidates) == 192


def test_a_pareto_set_is_what_nothing_beats() -> None:
    values = np.array([[1.0, 3.0], [2.0, 2.0], [2.0, 3.0], [3.0, 1.0], [np.inf, 0.0]])
    assert pareto(values).tolist() == [0, 1, 3]


def test_error_is_the_deflection_where_nothing_is_lost_and_the_force_has_no_steps(site: Site) -> None:
    """Lost motion adds to it, and so does a step of the force: a mode along the normal swings by its static part."""
    q = judge(site, site.robot.T_base_part).q
    assert q is not None
    tight = replace(site.error, loose=replace(site.error.loose, play=(Play(),) * 6))
    calm = replace(tight, steps_part=np.zeros_like(tight.steps_part))
    deflection, error, _ = worth(replace(site, error=calm), site.robot, q)
    assert error == pytest.approx(deflection, rel=1e-9)
    swinging = worth(replace(site, error=tight), site.robot, q)[1]
    losing = worth(replace(site, error=replace(site.error, steps_part=calm.steps_part)), site.robot, q)[1]
    assert error < swinging < worth(site, site.robot, q)[1]
    assert error < losing < worth(site, site.robot, q)[1]


def test_where_the_cut_feeds_a_swing_is_refused_as_the_best_places_allow() -> None:
    def places(*damping: float) -> JudgedPlacements:
        some = [Candidate(error_m=0.1 * (k + 1), least_damping=z) for k, z in enumerate(damping)]
        return JudgedPlacements(np.zeros((len(some), 4)), [*some, Candidate("out of reach")])

    present = Candidate(least_damping=-0.1)
    stable = places(-0.2, 0.01, 0.03).steadied(present)
    assert stable.ranked() == [1, 2]
    assert stable.refusals() == {CHATTER: 1, "out of reach": 1}
    assert places(-0.2, -0.05, -0.08).steadied(present).ranked() == [1, 2]  # none is stable: as good as the present
    assert places(-0.4, -0.3, -0.2).steadied(present).ranked() == [2]  # none is as good: the best of them
    assert places(np.nan, np.nan).steadied(present).ranked() == [0, 1]  # nobody looked


def test_more_of_the_same_cut_takes_damping_from_the_modes(site: Site) -> None:
    """A cut that feeds a swing feeds it more when it is deeper: the damping left is monotonous in the depth."""
    q = judge(site, site.robot.T_base_part).q
    feeding, X = site.feeding, tool_carried(site.robot.T_base_part).to_part
    assert q is not None
    assert feeding is not None
    turned = replace(feeding, A_part=-np.abs(feeding.A_part).max() * np.eye(3)[None])
    values = [
        replace(turned, A_part=f * turned.A_part).least_damping(site.robot.chain, q, X) for f in (0.0, 0.1, 0.2, 0.4)
    ]
    assert values[0] == pytest.approx(feeding.damping.ratio)
    assert np.all(np.diff(values) < 0.0)
