"""Machined area is judged, not judged or not seen: each square of it once, by distances counted out pair by pair."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.inspection.coverage import Coverage, coverage
from counterflex.evaluate.inspection.nominal_part import FACING, REACH_M
from counterflex.evaluate.inspection.part_deviations import FLOOR, PartDeviations
from counterflex.evaluate.surface import NominalSurface

NX, NY, CELL, DEPTH = 30, 20, 1.0 * MM, 2.0 * MM


def milled_plane() -> NominalSurface:
    """A blank milled down by 2 mm but for a strip of four columns that stays as it was."""
    after = np.full((NY, NX), -DEPTH, np.float32)
    after[:, :4] = 0.0
    stock, nominal = (HeightMap(0.0, 0.0, CELL, z.astype(np.float32), -10.0 * MM) for z in (np.zeros((NY, NX)), after))
    far = np.full((NY, NX), np.inf, np.float32)
    return NominalSurface(
        stock, nominal, Cutter(diameter_m=8.0 * MM), after < 0.0, np.ones((NY, NX), np.float32), far, far,
        np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), CELL,
    )  # fmt: skip


def brute(points: Float, rows: PartDeviations, left_out: Float, reach: float) -> tuple[Any, Any]:
    """Which squares are judged and which are seen, from every pair of places and points."""
    off = np.linalg.norm(points[:, None] - rows.points[None], axis=2)
    judged = np.any((off <= reach) & (rows.normals[None, :, 2] > FACING), axis=1)
    step = left_out[None] - points[:, None]
    over = (np.linalg.norm(step[..., :2], axis=2) < reach) & (np.linalg.norm(step, axis=2) <= REACH_M)
    return judged, judged | np.any(over, axis=1)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 40), st.integers(0, 40))
def test_every_square_counts_once(number: int, measured: int, others: int) -> None:
    rng = np.random.default_rng(number)

    def some(count: int, height: Float) -> Float:
        xy = rng.uniform([-2.0, -2.0], [NX + 2.0, NY + 2.0], (count, 2)) * CELL
        return np.column_stack([xy, height])

    lean = np.where(rng.random(measured) < 0.3, 0.8, 0.0)  # rad: 46 deg is another face
    normals = np.column_stack([np.sin(lean), np.zeros(measured), np.cos(lean)])
    none = np.zeros(measured)
    rows = PartDeviations(some(measured, none - DEPTH), normals, none, none + UM, np.full(measured, FLOOR))
    left_out = some(others, rng.uniform(-5.0, 2.0, others) * MM)
    surface = milled_plane()
    part: Any = SimpleNamespace(part=SimpleNamespace(surface=surface), rows=rows, left_out=left_out, pitch_m=CELL)
    half = SimpleNamespace(name="half", covers=lambda p, _: p[:, 0] > 0.5 * NX * CELL)
    nowhere = SimpleNamespace(name="nowhere", covers=lambda p, _: p[:, 0] > 1.0)
    whole, of_features = coverage(part, [half, nowhere])  # type: ignore[list-item]
    x, y = (v.ravel() for v in np.meshgrid(surface.nominal.x_m()[4:], surface.nominal.y_m()))
    points = np.column_stack([x, y, np.full(len(x), -DEPTH)])
    judged, seen = brute(points, rows, left_out, 1.5 * CELL)
    assert list(of_features) == ["half"]
    for found, mask in ((whole, np.ones(len(x), np.bool_)), (of_features["half"], x > 0.5 * NX * CELL)):
        counts = [np.sum(mask), np.sum(mask & judged), np.sum(mask & seen & ~judged), np.sum(mask & ~seen)]
        areas = (found.machined_m2, found.judged_m2, found.unjudged_m2, found.unseen_m2)
        np.testing.assert_allclose(np.array(areas) / CELL**2, counts, atol=1e-6)
        assert counts[0] == sum(counts[1:])
        np.testing.assert_allclose(found.judged_share, counts[1] / counts[0], atol=1e-9)


def test_nothing_machined_is_wholly_judged_and_a_tenth_left_out_is_not() -> None:
    assert Coverage(0.0, 0.0, 0.0, 0.0).whole
    assert Coverage(1.0, 0.91, 0.0, 0.09).whole
    assert not Coverage(1.0, 0.89, 0.11, 0.0).whole
