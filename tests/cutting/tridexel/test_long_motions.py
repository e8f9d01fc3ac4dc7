"""A long straight motion leaves what its pieces leave, and what the silhouette of the cutter leaves: closed form."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import DEG
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock, remove_turning
from counterflex.path import FEED

TOP_M = 0.06
CELL_M = 5e-4


def _cut(path: Float, axis: Float, cutter: Cutter, half: float) -> ColumnStock:
    stock = ColumnStock.of(HeightMap.from_box((-half, -0.02, -0.03), (half, 0.02, 0.0), CELL_M))
    kind = np.full(len(path) - 1, FEED, dtype=np.int64)
    remove_turning(stock, path, np.tile(axis, (len(path), 1)), kind, cutter, top_m=TOP_M)
    return stock


def _line(a: Float, b: Float, pieces: int) -> Float:
    return a + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (b - a)


def _silhouette(cutter: Cutter, lead_rad: float, y: Float) -> Float:
    """Lowest z over the tip at an offset y from the path of a tool that leans in its feed: an ellipse, offset by r.

    Seen along the feed the disc of the corner is an ellipse of half axes R - r and (R - r) sin(lead) at height
    r cos(lead); the corner rounds it by r.
    """
    inner, r = cutter.radius_m - cutter.corner_radius_m, cutter.corner_radius_m
    phi = np.linspace(0.0, np.pi, 200_001)
    normal = np.stack([np.sin(lead_rad) * np.cos(phi), np.sin(phi)])
    normal /= np.hypot(*normal)
    across = inner * np.cos(phi) + r * normal[0]
    down = inner * np.sin(lead_rad) * np.sin(phi) + r * normal[1]
    out: Float = r * np.cos(lead_rad) - np.interp(y, across[::-1], down[::-1])
    return out


@pytest.mark.parametrize("length", [0.005, 0.1, 1.0], ids=["5 mm", "100 mm", "1 m"])
@pytest.mark.parametrize("lead_deg", [3.0, 10.0, 35.0])
def test_a_bull_nose_that_leans_in_its_feed_leaves_its_silhouette(length: float, lead_deg: float) -> None:
    cutter, lead = Cutter(0.016, 0.003), lead_deg * DEG
    axis = np.array([np.sin(lead), 0.0, np.cos(lead)])
    path = _line(np.array([-0.5 * length - 0.03, 1e-4, -0.003]), np.array([0.5 * length + 0.03, 1e-4, -0.003]), 1)
    stock = _cut(path, axis, cutter, 0.004)
    y = stock.y0_m + CELL_M * np.arange(len(stock.high[0])) - 1e-4
    below = np.abs(y) < 0.95 * cutter.radius_m
    expected = np.minimum(-0.003 + _silhouette(cutter, lead, y[below]), 0.0)
    np.testing.assert_allclose(stock.high[0][below], np.tile(expected[:, None], stock.high.shape[2]), atol=5e-7)


@pytest.mark.parametrize("rounded", [(0.0, 0.0), (0.05, 0.95), (1.0, 1.0)], ids=["flat", "bull", "ball"])
def test_one_motion_leaves_what_its_pieces_of_5_mm_leave(rounded: tuple[float, float]) -> None:
    rng = np.random.default_rng(30)
    for _ in range(12):
        radius = rng.uniform(2e-3, 1e-2)
        cutter = Cutter(2.0 * radius, radius * rng.uniform(*rounded))
        tilt, around = rng.uniform(0.0, 60.0) * DEG, rng.uniform(0.0, 2.0 * np.pi)
        axis = np.array([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)])
        length = rng.uniform(0.05, 0.3)
        step = length * np.array([1.0, rng.normal(scale=0.1), rng.normal(scale=0.1)])
        middle = np.array([0.0, 0.0, -rng.uniform(0.003, 0.012)])
        ends = middle - 0.5 * step, middle + 0.5 * step
        whole = _cut(_line(*ends, 1), axis, cutter, 0.02)
        pieces = _cut(_line(*ends, int(np.ceil(length / 0.005))), axis, cutter, 0.02)
        np.testing.assert_array_equal(whole.count > 0, pieces.count > 0)
        both = (whole.count == 1) & (pieces.count == 1)
        assert np.count_nonzero(both & (whole.high[0] < 0.0)) > 500
        off = np.abs(whole.high[0] - pieces.high[0])[both]
        assert np.quantile(off, 0.999) < 1e-6
        # a column that the rim of a flat mill only grazes is found or not; a rounded end has no rim
        assert off.max() < (2e-5 if cutter.corner_radius_m > 0.0 else np.inf)
        assert whole.volume_m3 == pytest.approx(pieces.volume_m3, rel=1e-7 if cutter.corner_radius_m > 0.0 else 1e-4)
