"""Values of calibration certificates in cell files and manifests; results of identifications as documents."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.certificate.apply import apply_certificate
from counterflex.app.certificate.write import write_document
from counterflex.core.errors import CounterflexError
from counterflex.files.cell.cell import read_cell
from counterflex.files.certificate.document import read_certificate
from counterflex.files.certificate.dsi_unit import parse_unit
from counterflex.files.dataset.reader import read_dataset

EXAMPLES = Path(__file__).parents[2] / "examples"
SENSOR, BAR = (EXAMPLES / "certificates" / name for name in ("force_sensor.xml", "ball_bar.xml"))
CELL = EXAMPLES / "cells" / "kr300_d16_small.toml"
FRAME = """
[sensor]
segment = "sensor"
protocol = "frame"
[sensor.frame]
byte_order = "little"
header = "aa55"
fields = ["float32 ch1", "float32 ch2", "float32 ch3", "float32 ch4", "float32 ch5", "float32 ch6"]
matrix = [[1,0,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]]
"""
ROWS = "row_Fx,row_Fy,row_Fz,row_Mx,row_My,row_Mz"
BARS = """format = "counterflex-dataset"
version = 1
name = "ball bar"
kind = "distances"
[[files]]
path = "bar.csv"
[channels.q]
columns = ["q1_deg", "q2_deg", "q3_deg", "q4_deg", "q5_deg", "q6_deg"]
unit = "deg"
[channels.anchor]
constant = [1]
[channels.distance]
constant = [1000]
unit = "mm"
"""


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A cell with a sensor that sends frames."""
    file = tmp_path / "cell.toml"
    file.write_text(CELL.read_text(encoding="utf-8") + FRAME, encoding="utf-8")
    return file


