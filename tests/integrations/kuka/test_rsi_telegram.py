"""RSI telegrams: round trips, an XML library as judge, and nothing but exact telegrams accepted."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import FileFormatError, InputError, ProtocolError
from counterflex.integrations.kuka.link.config import RsiConfig, parse_config
from counterflex.integrations.kuka.link.kernel import MISSING, OK
from counterflex.integrations.kuka.link.telegram import (
    answer_reader,
    answer_writer,
    robot_reader,
    robot_writer,
)
from counterflex.protocols.decimal_kernel import read_decimal, write_decimal

CONFIG = """<ROOT>
  <CONFIG>
    <IP_NUMBER>192.168.44.10</IP_NUMBER><PORT>49152</PORT><SENTYPE>Counterflex</SENTYPE><ONLYSEND>FALSE</ONLYSEND>
  </CONFIG>
  <SEND><ELEMENTS>
    <ELEMENT TAG="DEF_RIst" TYPE="DOUBLE" INDX="INTERNAL"/>
    <ELEMENT TAG="DEF_RSol" TYPE="DOUBLE" INDX="INTERNAL"/>
    <ELEMENT TAG="DEF_AIPos" TYPE="DOUBLE" INDX="INTERNAL"/>
    <ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>
    <ELEMENT TAG="Corr.Stat" TYPE="LONG" INDX="1"/>
    <ELEMENT TAG="Enable" TYPE="BOOL" INDX="2"/>
  </ELEMENTS></SEND>
  <RECEIVE><ELEMENTS>
    <ELEMENT TAG="DEF_EStr" TYPE="STRING" INDX="INTERNAL"/>
    <ELEMENT TAG="RKorr.X" TYPE="DOUBLE" INDX="1" HOLDON="1"/>
    <ELEMENT TAG="RKorr.Y" TYPE="DOUBLE" INDX="2" HOLDON="1"/>
    <ELEMENT TAG="RKorr.Z" TYPE="DOUBLE" INDX="3" HOLDON="1"/>
    <ELEMENT TAG="FREE" TYPE="LONG" INDX="4" HOLDON="1"/>
    <ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="0"/>
  </ELEMENTS></RECEIVE>
