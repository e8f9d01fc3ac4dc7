"""Figures of a plan, of its warnings and of the parts it was corrected from, over random plans; by NumPy alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.compensation.compensate import shown_limits
from counterflex.app.compensation.headline import error_rows, extrapolation, headline_of, worse_lines, worse_warnings
from counterflex.app.compensation.prediction import (
    calm_feed,
    calm_feed_text,
    chatter,
    chatter_warnings,
    figures,
    path_error,
)
from counterflex.app.correction.causes import shown
from counterflex.app.correction.correct import PARTS, HistoryPart, keep_parts, read_parts, trend
from counterflex.app.unknown_stiffness import expected
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.evaluate.path_error.explanations import Explanation
from counterflex.evaluate.path_error.learning import MeasuredError
from counterflex.files.part_deviations import MeasuredPart
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.chip_range import uncertainty
from counterflex.plan.feed_limits import LimitedLine
from counterflex.plan.plan import Plan

QUICK = settings(max_examples=25)
seed = st.integers(0, 2**31)
LAW = KienzleLaw.from_k11(780e6, 0.27, kr11_pa=273e6, mr=0.2, ka11_pa=117e6, ma=0.1, h_min_m=0.01 * MM,
                          h_max_m=0.1 * MM, source="test", status="assumed")  # fmt: skip
N = 60


def plan_of(number: int) -> Plan:
    """A straight path along x with uneven steps, three lines, air and cuts; everything else at random."""
    rng = np.random.default_rng(number)
    x = np.cumsum(rng.uniform(1e-4, 5e-3, N))
    p = np.column_stack([x, np.zeros(N), np.zeros(N)])
    kind = np.where(rng.random(N) < 0.1, RAPID, FEED)
    path = ToolPath(p, np.tile([0.0, 0.0, 1.0], (N, 1)), kind, np.full(N, 0.02), np.full(N, 1000.0),
                    np.cumsum(rng.uniform(0.01, 0.2, N)), np.arange(N), np.ones(N, np.int64))  # fmt: skip

    def some(width: int, size: float) -> Float:
        out: Float = rng.normal(scale=size, size=(N, width))
        return out

    volume = np.where(rng.random(N) < 0.7, rng.uniform(1e-10, 1e-8, N), 0.0)
    chip = rng.uniform(0.001, 0.3, N) * MM
    outside = (volume > 0.0) & ((chip < LAW.h_min_m) | (chip > LAW.h_max_m))
    return Plan(
        path, np.sort(rng.integers(10, 13, N)), some(6, 1.0), some(6, 200.0), some(6, 1e-4), some(3, 1e-5),
        some(3, 1e-5), some(3, 1e-4), some(3, 1e-4), volume, rng.uniform(0.0, 3e-3, N), np.zeros(N), np.ones(N),
        np.full(N, 1e-4), some(3, 2e-4), some(3, 1.5e-4), some(6, 200.0), outside.astype(np.int64), None, chip,
    )  # fmt: skip


def across_x(deviation: Float) -> Float:
    """Size square to the path, which runs along x; the first row has no direction and counts whole."""
    out: Float = np.linalg.norm(deviation[:, 1:], axis=1)
    out[0] = np.linalg.norm(deviation[0])
    return out


@QUICK
@given(seed)
def test_peaks_and_sums_of_a_plan_are_those_of_its_rows(number: int) -> None:
    plan = plan_of(number)
    found = figures(plan)
    size = {
        "peak_force_n": (np.linalg.norm(plan.w_tcp_part[:, :3], axis=1), 1.0),
        "peak_deflection_um": (np.linalg.norm(plan.deflection_part[:, :3], axis=1), UM),
        "peak_correction_um": (np.linalg.norm(plan.correction_part, axis=1), UM),
        "peak_axial_depth_mm": (plan.axial_depth_m, MM),
    }
    for name, (values, unit) in size.items():
        row = int(np.argmax(values))
        assert found[name]["value"] == pytest.approx(values[row] / unit, abs=0.06)
        assert found[name]["line"] == plan.line[row]
        assert found[name]["at_mm"] == pytest.approx(plan.path.p_part_tcp[row] / MM, abs=1e-3)
        assert found[name]["joints_deg"] == pytest.approx(plan.q[row] / DEG, abs=1e-3)
    assert found["removed_mm3"] == pytest.approx(plan.volume_m3.sum() * 1e9, abs=1e-3)
    assert found["duration_s"] == pytest.approx(plan.path.time_s[-1], abs=1e-3)
    assert (found["points"], found["cutting_points"]) == (N, int(plan.cutting.sum()))
    step = np.diff(plan.path.p_part_tcp[:, 0], prepend=plan.path.p_part_tcp[0, 0])[plan.cutting]
    for name, deviation in (("nominal", plan.deviation_nominal_part), ("compensated", plan.deviation_compensated_part)):
        error, met = found[f"predicted_{name}"], across_x(deviation)[plan.cutting]
        assert error["max_mm"] == pytest.approx(met.max() / MM, abs=1e-4)
        assert error["rms_mm"] == pytest.approx(np.sqrt(np.sum(step * met**2) / step.sum()) / MM, abs=1e-4)
    struck = np.flatnonzero((plan.path.kind == RAPID) & (plan.volume_m3 > 1e-12))
    assert [c["line"] for c in found["collisions"]] == plan.line[struck].tolist()
    assert [c["volume_mm3"] for c in found["collisions"]] == pytest.approx(plan.volume_m3[struck] * 1e9, abs=1e-4)


@QUICK
@given(seed, st.integers(0, 5))
def test_a_predicted_error_weighs_by_length(number: int, times: int) -> None:
    rng = np.random.default_rng(number)
    size, weight = rng.uniform(0.0, 1e-3, 30), rng.uniform(1e-4, 1e-2, 30)
    again = path_error(np.repeat(size, times + 1), np.repeat(weight / (times + 1), times + 1))
    assert again == path_error(size, weight)


@QUICK
@given(seed)
def test_lines_that_get_worse_are_named_worst_first(number: int) -> None:
    plan = plan_of(number)
    before, after = across_x(plan.deviation_nominal_part), across_x(plan.deviation_compensated_part)
    worse = {}
    for line in np.unique(plan.line[plan.cutting]):
        rows = plan.cutting & (plan.line == line)
        if after[rows].max() > before[rows].max() + UM:
            worse[int(line)] = (before[rows].max() / MM, after[rows].max() / MM)
    found = worse_lines(plan)
    assert {r["line"]: (r["before_mm"], r["after_mm"]) for r in found} == {
        line: pytest.approx(pair, abs=1e-4) for line, pair in worse.items()
    }
    growth = [r["after_mm"] - r["before_mm"] for r in found]
    assert growth == sorted(growth, reverse=True)
    for text in worse_warnings(found):
        assert f"in line {found[0]['line']}, from {found[0]['before_mm']:.3f} to {found[0]['after_mm']:.3f} mm" in text


@QUICK
@given(seed)
def test_a_line_that_chatters_is_told_by_its_largest_deviation(number: int) -> None:
    plan = plan_of(number)
    quiet = replace(plan, deflection_part=0.1 * plan.deflection_part)
    rest = np.linalg.norm(quiet.deflection_part[:, :3] + quiet.sag_part + quiet.play_part, axis=1)
    most = rest[quiet.cutting].max()
    worst: dict[int, float] = {}
    for deviation, times in ((quiet.deviation_nominal_part, 2.0), (quiet.deviation_compensated_part, 1.0)):
        size = across_x(deviation)
        for row in np.flatnonzero(quiet.cutting & (size > times * most + 20.0 * UM)):
            worst[int(quiet.line[row])] = max(worst.get(int(quiet.line[row]), 0.0), float(size[row]))
    found = chatter(quiet)
    assert {r["line"]: r["deviation_mm"] for r in found} == {k: round(v / MM, 3) for k, v in worst.items()}
    for text in chatter_warnings(found):
        assert f"up to {max(r['deviation_mm'] for r in found):.3g} mm" in text


@QUICK
@given(seed)
def test_chips_outside_are_told_where_they_matter_most(number: int) -> None:
    plan = plan_of(number)
    found = extrapolation(plan, LAW)
    rows = plan.extrapolated == 1
    assert plan.chip_m is not None
    if not rows.any():
        assert found is None
        return
    effect = np.where(rows, uncertainty(LAW, plan.chip_m) * np.linalg.norm(plan.deflection_part[:, :3], axis=1), 0.0)
    worst = int(np.argmax(effect))
    assert found is not None
    assert found["effect_um"] == pytest.approx(effect.max() / UM, abs=0.01)
    assert (found["line"], found["mean_chip_mm"]) == (
        plan.line[worst],
        pytest.approx(plan.chip_m[worst] / MM, abs=1e-6),
    )
    assert found["range_mm"] == pytest.approx([0.01, 0.1])


def prediction(before: float, after: float, low: float, high: float) -> dict[str, Any]:
    return {
        "predicted_nominal": {"max_mm": 2 * before, "p997_mm": before, "rms_mm": 0.5 * before},
        "predicted_compensated": {"max_mm": 2 * after, "p997_mm": after, "rms_mm": 0.5 * after},
        "headline": {"before_mm": [before, low, high], "after_mm": [after, 0.5 * low, 0.5 * high],
                     "probability_of_worse": 0.1, "sharp_corners": 3},
    }  # fmt: skip


@QUICK
@given(st.floats(0.1, 0.9), st.floats(0.01, 0.09))
def test_before_and_after_of_a_plan_stand_in_their_places(before: float, after: float) -> None:
    one = prediction(before, after, 0.05, 1.5)
    made = headline_of(one)
    assert made.model_mm == (before, after)
    assert (made.before_mm, made.after_mm) == ((before, 0.05, 1.5), (after, 0.025, 0.75))
    rows = {name: text for name, text, _ in error_rows(one)}
    assert rows["Model without its unknowns, before"] == f"{before:.3f} mm, largest {2 * before:.3f} mm"
    assert rows["Model without its unknowns, after"] == f"{after:.3f} mm, largest {2 * after:.3f} mm"
    assert rows["Expected path error before"] != rows["Expected path error after"]
    assert rows["Sharp corners in the cut"] == "3"
    del one["headline"]["sharp_corners"]  # a summary of before
    assert "Sharp corners in the cut" not in {name for name, _, _ in error_rows(one)}


def test_a_lowered_feed_is_told_by_its_least_and_its_whole_length() -> None:
    lines = [{"line": 3, "feed_percent": 80.0, "length_mm": 2.0}, {"line": 9, "feed_percent": 35.5, "length_mm": 5.0}]
    text = calm_feed_text({"swing_um": 30, "extra_s": 1.25, "lines": lines})
    assert "down to 35.5 %, over 7 mm" in text
    assert "(line 3, 9): 1.2 s longer" in text


@QUICK
@given(seed)
def test_a_lowered_feed_is_told_of_each_line_by_its_least_and_the_way_that_is_slowed(number: int) -> None:
    """Row by row: what is fed at full speed in the same line counts neither as its feed nor as its length."""
    plan, rng = plan_of(number), np.random.default_rng(number)
    share = np.where(rng.random(N) < 0.5, rng.uniform(0.1, 0.99, N), 1.0)
    late = rng.uniform(0.0, 5.0)
    slowed = replace(plan.path, feed_m_s=share * plan.path.feed_m_s, time_s=plan.path.time_s + late)
    cell: Any = SimpleNamespace(tables=SimpleNamespace(dynamics=SimpleNamespace(swing_um=30.0)))
    job: Any = SimpleNamespace(path=plan.path)
    found = calm_feed(job, replace(plan, path=slowed), cell)
    x = plan.path.p_part_tcp[:, 0]
    least: dict[int, float] = {}
    way: dict[int, float] = {}
    for row in np.flatnonzero(share < 1.0):
        line = int(plan.line[row])
        least[line] = min(least.get(line, 1.0), share[row])
        way[line] = way.get(line, 0.0) + (x[row] - x[row - 1] if row else 0.0)
    assert [row["line"] for row in found["lines"]] == sorted(least)
    for row in found["lines"]:
        assert row["feed_percent"] == pytest.approx(100.0 * least[row["line"]], abs=0.051)
        assert row["length_mm"] == pytest.approx(way[row["line"]] / MM, abs=0.0051)
    assert (found["swing_um"], found["extra_s"]) == (30.0, pytest.approx(late, abs=6e-4))


def test_limits_show_the_share_before_and_after() -> None:
    limited: Any = SimpleNamespace(extra_s=3.0, lines=(LimitedLine(12, 0.4, "force", 2.5, 0.95),))
    (row,) = shown_limits(limited)["lines"]
    assert (row["before_percent"], row["after_percent"], row["feed_percent"]) == (250.0, 95.0, 40.0)
    assert row["kept"]


@QUICK
@given(seed)
def test_an_expected_range_is_low_to_high_about_its_median(number: int) -> None:
    sizes = np.random.default_rng(number).lognormal(size=200)
    found = expected(sizes, "x")
    assert found.low_m < found.median_m < found.high_m
    assert np.mean(sizes <= found.low_m) == pytest.approx(0.05, abs=0.01)
    assert np.mean(sizes <= found.high_m) == pytest.approx(0.95, abs=0.01)


def measured(rng: np.random.Generator, taken: Float, error: Float) -> MeasuredError:
    seen = rng.random((20, 3)) < 0.8
    return MeasuredError(taken, error, np.full((20, 3), 5.0 * UM), seen)


@QUICK
@given(seed, st.integers(2, 5))
def test_parts_that_follow_a_correction_have_not_changed_by_it(number: int, count: int) -> None:
    """What a part's program took back counts with what it left: the same machine shows no change, however corrected."""
    rng = np.random.default_rng(number)
    whole, parts = rng.normal(scale=1e-4, size=(20, 3)), []
    for _ in range(count):
        taken = rng.uniform(0.0, 1.0) * whole
        parts.append(HistoryPart(measured(rng, taken, whole - taken), {}))
    assert [row["part"] for row in trend(parts)] == list(range(1, count + 1))
    for row in trend(parts)[1:]:
        assert row.get("changed_um", 0.0) == pytest.approx(0.0, abs=1e-6)
    off = replace(parts[-1].error, error_m=parts[-1].error.error_m + 10.0 * UM)
    last = trend([*parts[:-1], HistoryPart(off, {})])[-1]
    assert last["changed_um"] == pytest.approx(10.0, abs=0.06)
    assert last["changed_sigmas"] == pytest.approx(2.0 / np.sqrt(2.0), abs=0.06)