def test_range_matrix_and_mass_go_into_the_cell(cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "elsewhere" / "new.toml"
    keys = [("sensor.range_n", ""), ("sensor.range_nm", "range_moment"), ("sensor.frame.matrix", ROWS)]
    apply_certificate(SENSOR, keys, out, cell=cell, channel=r"\milli\volt\volt\tothe{-1}")
    made, text = read_cell(out), out.read_text(encoding="utf-8")
    assert made is not None
    assert "range_n = 1900.0 # calibration certificate EX-2026-0412 of Example laboratory, 2026-03-13" in text
    assert "range_nm = 250.0" in text
    assert "[-3.1, 2.4, 15.2, -1012.5, -8.7, 1009.8]" in text  # N per mV/V, as stated
    assert "standard uncertainty" in text
    volts = tmp_path / "volts.toml"
    apply_certificate(SENSOR, [("sensor.frame.matrix", ROWS)], volts, cell=cell)
    assert "[-3100.0, 2400.0, 15200.0, -1012500.0, -8700.0, 1009800.0]" in volts.read_text(encoding="utf-8")  # per V/V


def test_everything_else_in_the_cell_is_kept(cell: Path, tmp_path: Path) -> None:
    apply_certificate(SENSOR, [("sensor.range_n", "")], tmp_path / "new.toml", cell=cell)
    before, after = (file.read_text(encoding="utf-8").splitlines() for file in (cell, tmp_path / "new.toml"))
    assert [line for line in after if line not in before] == [line for line in after if line.startswith("range_n = ")]
    assert [line for line in before if line not in after] == []


def test_length_and_uncertainty_go_into_a_manifest(tmp_path: Path) -> None:
    (tmp_path / "bars.toml").write_text(BARS, encoding="utf-8")
    rows = "\n".join(["q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg", *["0,-90,90,0,10,0"] * 3])
    (tmp_path / "bar.csv").write_text(rows + "\n", encoding="utf-8")
    out = tmp_path / "below" / "bars.toml"
    apply_certificate(BAR, [("channels.distance", "")], out, dataset=tmp_path / "bars.toml")
    read = read_dataset(out).channels["distance"]
    np.testing.assert_allclose(read.values.ravel(), 0.99998312, rtol=1e-12)
    assert read.sigma is not None
    np.testing.assert_allclose(read.sigma.ravel(), 0.7e-6, rtol=1e-9)  # U = 1.4 um, k = 2
    answer = apply_certificate(
        SENSOR, [("settings.force_accuracy_n", "basic_measuredValue")], out, dataset=tmp_path / "bars.toml"
    )
    assert answer["written"][0]["value"] == pytest.approx(7.6)  # the largest expanded uncertainty


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ([("sensor.range_n", "2")], "the unit is m^2 kg s^-2"),
        ([("sensor.range_n", "9")], "4 numbers where 1 belong"),
        ([("sensor.range_n", "99")], "no quantity of this number"),
        ([("sensor.range_n", "11")], "text, no number"),
        ([("sensor.frame.counts_per_n", "")], "no quantity fits"),
        ([("end_effector.spindle.mass_kg", "")], "no quantity fits"),
        ([("channels.distance", "")], "belongs into a manifest"),
        ([("sensor.frame.matrix", ROWS)], "per another unit of a channel"),
        ([("sensor.frame.matrix", "row_Fx,row_Fy")], "12 numbers where 36 belong"),
        ([("sensor.frame.matrix", ROWS.replace("row_Fz", "row_Mx"))], "the rows are not"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_is_written(
    cell: Path, tmp_path: Path, keys: list[tuple[str, str]], says: str
) -> None:
    with pytest.raises(CounterflexError) as fault:
        apply_certificate(SENSOR, keys, tmp_path / "new.toml", cell=cell, channel=r"\volt")
    assert says in str(fault.value)
    assert "\n" not in str(fault.value)
    assert not (tmp_path / "new.toml").exists()


def test_a_cell_without_the_table_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(CounterflexError, match=r"no table \[sensor\]"):
        apply_certificate(SENSOR, [("sensor.range_n", "")], tmp_path / "new.toml", cell=CELL)


def result(**changes: Any) -> dict[str, Any]:
    """A result as identify writes it, of two fits."""

    def row(name: str, unit: str, value: float, seen: str = "data") -> dict[str, Any]:
        held = seen == "held"
        low, high = (None, None) if held else (value - 0.02, value + 0.03)
        return {"name": name, "label": name, "unit": unit, "value": value, "sigma": 0.01, "low": low, "high": high}

    made = {
        "format": "counterflex-identification", "version": 1, "recipe": "stiffness", "title": "Compliances",
        "date": "2026-03-14 08:30:00", "cell": "KR 300 <A&B>", "versions": {"counterflex": "0.1.0"},
        "data": [{"name": "pulls", "sha256": "ab" * 32}],
        "fits": {
            "arm": {"parameters": [row("axis1.rz", "urad/kNm", 303.5), row("axis2.rz", "urad/kNm", 7.0, "held")]},
            "base": {"parameters": [row("T_base_tracker.x", "mm", -12.25)]},
        },
    }  # fmt: skip
    return made | changes


ABOUT: dict[str, Any] = {"laboratory": "Laboratory A", "person": "B. C.", "country": "DE", "city": "Ulm", "serial": "7"}


def test_a_result_is_written_and_read_back_by_value_unit_and_uncertainty(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(json.dumps(result()), encoding="utf-8")
    answer = write_document(tmp_path / "result.json", tmp_path / "found.xml", **ABOUT)
    back = read_certificate(tmp_path / "found.xml")
    assert (back.laboratory, back.date, back.items[0].name) == ("Laboratory A", "2026-03-14", "KR 300 <A&B>")
    assert back.number == answer["number"]
    assert [one.values[0] for one in back.quantities] == [303.5, 7.0, -12.25]
    assert [one.sigma for one in back.quantities] == [(0.01,), None, (0.01,)]
    assert parse_unit(back.quantities[0].units[0], "").factor == pytest.approx(1e-9)
    text = (tmp_path / "found.xml").read_text(encoding="utf-8")
    assert "has the form of a digital calibration certificate and is none" in text
    assert "<si:intervalMin>303.48</si:intervalMin>" in text


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"fits": {}}, "no parameters"),
        ({"fits": {"a": {"parameters": [{"name": "x"}]}}}, "not a whole result"),
        ({"versions": None}, "not a whole result"),
        ({"format": "counterflex-plan"}, "counterflex-identification"),
    ],
)
def test_a_result_that_is_none_is_refused(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    (tmp_path / "result.json").write_text(json.dumps(result(**changes)), encoding="utf-8")
    with pytest.raises(CounterflexError, match=says):
        write_document(tmp_path / "result.json", tmp_path / "found.xml", **ABOUT)
    assert not (tmp_path / "found.xml").exists()


TINY = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="https://ptb.de/dcc"
  xmlns:dcc="https://ptb.de/dcc" elementFormDefault="qualified">
  <xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:sequence>
    <xs:element name="administrativeData" type="xs:anyType"/>{more}
    <xs:element name="measurementResults" type="xs:anyType"/>
  </xs:sequence><xs:attribute name="schemaVersion" type="xs:string"/></xs:complexType></xs:element>
</xs:schema>
"""


@pytest.mark.skipif(importlib.util.find_spec("xmlschema") is None, reason="the extra dcc is not installed")
def test_a_document_is_held_against_a_schema(tmp_path: Path) -> None:
    """Of the outline only: the schema of PTB is not kept here."""
    (tmp_path / "result.json").write_text(json.dumps(result()), encoding="utf-8")
    (tmp_path / "dcc.xsd").write_text(TINY.format(more=""), encoding="utf-8")
    (tmp_path / "strict.xsd").write_text(TINY.format(more='<xs:element name="seal"/>'), encoding="utf-8")
    made = tmp_path / "found.xml"
    assert write_document(tmp_path / "result.json", made, schema=tmp_path / "dcc.xsd", **ABOUT)["checked"]
    made.unlink()
    for schema, says in (("strict.xsd", "not valid by the schema"), ("result.json", "schema cannot be read")):
        with pytest.raises(CounterflexError, match=says):
            write_document(tmp_path / "result.json", made, schema=tmp_path / schema, **ABOUT)
        assert not made.exists()
