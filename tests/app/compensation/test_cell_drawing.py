"""The drawing of the cell: links as the kinematics say, and a border that no posture crosses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.app.compensation.cell_facts import corners, links_of, reach
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.robot.elasticity.chain import forward, frames

DEMO = Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(DEMO)


def test_links_end_in_the_flange_and_in_the_tip(cell: Cell) -> None:
    q = np.radians([3.0, -92.0, 123.0, -174.0, 31.0, 175.0])
    points, flange = links_of(cell.chain, q)
    np.testing.assert_allclose(points[0], 0.0)
    np.testing.assert_allclose(points[-1], forward(cell.chain, q)[:3, 3])
    np.testing.assert_allclose(
        points[flange], (forward(cell.chain, q) @ np.linalg.inv(cell.chain.T_flange_tcp))[:3, 3], atol=1e-9
    )


def test_no_posture_with_a_stretched_wrist_reaches_farther_than_the_border(cell: Cell) -> None:
    curves = np.concatenate(reach(cell.chain))
    farthest = np.hypot(curves[:, 0], curves[:, 1]).max()
    rng = np.random.default_rng(3)
    low, high = cell.chain.joint_limits_rad[:, 0], cell.chain.joint_limits_rad[:, 1]
    q = rng.uniform(low, high, (2000, 6))
    q[:, 4] = 0.0
    T = frames(cell.chain, q)[:, cell.chain.flange_segment] @ cell.chain.T_segment_flange
    across, height = np.hypot(T[:, 0, 3], T[:, 1, 3]), T[:, 2, 3]
    assert across.max() <= np.abs(curves[:, 0]).max() + 1e-3
    assert height.max() <= curves[:, 1].max() + 1e-3
    assert farthest > 2.0


def test_corners_hold_the_blank() -> None:
    stock = HeightMap.from_box((0.0, -0.02, -0.01), (0.1, 0.05, 0.03), 1e-3)
    found = corners(stock)
    np.testing.assert_allclose(found.min(axis=0), [0.0, -0.02, -0.01], atol=1e-9)
    np.testing.assert_allclose(found.max(axis=0), [0.1, 0.05, 0.03], atol=1e-9)
    assert len({tuple(np.round(p, 6)) for p in found}) == 8
