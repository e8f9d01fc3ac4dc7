"""The context of a KUKA RSI set-up: its objects, how they are wired, their parameters.

Two forms are read: ``.rsi.xml`` (RSI 3: root ``RSIObjects``, indices from 1) and ``.rsix`` (RSI 4.1 and later: root
``RsiContext``, indices from 0). Indices are from 1 in everything this module hands out.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.protocols.xml_file import xml_root

_FIRST_INDEX: Final = {"rsiobjects": 1, "rsidata": 1, "rsicontext": 0}
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
_LARGEST: Final = 1e9
_SINKS: Final = ("POSCORR", "AXISCORR", "AXISCORREXT", "STOP", "ETHERNET")


@dataclass(frozen=True)
class Input:
    """One wired input."""

    index: int  # Of the input, from 1
    source: str  # ObjID whose output it takes
    output: int  # Index of that output, from 1


@dataclass(frozen=True)
class ContextObject:
    """One object of a context."""

    kind: str  # Type in capitals: ``POSCORR``, ``ETHERNET``
    name: str  # ObjID
    inputs: tuple[Input, ...]  # Wired inputs
    parameters: dict[str, str]  # Texts by name, as written
    public: frozenset[str] = frozenset()  # Parameters that are marked public: only these may be set by RSI_SETPUBLICPAR
    type_number: int | None = None  # ObjTypeID, by which the controller knows the type; None where the file gives none
    parameter_numbers: dict[str, int] = field(default_factory=dict)  # ParamID of parameters by name, likewise

    def number(self, parameter: str, default: float) -> float:
        """Value of a parameter; ``default`` where the file does not give it.

        Raises:
            FileFormatError: It is no number, or beyond 1e9.
        """
        text = next((v for k, v in self.parameters.items() if k.lower() == parameter.lower()), None)
        if text is None:
            return default
        value = decimal(text)
        if value is None:
            raise FileFormatError("not a number", where=f"{self.name} {parameter}", value=repr(text))
        return value


@dataclass(frozen=True)
class RsiContextFile:
    """A context."""

    objects: tuple[ContextObject, ...]  # In the order of the file
    where: str = ""  # Path, for messages
    first_index: int = 1  # Number of the first port in the file: 1 (RSI 3) or 0 (RSI 4 and later)

    def of_kind(self, kind: str) -> tuple[ContextObject, ...]:
        """Objects of a type, given in capitals."""
        return tuple(item for item in self.objects if item.kind == kind)

    def named(self, name: str) -> ContextObject | None:
        """Object with this ObjID, or None."""
        return next((item for item in self.objects if item.name == name), None)

    def reached(self, source: str, output: int) -> tuple[list[tuple[ContextObject, int]], list[ContextObject]]:
        """Return the ends of a signal, and the objects on its way.

        Args:
            source: ObjID.
            output: Index of its output, from 1.

        Returns:
            (object, index of its input) for every correction, stop, ``MAP2...`` and ETHERNET object that the signal
            arrives at, directly or through others; and the others.
        """
        ends: list[tuple[ContextObject, int]] = []
        passed: list[ContextObject] = []
        todo: list[tuple[str, int | None]] = [(source, output)]
        while todo:
            name, number = todo.pop(0)
            for item in self.objects:
                for wire in item.inputs:
                    if wire.source != name or (number is not None and wire.output != number):
                        continue
                    if item.kind in _SINKS or item.kind.startswith("MAP2"):
                        ends.append((item, wire.index))
                    elif item not in passed:
                        passed.append(item)
                        todo.append((item.name, None))
        return ends, passed


def decimal(text: str) -> float | None:
    """Value of a plain decimal number as controllers write it; None where the text is none, or too large."""
    if not _NUMBER.fullmatch(text.strip()):
        return None
    value = float(text)
    return value if abs(value) <= _LARGEST else None


def read_context(path: str | Path) -> RsiContextFile:
    """Read a context file (``.rsi.xml`` or ``.rsix``).

    Raises:
        FileFormatError: Missing, not XML, no RSI context, an object without type or name, an index out of range.
    """
    return parse_context(file_content.content(path), str(path))


def parse_context(text: bytes, where: str) -> RsiContextFile:
    """Check the text of a context. Raises as :func:`read_context`."""
    root = xml_root(text, where)
    first = _FIRST_INDEX.get(_local(root).lower())
    if first is None:
        raise FileFormatError(
            "not an RSI context", where=where, value=f"<{_local(root)}>",
            limit="<RSIObjects> (.rsi.xml) or <RsiContext> (.rsix)",
            hint="The .rsi file is the editor's drawing; give the .rsi.xml beside it",
        )  # fmt: skip
    objects = [_object(item, first, where) for item in root.iter() if _local(item).lower() == "rsiobject"]
    names = [item.name for item in objects]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise FileFormatError("two objects have one name", where=where, value=twice)
    if not objects:
        raise FileFormatError("the context has no objects", where=where)
    return RsiContextFile(tuple(objects), where, first)


def _local(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _object(element: Element, first: int, where: str) -> ContextObject:
    attributes = _attributes(element)
    kind, name = attributes.get("objtype", "").upper(), attributes.get("objid", "")
    if not kind or not name:
        raise FileFormatError("an object has no ObjType or no ObjID", where=where, value=name or kind or None)
    inputs, parameters, public, numbers = [], {}, set(), {}
    for child in element.iter():
        values = _attributes(child)
        if _local(child).lower() == "input":
            place = f"{where}: {name}"
            source = values.get("outobjid", "")
            if not source:
                raise FileFormatError("an input is wired to nothing: OutObjID is missing", where=place)
            inputs.append(
                Input(
                    _index(values.get("inidx", ""), first, place, "InIdx"),
                    source,
                    _index(values.get("outidx", ""), first, place, "OutIdx"),
                )
            )
        elif _local(child).lower() == "parameter":
            parameters[values.get("name", "")] = values.get("paramvalue", "")
            number = _whole(values.get("paramid", ""))
            if number is not None:
                numbers[values.get("name", "")] = number
            if values.get("ispublic", "").lower() in ("true", "1"):
                public.add(values.get("name", ""))
    type_number = _whole(attributes.get("objtypeid", ""))
    return ContextObject(kind, name, tuple(inputs), parameters, frozenset(public), type_number, numbers)


def _whole(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 6 else None


def _attributes(element: Element) -> dict[str, str]:
    return {str(key).rpartition("}")[2].lower(): value for key, value in element.attrib.items()}


def _index(text: str, first: int, where: str, what: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 3) or int(text) < first:
        raise FileFormatError(f"{what} is no index", where=where, value=repr(text), limit=f">= {first}")
    return int(text) - first + 1
