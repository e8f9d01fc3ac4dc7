"""Quotations through files: table and STEP, what is written, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import step_parts
from counterflex.app.quote import remedies
from counterflex.app.quote.quote import quote
from counterflex.cli.main import parsed
from counterflex.core.errors import CounterflexError
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, PROGRAM = EXAMPLES / "cells/kr300_d16_small.toml", EXAMPLES / "programs/groove.ngc"
HEAD = "feature,quantity,tolerance_mm\n"


@pytest.mark.long
def test_a_quotation_through_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(remedies, "DRAWS", 40)
    table = tmp_path / "part.csv"
    table.write_text(HEAD + "groove 1,width,0.2\nbore 1,diameter,0.05\n", encoding="utf-8")
    parsed(["quote", str(table), str(PROGRAM), str(CELL), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    summary = json.loads((tmp_path / "out/summary.json").read_text(encoding="utf-8"))
    page = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    width = next(row for row in summary["features"] if row["quantity"] == "width")
    assert width["tolerance_mm"] == 0.2
    assert width["tolerance_source"] == "given"
    assert width["probability_90"][0] < width["probability"] < width["probability_90"][1]
    assert width["probability_as_it_is"] < 0.01  # it is 0.4 mm too wide and more, uncompensated
    gains = [row["gain"] for row in summary["remedies"]]
    assert gains == sorted(gains, reverse=True)
    by_name = {row["remedy"]: row for row in summary["remedies"]}
    assert by_name["measure all of these"]["mean_gain"] > by_name["measure the cutting force"]["mean_gain"] > 0.0
    assert by_name["correct the second part from the first"]["gain"] > 0.2
    left_out = {row["remedy"]: row["why"] for row in summary["remedies_not_looked_at"]}
    assert "no [sensor], [holder] or [tracker]" in left_out["correct online"]
    assert "--placements" in left_out["another place of the part"]
    assert {"what": "diameter of bore 1", "why": "the program cuts no such feature"} in summary["not_looked_at"]
    for text in (printed, page):
        assert "not looked at" in text.lower()
        assert "diameter of bore 1" in text
        assert "heat of robot" in text
        assert "measure the cutting force" in text


@pytest.mark.long
def test_faces_of_a_step_file_are_quoted_as_the_features_of_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("counterflex.app.quote.quote.remedies", lambda *_: ())
    grooved = step_parts.less(step_parts.box((0, 0, 0), (60, 60, 40)), step_parts.box((-1, 7, 34), (61, 23, 41)))

    def name(face: object) -> str:
        x, y, z = step_parts.centre(face)
        places = {(30.0, 15.0, 34.0): "floor", (30.0, 7.0, 37.0): "right", (30.0, 23.0, 37.0): "left"}
        return places.get((round(x, 3), round(y, 3), round(z, 3)), "")

    zones = [("floor", "Flatness", 0.3), ("left", "Straightness", 0.1)]
    step_parts.write_step(tmp_path / "part.step", [grooved], name, unit="MM", zones=zones)
    quoted, _ = quote(tmp_path / "part.step", PROGRAM, read_cell(CELL))
    features = {(one.feature, one.quantity): one for one in quoted.features}
    floor, depth = features["floor", "position"], features["groove 1", "depth"]
    # the groove is measured on its middle, the face all over: off by as much but for a twentieth of a millimetre
    assert np.median(np.abs(floor.off_m + depth.off_m)) < 0.05 * MM
    assert features["floor", "flatness"].tolerance_m == pytest.approx(0.3 * MM)
    assert features["floor", "flatness"].tolerance_source == "PMI of part.step"
    left_out = {what for what, _ in quoted.not_looked_at}
    assert any("Straightness" in what for what in left_out)
    assert sum(what.startswith("face") for what in left_out) >= 6  # sides, bottom and top of the blank
    assert not any(one.feature.startswith("face") for one in quoted.features)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("part.obj", "v 0 0 0\n", "a part is quoted from a CAD solid or a table of tolerances"),
        ("part.csv", "feature,tolerance_mm\n", "other columns than those of tolerances"),
        ("part.csv", HEAD + "groove 1,width,-0.1\n", "tolerance_mm is no size"),
        ("part.csv", HEAD + "bore 1,width,0.1\n", "none of the tolerances is of what the program makes"),
    ],
)
def test_a_part_that_cannot_be_quoted_is_refused_in_one_line(
    name: str, text: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("counterflex.app.quote.quote.make_plan", None)  # before anything long begins
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(CounterflexError, match=message):
        parsed(["quote", str(tmp_path / name), str(PROGRAM), str(CELL), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
