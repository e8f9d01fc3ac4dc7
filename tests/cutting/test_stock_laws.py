"""Laws of a blank as a height map and of factors on a material: volume, finer cells, tilt of the tool, factors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ModelError
from counterflex.core.units import DEG, MM
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.material import VictorFactors, load, names, rake_factor
from counterflex.cutting.stock import HeightMap, require_vertical

QUICK = settings(max_examples=30)


def blank(x0: float, y0: float, bottom: float, cell: float, number: int) -> HeightMap:
    heights = bottom + np.random.default_rng(number).uniform(0.0, 0.02, (18, 24))
    return HeightMap(x0, y0, cell, heights.astype(np.float32), bottom)


@QUICK
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5), st.floats(0.2e-3, 2e-3), st.integers(1, 4))
def test_a_finer_blank_is_the_same_body_at_the_same_place(
    x0: float, y0: float, bottom: float, cell: float, n: int
) -> None:
    """Same volume above the bottom, same edges, same height over every point; wherever the bottom lies."""
    one = blank(x0, y0, bottom, cell, n)
    assert one.volume_m3 == pytest.approx(float(np.sum(one.z.astype(float) - bottom)) * cell**2, rel=1e-6)
    finer = one.finer(n)
    assert finer.volume_m3 == pytest.approx(one.volume_m3, rel=1e-6)
    for axis in ("x_m", "y_m"):
        before, after = getattr(one, axis)(), getattr(finer, axis)()
        assert after[0] - 0.5 * finer.cell_m == pytest.approx(before[0] - 0.5 * cell, abs=1e-12)
        assert after[-1] + 0.5 * finer.cell_m == pytest.approx(before[-1] + 0.5 * cell, abs=1e-12)
    i = np.rint((finer.x_m() - one.x0_m) / cell).astype(int)
    j = np.rint((finer.y_m() - one.y0_m) / cell).astype(int)
    np.testing.assert_array_equal(finer.z, one.z[np.ix_(j, i)])


@QUICK
@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.01, 80.0), st.integers(0, 9))
def test_a_tilted_tool_is_refused_whichever_way_it_leans(way: float, tilt_deg: float, row: int) -> None:
    axis = np.tile([0.0, 0.0, 1.0], (10, 1))
    require_vertical(axis)
    tilt = tilt_deg * DEG
    axis[row] = math.sin(tilt) * math.cos(way), math.sin(tilt) * math.sin(way), math.cos(tilt)
    with pytest.raises(ModelError, match=rf"path point {row}\b") as told:
        require_vertical(axis)
    assert isinstance(told.value.value, str)
    assert float(told.value.value.removesuffix(" deg")) == pytest.approx(tilt_deg, rel=1e-3)


def test_a_tool_that_points_up_is_tilted() -> None:
    with pytest.raises(ModelError):
        require_vertical(np.array([[0.0, 0.0, -1.0]]))


LAWS = (
    KienzleLaw(900e6, 0.3, 400e6, 0.6, -90e6, 0.1, 0.05 * MM, 0.01 * MM, 0.2 * MM, "test", "assumed", (2e3, 3e3, -1e3)),
    LinearEdgeLaw(600e6, 200e6, -50e6, 20e3, 30e3, -5e3, 0.01 * MM, 0.1 * MM, "test", "assumed"),
)


@QUICK
@given(st.sampled_from(LAWS), st.floats(0.05, 20.0), st.sampled_from([None, "measured"]))
def test_a_scaled_law_scales_every_force_at_every_thickness(law: ForceLaw, factor: float, status: str | None) -> None:
    """Chip and edge, in all three directions; where it holds and where it comes from stay."""
    h = np.array([0.0, 1e-6, 0.02, 0.3]) * MM
    made = law.scaled(factor, status)
    np.testing.assert_allclose(made.edge_force(h), factor * law.edge_force(h), rtol=1e-12)
    np.testing.assert_allclose(made.scaled(1.0 / factor).edge_force(h), law.edge_force(h), rtol=1e-12)
    assert (made.h_min_m, made.h_max_m, made.source) == (law.h_min_m, law.h_max_m, law.source)
    assert made.status == (status or law.status)


@QUICK
@given(st.floats(1e-3, 3.0))
def test_a_law_of_powers_is_that_of_its_formula_at_every_reference(h_mm: float) -> None:
    """``k h (h / h_ref)^-m + e`` by hand in each direction; the reference thickness is a way to write it only."""
    law, h = LAWS[0], h_mm * MM
    assert isinstance(law, KienzleLaw)
    rows = ((900e6, 0.3, 2e3), (400e6, 0.6, 3e3), (-90e6, 0.1, -1e3))
    expected = [k * h * (h_mm / 0.05) ** -m + e for k, m, e in rows]
    for other in (law, law.at_reference(0.7 * MM)):
        np.testing.assert_allclose(other.edge_force(h), expected, rtol=1e-9)
    assert law.k11_pa() == pytest.approx([k * 20.0**-m for k, m, _ in rows])


FACTORS = ("k_gamma", "k_v", "k_st", "k_ver", "k_sch", "k_kss")


@QUICK
@given(st.tuples(*[st.floats(0.5, 2.0)] * 6))
def test_every_factor_multiplies_the_force(values: tuple[float, ...]) -> None:
    factors = VictorFactors(**dict(zip(FACTORS, values, strict=True)))
    assert factors.product == pytest.approx(math.prod(values))
    material = next(load(name) for name in names() if load(name).radial is not None and load(name).axial is not None)
    h = np.array([0.02, 0.1]) * MM
    plain, scaled = material.law(), material.law(factors)
    np.testing.assert_allclose(scaled.edge_force(h), math.prod(values) * plain.edge_force(h), rtol=1e-9)


@QUICK
@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_force_falls_by_one_per_cent_for_each_degree_of_rake(rake: float, base: float) -> None:
    assert rake_factor(rake * DEG, base * DEG) == pytest.approx(1.0 - 0.01 * (rake - base))
