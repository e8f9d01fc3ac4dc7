"""Rules about the objects of a KUKA RSI context: wires end where there is a port, numbers belong to names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from counterflex.integrations.kuka.link.make.blocks import TYPES
from counterflex.integrations.kuka.link.whole_setup import Rule, Setup
from counterflex.protocols.finding import Finding

_CORRECTIONS: Final = ("POSCORR", "AXISCORR", "AXISCORREXT")


def ends_of_wires(setup: Setup) -> Iterator[Finding]:
    """Every wire begins at an output that there is and ends alone at an input that there is."""
    if setup.context is None:
        return
    for item in setup.context.objects:
        kind = TYPES.get(item.kind)
        seen: set[int] = set()
        for wire in item.inputs:
            place = setup.within(item, f"input {wire.index}")
            source = setup.context.named(wire.source)
            if source is None:
                names = ", ".join(other.name for other in setup.context.objects)
                yield _dangling(place, "is wired to an object that is not there", wire.source, names)
            elif source.kind in TYPES and wire.output > len(TYPES[source.kind].outputs):
                most = len(TYPES[source.kind].outputs)
                safe = f"1 .. {most}" if most else f"{source.kind} has no output"
                yield _dangling(
                    place, "is wired to an output that is not there", f"{wire.output} of {source.name}", safe
                )
            if kind is not None and wire.index > len(kind.inputs):
                safe = f"1 .. {len(kind.inputs)}" if kind.inputs else f"{item.kind} has no input"
                yield _dangling(place, "there is no such input", f"{wire.index}", safe)
            if wire.index in seen:
                yield _dangling(place, "two wires end at one input", "2", "one wire")
            seen.add(wire.index)
        if kind is not None and not kind.optional:
            for index in range(1, len(kind.inputs) + 1):
                if index not in seen:
                    yield Finding(
                        "open-input", "error", setup.within(item, f"input {index}"), "must not stay open", "no wire",
                        "wired", "Wire it, or take the object out",
                    )  # fmt: skip


def _dangling(place: str, what: str, value: str, safe: str) -> Finding:
    return Finding("dangling-wire", "error", place, f"{what}: RSI_CREATE fails", value, safe, "Correct the wiring")


def idle_corrections(setup: Setup) -> Iterator[Finding]:
    """A correction object that nothing arrives at does nothing, and somebody thinks that it does."""
    if setup.context is None:
        return
    for item in setup.context.objects:
        if item.kind in _CORRECTIONS and not item.inputs:
            yield Finding(
                "idle-object", "warning", setup.within(item), "nothing is wired to it: it corrects nothing", "no wire",
                "wired, or not there", "Take it out, or wire it",
            )  # fmt: skip


def numbers(setup: Setup) -> Iterator[Finding]:
    """Numbers of objects and parameters are those of their names: a controller goes by the number."""
    if setup.context is None:
        return
    for item in setup.context.objects:
        kind = TYPES.get(item.kind)
        if kind is None:
            continue
        if item.type_number is not None and item.type_number != kind.number:
            yield _number(
                setup.within(item, "ObjTypeID"), "of another object", item.type_number, kind.number, item.kind
            )
        known = {row.name: row.first if setup.context.first_index == 1 else row.second for row in kind.parameters}
        for name, value in item.parameter_numbers.items():
            if name in known and value != known[name]:
                yield _number(setup.within(item, f"{name} ParamID"), "of another parameter", value, known[name], name)


def _number(place: str, whose: str, value: int, right: int, name: str) -> Finding:
    return Finding(
        "number", "error", place, f"the number is that {whose}: the controller goes by the number, not by the name",
        f"{value}", f"{right} ({name})", "Correct the number, or make the context again in RSI Visual",
    )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (ends_of_wires, idle_corrections, numbers)
