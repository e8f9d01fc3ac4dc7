"""Writes the ETHERNET file and the context of a KUKA RSI set-up that corrects as ``counterflex run`` does.

Object types, their numbers, parameters and indices are those of contexts that are published and said to run on
KR C4 controllers; what only a controller can tell stands in the README that is written beside them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.wire.rsi_setup import OnlineLimits

ENABLE_INDEX: Final = 2
"""Index of $SEN_PREA that the program sets to enable the correction."""
FEED_HOLD_INDEX: Final = 1
"""Index of $SEN_PREA that the loop sets to ask for a feed hold."""
_MARGIN: Final = 1.2
_LEVER_M: Final = 0.2
_PATH_NORMAL: Final = 1


@dataclass(frozen=True)
class RsiFiles:
    """What the files are made of.

    Attributes:
        name: Of the context: ``counterflex``.
        host: Address of the sensor computer.
        port: UDP port on it.
        sentype: Type of the answers.
        limits: Of the loop.
        timeout: Unanswered cycles until the controller stops.
        precision: Decimals that are sent.
        currents: The controller sends its motor currents (MACur).
    """

    name: str
    host: str
    port: int
    sentype: str
    limits: OnlineLimits
    timeout: int = 10
    precision: int = 4
    currents: bool = False

    @property
    def ethernet_name(self) -> str:
        """File name of the ETHERNET file."""
        return f"{self.name}_ethernet.xml"

    @property
    def context_name(self) -> str:
        """File name of the context."""
        return f"{self.name}.rsi.xml"

    @property
    def clamp_mm(self) -> float:
        """Limit of POSCORR per axis: the loop's hard limit and a fifth."""
        return _up(self.limits.correction_mm * self.limits.hard_factor * _MARGIN)

    @property
    def clamp_deg(self) -> float:
        """Limit of POSCORR's angle, likewise."""
        return _up(self.limits.correction_deg * self.limits.hard_factor * _MARGIN)

    @property
    def axis_clamp_deg(self) -> float:
        """Limit of AXISCORR per axis: the hard limit of the tool's correction on a lever of 0.2 m, and a fifth."""
        limits = self.limits
        angle = limits.correction_mm * MM / _LEVER_M / DEG + limits.correction_deg
        return _up(angle * limits.hard_factor * _MARGIN)

    def public_parameters(self) -> tuple[tuple[str, str, float], ...]:
        """Object, parameter and value of every limit that the program sets again by RSI_SETPUBLICPAR."""
        if self.limits.axes:
            rows = [("AXISCORR1", f"LowerLimA{i}", -self.axis_clamp_deg) for i in range(1, 7)]
            return (*rows, *(("AXISCORR1", f"UpperLimA{i}", self.axis_clamp_deg) for i in range(1, 7)))
        sides = [("POSCORR1", f"LowerLim{axis}", -self.clamp_mm) for axis in "XYZ"]
        sides += [("POSCORR1", f"UpperLim{axis}", self.clamp_mm) for axis in "XYZ"]
        return (*sides, ("POSCORR1", "MaxRotAngle", self.clamp_deg))

    def ethernet(self) -> str:
        """Text of the ETHERNET file."""
        if self.limits.axes:
            corrections = [f"AKorr.A{i}" for i in range(1, 7)]
        else:
            corrections = [f"RKorr.{axis}" for axis in "XYZABC"]
        send = [(f"DEF_{word}", "DOUBLE", "INTERNAL") for word in ("RIst", "RSol", "AIPos", "ASPos")]
        if self.currents:
            send.append(("DEF_MACur", "DOUBLE", "INTERNAL"))
        send += [("DEF_Delay", "LONG", "INTERNAL"), ("Corr.Stat", "LONG", "1"), ("Enable", "DOUBLE", "2")]
        receive = [(tag, "DOUBLE") for tag in corrections]
        receive += [("Stop", "BOOL"), ("FeedHold", "DOUBLE"), ("Override", "DOUBLE")]
        lines = ["<ROOT>", "  <CONFIG>"]
        for key, text in (
            ("IP_NUMBER", self.host),
            ("PORT", f"{self.port}"),
            ("SENTYPE", self.sentype),
            ("ONLYSEND", "FALSE"),
        ):
            lines.append(f"    <{key}>{escape(text)}</{key}>")
        lines += ["  </CONFIG>", "  <SEND>", "    <ELEMENTS>"]
        lines += [f'      <ELEMENT TAG="{tag}" TYPE="{kind}" INDX="{index}"/>' for tag, kind, index in send]
        lines += ["    </ELEMENTS>", "  </SEND>", "  <RECEIVE>", "    <ELEMENTS>"]
        lines.append('      <ELEMENT TAG="DEF_EStr" TYPE="STRING" INDX="INTERNAL"/>')
        for index, (tag, kind) in enumerate(receive, start=1):
            lines.append(f'      <ELEMENT TAG="{tag}" TYPE="{kind}" INDX="{index}" HOLDON="1"/>')
        return "\n".join([*lines, "    </ELEMENTS>", "  </RECEIVE>", "</ROOT>", ""])

    def context(self) -> str:
        """Text of the context, ``.rsi.xml``."""
        axes = self.limits.axes
        correction = "AXISCORR" if axes else "POSCORR"
        if axes:
            limit = self.axis_clamp_deg
            values = [(f"LowerLimA{i}", i, -limit) for i in range(1, 7)]
            values += [(f"UpperLimA{i}", 12 + i, limit) for i in range(1, 7)]
            monitor = [(f"MaxA{i}", i, _up(limit * _MARGIN)) for i in range(1, 7)]
        else:
            values = [(f"LowerLim{axis}", i, -self.clamp_mm) for i, axis in enumerate("XYZ", start=1)]
            values += [(f"UpperLim{axis}", i, self.clamp_mm) for i, axis in enumerate("XYZ", start=4)]
            values.append(("MaxRotAngle", 7, self.clamp_deg))
            monitor = [("MaxTrans", 1, _up(self.clamp_mm * _MARGIN)), ("MaxRotAngle", 2, _up(self.clamp_deg * _MARGIN))]
        fixed = [] if axes else [("RefCorrSys", 1, "1")]
        channels = [(i, "ETHERNET1", i) for i in range(1, 7)]
        settings = [("Timeout", 1, self.timeout), ("Precision", 8, self.precision)]
        objects = [
            _object(correction, 33 if axes else 27, channels, values, fixed),
            _object("AXISCORRMON" if axes else "POSCORRMON", 82 if axes else 81, [], monitor),
            _object("STOP", 18, [(1, "ETHERNET1", 7)], [("Mode", 1, _PATH_NORMAL)]),
            _object("MAP2SEN_PREA", 17, [(1, "ETHERNET1", 8)], [("Index", 1, FEED_HOLD_INDEX)]),
            _object("MAP2OV_PRO", 25, [(1, "ETHERNET1", 9)], []),
            _object("SEN_PREA", 58, [], [("Index", 1, ENABLE_INDEX)]),
            _object(
                "ETHERNET",
                64,
                [(1, f"{correction}1", 1), (2, "SEN_PREA1", 1)],
                settings,
                [("ConfigFile", 1, self.ethernet_name)],
            ),
        ]
        head = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'
        root = (
            '<RSIObjects xsi:noNamespaceSchemaLocation="/Roboter/Config/System/Common/Schemes/RSIContext.xsd" '
            'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">'
        )
        return "\n".join([head, root, *objects, "</RSIObjects>", ""])


