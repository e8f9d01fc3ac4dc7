"""Faults in files: what goes wrong in a simulated instrument, in shop units.

Part of a scenario file (:mod:`counterflex.files.scenario_file`); a file of its own has the format
``counterflex-faults``, version 1:

    format = "counterflex-faults"
    version = 1
    seed = 7

    [[faults]]
    kind = "lost"
    share = 0.05

    [[faults]]
    kind = "silent"
    from_s = 2.0
    for_s = 0.5

The same in one line each, for a command's option: ``lost=0.05`` and ``silent@2.0+0.5``.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.similar import close_to
from counterflex.core.units import MICRO, MM, MS
from counterflex.files.schema import Table, parse
from counterflex.twin.network.faults import DATAGRAM_KINDS, SOURCE_KINDS, Fault

KIND: Final = "counterflex-faults"
KINDS: Final = (*DATAGRAM_KINDS, *SOURCE_KINDS)
Three = tuple[float, float, float]
_SHORT: Final = re.compile(
    r"(?P<kind>[a-z_]+)(?:=(?P<value>[^@#,]+))?"
    r"(?:@(?P<from>[0-9.]+)(?:\+(?P<for>[0-9.]+))?)?(?:#(?P<first>[0-9]+)(?:\+(?P<count>[0-9]+))?)?"
    r"(?P<more>(?:,[a-z_]+=[^,]+)*)"
)
_WITHOUT_SHARE: Final = ("silent", "dying", "counter")
_ONLY: Final = {
    "late_ms": ("late",),
    "mean": ("bursts",),
    "step": ("counter",),
    "bits": ("status",),
    "offset_mm": ("offset",),
    "offset_n": ("offset",),
    "offset_um_m": ("offset",),
    "bridge": ("saturated", "frozen", "nan", "offset"),
    "share": tuple(kind for kind in KINDS if kind not in _WITHOUT_SHARE),
    "direction": DATAGRAM_KINDS,
    "for_s": tuple(kind for kind in KINDS if kind not in ("dying", "counter")),
    "count": tuple(kind for kind in KINDS if kind not in ("dying", "counter")),
}


class FaultTable(Table):
    """One fault, see :class:`counterflex.twin.network.faults.Fault`."""

    kind: Literal[KINDS]  # type: ignore[valid-type]
    share: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    from_s: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    for_s: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    first: Annotated[int, Field(ge=0, le=2**40)] = 0
    count: Annotated[int, Field(ge=1, le=2**40)] | None = None
    direction: Literal["out", "in"] | None = None
    late_ms: Annotated[float, Field(gt=0.0, le=60000.0)] | None = None
    mean: Annotated[float, Field(ge=1.0, le=1e6)] | None = None
    step: Annotated[int, Field(ge=-(2**31), le=2**31)] | None = None
    bits: Annotated[int, Field(ge=1, le=0xFFFFFFFF)] | None = None
    offset_mm: Three | None = None
    offset_n: Three | None = None
    offset_um_m: Annotated[float, Field(ge=-1e5, le=1e5)] | None = None
    bridge: Annotated[int, Field(ge=1, le=12)] | None = None

    @model_validator(mode="after")
    def _belong(self) -> Self:
        for key, kinds in _ONLY.items():
            if getattr(self, key) is not None and self.kind not in kinds:
                raise ValueError(f"{key} does not belong to the fault '{self.kind}'; expected with {', '.join(kinds)}")
        needed = {"late": "late_ms", "bursts": "mean", "counter": "step", "status": "bits"}.get(self.kind)
        if needed is not None and getattr(self, needed) is None:
            raise ValueError(f"the fault '{self.kind}' needs the key {needed}")
        offsets = sum(value is not None for value in (self.offset_mm, self.offset_n, self.offset_um_m))
        if self.kind == "offset" and offsets != 1:
            raise ValueError(
                "the fault 'offset' needs offset_mm (a tracker), offset_n (a force sensor) or offset_um_m (strain)"
            )
        if self.kind == "bursts" and self.share is None:
            raise ValueError("the fault 'bursts' needs the key share")
        return self

    def fault(self) -> Fault:
        """The fault in SI. Raises InputError: its numbers contradict each other."""
        offset = (0.0, 0.0, 0.0)
        if self.offset_mm is not None:
            offset = (self.offset_mm[0] * MM, self.offset_mm[1] * MM, self.offset_mm[2] * MM)
        elif self.offset_n is not None:
            offset = self.offset_n
        elif self.offset_um_m is not None:
            offset = (self.offset_um_m * MICRO, 0.0, 0.0)
        return Fault(
            kind=self.kind,
            share=1.0 if self.share is None else self.share,
            from_s=self.from_s,
            for_s=math.inf if self.for_s is None else self.for_s,
            first=self.first,
            count=self.count,
            direction=self.direction or "out",
            late_s=0.0 if self.late_ms is None else self.late_ms * MS,
            mean=1.0 if self.mean is None else self.mean,
            step=self.step or 0,
            bits=self.bits or 0,
            offset=offset,
            bridge=self.bridge,
        )


def short_fault(text: str) -> FaultTable:
    """A fault in one line.

    Args:
        text: ``KIND[=VALUE][@FROM[+FOR]][#FIRST[+COUNT]][,KEY=VALUE...]``: VALUE is the share, for ``status`` the bits,
            for ``counter`` the step, for ``offset`` millimetres ``X:Y:Z``; FROM and FOR are seconds, FIRST and COUNT
            datagrams, KEY a key of the table.
    """
    match = _SHORT.fullmatch(text.strip())
    if match is None:
        raise InputError(
            "not a fault",
            value=repr(text),
            limit="KIND[=VALUE][@FROM[+FOR]][#FIRST[+COUNT]][,KEY=VALUE], for example lost=0.05 or silent@2+0.5",
        )
    kind = match["kind"]
    if kind not in KINDS:
        close = close_to(kind, KINDS, 1)
        raise InputError(
            "unknown fault", value=kind, limit=", ".join(KINDS), hint=f"Did you mean '{close[0]}'?" if close else None
        )
    data: dict[str, Any] = {"kind": kind}
    if match["value"] is not None:
        key = {"status": "bits", "counter": "step", "offset": "offset_mm"}.get(kind, "share")
        data[key] = _value(match["value"], text)
    for key, name in (("from_s", "from"), ("for_s", "for"), ("first", "first"), ("count", "count")):
        if match[name] is not None:
            data[key] = _value(match[name], text)
    for pair in filter(None, match["more"].split(",")):
        key, _, value = pair.partition("=")
        if key in data:
            raise InputError("a fault has a repeated entry", where=repr(text), value=key)
        data[key] = _value(value, text)
    try:
        return parse(FaultTable, data, where=repr(text))
    except FileFormatError as fault:
        raise InputError(fault.what, where=fault.where, value=fault.value, limit=fault.limit, hint=fault.hint) from None


def _value(text: str, where: str) -> int | float | str | list[float]:
    """A number, three numbers ``X:Y:Z``, or a word."""
    if text in ("in", "out"):
        return text
    try:
        if ":" in text:
            return [float(part) for part in text.split(":")]
        return int(text, 0) if re.fullmatch(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)", text) else float(text)
    except ValueError as fault:
        raise InputError("not a number in a fault", where=repr(where), value=repr(text)) from fault