</ROOT>"""


def config() -> RsiConfig:
    return parse_config(CONFIG.encode(), "cell.xml")


# Written by KUKA's own kit: no blank between elements, no Type but KUKA.
CANONICAL = (
    b'<Rob Type="KUKA"><RIst X="1825.0000" Y="0.0000" Z="2400.0000" A="0.0000" B="90.0000" C="0.0000"/>'
    b'<RSol X="1825.5000" Y="-0.2500" Z="2400.0000" A="0.0000" B="90.0000" C="0.0000"/>'
    b'<AIPos A1="10.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="45.0000" A6="0.0000"/>'
    b'<Delay D="0"/><Corr Stat="1"/><Enable>1</Enable><IPOC>4208163000</IPOC></Rob>'
)


SCAN_FAULTS = {
    1: "not an RSI telegram",
    2: "the telegram is cut short",
    3: "the telegram is malformed",
    4: "a value is not a number",
    5: "a value comes twice",
    6: "a declared value is missing",
    7: "the counter IPOC is missing",
}
"""What a status of :func:`counterflex.integrations.kuka.link.kernel.scan` means."""


def test_reads_the_canonical_telegram() -> None:
    reader = robot_reader(config())
    assert reader.read_bytes(CANONICAL) == OK
    assert reader.counter == 4208163000
    assert reader.values[reader.place("RSol.X", "RSol.Y", "AIPos.A2", "Corr.Stat", "Enable")].tolist() == [
        1825.5,
        -0.25,
        -90.0,
        1.0,
        1.0,
    ]


@pytest.mark.parametrize(
    "variant",
    [
        CANONICAL.replace(b"/>", b" />"),
        CANONICAL.replace(b'Type="KUKA"', b'TYPE="KUKA"'),
        CANONICAL.replace(b'<Rob Type="KUKA">', b"<Rob>"),
        CANONICAL.replace(b'"', b"'"),
        CANONICAL.replace(b"><", b">\r\n\t<") + b"\r\n",
        CANONICAL + b"\0",
        CANONICAL.replace(b"/>", b"></RSol>", 2).replace(b"></RSol>", b"></RIst>", 1),
        CANONICAL.replace(b"<Delay", b'<Unknown Q="abc">7</Unknown><Delay'),
        CANONICAL.replace(b'"1825.0000"', b'"+1.825e3"'),
    ],
)
def test_accepts_what_controllers_really_send(variant: bytes) -> None:
    reader, plain = robot_reader(config()), robot_reader(config())
    assert plain.read_bytes(CANONICAL) == OK
    assert reader.read_bytes(variant) == OK
    assert reader.counter == plain.counter
    np.testing.assert_array_equal(reader.values, plain.values)


@pytest.mark.parametrize(
    ("telegram", "said"),
    [
        (b"", "not an RSI telegram"),
        (b"hello", "not an RSI telegram"),
        (b"<Sen></Sen>", "not an RSI telegram"),
        (b"<Robot/>", "not an RSI telegram"),
        (CANONICAL[:-1], "cut short"),
        (CANONICAL[:200], "cut short"),
        (CANONICAL + b"<", "malformed"),
        (CANONICAL + CANONICAL, "malformed"),
        (CANONICAL.replace(b"</Rob>", b"</Sen>"), "malformed"),
        (CANONICAL.replace(b"<Delay", b"<!-- x --><Delay"), "malformed"),
        (CANONICAL.replace(b"<Delay", b"&amp;<Delay"), "malformed"),
        (CANONICAL.replace(b"<Delay", b"<A><B/></A><Delay"), "malformed"),
        (CANONICAL.replace(b"<Delay", b"<Note>a]]>b</Note><Delay"), "malformed"),
        (CANONICAL.replace(b"1825.0000", b"nan", 1), "not a number"),
        (CANONICAL.replace(b"1825.0000", b"inf", 1), "not a number"),
        (CANONICAL.replace(b"1825.0000", b"-", 1), "not a number"),
        (CANONICAL.replace(b"1825.0000", b"", 1), "not a number"),
        (CANONICAL.replace(b"1825.0000", b"1825,0", 1), "not a number"),
        (CANONICAL.replace(b"1825.0000", b"1e99", 1), "not a number"),
        (CANONICAL.replace(b"1825.0000", b"0x10", 1), "not a number"),
        (CANONICAL.replace(b"4208163000", b"-4"), "not a number"),
        (CANONICAL.replace(b"4208163000", b"9" * 19), "not a number"),
        (CANONICAL.replace(b'<Delay D="0"/>', b'<Delay D="0"/><Delay D="1"/>'), "twice"),
        (CANONICAL.replace(b"<IPOC>", b"<IPOC>1</IPOC><IPOC>"), "twice"),
        (CANONICAL.replace(b"<IPOC>4208163000</IPOC>", b""), "IPOC is missing"),
        (CANONICAL.replace(b'<Delay D="0"/>', b""), "missing"),
    ],
)
def test_refuses_everything_else_and_says_why(telegram: bytes, said: str) -> None:
    reader = robot_reader(config())
    status = reader.read_bytes(telegram)
    assert status != OK
    assert said in SCAN_FAULTS[status]


def test_nearly_empty_first_telegram_of_a_kr_c2_still_gives_its_counter() -> None:
    reader = robot_reader(config())
    assert reader.read_bytes(b'<Rob Type="KUKA"><IPOC>12</IPOC></Rob>') == MISSING
    assert reader.counter == 12
    assert not reader.seen.any()


@given(
    st.lists(st.floats(-9e5, 9e5), min_size=21, max_size=21),
    st.integers(0, 10**12),
    st.integers(0, 6),
)
def test_round_trip_to_the_written_places(values: list[float], counter: int, places: int) -> None:
    writer, reader = robot_writer(config(), decimals=places), robot_reader(config())
    writer.values[:] = values
    telegram = writer.telegram(counter)
    assert reader.read_bytes(telegram) == OK
    assert reader.counter == counter
    doubles = np.array([value.kind == "DOUBLE" for value in config().sent()])
    assert np.max(np.abs(reader.values - writer.values)[doubles]) <= 0.5 * 10.0**-places * (1 + 1e-6)
    assert np.max(np.abs(reader.values - writer.values)[~doubles]) <= 0.5
    root = ElementTree.fromstring(telegram)
    assert [float(root.find("RIst").get(a)) for a in "XYZABC"] == reader.values[:6].tolist()  # type: ignore[union-attr, arg-type]


@pytest.mark.long
@settings(max_examples=1500)
@given(st.data())
def test_what_is_accepted_an_xml_library_reads_alike(data: st.DataObject) -> None:
    """Telegrams damaged at random: either refused, or read as the library reads them."""
    telegram = bytearray(CANONICAL)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(telegram)))
        cut = data.draw(st.integers(0, 12))
        piece = data.draw(
            st.sampled_from([b"", b"<", b">", b'"', b"/", b"=", b" ", b"0", b"-", b"e", b"<A/>", b"\0", b"&"])
        )
        telegram[at : at + cut] = piece
    reader = robot_reader(config())
    status = reader.read_bytes(bytes(telegram))
    assert status in (OK, *SCAN_FAULTS)
    if status != OK:
        return
    root = ElementTree.fromstring(bytes(telegram).rstrip(b"\0 \r\n\t"))
    assert int(root.findtext("IPOC", "")) == reader.counter
    for value, number in zip(config().sent(), reader.values, strict=True):
        found = [e for e in root.findall(value.element) if not value.attribute or value.attribute in e.attrib]
        assert len(found) == 1
        text = found[0].get(value.attribute) if value.attribute else found[0].text
        assert float(text or "") == pytest.approx(number, rel=1e-15)


def test_answer_is_what_the_controller_expects() -> None:
    writer = answer_writer(config(), texts={"EStr": "ok"})
    writer.values[writer.place("RKorr.X", "RKorr.Y", "RKorr.Z")] = [0.0125, -0.031, -1e-9]
    assert writer.telegram(4208163000) == (
        b'<Sen Type="Counterflex"><EStr>ok</EStr><RKorr X="0.012500" Y="-0.031000" Z="0.000000"/><Stop>0</Stop>'
        b"<IPOC>4208163000</IPOC></Sen>"
    )
    reader = answer_reader(config())
    assert reader.read_bytes(writer.telegram(4)) == OK
    assert reader.values[reader.place("RKorr.Y")][0] == -0.031


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
def test_nothing_is_written_that_is_no_number(value: float) -> None:
    writer = answer_writer(config())
    writer.values[1] = value
    assert writer.write(4) == 0
    with pytest.raises(ProtocolError, match=r"RKorr\.X"):
        writer.telegram(4)


def test_nothing_is_written_for_a_counter_below_zero() -> None:
    assert answer_writer(config()).write(-1) == 0


def test_a_text_that_would_break_the_telegram_is_refused() -> None:
    with pytest.raises(InputError, match="cannot be written"):
        answer_writer(config(), texts={"EStr": "</Sen>"})


def test_unknown_value_names_those_there_are() -> None:
    with pytest.raises(InputError, match=r"RIst\.X"):
        robot_reader(config()).place("MACur.A1")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<ROOT>", "<ROUTE>", "not an XML file"),
        ("<PORT>49152</PORT>", "<PORT>70000</PORT>", "70000"),
        ("<PORT>49152</PORT>", "", "CONFIG.PORT is missing"),
        ("<SENTYPE>Counterflex</SENTYPE>", "<SENTYPE>a b&lt;</SENTYPE>", "SENTYPE"),
        ('TAG="DEF_RIst"', 'TAG="DEF_RIsst"', "keyword is unknown"),
        ('TAG="DEF_RIst"', 'TAG="DEF_RSol"', "twice"),
        ('TAG="Corr.Stat"', 'TAG="Corr.Stat.x"', "TAG cannot be used"),
        ('TYPE="BOOL" INDX="2"', 'TYPE="BIT" INDX="2"', "TYPE is unknown"),
        ('INDX="2" HOLDON', 'INDX="65" HOLDON', "1 .. 64"),
        ('INDX="2" HOLDON', 'INDX="1" HOLDON', "used twice"),
        ('HOLDON="0"', 'HOLDON="2"', "HOLDON"),
        ("FALSE</ONLYSEND>", "NO</ONLYSEND>", "ONLYSEND"),
        ("<ROOT>", '<!DOCTYPE r [<!ENTITY a "b">]><ROOT>', "not an XML file"),
    ],
)
def test_configuration_faults_are_named(old: str, new: str, said: str) -> None:
    assert old in CONFIG
    with pytest.raises(FileFormatError, match=said):
        parse_config(CONFIG.replace(old, new, 1).encode(), "cell.xml")


@given(st.floats(-1e9, 1e9), st.integers(0, 6))
def test_decimals_agree_with_python(value: float, places: int) -> None:
    buffer = np.zeros(64, dtype=np.uint8)
    end = write_decimal(buffer, 0, value, places)
    text = buffer[:end].tobytes().decode()
    assert abs(float(text) - value) <= 0.5 * 10.0**-places + abs(value) * 1e-15
    assert text == f"{float(text):.{places}f}".replace("-0" + ("." + "0" * places if places else ""), text)
    number, good = read_decimal(buffer, 0, end)
    assert good == 1
    assert number == float(text)


@given(st.text("0123456789+-.eE", max_size=24))
def test_a_decimal_is_read_as_python_reads_it_or_not_at_all(text: str) -> None:
    data = np.frombuffer(text.encode() or b" ", dtype=np.uint8).copy()
    number, good = read_decimal(data, 0, len(text))
    if good:
        assert number == pytest.approx(float(text), rel=3e-16, abs=5e-324)
