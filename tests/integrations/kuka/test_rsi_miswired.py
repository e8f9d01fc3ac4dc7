"""Contexts that were made, then broken in one place by hand: each is found, in every generation, where it is broken."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Final
from xml.etree import ElementTree

import pytest

from counterflex.integrations.kuka.language.rsi import with_correction
from counterflex.integrations.kuka.language.rsi_switching import RsiSwitching
from counterflex.integrations.kuka.link.calls import parse_calls
from counterflex.integrations.kuka.link.check.all_rules import check
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.context import parse_context
from counterflex.integrations.kuka.link.make.files import RsiFiles
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits, Setup
from counterflex.protocols.finding import Finding

LIMITS: Final = OnlineLimits(correction_mm=1.5, correction_deg=0.3, hard_factor=1.5, period_ms=4, override=True)
PATH: Final = "DEF part( )\nPTP XSTART\nLIN {X 0,Y 0,Z 5,A 0,B 90,C 0}\nEND\n"


class Context:
    """A made context whose objects can be broken; ports are counted from 1 here."""

    def __init__(self, files: RsiFiles) -> None:
        """Of a generation."""
        self.root = ElementTree.fromstring(files.context())
        self.first = 1 if files.generation == 3 else 0

    def item(self, name: str) -> ElementTree.Element:
        """An object."""
        rows = (row for row in self.root.iter() if row.tag.rpartition("}")[2].lower() == "rsiobject")
        return next(row for row in rows if row.attrib[key(row, "ObjID")] == name)

    def wire(self, name: str, index: int) -> ElementTree.Element:
        """What is wired to an input."""
        rows = (row for row in self.item(name).iter() if row.tag.endswith("Input"))
        return next(row for row in rows if int(row.attrib["InIdx"]) == index - 1 + self.first)

    def rewire(self, name: str, index: int, source: str = "", output: int = 0, to: int = 0) -> None:
        """Another source, output or input."""
        row = self.wire(name, index)
        if source:
            row.attrib[key(row, "OutObjID")] = source
        if output:
            row.attrib["OutIdx"] = str(output - 1 + self.first)
        if to:
            row.attrib["InIdx"] = str(to - 1 + self.first)

    def put(self, name: str, parameter: str, value: str, attribute: str = "ParamValue") -> None:
        """Another value of a parameter."""
        rows = (row for row in self.item(name).iter() if row.attrib.get("Name") == parameter)
        row = next(rows)
        row.attrib[key(row, attribute)] = value

    def drop(self, gone: ElementTree.Element) -> None:
        """Take an element out."""
        for row in self.root.iter():
            if gone in list(row):
                row.remove(gone)

    def again(self, name: str, as_name: str) -> ElementTree.Element:
        """A second object like one that there is."""
        other = copy.deepcopy(self.item(name))
        other.attrib[key(other, "ObjID")] = as_name
        parent = next(row for row in self.root.iter() if self.item(name) in list(row))
        parent.append(other)
        return other


def key(row: ElementTree.Element, name: str) -> str:
    """The attribute as this generation spells it."""
    return next(there for there in row.attrib if there.lower() == name.lower())


def idle(c: Context) -> None:
    other = c.again("POSCORR1", "POSCORR2")
    for row in list(other):
        if row.tag.endswith("Inputs"):
            other.remove(row)


def wide(c: Context) -> None:
    c.put("POSCORRMON1", "MaxTrans", "5.9")
    for axis in "XYZ":
        c.put("POSCORR1", f"UpperLim{axis}", "5.9")


def twice(c: Context) -> None:
    parent = next(row for row in c.item("POSCORR1").iter() if c.wire("POSCORR1", 1) in list(row))
    parent.append(copy.deepcopy(c.wire("POSCORR1", 1)))


def crossed(c: Context) -> None:
    c.rewire("MAP2SEN_PREA1", 1, output=9)
    c.rewire("MAP2SEN_PREA2", 1, output=8)


BROKEN: Final[dict[str, tuple[Callable[[Context], object], str, str, str]]] = {
    "another correction object": (lambda c: c.again("POSCORR1", "POSCORR2"), "two-corrections", "error", "POSCORR2"),
    "correction object of nobody": (idle, "idle-object", "warning", "POSCORR2"),
    "object gone": (lambda c: c.rewire("MAP2SEN_PREA3", 1, "NOPE1"), "dangling-wire", "error", "NOPE1"),
    "enable from nowhere": (lambda c: c.rewire("ETHERNET1", 2, "NOPE1"), "dangling-wire", "error", "NOPE1"),
    "no such output": (lambda c: c.rewire("MAP2SEN_PREA3", 1, output=9), "dangling-wire", "error", "1 .. 6"),
    "no such input": (lambda c: c.rewire("POSCORR1", 6, to=7), "dangling-wire", "error", "1 .. 6"),
    "two wires, one input": (twice, "dangling-wire", "error", "POSCORR1 input 1"),
    "open input": (
        lambda c: c.drop(c.wire("MAP2SEN_PREA4", 1)),
        "open-input",
        "error",
        "MAP2SEN_PREA4 input 1",
    ),
    "enabled by the sensor": (
        lambda c: c.rewire("ETHERNET1", 2, "ETHERNET1", 1),
        "wrong-wire",
        "error",
        "output 1 of ETHERNET1",
    ),
    "number of AXISCORR": (
        lambda c: c.item("POSCORR1").attrib.update({key(c.item("POSCORR1"), "ObjTypeID"): "33"}),
        "number",
        "error",
        "27 (POSCORR)",
    ),
    "number of a parameter": (
        lambda c: c.put("POSCORR1", "UpperLimX", "2", "ParamID"),
        "number",
        "error",
        "UpperLimX ParamID",
    ),
    "no such stop": (lambda c: c.put("STOP1", "Mode", "7"), "stop-mode", "error", "found 7"),
    "two writers": (lambda c: c.put("MAP2SEN_PREA2", "Index", "1"), "two-writers", "error", "$SEN_PREA[1]"),
    "enable overwritten": (lambda c: c.put("MAP2SEN_PREA1", "Index", "2"), "two-writers", "error", "$SEN_PREA[2]"),
    "no such variable": (lambda c: c.put("MAP2SEN_PREA8", "Index", "21"), "index", "error", "1 .. 20"),
    "hold unheard": (lambda c: c.put("MAP2SEN_PREA1", "Index", "15"), "unheard", "warning", "$SEN_PREA[15]"),
    "interrupt on nothing": (lambda c: c.put("MAP2SEN_PREA1", "Index", "15"), "unheard", "error", "$SEN_PREA[1]"),
    "waits for nothing": (lambda c: c.put("MAP2SEN_PREA2", "Index", "15"), "unheard", "error", "$SEN_PREA[3]"),
    "waits for another tag": (crossed, "blind-wait", "warning", "$SEN_PREA[1]"),
    "enable never set": (lambda c: c.put("SEN_PREA1", "Index", "17"), "enable-unset", "warning", "$SEN_PREA[17]"),
    "enable set to 0 only": (lambda c: c.put("SEN_PREA1", "Index", "7"), "enable-unset", "warning", "$SEN_PREA[7]"),
    "X twice, Y never": (lambda c: c.rewire("MAP2SEN_PREA4", 1, output=1), "unwatched-value", "warning", "output 2"),
    "wide limits": (wide, "wide-limit", "warning", "5.9 mm"),
    "wide monitor": (lambda c: c.put("POSCORRMON1", "MaxTrans", "500"), "wide-limit", "error", "500 mm"),
    "axes swapped": (lambda c: c.rewire("POSCORR1", 1, output=2), "wrong-wire", "error", "RKorr.Y"),
    "part frame": (lambda c: c.put("POSCORR1", "RefCorrSys", "3"), "reference-system", "error", "1 (Base)"),
    "stop moved": (lambda c: c.rewire("STOP1", 1, output=1), "not-wired", "error", "Stop"),
}
"""What is done to the context; rule, severity and a piece of the line that is expected."""


def findings(files: RsiFiles, context: bytes, limits: OnlineLimits = LIMITS) -> tuple[Finding, ...]:
    switching = RsiSwitching(files.created_as, files.public_parameters(), 4, 2, 1, 3, 4, armed_s=60.0, zero_s=3.0)
    krl = with_correction(PATH, switching, "part.src")
    krl = "\n".join(line for line in krl.splitlines() if "RSI_SETPUBLICPAR" not in line)  # the context alone counts
    return check(
        Setup(
            parse_config(files.ethernet().encode(), files.ethernet_name),
            parse_context(context, files.context_name),
            parse_calls(krl, "part.src"),
            limits,
        )
    )


@pytest.fixture(params=[3, 4, 5], ids=lambda generation: f"RSI {generation}")
def files(request: pytest.FixtureRequest) -> RsiFiles:
    """What a made set-up is made of."""
    return RsiFiles("cf", "192.168.44.10", 59152, "Cf", LIMITS, override=True, generation=request.param)


@pytest.mark.parametrize("case", BROKEN.values(), ids=list(BROKEN))
def test_one_broken_place_is_found_and_named(
    files: RsiFiles, case: tuple[Callable[[Context], object], str, str, str]
) -> None:
    change, rule, severity, piece = case
    context = Context(files)
    assert findings(files, ElementTree.tostring(context.root)) == ()
    change(context)
    found = findings(files, ElementTree.tostring(context.root))
    assert any(item.rule == rule and item.severity == severity and piece in item.line() for item in found), found


def test_the_speed_is_the_operators_without_a_table_override(files: RsiFiles) -> None:
    context = files.context().encode()
    told = findings(files, context, replace(LIMITS, override=False))
    assert [item.rule for item in told] == ["override-unasked"]
    silent = replace(files, override=False)
    assert findings(silent, silent.context().encode(), replace(LIMITS, override=False)) == ()


def test_default_limits_are_wider_than_a_small_correction(files: RsiFiles) -> None:
    context = Context(files)
    for axis in "XYZ":
        for side in ("LowerLim", "UpperLim"):
            context.put("POSCORR1", f"{side}{axis}", "other", "Name")
    context.drop(context.item("POSCORRMON1"))
    found = findings(files, ElementTree.tostring(context.root), replace(LIMITS, correction_mm=0.5))
    wide = [item.line() for item in found if item.rule == "wide-limit"]
    assert len(wide) == 3
    assert all("the default, nothing is written" in line and "0.75 (hard limit" in line for line in wide)