def check_files(files: RsiFiles) -> None:
    """Check that a robot can use what would be written.

    Raises:
        InputError: The limits need more than the monitors' defaults of 6 mm or 6 deg and a margin would allow.
    """
    if not 1 <= files.port <= 65535:
        raise InputError("no UDP port", where="--port", value=files.port, limit="1 .. 65535")
    for name, found, unit in (
        ("correction_mm", files.clamp_mm, "mm"),
        ("correction_deg", files.axis_clamp_deg if files.limits.axes else files.clamp_deg, "deg"),
    ):
        if found > 20.0:
            raise InputError(
                "the corrections are too large for a robot that cuts",
                where=f"[online] {name} x hard_factor",
                value=f"a limit of {found:g} {unit} on the controller",
                limit=f"<= 20 {unit}",
            )


def _up(value: float) -> float:
    """Rounded up to two decimals."""
    return math.ceil(value * 100.0 - 1e-6) / 100.0


def _object(
    kind: str,
    number: int,
    inputs: list[tuple[int, str, int]],
    values: Sequence[tuple[str, int, float]],
    fixed: list[tuple[str, int, str]] | None = None,
) -> str:
    lines = [f'  <RSIObject ObjType="{kind}" ObjTypeID="{number}" ObjID="{kind}1">']
    if inputs:
        wires = [f'      <Input InIdx="{i}" OutObjID="{source}" OutIdx="{o}"/>' for i, source, o in inputs]
        lines += ["    <Inputs>", *wires, "    </Inputs>"]
    rows = [f'      <Parameter Name="{name}" ParamID="{i}" ParamValue="{value:g}"/>' for name, i, value in values]
    for name, i, text in fixed or []:
        rows.append(f'      <Parameter Name="{name}" ParamID="{i}" ParamValue="{text}" IsRuntime="false"/>')
    if rows:
        lines += ["    <Parameters>", *rows, "    </Parameters>"]
    return "\n".join([*lines, "  </RSIObject>"])
