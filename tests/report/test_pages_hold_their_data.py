"""Pages of corrections, of what remains and of places hold the numbers that they are given, each in its own place."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.placement.placement_map import PlacementMap, map_figure
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.error_budget import REMAINDER, BudgetLine
from counterflex.report.correction_page import CorrectionData, _verdict, broken
from counterflex.report.data import PredictionData
from counterflex.report.distribution_figure import area_shares, budget_figure
from counterflex.report.figure_data import edges_mm, scale_limit_mm, thin
from counterflex.report.remaining_figure import remaining_figure, space_figure

QUICK = settings(max_examples=15)
seed = st.integers(0, 2**31)


def values_of(trace: Any, key: str = "y") -> Float:
    """Numbers of a curve; a gap is nan."""
    return np.array([np.nan if v is None else v for v in trace[key]], dtype=np.float64)


@QUICK
@given(seed)
def test_an_error_is_drawn_between_two_standard_deviations_with_the_change_beside_it(number: int) -> None:
    """Axis by axis: x, y and z do not stand in each other's place, and signs are kept."""
    rng = np.random.default_rng(number)
    error, change = rng.normal(size=(2, 30, 3)) * 100.0 * UM
    sigma, way = rng.uniform(1.0, 20.0, (30, 3)) * UM, np.cumsum(rng.uniform(0.0, 1.0, 30)) * MM
    error[7] = np.nan
    figure = CorrectionData("", "", "", {}, way, error, sigma, change).error_figure()
    assert len(figure["data"]) == 12
    for axis in range(3):
        of_axis = [t for t in figure["data"] if t["yaxis"] == f"y{axis + 1 if axis else ''}"]
        wanted = (error - 2.0 * sigma, error + 2.0 * sigma, error, change)
        for trace, values in zip(of_axis, wanted, strict=True):
            np.testing.assert_allclose(values_of(trace), values[:, axis] / UM, atol=0.051)
            np.testing.assert_allclose(values_of(trace, "x"), way / MM, atol=0.0051)
        assert [t["fill"] for t in of_axis[:2]] == [None, "tonexty"]
        title = figure["layout"][f"yaxis{axis + 1 if axis else ''}"]["title"]["text"]
        assert title == f"{'xyz'[axis]}, um"


def test_runs_are_drawn_apart() -> None:
    """One gap between two runs, in either direction of their numbers; a single run has none."""
    values = np.arange(21.0).reshape(7, 3)
    found = broken(values, np.array([4, 4, 4, 1, 1, 9, 9]))
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [2, 4]
    assert not np.isnan(broken(values, np.zeros(7, int))).any()
    assert values[2, 0] == 6.0  # the data stay


@pytest.mark.parametrize("changed", [True, False])
def test_a_correction_says_what_is_and_what_is_expected(changed: bool) -> None:
    expected = {"now_p997_um": 112.0, "next_p997_um": 41.0, "next_5_percent_um": 27.0, "next_95_percent_um": 66.0}
    text = _verdict({"expected": expected, "changed": changed})
    if changed:
        assert re.findall(r"\d+ um|\d+ to \d+", text) == ["112 um", "41 um", "27 to 66"]
    else:
        assert "stays as it is" in text


@QUICK
@given(seed, st.booleans())
def test_what_remains_is_drawn_over_the_way_where_it_cuts(number: int, predicted: bool) -> None:
    """Before and after each as its own curve, over the length along the path; the colours in space are those after."""
    rng = np.random.default_rng(number)
    n = 40
    p, cutting = np.cumsum(rng.normal(size=(n, 3)), axis=0) * MM, rng.random(n) < 0.7
    before, after = rng.uniform(0.0, 1e-3, (2, n))
    none: Any = np.zeros((n, 3))
    bent, line = rng.normal(size=(n, 3)) * 1e-4, np.sort(rng.integers(1, 9, n))
    errors: dict[str, Any] = {"error_before_m": before, "error_after_m": after} if predicted else {}
    data = PredictionData(
        title="", subtitle="", created="", time_s=np.linspace(0.0, 1.0, n), p_part_tcp=p, deflection_m=bent,
        correction_m=none, force_n=np.zeros(n), facts=(), assumptions=(), timing=(), versions={}, notes=(),
        cutting=cutting, line=line, **errors,
    )  # fmt: skip
    shown = after if predicted else np.linalg.norm(bent, axis=1)
    cut = space_figure(data)["data"][1]
    np.testing.assert_allclose(cut["marker"]["color"], shown[cutting] / UM, atol=0.051)
    np.testing.assert_allclose(np.stack([values_of(cut, axis) for axis in "xyz"], axis=1), p[cutting] / MM, atol=0.0051)
    assert cut["customdata"] == line[cutting].tolist()
    if not predicted:
        with pytest.raises(ValueError, match="not predicted"):
            remaining_figure(data)
        return
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    for trace, name, error in zip(remaining_figure(data)["data"], ("before", "after"), (before, after), strict=True):
        assert trace["name"].startswith(name)
        np.testing.assert_allclose(values_of(trace, "x"), way, atol=6e-5)
        np.testing.assert_allclose(values_of(trace), np.where(cutting, error / UM, np.nan), atol=0.051)


