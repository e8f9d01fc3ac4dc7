"""The benchmark part: its program makes what its drawing says, a part of known shape gives its size back, results."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from counterflex.app.benchmark_part.judge import BenchmarkConditions, compare, judge
from counterflex.app.benchmark_part.part import program_sha256, program_text, require_cell, tolerances_text, write
from counterflex.app.inspection.judging import How
from counterflex.core.errors import CounterflexError, FileFormatError, InputError
from counterflex.core.units import MM
from counterflex.files.benchmark_result import MEASURED, BenchmarkResult, read_benchmark_result
from counterflex.files.cell.cell import read_cell
from counterflex.files.small_table import read_tolerances

CELL = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
NOISE_MM = 0.005
ABOUT = BenchmarkConditions("made of solids", "uncompensated", "none", "air")


def solid() -> Any:
    """The part as drawn, mm, by a library of solids."""
    block = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [60.0, 60.0, 40.0]])
    along_x = trimesh.creation.box(bounds=[[-1.0, 3.0, 36.0], [61.0, 19.0, 50.0]])
    along_y = trimesh.creation.box(bounds=[[48.0, -1.0, 37.0], [58.0, 61.0, 50.0]])
    pocket = trimesh.creation.cylinder(12.0, 20.0, sections=512)
    pocket.apply_translation([30.0, 38.0, 47.0])
    made = trimesh.boolean.difference([block, along_x, along_y, pocket])
    assert made.is_volume
    return made


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the judged part."""
    folder = tmp_path_factory.mktemp("benchmark")
    points, _ = trimesh.sample.sample_surface(solid(), 60_000, seed=1)
    points = points + np.random.default_rng(1).normal(scale=NOISE_MM, size=points.shape)
    trimesh.PointCloud(points).export(folder / "scan.ply")
    judge(CELL, folder / "scan.ply", folder / "out", ABOUT, how=How(datum="x-,x+,y-,y+,top"))
    return folder / "out"


@pytest.mark.long
def test_the_program_makes_what_is_drawn(judged: Path) -> None:
    """Bounds: noise of 5 um, worst of some hundred places, and the chords of the round pocket."""
    result = read_benchmark_result(judged / "result.json")
    assert {(row.feature, row.quantity) for row in result.features} == {(m.feature, m.quantity) for m in MEASURED}
    for row in result.features:
        assert abs(row.deviation_mm) < 8.0 * NOISE_MM, row
        assert row.within
        assert 0.0 < row.uncertainty_um < 8.0e3 * NOISE_MM
    assert result.surface_p997_mm < 6.0 * NOISE_MM
    assert (judged / "report.html").exists()


def test_results_are_compared(judged: Path) -> None:
    files = [judged / "result.json"] * 2
    answer = compare(files)
    assert [row["within"] for row in answer["results"]] == [len(MEASURED)] * 2
    assert all(len(row["deviation_um"]) == 2 for row in answer["features"])


def _changed(judged: Path, tmp_path: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    data = json.loads((judged / "result.json").read_text(encoding="utf-8"))
    change(data)
    file = tmp_path / "changed.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["features"][0].update(worst_mm=17.0), "within is True"),
        (lambda d: d["features"][0].update(tolerance_mm=0.5), r"drawing says 16 \+- 0.1"),
        (lambda d: d["features"][0].update(nominal_mm=16.01), r"drawing says 16 \+- 0.1"),
        (lambda d: d["features"].pop(), "flatness of pocket 1"),
        (lambda d: d["features"].append(d["features"][3]), "depth of groove 1"),
        (lambda d: d.update(version=2), "newer"),
        (lambda d: d.update(format="counterflex-summary"), "counterflex-benchmark-result"),
        (lambda d: d.update(laboratory=""), "laboratory"),
        (lambda d: d.update(method="by hand"), "method"),
        (lambda d: d.update(surface_p997_mm=float("nan")), "surface_p997_mm"),
        (lambda d: d.update(more=1), "more"),
    ],
)
def test_a_result_that_contradicts_itself_or_the_drawing_is_refused(
    judged: Path, tmp_path: Path, change: Callable[[dict[str, Any]], Any], said: str
) -> None:
    with pytest.raises(FileFormatError, match=said):
        read_benchmark_result(_changed(judged, tmp_path, change))


def test_a_part_of_another_path_is_not_compared(judged: Path, tmp_path: Path) -> None:
    file = _changed(judged, tmp_path, lambda data: data.update(program_sha256="0" * 64))
    with pytest.raises(InputError, match="not made by the path of CF-1"):
        compare([judged / "result.json", file])


def test_speeds_feeds_and_comments_may_be_changed_and_the_path_may_not() -> None:
    text = program_text()
    free = text.replace("F1500", "F900").replace("S13000", "S8000").replace("M30", "M30 (end)").lower()
    assert program_sha256(free) == program_sha256()
    assert program_sha256(text.replace("X72", "X71")) != program_sha256()
    assert program_sha256(text.replace("M6 T2", "M6 T1")) != program_sha256()


def test_what_is_written_can_be_read(tmp_path: Path) -> None:
    assert write(tmp_path / "part") == ["cf1.ngc", "cf1.svg", "cf1.pdf", "cf1-tolerances.csv"]
    assert ElementTree.fromstring((tmp_path / "part" / "cf1.svg").read_text(encoding="utf-8")).tag.endswith("svg")
    read = read_tolerances(tmp_path / "part" / "cf1-tolerances.csv")
    assert read == {(m.feature, m.quantity): m.tolerance_mm * MM for m in MEASURED}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("box_max_mm = [60, 60, 40]", "box_max_mm = [60, 60, 30]", "blank is not that"),
        ("diameter_mm = 10", "diameter_mm = 12", "T2 is not that"),
    ],
)
def test_a_cell_with_another_blank_or_tool_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = CELL.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "cell.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CounterflexError, match=said):
        require_cell(read_cell(tmp_path / "cell.toml"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "columns"),
        ("feature,quantity\n", "columns"),
        ("feature,quantity,tolerance_mm\ngroove 1,width\n", "another length"),
        ("feature,quantity,tolerance_mm\ngroove 1,width,wide\n", "no number"),
        ("feature,quantity,tolerance_mm\ngroove 1,width,nan\n", "no size"),
        ("feature,quantity,tolerance_mm\ngroove 1,width,0\n", "no size"),
        (tolerances_text() + "groove 1,width,0.2\n", "twice"),
    ],
)
def test_bad_tolerances_are_named(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "t.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=said):
        read_tolerances(file)


def test_a_result_says_who_made_it(judged: Path) -> None:
    result = read_benchmark_result(judged / "result.json")
    assert isinstance(result, BenchmarkResult)
    assert result.label == "made of solids, uncompensated"
    assert result.program_sha256 == program_sha256()
