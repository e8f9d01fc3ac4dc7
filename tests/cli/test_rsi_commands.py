"""rsi check and rsi make as a user types them; what is made is accepted by the loop's link and a simulated robot."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import examples
from counterflex.core.errors import CounterflexError, InputError, OutputError, ProgramError
from counterflex.core.units import DEG, MM
from counterflex.integrations.kuka.link.calls import read_calls
from counterflex.integrations.kuka.link.config import read_config
from counterflex.integrations.kuka.link.context import read_context
from counterflex.integrations.kuka.link.link import RsiLink
from counterflex.integrations.kuka.link.setup import CheckSettings, RsiMakeSettings
from counterflex.integrations.kuka.simulated import CORRECTING, FakeRsi, RsiContext
from counterflex.twin.devices.commanded_motion import Report

COMPENSATED = """&ACCESS RVP
&REL 1
DEF part( )
; a comment
$BASE=BASE_DATA[1]
PTP XSTART
$VEL.CP=0.025
part_001( )
LIN {X 0.0000,Y 0.0000,Z 5.0000,A 0.00000,B 90.00000,C 0.00000} C_DIS
END
"""
PIECE = "DEF part_001( )\nLIN {X 1,Y 0,Z 5,A 0,B 90,C 0} C_DIS\nEND\n"
DATA = "DEFDAT part\nDECL E6AXIS XSTART={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nENDDAT\n"
REPORT = Report(0.0, np.eye(4), np.eye(4), np.zeros(6), np.zeros(6), True, False)


@pytest.fixture
def shop(folder: Path) -> Path:
    """A cell that corrects online, and a KRL program in a folder of its own."""
    with (folder / "cell.toml").open("a", encoding="utf-8") as stream:
        stream.write("\n[online]\ncorrection_mm = 1.5\n")
    (folder / "krl").mkdir()
    for name, text in (("part.src", COMPENSATED), ("part_001.src", PIECE), ("part.dat", DATA)):
        (folder / "krl" / name).write_text(text, encoding="latin-1")
    (folder / "rsi.xml").write_text(examples.text("rsi.xml"), encoding="utf-8")
    return folder


def made(shop: Path, **settings: Any) -> Path:
    RsiMakeSettings(shop / "cell.toml", **settings).make(shop / "robot")
    return shop / "robot"


def with_rsi(shop: Path, version: str, more: str = "") -> None:
    """The cell of a shop with another RSI, and more tables."""
    text = (shop / "cell.toml").read_text(encoding="utf-8")
    assert 'rsi_version = "4.1"' in text
    (shop / "cell.toml").write_text(text.replace('rsi_version = "4.1"', version) + more, encoding="utf-8")


def judged(robot: Path, main: str, cell: Path) -> list[str]:
    context = next(path for path in robot.iterdir() if path.name in ("counterflex.rsi.xml", "counterflex.rsix"))
    files = CheckSettings(robot / "counterflex_ethernet.xml", cell, context, robot / main, {"the tracker": 4000})
    return [item.line() for item in files.check()]


def test_check_ends_with_one_where_there_is_an_error(shop: Path, counterflex: Callable[..., Any]) -> None:
    ended = counterflex("rsi", "check", "rsi.xml", "--cell", "cell.toml")
    assert ended.status == 0
    assert "0 errors" in ended.out
    assert ended.err == ""
    text = (shop / "rsi.xml").read_text(encoding="utf-8").replace('HOLDON="1"', 'HOLDON="0"')
    (shop / "rsi.xml").write_text(text, encoding="utf-8")
    ended = counterflex("rsi", "check", "rsi.xml", "--tracker", "49152")
    assert ended.status == 1
    lines = ended.out.splitlines()
    assert lines[0].startswith("error [")
    assert any("the tracker uses this port" in line for line in lines)
    assert lines[-1].endswith("not checked without --context, --krl, --cell")
    ended = counterflex("rsi", "check", "rsi.xml", "--json")
    answer = json.loads(ended.out)
    assert ended.status == 1
    assert answer["errors"] == sum(item["severity"] == "error" for item in answer["findings"]) > 0


@pytest.mark.parametrize("program", [None, "krl/part.src"])
@pytest.mark.parametrize("more", ["", 'output = "axes"\nperiod_ms = 12\n'])
@pytest.mark.parametrize("version", ['rsi_version = "3.3"', 'rsi_version = "5.0"'])
def test_what_is_made_is_clean(shop: Path, program: str | None, more: str, version: str) -> None:
    with_rsi(shop, version, more)
    robot = made(shop, program=None if program is None else shop / program)
    main = "cf_link_test.src" if program is None else "part.src"
    assert judged(robot, main, shop / "cell.toml") == []
    calls = read_calls(robot / main)
    assert (calls.mode, calls.cycle_ms) == ("absolute", 12 if more else 4)
    three = ("counterflex.rsi.xml", "counterflex.rsi", "counterflex.rsi.diagram")
    assert {path.name for path in robot.iterdir()} == {
        *("counterflex_ethernet.xml", "README.txt", "summary.json"),
        *(three if "3.3" in version else ("counterflex.rsix",)),
        *(("part.src", "part.dat", "part_001.src") if program else ("cf_link_test.src",)),
    }


@pytest.mark.parametrize(
    ("version", "context", "created"),
    [
        ('rsi_version = "3"', "counterflex.rsi.xml", "counterflex.rsi"),
        ('rsi_version = "4.0"', "counterflex.rsix", "counterflex"),
        ('rsi_version = "5.0.4.485"', "counterflex.rsix", "counterflex"),
        ('kss_version = "8.3"', "counterflex.rsi.xml", "counterflex.rsi"),
        ('kss_version = "8.6.5"', "counterflex.rsix", "counterflex"),
        ('rsi_version = "4.0"\nkss_version = "8.4"', "counterflex.rsi.xml", "counterflex.rsi"),
    ],
)
def test_the_version_of_the_controller_chooses_the_files(shop: Path, version: str, context: str, created: str) -> None:
    with_rsi(shop, version)
    robot = made(shop)
    assert (robot / context).is_file()
    assert len(list(robot.glob("counterflex.rsi*"))) == (3 if context.endswith(".xml") else 1)
    first = read_calls(robot / "cf_link_test.src").first("RSI_CREATE")
    assert first is not None
    assert first.arguments[0] == f'"{created}"'


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("", ["RSI version of the controller", "rsi_version", "3.3", "4.1"]),
        ('rsi_version = "2.3"', ["rsi_version = 2.3", "KR C2"]),
        ('rsi_version = "6.2"', ["rsi_version = 6.2", "iiQKA"]),
        ('rsi_version = "four"', ["controller.rsi_version", "not a version: 'four'", '"4.1"']),
        ("rsi_version = 4.1", ["rsi_version", "a text in quotes"]),
        ('correction_signal = "2nd"', ["correction_signal", "not the name of a signal"]),
        ('kss_version = "5.6"', ["kss_version = 5.6", "8.1 to 8.7"]),
        ('rsi_version = "3.3"\nkss_version = "8.6"', ["do not belong together", "RSI 4 or 5"]),
        ('rsi_version = "5.0"\nkss_version = "8.3"', ["do not belong together", "KSS 8.7"]),
    ],
)
def test_a_controller_that_no_files_can_be_made_for(
    shop: Path, refused: Callable[..., str], version: str, words: list[str]
) -> None:
    with_rsi(shop, version)
    said = refused("rsi", "make", "--cell", "cell.toml", "--out", "robot")
    for word in words:
        assert word in said


def test_the_speed_is_written_only_where_the_loop_may_change_it(shop: Path) -> None:
    assert "OV_PRO" not in (made(shop) / "counterflex.rsix").read_text(encoding="utf-8").upper()
    assert "Override" not in (shop / "robot/counterflex_ethernet.xml").read_text(encoding="utf-8")
    with_rsi(shop, 'rsi_version = "4.1"', "\n[override]\n")
    context = read_context(made(shop) / "counterflex.rsix")
    (item,) = context.of_kind("MAP2OV_PRO")
    ethernet = read_config(shop / "robot/counterflex_ethernet.xml")
    assert item.inputs[0].output == next(tag.channel for tag in ethernet.receive if tag.tag == "Override")


def test_only_the_switching_is_added_to_the_program(shop: Path) -> None:
    lines = (made(shop, program=shop / "krl/part.src") / "part.src").read_text(encoding="latin-1").splitlines()
    at = [lines.index(line) for line in COMPENSATED.splitlines()]
    assert at == sorted(at)
    order = [
        *("DECL INT cfid", "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )", "BAS (#INITMOV,0 )"),
        *("$BASE=BASE_DATA[1]", "PTP XSTART", 'cfr=RSI_CREATE("counterflex",cfid,TRUE)'),
        'cfr=RSI_SETPUBLICPAR(cfid,"POSCORR1","UpperLimX",2.700)',
        "HALT ; start counterflex run, then press start",
        *("cfr=RSI_ON(#ABSOLUTE,#IPO_FAST)", "WHILE NOT (($SEN_PREA[3]>1.5) AND ($SEN_PREA[3]<2.5))"),
        *("$SEN_PREA[2]=1.0", "part_001( )", "WAIT SEC 0.0", "WHILE NOT (CF_ZERO( ))"),
        *("cfr=RSI_OFF()", "cfr=RSI_DELETE(cfid)", "END", "DEF CF_CHECK(cfresult:IN)"),
    ]
    found = [lines.index(line) for line in order]
    assert found == sorted(found)
    assert (shop / "robot/part_001.src").read_text(encoding="latin-1") == PIECE
    assert (shop / "robot/part.dat").read_text(encoding="latin-1") == DATA


def test_link_and_simulated_robot_accept_what_is_made(shop: Path) -> None:
    with_rsi(shop, 'rsi_version = "4.1"', "\n[override]\n")
    robot = made(shop)
    config = read_config(robot / "counterflex_ethernet.xml")
    context = read_context(robot / "counterflex.rsix")
    poscorr, ethernet = context.of_kind("POSCORR")[0], context.of_kind("ETHERNET")[0]
    fake = FakeRsi(
        config,
        RsiContext(
            timeout=int(ethernet.number("Timeout", 0)),
            precision=int(ethernet.number("Precision", 0)),
            clamp_m=poscorr.number("UpperLimX", 0.0) * MM,
            clamp_rad=poscorr.number("MaxRotAngle", 0.0) * DEG,
        ),
        {"Enable": 1.0},
    )
    link = RsiLink(replace(config, host="127.0.0.1"), port=0)
    controller = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    controller.settimeout(5.0)
    try:
        for x_mm in (0.0, 0.3, 1.5):
            controller.sendto(fake.telegram(REPORT), link.address)
            assert link.wait(5.0)
            assert link.enable
            assert not link.clamped
            assert link.answer(np.array([x_mm * MM, 0.0, 0.0, 0.0, 0.0, 0.1 * DEG]), override=0.5)
            fake.answer(controller.recv(65535))
            assert fake.refused == ""
            assert fake.correction[0] == pytest.approx(x_mm * MM, abs=1e-9)
        assert fake.stat == CORRECTING
        assert fake.override == pytest.approx(0.5)
        controller.sendto(fake.telegram(REPORT), link.address)
        assert link.wait(5.0)
        assert link.answer(np.zeros(6), stop=True, feed_hold=True)
        fake.answer(controller.recv(65535))
        assert fake.stopped == "Stop"
        assert fake.feed_hold
        assert fake.late == 0
    finally:
        controller.close()
        link.close()


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("krl/part.src", "PTP XSTART\n", "", ["part.src:", "first motion is not PTP"]),
        ("krl/part.src", "END\n", "PTP XSTART\nEND\n", ["part.src:10", "LIN and CIRC only"]),
        ("krl/part.src", "LIN {", "SLIN {", ["part.src:9", "spline", "SLIN"]),
        ("krl/part.src", "$VEL.CP=0.025", "cfr=RSI_OFF()", ["part.src:7", "switches RSI itself"]),
        ("krl/part.src", "$VEL.CP=0.025", "$SEN_PREA[3]=1.0", ["part.src:7", "$SEN_PREA", "free"]),
        ("krl/part_001.src", "LIN", "INTERRUPT DECL 21 WHEN $IN[1] DO X()\nLIN", ["part_001.src:2", "interrupt 21"]),
        ("krl/part.src", "END\n", "$TOOL=TOOL_DATA[2]\nEND\n", ["part.src:10", "tool is changed"]),
        ("krl/part_001.src", "LIN", "; M3 S9000\nLIN", ["part_001.src:2", "a comment alone", "controller.spindle"]),
        ("krl/part_001.src", "LIN", "$TOOL=TOOL_DATA[2]\nLIN", ["part_001.src:2", "tool is changed"]),
        ("krl/part.src", "END\n", "", ["part.src", "cut off"]),
        ("krl/part.src", "DEF part( )", "", ["part.src", "no DEF"]),
        ("krl/part_001.src", "LIN", "PTP", ["part_001.src:2", "LIN and CIRC only"]),
        ("cell.toml", "[online]\ncorrection_mm = 1.5", "", ["cell.toml", "[online]"]),
        ("cell.toml", "correction_mm = 1.5", "correction_mm = 50", ["correction_mm", "90 mm", "<= 20 mm"]),
        ("cell.toml", "correction_mm = 1.5", 'mode = "relative"', ["online", "one lost answer stays", '"absolute"']),
    ],
)
def test_make_refuses_and_writes_nothing(
    shop: Path, refused: Callable[..., str], name: str, old: str, new: str, words: list[str]
) -> None:
    text = (shop / name).read_text(encoding="utf-8")
    assert old in text
    (shop / name).write_text(text.replace(old, new), encoding="utf-8")
    said = refused("rsi", "make", "--cell", "cell.toml", "--program", "krl/part.src", "--out", "robot")
    for word in words:
        assert word in said


def test_a_program_without_its_data_list_is_refused(shop: Path, refused: Callable[..., str]) -> None:
    """XSTART is declared there: no controller loads the program without it."""
    (shop / "krl" / "part.dat").unlink()
    said = refused("rsi", "make", "--cell", "cell.toml", "--program", "krl/part.src", "--out", "robot")
    assert "XSTART, but no part.dat" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--host", "192.0.1.4"), ["192.0.1", "KR C2"]),
        (("--host", "mill-pc"), ["mill-pc", "IPv4"]),
        (("--sentype", "<x>"), ["SENTYPE"]),
        (("--program", "krl/none.src"), ["none.src", "no such file"]),
        (("--program", "part.ngc"), ["part.ngc", "--as krl"]),
        (("--program", "krl/part.src", "--out", "krl"), ["could be replaced"]),
    ],
)
def test_make_refuses_arguments(
    shop: Path, refused: Callable[..., str], arguments: tuple[str, ...], words: list[str]
) -> None:
    out = () if "--out" in arguments else ("--out", "robot")
    said = refused("rsi", "make", "--cell", "cell.toml", *out, *arguments)
    for word in words:
        assert word in said


@pytest.mark.parametrize(
    ("option", "text", "words"),
    [
        ("FILE", "<ROOT>", ["not an XML file"]),
        ("--context", "<rSIModel/>", ["not an RSI context", ".rsi.xml"]),
        ("--context", '<RSIObjects><RSIObject ObjType="POSCORR"/></RSIObjects>', ["no ObjID"]),
        ("--krl", "LIN {X 1}", ["no DEF"]),
    ],
)
def test_check_refuses_other_files(
    shop: Path, refused: Callable[..., str], option: str, text: str, words: list[str]
) -> None:
    (shop / "bad").write_text(text, encoding="utf-8")
    arguments = ("bad",) if option == "FILE" else ("rsi.xml", option, "bad")
    said = refused("rsi", "check", *arguments)
    for word in words:
        assert word in said


def test_a_folder_that_cannot_be_written_stays_as_it_was(shop: Path) -> None:
    (shop / "robot").mkdir()
    (shop / "robot" / "README.txt").mkdir()
    with pytest.raises(OutputError):
        RsiMakeSettings(shop / "cell.toml").make(shop / "robot")
    assert [path.name for path in (shop / "robot").iterdir()] == ["README.txt"]


def test_line_ends_and_letters_of_the_source_stay(shop: Path) -> None:
    source = COMPENSATED.replace("a comment", "Fräser").replace("\n", "\r\n").encode("latin-1")
    (shop / "krl" / "part.src").write_bytes(source)
    data = (made(shop, program=shop / "krl/part.src") / "part.src").read_bytes()
    assert "Fräser".encode("latin-1") in data
    assert data.count(b"\r\n") == data.count(b"\n")


def test_errors_are_of_their_family(shop: Path) -> None:
    (shop / "krl" / "part.src").write_text("no program", encoding="utf-8")
    with pytest.raises(ProgramError):
        made(shop, program=shop / "krl/part.src")
    with pytest.raises(InputError):
        made(shop, port=70_000)
    with pytest.raises(CounterflexError):
        made(shop, host="224.0.0.1")


def test_around_a_program_that_compensate_wrote(shop: Path, counterflex: Callable[..., Any]) -> None:
    quick = ("--no-predict", "--no-report", "--as", "krl")
    assert counterflex("compensate", "part.ngc", "--cell", "cell.toml", "--out", "comp", *quick).status == 0
    made_ = counterflex("rsi", "make", "--cell", "cell.toml", "--program", "comp/part.src", "--out", "robot")
    assert made_.status == 0
    assert "README.txt" in made_.out
    assert "set controller.correction_output" in made_.out
    ended = counterflex(
        *("rsi", "check", "robot/counterflex_ethernet.xml", "--context", "robot/counterflex.rsix"),
        *("--krl", "robot/part.src", "--cell", "cell.toml"),
    )
    assert (ended.status, ended.out) == (0, "0 errors, 0 warnings\n")


BRANCHES = {
    "around its begin": ("LIN {X 0.0000", "IF $IN[1] THEN\nLIN {X 0.0000"),
    "loop that ends behind it": ("LIN {X 0.0000", "LIN {X 0,Y 0,Z 6,A 0,B 90,C 0}\nLOOP\nLIN {X 0.0000"),
    "left early": ("LIN {X 0.0000", "LIN {X 0,Y 0,Z 6,A 0,B 90,C 0}\nIF $IN[1] THEN\nRETURN\nENDIF\nLIN {X 0.0000"),
    "jump": ("LIN {X 0.0000", "LIN {X 0,Y 0,Z 6,A 0,B 90,C 0}\nGOTO last\nLIN {X 0.0000"),
    "other base": ("LIN {X 0.0000", "LIN {X 0,Y 0,Z 6,A 0,B 90,C 0}\n$BASE=BASE_DATA[2]\nLIN {X 0.0000"),
    "output of the safety PLC": ("LIN {X 0.0000", "$OUT[ 31]=FALSE\nLIN {X 0.0000"),
    "other routine than the file": ("DEF part( )", "DEF other( )"),
}


@pytest.mark.parametrize("case", BRANCHES.values(), ids=list(BRANCHES))
def test_a_program_that_may_leave_its_path_with_the_correction_on_is_refused(shop: Path, case: tuple[str, str]) -> None:
    old, new = case
    with_rsi(shop, 'rsi_version = "4.1"\ncorrection_output = 31')
    made(shop, program=shop / "krl/part.src")
    text = COMPENSATED.replace(*case)
    if old.startswith("LIN"):
        text = text.replace("part_001( )\n", "")  # the path of the main file alone
    assert new in text
    (shop / "krl/part.src").write_text(text, encoding="latin-1")
    with pytest.raises(ProgramError):
        RsiMakeSettings(shop / "cell.toml", shop / "krl/part.src").make(shop / "again")
    assert not (shop / "again").exists()


def test_the_compensated_program_is_not_written_over(shop: Path) -> None:
    with pytest.raises(InputError, match="written over"):
        RsiMakeSettings(shop / "cell.toml", shop / "krl/part.src").make(shop / "krl")
    assert (shop / "krl/part.src").read_text(encoding="latin-1") == COMPENSATED


def test_a_program_of_no_plan_is_told(shop: Path) -> None:
    summary = RsiMakeSettings(shop / "cell.toml", shop / "krl/part.src").make(shop / "robot")
    assert any("0 marks of a job" in line for line in summary["warnings"])
    marked = COMPENSATED.replace("; a comment", "; counterflex job 452f96504e90f0b6")
    (shop / "krl/part.src").write_text(marked, encoding="latin-1")
    summary = RsiMakeSettings(shop / "cell.toml", shop / "krl/part.src").make(shop / "again")
    assert not any("marks of a job" in line for line in summary["warnings"])
