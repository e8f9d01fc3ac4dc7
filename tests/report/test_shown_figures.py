"""What pages and maps show equals what they are given: before and after in their places, both signs, the worst of each.

Numbers are read back from the page or the figure and held against the data by NumPy alone.
"""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.figures import NONE, DeviationFigures
from counterflex.evaluate.inspection.coverage import Coverage
from counterflex.evaluate.inspection.sections import PartSection, Profile
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation
from counterflex.report.inspection.page import InspectionData, MeasuredPath, enlarged
from counterflex.report.map_figure import MapPicture, callouts, map_figure, map_picture
from counterflex.report.preflight.page import PreflightData
from counterflex.report.preflight.path_figures import PathCurves

NX, NY, CELL = 40, 24, 1.0 * MM
seed = st.integers(0, 2**31)
QUICK = settings(max_examples=15)


def words(page: str) -> str:
    """Text of a page without scripts and markup."""
    text = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", text)))


def figures_in(page: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(re.findall(r'id="figures">(.*?)</script>', page, re.DOTALL)[0])
    return found


def surface(wall: Float | None = None) -> NominalSurface:
    """A floor, with walls at some points."""
    stock, nominal = (HeightMap(0.0, 0.0, CELL, np.full((NY, NX), z, np.float32), -10.0 * MM) for z in (0.0, -2.0 * MM))
    far = np.full((NY, NX), np.inf, np.float32)
    points = np.zeros((0, 3)) if wall is None else wall
    normals = np.tile([1.0, 0.0], (len(points), 1))
    floor = np.ones((NY, NX), np.bool_)
    return NominalSurface(
        stock, nominal, Cutter(diameter_m=8.0 * MM), floor, np.ones((NY, NX), np.float32), far, far, points, normals,
        np.full(len(points), 1e-6), 1.0 * MM,
    )  # fmt: skip


def deviation(floor_m: Float, wall_m: Float | None = None) -> SurfaceDeviation:
    wall = np.zeros(0) if wall_m is None else wall_m
    cells = floor_m[np.isfinite(floor_m)]
    figures = DeviationFigures.weighted(cells, CELL**2)
    of_wall = DeviationFigures.weighted(wall, 1e-6) if len(wall) else NONE
    return SurfaceDeviation(floor_m.astype(np.float32), wall, figures, figures, of_wall, CELL, 0.1 * UM, 0.0)


def random_floor(number: int) -> Float:
    out: Float = np.random.default_rng(number).normal(scale=50.0 * UM, size=(NY, NX))
    return out


@QUICK
@given(seed, st.sampled_from([-1.0, 1.0]), st.integers(2, 6))
def test_a_pixel_shows_the_farthest_deviation_under_it(number: int, sign: float, side: int) -> None:
    floor = np.abs(random_floor(number)) * -sign * 0.1
    j, i = np.random.default_rng(number).integers(0, (NY, NX))
    floor[j, i] = sign * 1e-3  # the farthest, of the other sign than the rest
    shown = map_picture(surface(), deviation(floor), NX * NY // side**2)
    k = round(NX / shown.value_mm.shape[1])
    assert shown.value_mm[j // k, i // k] == pytest.approx(sign, rel=1e-6)
    mirrored = map_picture(surface(), deviation(-floor), NX * NY // side**2)
    np.testing.assert_allclose(mirrored.value_mm, -shown.value_mm)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_wall_is_shown_by_its_farthest_neighbour(sign: float) -> None:
    floor = np.full((NY, NX), 0.0)
    floor[:, 20:] = np.nan
    wall = np.array([[20.4, 10.0, -1.0], [20.5, 10.2, -1.0], [20.6, 9.8, -1.0]]) * MM
    shown = map_picture(surface(wall), deviation(floor, sign * np.array([10.0, -300.0, 20.0]) * UM))
    assert shown.value_mm[10, 20] == pytest.approx(-0.3 * sign)


def picture(value_mm: Float) -> MapPicture:
    return MapPicture(np.arange(float(NX)), np.arange(float(NY)), value_mm)


@QUICK
@given(seed)
def test_callouts_say_what_both_maps_hold_at_the_worst_places_of_either_sign(number: int) -> None:
    rng = np.random.default_rng(number)
    before, after = (picture(rng.normal(size=(NY, NX))) for _ in range(2))
    places = callouts(before, after)
    assert [abs(places[0].after_mm), abs(places[3].before_mm)] == pytest.approx(
        [np.abs(after.value_mm).max(), max(abs(p.before_mm) for p in places[3:])]
    )
    for place in places:
        j, i = round(place.y_mm), round(place.x_mm)
        assert (place.before_mm, place.after_mm) == (before.value_mm[j, i], after.value_mm[j, i])
    figure = map_figure(before, after, places, 1.0)
    for n, (data, shown) in enumerate(zip(figure["data"], (before, after), strict=True)):
        notes = [a for a in figure["layout"]["annotations"] if a.get("xref") == ("x2" if n else "x")]
        value = [place.after_mm if n else place.before_mm for place in places]
        assert [a["text"].split("</b> ")[1] for a in notes] == [f"{v:+.2f}" for v in value]
        assert data["coloraxis"] == "coloraxis"
        assert shown.value_mm.shape == (NY, NX)


@QUICK
@given(seed)
def test_mirrored_maps_have_the_same_callouts(number: int) -> None:
    value = random_floor(number) / MM
    one, other = (callouts(picture(sign * value), picture(0.5 * sign * value)) for sign in (1.0, -1.0))
    assert [(p.x_mm, p.y_mm, p.after_mm) for p in one] == [(p.x_mm, p.y_mm, -p.after_mm) for p in other]


def feature(off: dict[str, float], sigma_m: float = 2.0 * UM, tolerance_m: float = 0.1 * MM) -> FeatureRow:
    value = {name: 10.0 * MM + d for name, d in off.items()}
    spread = dict.fromkeys(off, sigma_m)
    return FeatureRow("bore 1", "diameter", 10.0 * MM, value, value, tolerance_m, "given", spread, {})


def inspection(features: tuple[FeatureRow, ...] = (), scale: tuple[float, ...] = (1.0, 0.2)) -> InspectionData:
    names = ("before", "after") if len(scale) == 2 else ("part",)
    floor = random_floor(1)
    found = {name: deviation(s * floor) for name, s in zip(names, scale, strict=True)}
    return InspectionData("Part", "", "", surface(), found, features, (), dict.fromkeys(names, ()))


@QUICK
@given(st.floats(0.05, 2.0), st.floats(0.05, 2.0))
def test_an_inspection_says_before_and_after_in_their_places(before: float, after: float) -> None:
    assume(abs(before - after) > 0.02)
    data = inspection(scale=(before, after))
    p997 = [data.deviations[name].surface.p997_m / MM for name in ("before", "after")]
    text = words(data.page())
    assert f"lies within {p997[1]:.3f} mm of the nominal one; before, within {p997[0]:.3f} mm." in text
    one = inspection(scale=(after,))
    assert f"lies within {p997[1]:.3f} mm of the nominal one." in words(one.page())
    row = re.search(r"Floors ((?:[\d.]+ ){8})", text)
    assert row is not None
    shown = [float(word) for word in row[1].split()]
    expected: list[float] = []
    for name in ("before", "after"):
        f = data.deviations[name].floor
        expected += [f.max_m / MM, f.p997_m / MM, f.rms_m / MM, f.extent / MM**2]
    assert shown == pytest.approx(expected, abs=6e-4)


def measured_path(number: int, scale_m: float) -> MeasuredPath:
    """A straight path in x with deviations at random; it cuts all the way, its first and last fifth are entry, exit."""
    rng, n = np.random.default_rng(number), 50
    left, up, along = rng.normal(size=(3, n)) * scale_m
    x, none = np.linspace(0.0, (n - 1) * MM, n), np.zeros(n)
    nominal, yes = np.column_stack([x, none, none]), np.ones(n, np.bool_)
    place = np.arange(n) / n
    deviation = PathDeviation(
        MM, x, nominal, nominal, x, np.zeros(n, np.int64), np.tile([1.0, 0.0, 0.0], (n, 1)),
        np.tile([0.0, 1.0, 0.0], (n, 1)), np.column_stack([none, left, up]), left, up, along, yes.astype(float), yes,
        place < 0.2, place >= 0.8, ~yes, ~yes,
    )  # fmt: skip
    return MeasuredPath(deviation, {"floor": up}, PathFigures.of(deviation), cut_known=True, along_known=True)


@settings(max_examples=5)
@given(seed, st.floats(0.05, 2.0), st.floats(0.05, 2.0), st.booleans())
def test_an_inspected_path_says_what_it_leaves_across_the_feed_after_and_before(
    number: int, before: float, after: float, both: bool
) -> None:
    """By NumPy from the stations of each; the table has the same in the order of the parts, entries apart."""
    assume(abs(before - after) > 0.1)
    scale = (before, after) if both else (after,)
    data = inspection(scale=scale)
    paths = {name: measured_path(number, s * MM) for name, s in zip(data.deviations, scale, strict=True)}
    text = words(replace(data, paths=paths).page())
    size = [np.linalg.norm(path.deviation.across, axis=1) / MM for path in paths.values()]
    p997 = [float(np.quantile(v, 0.997, method="inverted_cdf")) for v in size]
    more = f"; before, within {p997[0]:.3f} mm." if both else "."
    assert f"the path of the tool lies within {p997[-1]:.3f} mm of the program's, across the feed{more}" in text
    for title, rows in (("Across the feed, where the tool cut", slice(None)), ("Entries", slice(10)),
                        ("Exits", slice(40, None)), ("Between them", slice(10, 40))):  # fmt: skip
        shown = re.search(rf"{title} ((?:[\d.]+ ){{{4 * len(scale)}}})", text)
        assert shown is not None
        expected: list[float] = []
        for v in size:
            some = v[rows]
            expected += [some.max(), float(np.quantile(some, 0.997, method="inverted_cdf")), np.sqrt(np.mean(some**2))]
            expected.append(float(len(some)))
        assert [float(word) for word in shown[1].split()] == pytest.approx(expected, abs=6e-4)


@QUICK
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(1.0, 50.0))
def test_a_feature_is_judged_after_with_twice_its_deviation(before: float, after: float, sigma_um: float) -> None:
    before, after = (round(v, 3) + 2e-4 for v in (before, after))  # not half of what the page rounds to
    sigma_um = round(sigma_um) + 0.1
    data = inspection((feature({"before": before * MM, "after": after * MM}, sigma_um * UM),))
    text = words(data.page())
    good = abs(after) <= 0.1
    assert ("All 1 quantities within tolerance" in text) == good
    assert ("Of 1 quantities 1 out of tolerance" in text) == (not good)
    row = text[text.index("bore 1 diameter") :][:200]
    assert row.startswith(f"bore 1 diameter {10.0 + before:.3f}")
    marks = ["OK" if abs(v) <= 0.1 else "not" for v in (before, after)]
    assert re.findall(r"✓ (OK)|✗ (not)", row) == [(m, "") if m == "OK" else ("", m) for m in marks]
    off = [f"{v:+.3f}".replace("-", "−") for v in (before, after)]
    assert f"{off[0]} {2.0 * sigma_um:.0f} {off[1]} {2.0 * sigma_um:.0f}" in row


def test_what_was_not_measured_is_not_passed() -> None:
    data = inspection((feature({"before": 0.0}), feature({"before": 0.0, "after": 0.0})))
    assert "Of 2 quantities 1 not measured" in words(data.page())


@pytest.mark.parametrize("measured", [1.0, 0.5])
def test_what_was_measured_in_part_is_said_and_not_passed(measured: float) -> None:
    one = replace(feature({"part": 0.0}), measured_share={"part": measured})
    text = words(inspection((one,), scale=(1.0,)).page())
    assert ("All 1 quantities within tolerance" in text) == (measured == 1.0)
    assert ("Of 1 quantities 1 measured in part only" in text) == (measured == 0.5)
    assert ("50 % seen" in text) == (measured == 0.5)
    good = re.search(r'class="[^"]*badge[^"]*"', inspection((one,), scale=(1.0,)).page())
    bad = re.search(r'class="[^"]*badge[^"]*"', inspection((feature({"part": 1.0}),), scale=(1.0,)).page())
    assert good is not None
    assert bad is not None
    assert (good[0] == bad[0]) == (measured == 0.5)


def test_areas_of_a_scan_stand_in_their_columns() -> None:
    whole, some = (Coverage(*(k * MM**2 for k in areas)) for areas in ((100, 60, 10, 30), (40, 38, 2, 0)))
    data = replace(inspection(scale=(1.0,)), coverage={"part": (whole, {"groove 1": some})})
    text = words(data.page())
    assert "feature judged not scanned, mm² not judged, mm² judged, mm² machined, mm²" in text
    assert "whole machined surface 60 % 30 10 60 100" in text
    assert "groove 1 95 % 0 2 38 40" in text


@QUICK
@given(seed)
def test_a_section_is_enlarged_alike_for_both_signs(number: int) -> None:
    size = np.abs(np.random.default_rng(number).normal(scale=1e-4, size=60))
    factors = []
    for sign in (1.0, -1.0):
        one = Profile(np.zeros(60), np.zeros(60), np.tile([0.0, 1.0], (60, 1)), sign * size)
        factors.append(enlarged(PartSection("groove 1", 0.0, np.zeros(2), np.zeros(2), {"part": one})))
    assert factors[0] == factors[1]
    assert factors[0] * np.percentile(np.append(size, 0.0), 95.0) <= 2.0 * MM


CHECKS = st.lists(st.sampled_from(["ok", "warning", "fail", "not looked at"]), min_size=1, max_size=12)


def preflight(verdicts: list[str], points: list[int | None]) -> PreflightData:
    checks = [
        {"check": f"check {k}", "verdict": v, "value": None, "limit": None, "unit": "", "line": None, "what": "",
         "advice": "", "missing": "", "place": None}
        for k, v in enumerate(verdicts)
    ]  # fmt: skip
    return PreflightData(
        "P", "", checks, "fail" in verdicts, np.arange(5.0), np.full((5, 6), 10.0), 5.0, np.arange(5), points,
        np.ones(5, np.bool_), (),
    )  # fmt: skip


@QUICK
@given(CHECKS)
def test_a_preflight_counts_each_verdict_by_itself(verdicts: list[str]) -> None:
    text = words(preflight(verdicts, [None] * len(verdicts)).page())
    warnings, unseen, failed = (verdicts.count(v) for v in ("warning", "not looked at", "fail"))
    plural = "" if warnings == 1 else "s"
    assert f"{warnings} warning{plural}; {unseen} hazards are not looked at." in text
    assert (f"{failed} check{'s fail' if failed > 1 else ' fails'}: " in text) == (failed > 0)


@QUICK
@given(st.permutations(["fail", "warning", "warning"]))
def test_a_place_that_fails_is_marked_as_failed_in_any_order_of_checks(verdicts: list[str]) -> None:
    figure = figures_in(preflight(list(verdicts), [2, 2, 2]).page())["margins"]
    (note,) = [a for a in figure["layout"]["annotations"] if a["text"].startswith("line 2")]
    assert note["font"]["color"] == "#b91c1c"
    assert note["text"] == "line 2: check 0, check 1, check 2"


@QUICK
@given(st.floats(0.1, 3.0), st.booleans())
def test_joint_speeds_are_shown_in_percent_of_their_own_limit(share: float, limited: bool) -> None:
    limits = np.array([1.0, 1.5, 2.0, 3.0, 3.5, 4.0])
    speeds = np.tile(-share * limits, (5, 1))
    some = np.linspace(0.0, 1.0, 5)
    whole = np.ones(5, np.bool_)
    curves = PathCurves(
        some, whole, some, some, whole, speeds, speeds, limits if limited else None, limits if limited else None,
        np.zeros(0), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    figure = curves.figures()["joint_speed"]
    for axis, trace in enumerate(figure["data"][:6]):
        expected = 100.0 * share if limited else share * limits[axis] / DEG
        np.testing.assert_allclose([y for y in trace["y"] if y is not None], expected, rtol=1e-3)
    assert ("% of its limit" in figure["layout"]["yaxis"]["title"]["text"]) == limited