def test_a_second_correction_keeps_the_parts_of_the_first(tmp_path: Any) -> None:
    """Numbered on behind them, in their order."""
    rng = np.random.default_rng(1)
    deviations = PartDeviations(
        np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.ones(1), np.zeros(1, int)
    )
    about: dict[str, Any] = {"job": "correct"}
    source_of = MeasuredPart("part.ngc", 64 * "0", "scan.ply", "mm", (), 1.0)
    folders = [tmp_path / name for name in ("plan", "first", "second")]
    for folder in folders:
        folder.mkdir()
    facts = [{"scan": "a"}, {"scan": "b"}, {"scan": "c"}]
    for source, target, new in ((0, 1, facts[:2]), (1, 2, facts[2:])):
        rows: list[Any] = [
            (deviations, source_of, HistoryPart(measured(rng, np.zeros((20, 3)), np.zeros((20, 3))), fact))
            for fact in new
        ]
        keep_parts(folders[source], folders[target], rows, about)
    assert [part.facts for part in read_parts(folders[2])] == facts
    assert sorted(path.name for path in (folders[2] / PARTS).iterdir()) == ["001", "002", "003"]


@pytest.mark.parametrize(
    "law",
    [
        replace(LAW, edge_n_m=(2e3, 3e3, -1e3)),
        LinearEdgeLaw(600e6, 200e6, -50e6, 20e3, 30e3, -5e3, 0.01 * MM, 0.1 * MM, "test", "assumed"),
    ],
    ids=["kienzle", "linear"],
)
@settings(max_examples=10)
@given(st.floats(0.2, 3.0), st.floats(0.2, 3.0), st.floats(0.2, 3.0))
def test_a_scaled_law_scales_every_force(law: Any, factor: float, radial: float, axial: float) -> None:
    h = np.array([0.001, 0.02, 0.3]) * MM
    np.testing.assert_allclose(law.scaled(factor).edge_force(h), factor * law.edge_force(h), rtol=1e-12)
    made = law.scaled((factor, radial, axial))
    np.testing.assert_allclose(made.edge_force(h), [factor, radial, axial] * law.edge_force(h), rtol=1e-12)


def test_explanations_are_shown_in_their_units() -> None:
    names = ("force, relative", "offset x, m", "rotation about z, rad")
    one = Explanation(
        "force", names, np.array([0.1, 2e-5, 3e-5]), np.array([0.01, 1e-6, 2e-6]), np.eye(3), 12.34, 0.876
    )
    (row,) = shown([one])
    assert [(f["name"], f["value"], f["standard_deviation"], f["unit"]) for f in row["factors"]] == [
        ("force", 10.0, 1.0, "%"), ("offset x", 20.0, 1.0, "um"), ("rotation about z", 30.0, 2.0, "urad"),
    ]  # fmt: skip
    assert (row["log_evidence"], row["explained_percent"]) == (12.3, 87.6)
