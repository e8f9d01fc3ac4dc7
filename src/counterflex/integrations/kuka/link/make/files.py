"""Writes the ETHERNET file and the context of a KUKA RSI set-up that corrects as ``counterflex run`` does.

Object types, their numbers, parameters and indices are those of contexts that are published and said to run on
KR C4 controllers; what only a controller can tell stands in the README that is written beside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

from counterflex.core.errors import InputError
from counterflex.integrations.kuka.link.make.blocks import ContextBlock
from counterflex.integrations.kuka.link.make.context_file import context_file
from counterflex.integrations.kuka.link.make.editor_files import controller_file, diagram_file, model_file
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits

FEED_HOLD_INDEX: Final = 1
"""Index of $SEN_PREA that the loop sets to ask for a feed hold."""
ENABLE_INDEX: Final = 2
"""Index of $SEN_PREA that the program sets to enable the correction."""
STATE_INDEX: Final = 3
"""Index of $SEN_PREA in which the loop says its state."""
CORRECTION_INDEX: Final = 4
"""First of six indices of $SEN_PREA in which the controller says what it has corrected, mm and deg."""
_MARGIN: Final = 1.2
_AS_WRITTEN: Final = {"\r": "&#13;"}
"""A reader of XML takes a bare carriage return for a line feed (XML 1.0, 2.11)."""


@dataclass(frozen=True)
class RsiFiles:
    """Settings that the files are made of."""

    name: str  # Of the context: ``counterflex``
    host: str  # Address of the sensor computer
    port: int  # UDP port on it
    sentype: str  # Type of the answers
    limits: OnlineLimits  # Of the loop
    timeout: int = 10  # Unanswered cycles until the controller stops
    precision: int = 4  # Decimals that are sent
    currents: bool = False  # The controller sends its motor currents (MACur)
    override: bool = False  # The loop may change the speed of the program
    generation: int = 3  # Major version of RSI that the context is for: 3, 4 or 5

    @property
    def ethernet_name(self) -> str:
        """File name of the ETHERNET file."""
        return f"{self.name}_ethernet.xml"

    @property
    def context_name(self) -> str:
        """File name of the context that the controller reads."""
        return f"{self.name}.rsi.xml" if self.generation == 3 else f"{self.name}.rsix"

    @property
    def created_as(self) -> str:
        """Argument of RSI_CREATE: RSI 3 wants the ending, later ones add theirs to whatever they are given."""
        return f"{self.name}.rsi" if self.generation == 3 else self.name

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
        return _up(self.limits.axis_deg * self.limits.hard_factor * _MARGIN)

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
        receive += [("Stop", "BOOL"), ("FeedHold", "DOUBLE"), ("State", "DOUBLE")]
        receive += [("Override", "DOUBLE")] if self.override else []
        lines = ["<ROOT>", "  <CONFIG>"]
        for key, text in (
            ("IP_NUMBER", self.host),
            ("PORT", f"{self.port}"),
            ("SENTYPE", self.sentype),
            ("ONLYSEND", "FALSE"),
        ):
            lines.append(f"    <{key}>{escape(text, _AS_WRITTEN)}</{key}>")
        lines += ["  </CONFIG>", "  <SEND>", "    <ELEMENTS>"]
        lines += [f'      <ELEMENT TAG="{tag}" TYPE="{kind}" INDX="{index}"/>' for tag, kind, index in send]
        lines += ["    </ELEMENTS>", "  </SEND>", "  <RECEIVE>", "    <ELEMENTS>"]
        lines.append('      <ELEMENT TAG="DEF_EStr" TYPE="STRING" INDX="INTERNAL"/>')
        for index, (tag, kind) in enumerate(receive, start=1):
            lines.append(f'      <ELEMENT TAG="{tag}" TYPE="{kind}" INDX="{index}" HOLDON="1"/>')
        return "\n".join([*lines, "    </ELEMENTS>", "  </RECEIVE>", "</ROOT>", ""])

    def context(self) -> str:
        """Text of the context that the controller reads."""
        return self.contexts()[self.context_name]

    def contexts(self) -> dict[str, str]:
        """Every file of the context by its name: three for RSI 3, one for RSI 4 and 5."""
        blocks = self.blocks()
        if self.generation != 3:
            return {self.context_name: context_file(blocks, self.generation)}
        return {
            self.context_name: controller_file(blocks),
            f"{self.name}.rsi": model_file(blocks),
            f"{self.name}.rsi.diagram": diagram_file(blocks, self.name),
        }

    def blocks(self) -> tuple[ContextBlock, ...]:
        """The objects: correction, monitor, stop, what the program is told and tells, ETHERNET."""
        axes = self.limits.axes
        kind = "AXISCORR" if axes else "POSCORR"
        name, monitor = f"{kind}1", f"{kind}MON1"
        limits: dict[str, float | str] = {parameter: value for _, parameter, value in self.public_parameters()}
        if axes:
            most: dict[str, float | str] = {f"MaxA{i}": _up(self.axis_clamp_deg * _MARGIN) for i in range(1, 7)}
        else:
            most = {"MaxTrans": _up(self.clamp_mm * _MARGIN), "MaxRotAngle": _up(self.clamp_deg * _MARGIN)}
        links = [("ETHERNET1", 8, FEED_HOLD_INDEX), ("ETHERNET1", 9, STATE_INDEX)]
        links += [(monitor, i, CORRECTION_INDEX + i - 1) for i in range(1, 7)]
        override = [ContextBlock("MAP2OV_PRO", "MAP2OV_PRO1", {1: ("ETHERNET1", 10)})] if self.override else []
        return (
            ContextBlock(
                kind,
                name,
                {i: ("ETHERNET1", i) for i in range(1, 7)},
                limits if axes else {**limits, "RefCorrSys": "Base"},
                frozenset(limits),
            ),
            ContextBlock(f"{kind}MON", monitor, {}, most),
            ContextBlock("STOP", "STOP1", {1: ("ETHERNET1", 7)}, {"Mode": "PathNormal", "Channel": 0}),
            *(
                ContextBlock("MAP2SEN_PREA", f"MAP2SEN_PREA{k}", {1: (source, output)}, {"Index": index})
                for k, (source, output, index) in enumerate(links, start=1)
            ),
            *override,
            ContextBlock("SEN_PREA", "SEN_PREA1", {}, {"Index": ENABLE_INDEX}),
            ContextBlock(
                "ETHERNET",
                "ETHERNET1",
                {1: (name, 1), 2: ("SEN_PREA1", 1)},
                {"ConfigFile": self.ethernet_name, "Timeout": self.timeout, "Precision": self.precision},
            ),
        )


def check_files(files: RsiFiles) -> None:
    """Check that a robot can use what would be written.

    Raises:
        InputError: The limits need more than the monitors' defaults of 6 mm or 6 deg and a margin would allow.
    """
    if not 1 <= files.port <= 65535:
        raise InputError("no UDP port", where="--port", value=files.port, limit="1 .. 65535")
    for name, value, unit in (
        ("correction_mm", files.clamp_mm, "mm"),
        ("correction_deg", files.axis_clamp_deg if files.limits.axes else files.clamp_deg, "deg"),
    ):
        if value > 20.0:
            raise InputError(
                "the corrections are too large for a robot that cuts", where=f"[online] {name} x hard_factor",
                value=f"a limit of {value:g} {unit} on the controller", limit=f"<= 20 {unit}",
            )  # fmt: skip


def _up(value: float) -> float:
    """Rounded up to two decimals."""
    return math.ceil(value * 100.0 - 1e-6) / 100.0
