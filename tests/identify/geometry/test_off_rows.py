"""Consecutive rows of a session that are all off are found, named and left out; clean sessions keep all their rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.arm_geometry import ArmGeometry, ArmLayout
from counterflex.identify.geometry.off_rows import OffRows, off_rows, without
from counterflex.identify.kinematics import recipe as kinematics
from counterflex.identify.kinematics.setup import sessions, set_up
from counterflex.identify.kinematics.stages import model_of_data, priors_of
from counterflex.identify.recipe import Identification
from counterflex.identify.solver.solve import solve
from counterflex.identify.tracker_frame import recipe as tracker_frame

CELL = model_of(read_cell("examples/cells/kr300_d10_ball.toml"))
TRACKER = pose.make(rotation.exp(np.array([0.3, -2.0, 1.0])), np.array([4.0, -2.0, 1.5]))
TARGET = pose.make(rotation.exp(np.array([1.0, 0.5, -2.0])), np.array([0.05, 0.02, -0.1]))
SIGMA_M, SIGMA_RAD = 30e-6, 50e-6
OPTIONS = {"periodic": "off", "sag": "off", "folds": 2}
WAYS = ("target", "tracker", "each its own", "warm-up")


@cache
def session(m: int, seed: int, name: str = "May") -> Dataset:
    """Poses of an arm off by the usual."""
    rng, true = np.random.default_rng(1000 + seed), np.random.default_rng(5)
    names = [CELL.nominal_chain.names[i] for i in np.flatnonzero(CELL.nominal_chain.joint >= 0)][:-1]
    moves = {n: 4e-4 * true.normal(size=6) for n in names}
    near = np.radians([0.0, -95.0, 110.0, 10.0, 60.0, 0.0])
    q = near + np.radians([25.0, 12.0, 12.0, 60.0, 40.0, 90.0]) * rng.uniform(-1.0, 1.0, (m, 6))
    T = pose.inverse(TRACKER) @ ArmGeometry(CELL.nominal_chain, ArmLayout({}, moves, {}, {}), q).poses(np.zeros(0))
    noise = np.concatenate([SIGMA_M * rng.normal(size=(m, 3)), SIGMA_RAD * rng.normal(size=(m, 3))], axis=1)
    T = pose.displaced(T @ TARGET, noise)
    arrays = {"q": q, "p_tracker_target": T[:, :3, 3], "R_tracker_target": T[:, :3, :3]}
    return of_arrays(name, "tracker_poses", arrays, {"p_tracker_target": SIGMA_M, "R_tracker_target": SIGMA_RAD})


def off_by(d: Dataset, rows: Int, way: str, seed: int) -> Dataset:
    """The session with rows 5 to 7 mm off, as such rows come about."""
    rng = np.random.default_rng(seed)
    n = len(rows)
    u = rng.normal(size=(n, 3)) if way == "each its own" else np.repeat(rng.normal(size=(1, 3)), n, axis=0)
    u *= (rng.uniform(5e-3, 7e-3, n if way == "each its own" else 1) / np.linalg.norm(u, axis=1))[:, None]
    if way == "target":
        u = np.einsum("nij,nj->ni", d.values("R_tracker_target")[rows], u)
    if way == "warm-up":
        u *= np.exp(-2.0 * np.arange(n) / n)[:, None]
    p = d.channel("p_tracker_target")
    values = p.values.copy()
    values[rows] += u
    return replace(d, channels={**d.channels, "p_tracker_target": replace(p, values=values)})


def found_in(data: Sequence[Dataset]) -> tuple[OffRows, ...]:
    model = model_of_data(CELL, data, priors_of(kinematics.RECIPE.settings), "off", tied=False)
    setup = set_up(CELL, model, data)
    return off_rows(setup.parameters, setup.blocks, solve(setup.parameters, setup.blocks), sessions(data, setup.blocks))


def identified(data: Sequence[Dataset], holdout: Sequence[Dataset] = (), **options: object) -> Identification:
    return kinematics.RECIPE.identify(CELL, list(data), list(holdout), {**OPTIONS, **options}, silent)


def ordered(d: Dataset, axis: int) -> Dataset:
    """The same poses as a session that runs from one end of an axis to the other."""
    order = np.argsort(d.values("q")[:, axis])
    channels = {
        name: replace(c, values=c.values[order], sigma=None if c.sigma is None else c.sigma[order])
        for name, c in d.channels.items()
    }
    return replace(d, channels=channels)


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("place", ["beginning", "middle", "end"])
def test_a_block_of_rows_is_found_wherever_it_stands(way: str, place: str) -> None:
    for seed in range(2):
        rng = np.random.default_rng([WAYS.index(way), seed, len(place)])
        m = int(rng.integers(36, 50))
        count = int(rng.integers(4, m // 3))
        first = {"beginning": 0, "middle": int(rng.integers(4, m - count - 4)), "end": m - count}[place]
        rows = np.arange(first, first + count)
        blocks = found_in([off_by(session(m, seed), rows, way, seed)])
        assert [b.rows.tolist() for b in blocks] == [rows.tolist()]
        assert blocks[0].most_m == pytest.approx(6e-3, abs=1.3e-3)
        assert blocks[0].usual_m < 5.0 * SIGMA_M


@pytest.mark.long
@pytest.mark.parametrize("axis", [None, 0, 1, 3])
def test_clean_sessions_have_none_in_any_order(axis: int | None) -> None:
    for seed in range(10, 16):
        d = session(32 + seed, seed)
        assert found_in([d if axis is None else ordered(d, axis)]) == ()


def test_two_blocks_are_both_found() -> None:
    d = off_by(off_by(session(60, 3), np.arange(6), "tracker", 1), np.arange(50, 60), "target", 2)
    assert sorted(b.rows.tolist() for b in found_in([d])) == [list(range(6)), list(range(50, 60))]


def test_kinematics_leaves_them_out_and_says_so() -> None:
    """The robust fit alone took 14 of 45 rows of a tracker that was moved for true: 2.4 mm on poses held out."""
    found = identified([off_by(session(45, 4), np.arange(14), "tracker", 4)])
    assert found.headline[0].value < 0.12
    assert found.remarks[0].startswith(
        "May: rows 1 to 14 (lines 1 to 14) at the beginning of the session are all off, by"
    )
    assert "They were left out" in found.remarks[0]
    assert "first_line = 15 under [rows]" in found.remarks[0]
    assert not any("is off by" in r for r in found.remarks)


def test_points_of_several_reflectors_are_one_session() -> None:
    d = off_by(session(60, 6), np.arange(10), "tracker", 6)
    number = np.tile([1.0, 2.0], 30)[:, None]
    points = of_arrays(
        "points",
        "tracker_points",
        {"q": d.values("q"), "p_tracker_target": d.values("p_tracker_target"), "target": number},
        {"p_tracker_target": SIGMA_M},
    )
    assert [b.rows.tolist() for b in found_in([points])] == [list(range(10))]


def test_rows_of_the_data_held_out_are_left_out_of_the_judgement() -> None:
    other = off_by(session(40, 8, "June"), np.arange(7), "tracker", 8)
    found = identified([session(45, 4)], [other])
    assert found.headline[0].value < 0.12
    assert found.remarks[0].startswith("June: rows 1 to 7")


def test_more_than_a_third_of_a_session_is_refused_and_as_stated_keeps_all() -> None:
    d = off_by(session(45, 5), np.arange(17), "each its own", 5)
    with pytest.raises(InputError, match=r"rows 1 to 17 .*17 of 45 rows.*first_line = 18"):
        identified([d])
    kept = identified([off_by(session(45, 4), np.arange(6), "target", 4)], as_stated=True)
    assert any("rows 1 to 6" in r and "used as stated" in r for r in kept.remarks)
    assert any("is off by" in r for r in kept.remarks)


@pytest.mark.long
def test_the_frame_of_the_tracker_leaves_them_out_too() -> None:
    d = off_by(session(45, 4), np.arange(10), "tracker", 4)
    found = tracker_frame.RECIPE.identify(CELL, [d], [], {}, silent)
    assert found.remarks[0].startswith("May: rows 1 to 10")
    clean = tracker_frame.RECIPE.identify(CELL, [d.rows(np.arange(45) >= 10)], [], {}, silent)
    assert found.headline[0].value == pytest.approx(clean.headline[0].value, rel=1e-6)


def test_a_dataset_that_lost_rows_keeps_its_lines() -> None:
    d = session(40, 0)
    block = OffRows(d, np.arange(5), 5e-3, 6e-3, 1e-4)
    rest, remarks = without([d], [block], as_stated=False)
    assert rest[0].line.tolist() == list(range(6, 41))
    assert len(remarks) == 1
    values: Float = rest[0].values("q")
    np.testing.assert_array_equal(values, d.values("q")[5:])
