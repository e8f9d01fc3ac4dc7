"""The page: self-contained, escaped, and its numbers are the summary's."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.error_budget import error_budget
from counterflex.evaluate.feature_finding import find_features
from counterflex.evaluate.features import Machined, measure_features
from counterflex.evaluate.path_deviation import PathFigures, path_deviation
from counterflex.evaluate.summary import SeedResult, Variant, summary, table_rows
from counterflex.evaluate.surface import SurfaceDeviation, nominal_surface
from counterflex.path import FEED, RAPID, ToolPath
from counterflex.report.data import (
    CellDrawing,
    ErrorCurve,
    Fact,
    Headline,
    PredictionData,
    ReportData,
    ReportedDifference,
    VariantData,
)
from counterflex.report.distribution_figure import area_shares
from counterflex.report.figure_data import edges_mm, scale_limit_mm
from counterflex.report.page import prediction_page, report_page, write_page

CUTTER = Cutter(diameter_m=16e-3, flutes=3)
FEED_M_S = 0.025
NASTY = "Müller & Söhne <script>alert('x')</script>"


def example_path() -> ToolPath:
    """Three grooves, two ramps and a round pocket, sampled every 0.5 mm."""
    points: list[list[float]] = []
    kinds: list[int] = []
    motions: list[int] = []

    def go(kind: int, target: list[float]) -> None:
        start = np.array(points[-1] if points else target)
        n = max(1, round(float(np.linalg.norm(np.array(target) - start)) / 5e-4)) if kind == FEED else 1
        motion = motions[-1] + 1 if motions else 0
        for t in np.linspace(0.0, 1.0, n + 1)[1:]:
            points.append((start + t * (np.array(target) - start)).tolist())
            kinds.append(kind)
            motions.append(motion)

    cuts: list[tuple[float, float, float, float, float]] = [
        (-0.012, 0.212, 0.016, -0.002, -0.002),
        (-0.012, 0.212, 0.040, -0.004, -0.004),
        (-0.012, 0.212, 0.064, -0.006, -0.006),
        (0.015, 0.105, 0.086, 0.0, -0.006),
        (0.015, 0.105, 0.108, 0.0, -0.003),
    ]
    go(RAPID, [-0.012, 0.016, 0.01])
    for x0, x1, y, z0, z1 in cuts:
        go(RAPID, [x0, y, 0.005])
        go(FEED, [x0, y, z0])
        go(FEED, [x1, y, z1])
        go(RAPID, [x1, y, 0.005])
    go(RAPID, [0.172, 0.097, 0.005])
    go(FEED, [0.172, 0.097, -0.004])
    motion = motions[-1] + 1
    for a in np.linspace(0.0, 2 * np.pi, 220)[1:]:
        points.append([0.16 + 0.012 * np.cos(a), 0.097 + 0.012 * np.sin(a), -0.004])
        kinds.append(FEED)
        motions.append(motion)
    go(RAPID, [0.172, 0.097, 0.01])
    p = np.array(points)
    n = len(p)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    return ToolPath(
        p_part_tcp=p,
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=np.array(kinds, dtype=np.int64),
        feed_m_s=np.full(n, FEED_M_S),
        spindle_rad_s=np.full(n, 1361.0),
        time_s=length / FEED_M_S,
        motion=np.array(motions, dtype=np.int64),
        tool=np.ones(n, dtype=np.int64),
    )


def blank() -> HeightMap:
    return HeightMap.from_box((0.0, 0.0, -0.04), (0.2, 0.12, 0.0), 0.25e-3)


def pushed(path: ToolPath, area: Float, remaining: float) -> tuple[Float, Float, Float]:
    """A plausible cell: force from the section of the chip, pushed left and up, a first-order lag behind it."""
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    size = np.linalg.norm(step, axis=1)
    along = step / np.where(size > 0.0, size, 1.0)[:, None]
    left = np.stack([-along[:, 1], along[:, 0], 0 * size], axis=1)
    force = 546.0 * area[:, None] / 1.52e-4 * (-0.3 * along + 0.92 * left + np.array([0.0, 0.0, 0.12]))
    offset = np.zeros_like(force)
    state = np.zeros(3)
    previous = np.zeros(3)
    for i in range(len(force)):
        keep = np.exp(-max(size[i], 1e-6) / (0.03 * FEED_M_S))
        state = keep * state + (1.0 - keep) * force[i] / 3.9e5
        previous = 0.8 * previous + 0.2 * force[i] / 3.9e5
        offset[i] = state if remaining >= 1.0 else remaining * state + 0.25 * (state - previous)
    return path.p_part_tcp + offset, np.linalg.norm(force, axis=1), force / 3.9e5


@pytest.fixture(scope="module")
def job() -> tuple[ReportData, dict[str, Any]]:
    path = example_path()
    stock, nominal = blank(), blank()
    removed = remove_path(nominal, path.p_part_tcp, path.kind, CUTTER)
    moved = np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1)
    area = np.concatenate([[0.0], removed.volume_m3 / np.where(moved > 0.0, moved, 1.0)])
    surface = nominal_surface(stock, nominal, path.p_part_tcp, CUTTER)
    variants, shown, parts = {}, {}, {}
    predicted: Float = np.zeros((1, 3))
    for name, remaining in (("nominal", 1.0), ("compensated", 0.1)):
        actual, force, predicted = pushed(path, area, remaining)
        cut = blank()
        remove_path(cut, actual, path.kind, CUTTER, engagement=False)
        deviation = path_deviation(path, path.time_s, actual, area, CUTTER.radius_m, gap_m=0.02)
        joined: Bool = ~deviation.broken
        found = SurfaceDeviation.of(surface, cut, deviation.p_part_actual, joined)
        variants[name] = Variant(PathFigures.of(deviation), found, float(force.max()))
        shown[name] = VariantData(deviation, found, ErrorCurve(path.time_s, force))
        parts[name] = Machined(cut, deviation.p_part_actual, joined)
    features = measure_features(surface, path.p_part_tcp, find_features(path, CUTTER.radius_m), parts)
    figures = summary(
        [
            SeedResult(1, "catalogue", variants),
            SeedResult(2, "catalogue", variants),
            SeedResult(1, "exact", variants),
        ]
    )
    cutting = shown["nominal"].deviation.cutting
    met = shown["nominal"].deviation.across[cutting]
    time = shown["nominal"].deviation.time_s[cutting]
    whole = np.stack([np.interp(time, path.time_s, predicted[:, c]) for c in range(3)], axis=1)
    shares = {
        "spindle and holder": 0.46, "axis 2": 0.11, "axis 3": 0.09, "axis 5": 0.08, "axis 1": 0.06, "axis 6": 0.05,
        "link arm": 0.04, "arm": 0.03, "axis 4": 0.03, "gravity along the path": -0.02, "controller": 0.02,
    }  # fmt: skip
    data = ReportData(
        title="Grooves, ramps and pocket in EN AW-2017",
        subtitle=f"KUKA KR 300 R2500 ultra, end mill D16 z3, 13 000 rpm, 25 mm/s. {NASTY}",
        created="21 Nov 2026",
        summary=figures,
        nominal=shown["nominal"],
        compensated=shown["compensated"],
        facts=(
            Fact("Robot", "KUKA KR 300 R2500 ultra", "catalogue, verified"),
            Fact("Tool", "end mill D 16 mm, 3 teeth, helix 30 deg"),
            Fact("Material", "EN AW-2017, kc1.1 = 780 N/mm²", "Berger2013"),
        ),
        nominal_surface=surface,
        engagement_label="chip section<br>mm²",
        engagement_scale=1e6,
        features=features,
        budget=error_budget(met, {name: share * whole for name, share in shares.items()}),
        assumptions=(
            Fact("Rotational stiffness, spindle and holder", "190 / 67 / 91 MN mm/rad", "Haehn2020 table 1"),
            Fact("Mass of spindle with holder", "75 kg", "assumed", "enters gravity and vibration only"),
        ),
        differences=(
            ReportedDifference("compliance axis 2, about z", "1.85e-7 rad/(N m)", "2.01e-7 rad/(N m)", "+8.6 %"),
            ReportedDifference("force constants, all", "1", "0.93", "-7.0 %"),
        ),
        timing=(Fact("plan", "4.2 s"), Fact("simulate, two machinings", "38 s", note="real time 61 s")),
        versions={"counterflex": "0.1.0", "numpy": np.__version__},
        notes=("Simulated on an independent physics model; no metal was cut.",),
    )
    return data, figures


@pytest.fixture(scope="module")
def page(job: tuple[ReportData, dict[str, Any]]) -> str:
    return report_page(job[0])


class Outline(HTMLParser):
    """Collects what a browser would fetch, and whether every element is closed."""

    void = frozenset({"meta", "link", "br", "img", "input", "hr"})

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.fetched: list[str] = []
        self.stack: list[str] = []
        self.scripts = 0
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href", "action", "data", "srcset")]
        self.scripts += tag == "script"
        if tag not in self.void:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.stack and self.stack[-1] not in ("script", "style"):
            self.text.append(data)


def outline(page: str) -> Outline:
    found = Outline()
    found.feed(page)
    found.close()
    return found


def test_page_is_whole_and_loads_nothing(page: str) -> None:
    found = outline(page)
    assert found.stack == []
    assert found.fetched == ["data:,"]
    assert found.scripts == 4
    style = page[page.index("<style>") : page.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    assert len(page) < 12e6


def test_own_script_and_data_name_no_address(page: str) -> None:
    start = page.index('<script type="application/json" id="figures">')
    assert re.search(r"https?:|[\"'(]//", page[start:]) is None


def test_names_are_escaped(page: str) -> None:
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page
    assert "Müller &amp; Söhne" in page


def test_numbers_are_those_of_the_summary(page: str, job: tuple[ReportData, dict[str, Any]]) -> None:
    text = " ".join(outline(page).text)
    figures = job[1]
    for part, figure in (("path", "p997_mm"), ("path", "max_mm"), ("exit", "max_mm"), ("surface", "p997_mm")):
        for variant in ("nominal", "compensated"):
            assert f"{figures['variants'][variant][part][figure]:.3f}" in text
    for row in table_rows(figures):
        counted = not row[0].startswith(("air", "along"))
        for cell in row[1 : 4 if counted else 3]:
            assert cell in text


CARD = re.compile(
    r'<div class="name">([^<]*)</div>\s*<div class="big"><span class="from">([^<]*)</span><span class="arrow">→</span>'
    r'<span class="to">([^<]*)</span>.*?<span class="change ([^"]*)">([^<]*)</span>',
    re.DOTALL,
)
CARDS = {
    "Path error, 99.7 %": ("path", "p997_mm"),
    "Path error, largest": ("path", "max_mm"),
    "At cutter exit, largest": ("exit", "max_mm"),
    "Machined surface, 99.7 %": ("surface", "p997_mm"),
}


@pytest.mark.parametrize("exchanged", [False, True])
def test_before_and_after_stand_in_their_places(job: tuple[ReportData, dict[str, Any]], *, exchanged: bool) -> None:
    """Cards, verdict and counts are those of the summary, and change places when the programs do."""
    data, figures = job
    variants = figures["variants"]
    if exchanged:
        variants = {"nominal": variants["compensated"], "compensated": variants["nominal"]}
        rows = tuple(
            replace(row, worst_m={"nominal": row.worst_m["compensated"], "compensated": row.worst_m["nominal"]})
            for row in data.features
        )
        data = replace(
            data, summary={**figures, "variants": variants}, nominal=data.compensated, compensated=data.nominal,
            features=rows,
        )  # fmt: skip
    page = report_page(data)
    cards = {card[0]: card[1:] for card in CARD.findall(page)}
    assert set(CARDS) <= set(cards)
    for name, (part, figure) in CARDS.items():
        before, after = (variants[v][part][figure] for v in ("nominal", "compensated"))
        change = f"{100.0 * (after / before - 1.0):+.0f} %".replace("-", "−")
        assert cards[name] == (f"{before:.3f}", f"{after:.3f}", "worse" if after > before else "", change)
    text = " ".join(" ".join(outline(page).text).split())
    p997 = [variants[v]["path"]["p997_mm"] for v in ("nominal", "compensated")]
    assert f"stays within {p997[1]:.3f} mm of the programmed path; before, within {p997[0]:.3f} mm." in text
    bad = [
        sum(abs(row.worst_m[v] - row.nominal_m) > row.tolerance_m for row in data.features)
        for v in ("nominal", "compensated")
    ]
    assert f"before compensation: {bad[0]} of {len(data.features)} out of tolerance" in text
    assert (f"{bad[1]} of {len(data.features)} features out of tolerance" in text) == (bad[1] > 0)


def test_a_feature_that_was_not_found_is_out_of_tolerance(job: tuple[ReportData, dict[str, Any]]) -> None:
    data, _ = job
    wide = tuple(replace(row, tolerance_m=1.0) for row in data.features)
    lost = replace(wide[0], worst_m={"nominal": wide[0].worst_m["nominal"]})
    text = " ".join(outline(report_page(replace(data, features=(lost, *wide[1:])))).text)
    assert f"1 of {len(wide)} features out of tolerance" in text
    assert "not found" in text


def test_a_prediction_names_its_largest_values_and_their_places() -> None:
    n = 300
    force: Float = 100.0 + np.arange(n, dtype=np.float64) % 97
    deflection = np.zeros((n, 3))
    deflection[:, 1] = -1e-6 * np.abs(np.arange(n) - 250.0)
    deflection[41, 0] = -7e-4  # the largest, and negative
    correction = np.full((n, 3), 1e-5)
    correction[77, 2] = -9e-4
    data = replace(prediction(n), force_n=force, deflection_m=deflection, correction_m=correction, cutting=force > 0.0)
    text = " ".join(" ".join(outline(prediction_page(data)).text).split())
    size, sent = (np.linalg.norm(v, axis=1) * 1e3 for v in (deflection, correction))
    place = ", ".join(f"{v * 1e3:.1f}" for v in data.p_part_tcp[41])
    assert f"Largest predicted deflection {size[41]:.3f} mm at x y z {place} mm" in text
    assert f"Largest correction {sent[77]:.3f} mm mean {sent.mean():.3f} mm" in text
    assert f"Largest mean force {force.max():.0f} N" in text
    assert f"Program time {data.time_s[-1]:.1f} s {n} points" in text
    expected = Headline((0.8, 0.08), (0.9, 0.51, 1.42), (0.225, 0.11, 0.63), "4 %")
    text = " ".join(" ".join(outline(prediction_page(replace(data, headline=expected))).text).split())
    assert "before 0.51 to 1.42 mm, after 0.11 to 0.63 mm" in text


def test_example_is_plausible(job: tuple[ReportData, dict[str, Any]]) -> None:
    variants = job[1]["variants"]
    assert 0.5 < variants["nominal"]["path"]["max_mm"] < 2.0
    assert variants["compensated"]["path"]["p997_mm"] < 0.5 * variants["nominal"]["path"]["p997_mm"]
    assert variants["nominal"]["surface"]["max_mm"] <= variants["nominal"]["path"]["max_mm"] + 0.05
    names = [row.feature for row in job[0].features]
    assert {"groove 1", "groove 3", "ramp 1", "ramp 2", "pocket 1"} <= set(names)


def test_figures_are_json_with_one_scale_for_both_maps(page: str) -> None:
    text = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    assert text is not None
    figures = json.loads(text.group(1))
    colour = figures["map"]["layout"]["coloraxis"]
    assert len({trace["coloraxis"] for trace in figures["map"]["data"]}) == 1
    assert colour["cmin"] == -colour["cmax"]
    assert len(colour["colorscale"]) == 30
    assert "+ = material left" in colour["colorbar"]["title"]["text"]
    z = figures["map"]["data"][0]["z"]
    rows, columns = (int(v) for v in z["shape"].split(","))
    values = np.frombuffer(base64.b64decode(z["bdata"]), dtype="<f4").reshape(rows, columns)
    assert rows * columns <= 250_000
    scales = json.loads(re.findall(r'id="controls">(.*?)</script>', page, re.DOTALL)[0])["scales"]
    assert np.nanmax(np.abs(values)) <= scales[-1]["limit"]
    assert {"map", "series", "signed", "budget", "histogram", "space_before", "space_after"} == set(figures)


def figures_in(page: str) -> dict[str, Any]:
    """The figures that a page draws."""
    found: dict[str, Any] = json.loads(re.findall(r'id="figures">(.*?)</script>', page, re.DOTALL)[0])
    return found


def test_maps_begin_at_the_tolerance_and_point_at_the_worst_after(
    page: str, job: tuple[ReportData, dict[str, Any]]
) -> None:
    """The scale is the narrowest tolerance; call-out 1 is the largest deviation that the map of the result shows."""
    figures = figures_in(page)
    assert figures["map"]["layout"]["coloraxis"]["cmax"] == min(row.tolerance_m for row in job[0].features) * 1e3
    z = figures["map"]["data"][1]["z"]
    after = np.frombuffer(base64.b64decode(z["bdata"]), dtype="<f4")
    pointers = [note for note in figures["map"]["layout"]["annotations"] if note["text"].startswith("<b>1</b>")]
    assert f"{after[np.nanargmax(np.abs(after))]:+.2f}" in pointers[1]["text"]


def test_table_and_map_have_one_sign(page: str, job: tuple[ReportData, dict[str, Any]]) -> None:
    """A groove that is too wide or too deep lacks material: minus, in the table as in the map."""
    row = next(row for row in job[0].features if row.quantity == "width")
    wide = row.worst_m["nominal"] > row.nominal_m
    assert (row.material_left_m("nominal") < 0.0) == wide
    shown = f"{row.material_left_m('nominal') * 1e3:+.3f}".replace("-", "−")
    text = " ".join(outline(page).text)
    assert shown in text
    assert text.count("+ = material left") >= 2
    assert replace(row, nominal_m=0.0, worst_m={"nominal": 2e-4}, grows=True).material_left_m("nominal") == 2e-4


def test_before_and_after_stand_at_the_same_place_of_the_path(
    page: str, job: tuple[ReportData, dict[str, Any]]
) -> None:
    layout = figures_in(page)["series"]["layout"]
    assert layout["xaxis"]["title"]["text"] == "length along the program, m"
    length = max(float(v.deviation.length_m.max()) for v in (job[0].nominal, job[0].compensated))
    for trace in figures_in(page)["series"]["data"]:
        assert max(trace["x"]) <= length + 1e-3


def test_what_the_plan_expects_stands_before_what_was_simulated(job: tuple[ReportData, dict[str, Any]]) -> None:
    data = replace(job[0], expected=Headline((0.8, 0.08), (0.9, 0.5, 1.4), (0.225, 0.11, 0.6), "4 %"))
    text = " ".join(outline(report_page(data)).text)
    assert text.index("0.11 to 0.60 mm") < text.index("On this simulated cell")


def test_shares_of_area_add_up(job: tuple[ReportData, dict[str, Any]]) -> None:
    data = job[0]
    assert data.nominal_surface is not None
    assert data.nominal.surface is not None
    shares = area_shares(data.nominal_surface, data.nominal.surface, np.linspace(-0.2, 0.2, 12))
    assert shares.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("value", "limit"), [(1.4, 1.5), (1.6, 3.0), (0.07, 0.075), (0.0, 0.0015), (13.0, 15.0)])
def test_scales_have_round_steps_and_hold_the_value(value: float, limit: float) -> None:
    assert scale_limit_mm(value) == pytest.approx(limit)
    edges = edges_mm(limit)
    assert len(edges) == 16
    assert edges[7] == -edges[8]  # the middle step lies about zero


def test_page_without_a_part_or_extras(job: tuple[ReportData, dict[str, Any]]) -> None:
    data, figures = job
    bare = ReportData(
        title="bare",
        subtitle="",
        created="",
        summary=figures,
        nominal=VariantData(data.nominal.deviation),
        compensated=VariantData(data.compensated.deviation),
    )
    found = outline(report_page(bare))
    assert found.stack == []
    assert "Features against tolerance" not in " ".join(found.text)


def test_other_summaries_are_refused(job: tuple[ReportData, dict[str, Any]]) -> None:
    data = job[0]
    broken = {**data.summary, "variants": {"nominal": data.summary["variants"]["nominal"]}}
    for wrong, fault in ((broken, InputError), ({"a": 1}, FileFormatError)):
        with pytest.raises(fault):
            report_page(
                ReportData(
                    title="x",
                    subtitle="",
                    created="",
                    summary=wrong,
                    nominal=data.nominal,
                    compensated=data.compensated,
                )
            )


def prediction(n: int = 400) -> PredictionData:
    path = example_path()
    s: Int = np.linspace(0, len(path) - 1, n).astype(np.int64)
    force = 300.0 + 200.0 * np.sin(np.linspace(0.0, 20.0, n))
    deflection = np.outer(force, [-3e-7, 9e-7, 2e-7])
    return PredictionData(
        title=NASTY,
        subtitle="plan only",
        created="21 Nov 2026",
        time_s=path.time_s[s],
        p_part_tcp=path.p_part_tcp[s],
        deflection_m=deflection,
        correction_m=-deflection,
        force_n=force,
        cutting=force > 250.0,
        line=np.arange(n, dtype=np.int64),
        facts=(Fact("Robot", "KR 300"),),
    )


def drawing() -> CellDrawing:
    links = np.array([[0.0, 0, 0], [0, 0, 0.7], [0.3, 0.1, 1.8], [1.5, 0.5, 1.4], [1.5, 0.5, 1.1]])
    blank = np.array([[1.2 + 0.4 * (i & 1), 0.2 + 0.3 * (i >> 1 & 1), 0.8 + 0.2 * (i >> 2)] for i in range(8)])
    reach = (np.array([[0.5, 2.0], [2.5, 1.0]]), np.array([[2.5, 1.0], [0.5, 2.0]]))
    return CellDrawing(NASTY, "Posture of the largest deflection", links, 3, reach, blank, blank[:4])


def test_headline_curve_and_drawing_say_what_the_data_say() -> None:
    """Judged by what is in the page: the numbers in its JSON against the arrays that went in, by NumPy alone."""
    before = np.abs(np.sin(np.arange(400) / 30.0)) * 8e-4
    data = replace(
        prediction(),
        error_before_m=before,
        error_after_m=0.1 * before,
        headline=Headline((0.8, 0.08), (0.9, 0.5, 1.4), (0.225, 0.11, 0.6), "4 %"),
        drawing=drawing(),
        load=(Fact("Copy", "part.src, part.dat"),),
        next_steps=("Try it first", "Then mill"),
    )
    page = prediction_page(data)
    text = " ".join(outline(page).text)
    for word in (
        "0.800",
        "0.080",
        "−90 %",
        "0.90",
        "0.23",
        "−75 %",
        "0.11 to 0.60 mm",
        "gets worse: 4 %",
        "part.src, part.dat",
        "Try it first",
        "Then mill",
    ):
        assert word in text
    figures = json.loads(re.findall(r'id="figures">(.*?)</script>', page, re.DOTALL)[0])
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(data.p_part_tcp, axis=0), axis=1))]
    for trace, error in zip(figures["remaining"]["data"], (before, 0.1 * before), strict=True):
        shown = np.array([np.nan if y is None else y for y in trace["y"]])
        np.testing.assert_array_equal(np.isnan(shown), ~data.cutting)
        np.testing.assert_allclose(shown[data.cutting], error[data.cutting] * 1e6, atol=0.051)
        np.testing.assert_allclose(trace["x"], length, atol=5.1e-5)
    cut = figures["space"]["data"][1]
    np.testing.assert_allclose(cut["marker"]["color"], 0.1 * before[data.cutting] * 1e6, atol=0.051)
    np.testing.assert_allclose(cut["z"], data.p_part_tcp[data.cutting, 2] * 1e3, atol=0.0051)
    assert cut["customdata"] == np.flatnonzero(data.cutting).tolist()
    tool = [t for t in figures["cell"]["data"] if t["name"] == "tool"]
    along = np.hypot(1.5, 0.5) * 1e3
    np.testing.assert_allclose(tool[0]["x"], [along, along], atol=0.1)  # from the side: distance from axis 1
    np.testing.assert_allclose(tool[0]["y"], [1400.0, 1100.0], atol=0.1)
    np.testing.assert_allclose(tool[1]["x"] + tool[1]["y"], [1500.0, 1500.0, 500.0, 500.0], atol=0.1)
    circle = next(t for t in figures["cell"]["data"] if t["xaxis"] == "x2" and t["name"].startswith("reach"))
    np.testing.assert_allclose(np.hypot(circle["x"], circle["y"]), 2500.0, atol=0.2)


def test_a_result_that_is_worse_is_shown_as_worse() -> None:
    size = np.full(400, 1e-4)
    data = replace(prediction(), error_before_m=size, error_after_m=2 * size, headline=Headline((0.1, 0.2)))
    page = prediction_page(data)
    assert page.count('class="change worse">+100 %') == 1
    assert "Not looked at: what is not known of the cell" in page


def test_features_out_of_tolerance_stand_on_top(job: tuple[ReportData, dict[str, Any]]) -> None:
    data, _ = job
    missed = sum(abs(row.worst_m["compensated"] - row.nominal_m) > row.tolerance_m for row in data.features)
    text = " ".join(outline(report_page(data)).text)
    if missed:
        assert f"{missed} of {len(data.features)} features out of tolerance" in text
    good = replace(data, features=tuple(replace(row, tolerance_m=1.0) for row in data.features))
    assert f"All {len(data.features)} features within tolerance" in " ".join(outline(report_page(good)).text)
    bad = replace(data, features=tuple(replace(row, tolerance_m=-1.0) for row in data.features))
    text = " ".join(outline(report_page(bad)).text)
    assert f"{len(data.features)} of {len(data.features)} features out of tolerance" in text
    assert text.index("out of tolerance") < text.index("Path error, 99.7 %")
    assert "tolerance" not in " ".join(outline(report_page(replace(data, features=()))).text).split("Path error")[0]


def test_prediction_page_says_that_nothing_was_machined() -> None:
    data = prediction()
    text_page = prediction_page(data)
    found = outline(text_page)
    text = " ".join(found.text)
    assert found.stack == []
    assert found.fetched == ["data:,"]
    assert "Predicted, not measured" in text
    assert f"{np.linalg.norm(data.deflection_m, axis=1).max() * 1e3:.3f} mm" in text
    assert "<script>alert" not in text_page
    with pytest.raises(InputError, match="different lengths"):
        prediction_page(PredictionData(**{**data.__dict__, "force_n": data.force_n[:-1]}))


def test_page_is_written_whole_or_refused(tmp_path: Path, page: str) -> None:
    write_page(page, tmp_path / "sub" / "report.html")
    assert (tmp_path / "sub" / "report.html").read_text(encoding="utf-8") == page
    blocked = tmp_path / "file"
    blocked.write_text("x")
    with pytest.raises(OutputError):
        write_page(page, blocked / "report.html")
