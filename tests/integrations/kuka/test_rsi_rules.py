"""Rules about KUKA RSI set-ups, in pairs: the clean set-up has no finding, one change brings the expected one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import example, given, strategies as st

import counterflex
from counterflex.core.errors import FileFormatError, InputError
from counterflex.integrations.kuka.language.rsi import with_correction
from counterflex.integrations.kuka.language.rsi_switching import RsiSwitching
from counterflex.integrations.kuka.link.calls import parse_calls
from counterflex.integrations.kuka.link.check.all_rules import check
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.context import parse_context
from counterflex.integrations.kuka.link.make.files import RsiFiles, check_files
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits, Setup
from counterflex.protocols.finding import Finding

LIMITS = OnlineLimits(correction_mm=2.0, correction_deg=0.3, hard_factor=1.5, period_ms=4)
FILES = RsiFiles("counterflex", "192.168.44.10", 59152, "Counterflex", LIMITS, override=True)
ETHERNET, CONTEXT = FILES.ethernet(), FILES.context()
PATH = """&ACCESS RVP
&REL 1
DEF groove( )
$TOOL=TOOL_DATA[1]
PTP XSTART
$VEL.CP=0.025
LIN {X 0,Y 0,Z 5,A 0,B 90,C 0}
CIRC {X 1,Y 1,Z 5},{X 2,Y 0,Z 5} C_DIS
END
"""


def switching(files: RsiFiles) -> RsiSwitching:
    return RsiSwitching(
        files.created_as, files.public_parameters(), files.limits.period_ms, 2, 1, 3, 4, armed_s=60.0, zero_s=3.0
    )


KRL = with_correction(PATH, switching(FILES), "groove.src")


def found(
    ethernet: str = ETHERNET,
    context: str | None = CONTEXT,
    krl: str | None = KRL,
    limits: OnlineLimits | None = LIMITS,
    ports: dict[str, int] | None = None,
) -> tuple[Finding, ...]:
    setup = Setup(
        parse_config(ethernet.encode(), "D:/x/counterflex_ethernet.xml"),
        None if context is None else parse_context(context.encode(), "counterflex.rsi.xml"),
        None if krl is None else parse_calls(krl, "groove.src"),
        limits,
        ports or {},
    )
    return check(setup)


def without(text: str, *pieces: str) -> str:
    """Lines that hold none of the pieces; each must be there."""
    assert all(piece in text for piece in pieces)
    return "\n".join(line for line in text.splitlines() if not any(piece in line for piece in pieces))


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new)


def rules(findings: tuple[Finding, ...], severity: str = "") -> set[str]:
    return {item.rule for item in findings if severity in ("", item.severity)}


def test_made_files_are_clean() -> None:
    assert found() == ()
    axes = replace(FILES, limits=replace(LIMITS, axes=True, period_ms=12))
    krl = with_correction(PATH, switching(axes), "groove.src")
    assert found(axes.ethernet(), axes.context(), krl, axes.limits) == ()
    assert found(context=None, krl=None, limits=None) == ()


ETHERNET_CASES: dict[str, tuple[str, str, str, str]] = {
    "RSol": ('TAG="DEF_RSol"', 'TAG="FREE"', "missing-tag", "error"),
    "ASPos": ('TAG="DEF_ASPos"', 'TAG="FREE"', "missing-tag", "warning"),
    "RIst": ('TAG="DEF_RIst"', 'TAG="FREE"', "missing-tag", "warning"),
    "Delay": ('TAG="DEF_Delay"', 'TAG="FREE"', "missing-tag", "warning"),
    "Enable": ('TAG="Enable"', 'TAG="Other"', "missing-tag", "warning"),
    "Stat": ('TAG="Corr.Stat"', 'TAG="Corr.Other"', "missing-stat", "warning"),
    "Stop": ('TAG="Stop"', 'TAG="Halt"', "missing-stop", "error"),
    "only send": ("<ONLYSEND>FALSE", "<ONLYSEND>TRUE", "only-send", "error"),
    "in part": ('TAG="RKorr.B"', 'TAG="FREE"', "partly-declared", "error"),
    "rounded": ('TAG="RKorr.X" TYPE="DOUBLE"', 'TAG="RKorr.X" TYPE="LONG"', "type", "error"),
    "rounded pose": ('TAG="DEF_RSol" TYPE="DOUBLE"', 'TAG="DEF_RSol" TYPE="LONG"', "type", "error"),
    "not held": ('HOLDON="1"', 'HOLDON="0"', "holdon-absolute", "error"),
    "held in part": ('INDX="2" HOLDON="1"', 'INDX="2" HOLDON="0"', "holdon-mixed", "error"),
    "speed not held": ('INDX="10" HOLDON="1"', 'INDX="10" HOLDON="0"', "holdon-command", "error"),
    "stop not held": ('INDX="7" HOLDON="1"', 'INDX="7" HOLDON="0"', "holdon-command", "warning"),
    "generator": ('TAG="DEF_EStr" TYPE="STRING"', 'TAG="DEF_Tech.T1" TYPE="DOUBLE"', "generator-1", "error"),
    "robot's type": ("<SENTYPE>Counterflex", "<SENTYPE>KUKA", "sentype", "warning"),
    "blank in type": ("<SENTYPE>Counterflex", "<SENTYPE>Counter flex", "sentype", "warning"),
    "KR C2 inside": ("192.168.44.10", "192.0.1.7", "address", "error"),
    "no address": ("192.168.44.10", "mill-pc", "address", "error"),
    "everybody": ("192.168.44.10", "192.168.44.255", "address", "error"),
    "loopback": ("192.168.44.10", "127.0.0.1", "address", "warning"),
    "administrator": ("<PORT>59152", "<PORT>80", "port", "warning"),
}


@pytest.mark.parametrize("case", ETHERNET_CASES.values(), ids=list(ETHERNET_CASES))
def test_a_dangerous_ethernet_file(case: tuple[str, str, str, str]) -> None:
    old, new, rule, severity = case
    findings = found(changed(ETHERNET, old, new), None, None)
    assert rules(findings) == {rule} | ({"holdon-command"} if rule == "holdon-absolute" else set())
    assert next(item for item in findings if item.rule == rule).severity == severity


CONTEXT_CASES: dict[str, tuple[str, str, str, str]] = {
    "precision": (
        '"Precision" ParamID="8" ParamValue="4"',
        '"Precision" ParamID="8" ParamValue="1"',
        "precision",
        "error",
    ),
    "precision default": ('Name="Precision"', 'Name="Other"', "precision", "error"),
    "timeout low": ('ParamID="1" ParamValue="10"', 'ParamID="1" ParamValue="2"', "timeout", "warning"),
    "timeout none": ('ParamID="1" ParamValue="10"', 'ParamID="1" ParamValue="0"', "timeout", "error"),
    "timeout high": ('ParamID="1" ParamValue="10"', 'ParamID="1" ParamValue="100"', "timeout", "warning"),
    "timeout endless": ('ParamID="1" ParamValue="10"', 'ParamID="1" ParamValue="1000"', "timeout", "error"),
    "monitor low": (
        'Name="MaxTrans" ParamID="1" ParamValue="4.32"',
        'Name="MaxTrans" ParamID="1" ParamValue="3"',
        "limit-above-monitor",
        "error",
    ),
    "monitor below us": (
        'Name="MaxTrans" ParamID="1" ParamValue="4.32"',
        'Name="MaxTrans" ParamID="1" ParamValue="1.9"',
        "own-limit",
        "error",
    ),
    "reference system": (
        '"RefCorrSys" ParamID="1" ParamValue="1"',
        '"RefCorrSys" ParamID="1" ParamValue="3"',
        "reference-system",
        "error",
    ),
    "stop is a message": (
        '"Mode" ParamID="1" ParamValue="1"',
        '"Mode" ParamID="1" ParamValue="0"',
        "stop-mode",
        "error",
    ),
    "stop of movecorr": (
        '"Mode" ParamID="1" ParamValue="1"',
        '"Mode" ParamID="1" ParamValue="4"',
        "stop-mode",
        "error",
    ),
    "other file": ("counterflex_ethernet.xml", "ethernet.xml", "config-file", "error"),
    "stop not wired": (
        'InIdx="1" OutObjID="ETHERNET1" OutIdx="7"',
        'InIdx="1" OutObjID="SEN_PREA1" OutIdx="1"',
        "not-wired",
        "error",
    ),
    "override not wired": (
        'InIdx="1" OutObjID="ETHERNET1" OutIdx="9"',
        'InIdx="1" OutObjID="SEN_PREA1" OutIdx="1"',
        "not-wired",
        "warning",
    ),
    "correction not wired": (
        'InIdx="3" OutObjID="ETHERNET1" OutIdx="3"',
        'InIdx="3" OutObjID="SEN_PREA1" OutIdx="1"',
        "not-wired",
        "error",
    ),
    "axes mixed up": (
        'InIdx="3" OutObjID="ETHERNET1" OutIdx="3"',
        'InIdx="3" OutObjID="ETHERNET1" OutIdx="2"',
        "wrong-wire",
        "error",
    ),
    "channel of nobody": (
        'InIdx="1" OutObjID="ETHERNET1" OutIdx="9"',
        'InIdx="1" OutObjID="ETHERNET1" OutIdx="12"',
        "undeclared-channel",
        "error",
    ),
    "status of something else": (
        'InIdx="1" OutObjID="POSCORR1" OutIdx="1"',
        'InIdx="1" OutObjID="POSCORR1" OutIdx="2"',
        "wrong-wire",
        "error",
    ),
    "enable open": ('InIdx="2" OutObjID="SEN_PREA1"', 'InIdx="1" OutObjID="SEN_PREA1"', "not-wired", "error"),
}


@pytest.mark.parametrize("case", CONTEXT_CASES.values(), ids=list(CONTEXT_CASES))
def test_a_dangerous_context(case: tuple[str, str, str, str]) -> None:
    old, new, rule, severity = case
    findings = found(context=changed(CONTEXT, old, new))
    assert any(item.rule == rule and item.severity == severity for item in findings)


def poscorr(limit: float, angle: float = 0.54) -> str:
    text = CONTEXT.replace('ParamValue="-3.6"', f'ParamValue="{-limit:g}"').replace('"3.6"', f'"{limit:g}"')
    return text.replace('ParamValue="0.54"', f'ParamValue="{angle:g}"')


@pytest.mark.parametrize(
    ("limit", "angle", "severities"),
    [
        (3.0, 0.45, set()),
        (2.9, 0.45, {"warning"}),
        (2.0, 0.45, {"warning"}),
        (1.9, 0.45, {"error"}),
        (3.0, 0.4, {"warning"}),
        (3.0, 0.2, {"error"}),
    ],
)
def test_limits_of_the_cell_against_those_of_the_controller(limit: float, angle: float, severities: set[str]) -> None:
    findings = found(context=poscorr(limit, angle), krl=without(KRL, "RSI_SETPUBLICPAR"))
    assert {item.severity for item in findings if item.rule == "own-limit"} == severities


def test_what_the_program_sets_counts_more_than_the_context() -> None:
    assert "own-limit" not in rules(found(context=poscorr(1.0)))
    assert "own-limit" in rules(found(krl=KRL.replace('"UpperLimY",3.600', '"UpperLimY",1.000')))
    assert "limit-above-monitor" in rules(found(krl=KRL.replace('"UpperLimY",3.600', '"UpperLimY",5.000')))


def test_the_monitor_acts_without_its_object() -> None:
    begin = CONTEXT.index('  <RSIObject ObjType="POSCORRMON"')
    end = CONTEXT.index('  <RSIObject ObjType="STOP"')
    gone = CONTEXT[:begin] + CONTEXT[end:]
    assert {item.rule for item in found(context=gone)} == {"dangling-wire"}
    for number in range(3, 9):  # what took the correction from it
        begin = gone.index(f'  <RSIObject ObjType="MAP2SEN_PREA" ObjTypeID="17" ObjID="MAP2SEN_PREA{number}"')
        end = gone.index("</RSIObject>", begin) + len("</RSIObject>\n")
        gone = gone[:begin] + gone[end:]
    assert found(context=gone) == ()
    assert rules(found(context=gone.replace('"3.6"', '"6.1"'), krl=without(KRL, "RSI_SETPUBLICPAR"))) == {
        "limit-above-monitor",
        "wide-limit",
    }


def test_both_corrections() -> None:
    extra = "".join(f'<ELEMENT TAG="AKorr.A{i}" TYPE="DOUBLE" INDX="{10 + i}" HOLDON="1"/>' for i in range(1, 7))
    ethernet = ETHERNET.replace("</ELEMENTS>\n  </RECEIVE>", f"{extra}</ELEMENTS>\n  </RECEIVE>")
    assert rules(found(ethernet, None, None)) == {"both-corrections"}
    assert found(ethernet) == ()
    wires = "".join(f'<Input InIdx="{i}" OutObjID="ETHERNET1" OutIdx="{10 + i}"/>' for i in range(1, 7))
    item = f'<RSIObject ObjType="AXISCORR" ObjTypeID="33" ObjID="A"><Inputs>{wires}</Inputs></RSIObject>'
    both = found(ethernet, CONTEXT.replace("</RSIObjects>", f"{item}</RSIObjects>"))
    assert rules(both, "error") == {"both-corrections"}


def test_a_limit_object_on_the_way() -> None:
    def with_limit(size: float) -> str:
        item = (
            '<RSIObject ObjType="LIMIT" ObjTypeID="39" ObjID="L"><Inputs>'
            '<Input InIdx="1" OutObjID="ETHERNET1" OutIdx="1"/></Inputs><Parameters>'
            f'<Parameter Name="LowerLimit" ParamID="1" ParamValue="{-size}"/>'
            f'<Parameter Name="UpperLimit" ParamID="2" ParamValue="{size}"/></Parameters></RSIObject>'
        )
        text = changed(CONTEXT, 'InIdx="1" OutObjID="ETHERNET1" OutIdx="1"', 'InIdx="1" OutObjID="L" OutIdx="1"')
        return text.replace("</RSIObjects>", f"{item}</RSIObjects>")

    assert found(context=with_limit(2.0)) == ()
    assert rules(found(context=with_limit(1.5)), "error") == {"limit-object"}


@pytest.mark.parametrize(
    ("gone", "rule"),
    [
        ("HALT ; start", "gate"),
        ("cfr=RSI_OFF", "missing-call"),
        ("cfr=RSI_ON", "missing-call"),
        ("cfr=RSI_CREATE", "missing-call"),
        ("PTP XSTART", "first-motion"),
        ("$SEN_PREA[2]=", "enable-unset"),
        ("CF_CHECK(cfr)", "unchecked"),
        ("WHILE NOT (($SEN_PREA[3]>1.5)", "blind-wait"),
        ("WHILE NOT (CF_ZERO( ))", "blind-wait"),
    ],
)
def test_a_line_that_is_missing_in_the_program(gone: str, rule: str) -> None:
    assert rule in rules(found(krl=without(KRL, gone)))


@pytest.mark.parametrize(
    ("old", "new", "rule", "severity"),
    [
        ("#ABSOLUTE", "#RELATIVE", "relative", "error"),
        ("#ABSOLUTE", "#RELATIVE", "holdon-relative", "error"),
        ("#IPO_FAST", "#IPO", "cycle", "error"),
        ("CIRC {", "SCIRC {", "spline-corrected", "warning"),
        ("CIRC {", "PTP {", "ptp-corrected", "error"),
        ("CIRC {", "RSI_MOVECORR() ;", "movecorr", "warning"),
        ("CIRC {", "HALT ; CIRC {", "stop-corrected", "warning"),
        ('cfid,"POSCORR1","UpperLimZ"', 'cfid,"POSCORR7","UpperLimZ"', "unknown-parameter", "error"),
        ('cfid,"POSCORR1","UpperLimZ"', 'cfid,"POSCORR1","UpperLimW"', "unknown-parameter", "error"),
        ('cfid,"POSCORR1","UpperLimZ"', 'cfid,"POSCORR1","RefCorrSys"', "not-public", "error"),
        ('cfid,"POSCORR1","UpperLimZ",3.600', 'cfid,"POSCORR1",3.600', "unknown-parameter", "error"),
        ('"counterflex.rsi"', '"other.rsi"', "context-name", "error"),
    ],
)
def test_a_dangerous_program(old: str, new: str, rule: str, severity: str) -> None:
    assert (rule in rules(found(krl=changed(KRL, old, new)), severity)) == bool(severity)


def test_a_name_with_an_ending_is_not_found_by_rsi_4() -> None:
    """It adds .rsix to whatever it is given."""
    new = replace(FILES, generation=4)
    context = parse_context(new.context().encode(), "D:/x/counterflex.rsix")

    def judged(created: str) -> set[str]:
        krl = changed(KRL, '"counterflex.rsi"', f'"{created}"')
        config = parse_config(ETHERNET.encode(), "counterflex_ethernet.xml")
        return rules(check(Setup(config, context, parse_calls(krl, "groove.src"), LIMITS)))

    assert judged("counterflex") == set()
    assert judged("counterflex.rsi") == {"context-name"}
    assert judged("counterflex.rsix") == {"context-name"}
    assert judged("other") == {"context-name"}


def test_relative_is_safe_against_losses_without_holdon_but_not_what_is_sent() -> None:
    findings = found(ETHERNET.replace('HOLDON="1"', 'HOLDON="0"'), krl=KRL.replace("#ABSOLUTE", "#RELATIVE"))
    assert {"relative"} <= rules(findings)
    assert not rules(findings) & {"holdon-relative", "holdon-absolute"}


def test_a_halt_under_a_condition_is_no_gate() -> None:
    guarded = KRL.replace("HALT ; start", "IF cfr<>RSIOK THEN\nHALT\nENDIF ; start")
    assert "gate" in rules(found(krl=guarded))
    assert "gate" not in rules(found(krl=guarded.replace("IF cfr", "WAIT FOR $IN[1]\nIF cfr", 1)))


def test_ports_and_outputs_of_others() -> None:
    assert rules(found(ports={"the tracker": 59152})) == {"port"}
    assert found(ports={"the tracker": 59153}) == ()
    assert "output" in rules(found(context=None, krl=None, limits=replace(LIMITS, axes=True)))
    simulated = ETHERNET.replace("192.168.44.10", "127.0.0.1").replace("59152", "49152")
    assert rules(found(simulated, None, None)) == {"address", "port"}
    assert rules(found(ETHERNET.replace("59152", "49152"), None, None)) == set()


def test_both_forms_of_a_context_are_one() -> None:
    import re

    shifted = re.sub(r'(InIdx|OutIdx)="(\d+)"', lambda m: f'{m[1]}="{int(m[2]) - 1}"', CONTEXT)
    for old, new in (("RSIObjects", "RsiContext"), ("RSIObject ", "RsiObject "), ("/RSIObject>", "/RsiObject>")):
        shifted = shifted.replace(old, new)
    shifted = shifted.replace("ObjID", "ObjId").replace("POSCORR", "PosCorr").replace("ETHERNET", "Ethernet")
    first, second = (parse_context(text.encode(), "x") for text in (CONTEXT, shifted))
    assert [(a.kind, [(w.index, w.output) for w in a.inputs]) for a in first.objects] == [
        (b.kind, [(w.index, w.output) for w in b.inputs]) for b in second.objects
    ]


def test_the_shipped_example_has_no_error() -> None:
    text = (Path(counterflex.__file__).parent / "app/demo/rsi.xml").read_text(encoding="utf-8")
    assert rules(found(text, None, None), "error") == set()


def test_a_finding_is_one_line_with_everything() -> None:
    (finding,) = found(ETHERNET.replace("192.168.44.10", "192.0.1.7"), None, None)
    line = finding.line()
    assert "\n" not in line
    for word in ("error", "address", "counterflex_ethernet.xml", "IP_NUMBER", "192.0.1.7", "safe:", "network"):
        assert word in line


@given(st.floats(0.01, 5.0), st.floats(0.01, 3.0), st.floats(1.0, 3.0), st.sampled_from([4, 12]), st.booleans())
def test_whatever_is_made_is_clean_or_refused(mm: float, deg: float, hard: float, period_ms: int, axes: bool) -> None:
    files = replace(FILES, limits=OnlineLimits(mm, deg, hard, period_ms, axes))
    try:
        check_files(files)
    except InputError:
        assert max(files.clamp_mm, files.clamp_deg, files.axis_clamp_deg) > 20.0
        return
    krl = with_correction(PATH, switching(files), "groove.src")
    assert rules(found(files.ethernet(), files.context(), krl, files.limits)) == set()


@given(st.sampled_from([ETHERNET, CONTEXT]), st.integers(0, 4000), st.integers(0, 60), st.binary(max_size=30))
@example(CONTEXT, 0, 4000, b"")
@example(ETHERNET, 0, 4000, b"<ROOT/>")
def test_damaged_files_are_judged_or_refused_in_one_line(text: str, at: int, cut: int, put: bytes) -> None:
    data = text.encode()
    damaged = data[: at % len(data)] + put + data[at % len(data) + cut :]
    try:
        config = parse_config(damaged if text is ETHERNET else ETHERNET.encode(), "counterflex_ethernet.xml")
        context = parse_context(damaged if text is CONTEXT else CONTEXT.encode(), "counterflex.rsi.xml")
        lines = [item.line() for item in check(Setup(config, context, parse_calls(KRL, "x.src"), LIMITS))]
    except FileFormatError as fault:
        lines = [str(fault)]
    assert all("\n" not in line for line in lines)


@given(st.text(alphabet=st.characters(max_codepoint=255), max_size=300))
def test_any_text_as_a_program(text: str) -> None:
    for krl in (text, KRL[:200] + text + KRL[200:]):
        try:
            calls = parse_calls(krl, "x.src")
        except FileFormatError:
            continue
        check(Setup(parse_config(ETHERNET.encode(), "x"), parse_context(CONTEXT.encode(), "y"), calls, LIMITS))


@given(st.text(max_size=40), st.text(max_size=40))
@example("0\r0", "0")
def test_no_address_or_name_breaks_out_of_its_place(host: str, sentype: str) -> None:
    files = replace(FILES, host=host, sentype=sentype)
    try:
        config = parse_config(files.ethernet().encode(errors="replace"), "x")
    except FileFormatError:
        return
    assert (config.host, config.sentype, config.port) == (host.strip(), sentype.strip(), 59152)
    assert len(config.receive) == len(parse_config(ETHERNET.encode(), "x").receive)


@pytest.mark.parametrize("text", ["nan", "1e400", "-inf", "1_0", "", "4,0", "1e12"])
def test_a_parameter_that_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(FileFormatError, match="Precision"):
        found(context=CONTEXT.replace('ParamID="8" ParamValue="4"', f'ParamID="8" ParamValue="{text}"'))


@pytest.mark.parametrize("value", ["-1e9", "-3", "3.9", "+1.5e0"])
def test_any_small_precision_is_an_error(value: str) -> None:
    text = CONTEXT.replace('ParamID="8" ParamValue="4"', f'ParamID="8" ParamValue="{value}"')
    assert rules(found(context=text), "error") == {"precision"}


@pytest.mark.parametrize("digits", ["9" * 5000, "0", "65536", "-1", "1.5", "\u0661"])
def test_numbers_that_are_none_are_refused(digits: str) -> None:
    for text in (ETHERNET.replace("<PORT>59152", f"<PORT>{digits}"), ETHERNET.replace('INDX="2"', f'INDX="{digits}"')):
        with pytest.raises(FileFormatError):
            found(text, None, None)
    if digits != "65536":
        with pytest.raises(FileFormatError, match="InIdx"):
            found(context=CONTEXT.replace('InIdx="2"', f'InIdx="{digits}"'))