@QUICK
@given(seed, st.integers(2, 7), st.integers(2, 5), st.sampled_from(["level", "upright"]))
def test_a_map_of_places_holds_each_value_at_its_place(number: int, nx: int, ny: int, view: str) -> None:
    """Columns are x, rows y or height, whatever their order in the table; what is refused has no value but a reason."""
    rng = np.random.default_rng(number)
    second = "y_mm" if view == "level" else "z_mm"
    rows: list[dict[str, Any]] = []
    for x in range(nx):
        for y in range(ny):
            known = rng.random() < 0.8
            rows.append({"view": view, "x_mm": 100.0 * x, "y_mm": -1.0, "z_mm": -1.0, second: 10.0 * y,
                         "deflection_um": float(rng.uniform(1, 9)) if known else None,
                         "refused": "" if known else f"no {x} {y}"})  # fmt: skip
    other = [{**row, "view": "other", "deflection_um": 1e3} for row in rows]
    mixed = [(rows + other)[k] for k in rng.permutation(2 * len(rows))]
    present = {"x_mm": 120.0, "y_mm": 7.0, "z_mm": 7.0}
    heat, mark = map_figure(mixed, present, view, "deflection_um")["data"]
    assert (mark["x"], mark["y"]) == ([120.0], [7.0])
    for row in rows:
        i, j = heat["x"].index(row["x_mm"]), heat["y"].index(row[second])
        assert (heat["z"][j][i], heat["text"][j][i]) == (row["deflection_um"], row["refused"])


@pytest.mark.parametrize("present_um", [None, 250.0])
def test_the_best_place_is_named_with_the_present_one(present_um: float | None) -> None:
    best = {"deflection_um": 110.0, "x_mm": 1500.0, "y_mm": -300.0}
    row = {"view": "level", "x_mm": 1.0, "y_mm": 2.0, "z_mm": 3.0, "deflection_um": 1.0, "stiffness_n_per_um": 1.0,
           "first_mode_hz": 9.0, "refused": ""}  # fmt: skip
    summary = {"program": "p", "cell": "c", "robot": "r", "refused": 7, "places": 40,
               "best": {"level": best, "upright": None},
               "present": {"x_mm": 0.0, "y_mm": 0.0, "z_mm": 0.0, "deflection_um": present_um}}  # fmt: skip
    text = re.sub(r"\s+", " ", PlacementMap(summary).page([row]))
    told = "." if present_um is None else "; 250 um in the present place."
    assert f"Least deflection by the model at this height: 110 um at x 1500, y -300 mm{told}" in text
    assert "refused (7 of 40 places)" in text


@QUICK
@given(seed, st.integers(1, 400), st.integers(4, 60))
def test_a_curve_that_is_thinned_keeps_its_peaks_and_its_gaps(number: int, n: int, limit: int) -> None:
    """Largest and smallest shown values stay, both signs; every point that is left is one of the curve."""
    rng = np.random.default_rng(number)
    x, y, keep = np.cumsum(rng.uniform(0.1, 1.0, n)), rng.normal(size=n), rng.random(n) < 0.7
    shown_x, shown = thin(x, y, keep, limit)
    assert len(shown) <= max(limit, n if n <= limit else 0) + 2
    assert np.all(np.diff(shown_x) >= 0.0)
    at = np.searchsorted(x, shown_x)
    known = np.isfinite(shown)
    np.testing.assert_array_equal(x[at], shown_x)
    np.testing.assert_array_equal(shown[known], y[at][known])
    assert keep[at][known].all()
    if keep.any():
        assert (np.nanmin(shown), np.nanmax(shown)) == (y[keep].min(), y[keep].max())
    else:
        assert not known.any()


