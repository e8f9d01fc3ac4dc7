"""Digital calibration certificates: units of D-SI, every form of uncertainty, and what is refused in one line."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.files.certificate.document import read_certificate
from counterflex.files.certificate.dsi_unit import DSI_OF, parse_unit

EXAMPLES = Path(__file__).parents[2] / "examples" / "certificates"
ROOT = (
    '<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="{}">'
)
BELOW = "<si:expandedUnc><si:uncertainty>-1</si:uncertainty>{}</si:expandedUnc>"
NO_K = "<si:expandedUnc><si:uncertainty>1</si:uncertainty></si:expandedUnc>"
EXPANDED = "<si:coverageFactor>{k}</si:coverageFactor><si:coverageProbability>0.95</si:coverageProbability>"


def certificate(quantities: str, version: str = "3.3.0") -> str:
    """A certificate of nothing but quantities."""
    return (
        f"{ROOT.format(version)}<dcc:administrativeData/><dcc:measurementResults><dcc:measurementResult><dcc:results>"
        f"<dcc:result><dcc:data>{quantities}</dcc:data></dcc:result></dcc:results></dcc:measurementResult>"
        "</dcc:measurementResults></dcc:digitalCalibrationCertificate>"
    )


def quantity(inside: str, attributes: str = "") -> str:
    return f"<dcc:quantity {attributes}>{inside}</dcc:quantity>"


def real(uncertainty: str = "", value: str = "2.5", unit: str = r"\newton") -> str:
    return quantity(f"<si:real><si:value>{value}</si:value><si:unit>{unit}</si:unit>{uncertainty}</si:real>")


def read(tmp_path: Path, text: str) -> tuple[object, ...]:
    file = tmp_path / "c.xml"
    file.write_text(text, encoding="utf-8")
    return read_certificate(file).quantities


@pytest.mark.parametrize(
    ("text", "factor", "si"),
    [
        (r"\newton", 1.0, "m kg s^-2"),
        (r"\kilo\newton\metre", 1e3, "m^2 kg s^-2"),
        (r"\milli\metre\tothe{2}", 1e-6, "m^2"),
        (r"\newton\milli\metre\tothe{-2}", 1e6, "m^-1 kg s^-2"),
        (r"\metre\per\second\tothe{2}", 1.0, "m s^-2"),
        (r"\newton\volt\milli\volt\tothe{-1}", 1e3, "m kg s^-2"),
        (r"\gram", 1e-3, "kg"),
        (r"\percent", 1e-2, "1"),
        (r"\degree\hour\tothe{-1}", math.pi / 180.0 / 3600.0, "s^-1 rad"),
        (r"\one", 1.0, "1"),
    ],
)
def test_units_of_dsi(text: str, factor: float, si: str) -> None:
    unit = parse_unit(text, "here")
    assert unit.factor == pytest.approx(factor, rel=1e-14)
    assert unit.si == si


@pytest.mark.parametrize(
    "text",
    [
        "", "mm", r"\inch", r"\degreecelsius", r"\milli", r"\milli\kilo\metre", r"\tothe{2}", r"\metre\tothe", r"\per",
        r"\metre\tothe{1.5}", r"\metre newton", r"|mm", r"\metre{2}", r"\metre\per\per\second",
        r"\metre\tothe{2}\tothe{2}",
    ],
)  # fmt: skip
def test_units_that_are_refused(text: str) -> None:
    with pytest.raises(FileFormatError, match="unit is not understood"):
        parse_unit(text, "here")


@given(st.text(alphabet="\\{}-0123456789tohepmlirnwdsac ", max_size=30))
def test_any_text_is_a_unit_or_refused(text: str) -> None:
    said = ""
    try:
        assert parse_unit(text, "here").factor > 0.0
    except FileFormatError as fault:
        said = str(fault)
    assert "\n" not in said


def test_every_unit_that_is_written_is_read() -> None:
    for unit, text in DSI_OF.items():
        assert parse_unit(text, unit).factor > 0.0
    assert parse_unit(DSI_OF["um/kN"], "").factor == pytest.approx(1e-9)
    assert parse_unit(DSI_OF["urad/kNm"], "").factor == pytest.approx(1e-9)
    assert parse_unit(DSI_OF["N/mm2"], "").factor == pytest.approx(1e6)


NEW = "<si:measurementUncertaintyUnivariate>{}</si:measurementUncertaintyUnivariate>"
INTERVAL = (
    "<si:{u}>0.3</si:{u}><si:intervalMin>2</si:intervalMin><si:intervalMax>3</si:intervalMax>"
    "<si:coverageProbability>0.95</si:coverageProbability>"
)


@pytest.mark.parametrize(
    ("stated", "sigma", "k"),
    [
        ("", None, ()),
        (f"<si:expandedUnc><si:uncertainty>0.6</si:uncertainty>{EXPANDED.format(k=2)}</si:expandedUnc>", 0.3, (2.0,)),
        (
            NEW.format(
                f"<si:expandedMU><si:valueExpandedMU>0.6</si:valueExpandedMU>{EXPANDED.format(k=3)}</si:expandedMU>"
            ),
            0.2,
            (3.0,),
        ),
        (f"<si:coverageInterval>{INTERVAL.format(u='standardUnc')}</si:coverageInterval>", 0.3, ()),
        (NEW.format(f"<si:coverageIntervalMU>{INTERVAL.format(u='valueStandardMU')}</si:coverageIntervalMU>"), 0.3, ()),
        (NEW.format("<si:standardMU><si:valueStandardMU>0.1</si:valueStandardMU></si:standardMU>"), 0.1, ()),
    ],
)
def test_uncertainties_become_standard_uncertainties(
    tmp_path: Path, stated: str, sigma: float | None, k: tuple[float, ...]
) -> None:
    (one,) = read(tmp_path, certificate(real(stated)))
    assert one.values == (2.5,)  # type: ignore[attr-defined]
    assert one.coverage == k  # type: ignore[attr-defined]
    assert one.sigma == (None if sigma is None else (pytest.approx(sigma),))  # type: ignore[attr-defined]


def test_lists_share_unit_and_coverage_factor_or_have_their_own(tmp_path: Path) -> None:
    stated = (
        "<si:expandedUncXMLList><si:uncertaintyXMLList>0.2 0.4 0.9</si:uncertaintyXMLList>"
        "<si:coverageFactorXMLList>2 2 3</si:coverageFactorXMLList>"
        "<si:coverageProbabilityXMLList>0.95</si:coverageProbabilityXMLList></si:expandedUncXMLList>"
    )
    numbers = f"<si:valueXMLList>1 2 3</si:valueXMLList><si:unitXMLList>\\newton</si:unitXMLList>{stated}"
    rows = "".join(f"<si:real><si:value>{v}</si:value></si:real>" for v in (1, 2))
    common = f"<si:expandedUnc><si:uncertainty>0.2</si:uncertainty>{EXPANDED.format(k=2)}</si:expandedUnc>"
    listed = f"<si:listUnit>\\metre</si:listUnit><si:listUnivariateUnc>{common}</si:listUnivariateUnc>{rows}"
    both = (
        quantity(f"<si:realListXMLList>{numbers}</si:realListXMLList>")
        + f"<dcc:list>{quantity(f'<si:realList>{listed}</si:realList>')}</dcc:list>"
    )
    first, second = read(tmp_path, certificate(both))
    assert first.sigma == pytest.approx((0.1, 0.2, 0.3))  # type: ignore[attr-defined]
    assert first.units == (r"\newton",) * 3  # type: ignore[attr-defined]
    assert second.sigma == pytest.approx((0.1, 0.1))  # type: ignore[attr-defined]
    assert second.units == (r"\metre",) * 2  # type: ignore[attr-defined]


def test_of_a_hybrid_the_form_in_dsi_is_taken(tmp_path: Path) -> None:
    inches = "<si:real><si:value>1</si:value><si:unit>|inch</si:unit></si:real>"
    metres = "<si:real><si:value>25.4</si:value><si:unit>\\milli\\metre</si:unit></si:real>"
    (one,) = read(tmp_path, certificate(quantity(f"<si:hybrid>{inches}{metres}</si:hybrid>")))
    assert (one.values, one.units) == ((25.4,), (r"\milli\metre",))  # type: ignore[attr-defined]


def test_what_is_not_read_is_named(tmp_path: Path) -> None:
    complex_ = quantity("<si:complex><si:valueReal>1</si:valueReal></si:complex>")
    region = real("<si:ellipsoidalRegion/>")
    text = quantity("<dcc:noQuantity><dcc:content>dry</dcc:content></dcc:noQuantity>")
    unread = [one.unread for one in read(tmp_path, certificate(complex_ + region + text))]  # type: ignore[attr-defined]
    assert unread == ["complex is not read", "uncertainty as ellipsoidalRegion is not read", "text, no number"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("no xml", "not an XML file"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "not an XML file"),
        ("<a/>", "no digital calibration certificate"),
        (certificate("", "2.4.0"), "another version of the schema"),
        (ROOT.format("3.3.0") + "</dcc:digitalCalibrationCertificate>", "without administrativeData"),
        (certificate(real(value="two")), "value is no number"),
        (certificate(real(value="inf")), "value is not finite"),
        (certificate(real(value="")), "without a value"),
        (certificate(real(unit="")), "wrong number of units"),
        (
            certificate(real(f"<si:expandedUnc><si:uncertainty>1</si:uncertainty>{EXPANDED.format(k=0.5)}</si:expandedUnc>")),
            "the coverage factor",
        ),
        (
            certificate(real(BELOW.format(EXPANDED.format(k=2)))),
            "uncertainty below zero",
        ),
        (certificate(real(NO_K)), "number of coverage"),
        (certificate("<dcc:list>" * 40 + "</dcc:list>" * 40), "lists within lists"),
    ],
)  # fmt: skip
def test_what_is_refused_says_so_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(FileFormatError, match=says) as fault:
        read(tmp_path, text)
    assert "\n" not in str(fault.value)
    assert "c.xml" in str(fault.value)


def test_a_pdf_is_told_from_its_attachment(tmp_path: Path) -> None:
    (tmp_path / "c.xml").write_bytes(b"%PDF-1.7 ...")
    with pytest.raises(FileFormatError, match="attachment"):
        read_certificate(tmp_path / "c.xml")


@given(cut=st.integers(0, 11000), letter=st.characters(max_codepoint=255))
def test_a_damaged_certificate_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, cut: int, letter: str
) -> None:
    text = (EXAMPLES / "force_sensor.xml").read_text(encoding="utf-8")
    said = ""
    try:
        read(tmp_path_factory.mktemp("c"), text[:cut] + letter + text[cut + 1 :])
    except CounterflexError as fault:
        said = str(fault)
    assert "\n" not in said


def test_the_examples() -> None:
    sensor = read_certificate(EXAMPLES / "force_sensor.xml")
    assert (sensor.number, sensor.laboratory, sensor.date) == ("EX-2026-0412", "Example laboratory", "2026-03-13")
    assert sensor.items[0].name == "Example six-axis force sensor F6"
    assert sensor.items[0].identifications == ("0815",)
    assert [len(one.values) for one in sensor.quantities] == [1, 1, 6, 6, 6, 6, 6, 6, 4, 4, 0]
    indicated = sensor.quantities[9]
    assert indicated.ref_types == ("basic_measuredValue",)
    assert indicated.sigma == pytest.approx((2.05, 2.6, 3.2, 3.8))
    (length,) = read_certificate(EXAMPLES / "ball_bar.xml").quantities
    assert length.sigma == pytest.approx((0.0007,))