@QUICK
@given(st.lists(st.floats(-1.0, 2.0), min_size=1, max_size=7, unique=True))
def test_causes_of_an_error_stand_by_their_size_whichever_way_they_act(shares: list[float]) -> None:
    """Largest on top, a helping cause beside a harming one of its size; the remainder below all; texts keep signs."""
    lines = [BudgetLine(f"cause {k}", share, 120.0 * share * UM, 1.0, 1.0) for k, share in enumerate(shares)]
    rest = BudgetLine(REMAINDER, 5.0, 600.0 * UM, 1.0, 1.0)
    bars, texts = budget_figure((*lines, rest))["data"]
    size = [abs(shares[int(name.split()[1])]) for name in bars["y"][1:]]
    assert bars["y"][0] == REMAINDER
    assert size == sorted(size)
    known = {line.name: line for line in (*lines, rest)}
    for name, value, text in zip(bars["y"], bars["x"], texts["text"], strict=True):
        assert value == pytest.approx(known[name].mean_m / UM, abs=0.006)
        assert text == f"{value:.0f} µm · {100.0 * known[name].share:.1f} %".replace("-", "−")


@QUICK
@given(seed)
def test_shares_of_an_area_weigh_floor_and_wall_by_their_own_area(number: int) -> None:
    """Sums over all classes are one; what lies beyond the scale counts at its end, what was not seen nowhere."""
    rng = np.random.default_rng(number)
    floor, wall = rng.normal(size=(8, 20)) * 0.3 * MM, rng.normal(size=30) * 0.3 * MM
    floor[rng.random((8, 20)) < 0.3], wall[:5] = np.nan, np.nan
    area, cell, edges = rng.uniform(0.1, 5.0, 30) * MM**2, 0.5 * MM, np.linspace(-0.4, 0.4, 9)
    surface: Any = SimpleNamespace(nominal=SimpleNamespace(cell_m=cell), wall_area_m2=area)
    deviation: Any = SimpleNamespace(floor_m=floor, wall_m=wall)
    found = area_shares(surface, deviation, edges)
    value = np.concatenate([floor.ravel(), wall])
    weight = np.concatenate([np.full(160, cell**2), area])
    known = np.isfinite(value)
    place = np.clip(np.searchsorted(edges, value[known] / MM, side="right") - 1, 0, 7)
    np.testing.assert_allclose(found, np.bincount(place, weight[known], minlength=8) / weight[known].sum())
    assert found.sum() == pytest.approx(1.0)


@QUICK
@given(st.floats(1e-3, 50.0))
def test_a_scale_holds_its_value_with_a_zero_band_in_the_middle(largest: float) -> None:
    limit = scale_limit_mm(largest)
    assert largest <= limit * (1.0 + 1e-6)
    assert limit <= 2.0 * largest * (1.0 + 1e-6)
    edges = edges_mm(limit)
    assert len(edges) == 16
    assert (edges[0], edges[-1]) == pytest.approx((-limit, limit), abs=1e-6)
    assert edges[7] == pytest.approx(-edges[8], abs=2e-6)


@QUICK
@given(seed, st.lists(st.sampled_from([0.0, 1e-6, 1.0]), min_size=3, max_size=3))
def test_a_path_in_space_fills_its_box_whatever_it_lacks(number: int, widths: list[float]) -> None:
    """A path on a line or in a plane too: alike scales along all axes, all points within, one axis filled."""
    rng = np.random.default_rng(number)
    p = rng.uniform(-0.1, 0.1, (20, 3)) * widths
    none: Any = np.zeros((20, 3))
    data = PredictionData(
        title="", subtitle="", created="", time_s=np.linspace(0.0, 1.0, 20), p_part_tcp=p, deflection_m=none,
        correction_m=none, force_n=np.zeros(20), facts=(), assumptions=(), timing=(), versions={}, notes=(),
        cutting=np.ones(20, np.bool_), line=np.arange(20),
    )  # fmt: skip
    scene = space_figure(data)["layout"]["scene"]
    low, high = np.array([scene[f"{axis}axis"]["range"] for axis in "xyz"]).T
    assert np.all((p / MM >= low - 0.006) & (p / MM <= high + 0.006))
    aspect = np.array([scene["aspectratio"][axis] for axis in "xyz"])
    np.testing.assert_allclose(aspect / aspect.max(), (high - low) / (high - low).max(), atol=0.02)
    assert 0.25 < aspect.min() <= aspect.max() < 2.5
    if max(np.ptp(p, axis=0)) > MM:
        assert (np.ptp(p, axis=0) / MM / (high - low)).max() > 0.9
