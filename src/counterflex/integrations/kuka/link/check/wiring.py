"""Rules about the wiring of a KUKA RSI context: every signal arrives where it should, and nowhere else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from counterflex.integrations.kuka.link.context import ContextObject, Input, RsiContextFile
from counterflex.integrations.kuka.link.whole_setup import Rule, Setup
from counterflex.protocols.finding import Finding, Severity


def wired_corrections(setup: Setup) -> Iterator[Finding]:
    """Each correction arrives at its own input of its own object, and nowhere else."""
    item, context = setup.ethernet, setup.context
    if item is None or context is None:
        return
    for value in setup.corrections:
        if value.tag.channel is None:
            continue
        kind, order = ("POSCORR", "XYZABC") if value.element == "RKorr" else ("AXISCORR", "123456")
        right = order.find(value.attribute[-1:]) + 1
        ends, passed = context.reached(item.name, value.tag.channel)
        hits = [(end, index) for end, index in ends if end.kind in ("POSCORR", "AXISCORR", "AXISCORREXT")]
        # One that is declared beside another that is wired is not in use.
        other, of_other = ("POSCORR", setup.pose_values) if kind == "AXISCORR" else ("AXISCORR", setup.axis_values)
        if not hits and context.of_kind(other) and of_other:
            continue
        if not hits:
            yield Finding(
                "not-wired", "error", setup.at(value.tag.tag), "the correction goes nowhere in the context",
                f"INDX {value.tag.channel} not wired", f"wired to input {right} of {kind}",
                "Wire it, or take the tag out",
            )  # fmt: skip
        yield from _wrong_ends(setup.at(value.tag.tag), hits, kind, right)
        yield from _limits_on_the_way(setup, value.name, passed)


def _wrong_ends(place: str, hits: list[tuple[ContextObject, int]], kind: str, right: int) -> Iterator[Finding]:
    for end, index in hits:
        if end.kind != kind or index != right:
            yield Finding(
                "wrong-wire", "error", place, "the correction arrives at the wrong input",
                f"input {index} of {end.name} ({end.kind})", f"input {right} of {kind}", "Correct the wiring",
            )  # fmt: skip
    objects = sorted({end.name for end, _ in hits})
    if len(objects) > 1:
        yield Finding(
            "two-corrections", "error", place, "the correction acts more than once: what two objects correct adds up",
            " and ".join(objects), f"one {kind}", "Take one object out of the context",
        )  # fmt: skip


def _limits_on_the_way(setup: Setup, name: str, passed: list[ContextObject]) -> Iterator[Finding]:
    limits = setup.limits
    if limits is None or not name.startswith("RKorr"):
        return
    required = limits.correction_mm if name[-1] in "XYZ" else limits.correction_deg
    for item in passed:
        if item.kind != "LIMIT":
            continue
        low, high = setup.parameter(item, "LowerLimit", -10.0), setup.parameter(item, "UpperLimit", 10.0)
        if min(-low, high) < required:
            yield Finding(
                "limit-object", "error", setup.within(item),
                f"cuts {name} off below what the cell may send, and no status says so", f"{low:g} .. {high:g}",
                f"-{required:g} .. {required:g} or wider", "Widen it or lower [online] in the cell file",
            )  # fmt: skip


def wired_commands(setup: Setup) -> Iterator[Finding]:
    """Stop, Override and FeedHold do something."""
    item, context = setup.ethernet, setup.context
    if item is None or context is None:
        return
    for name, required in (("Stop", "STOP"), ("Override", "MAP2OV_PRO"), ("FeedHold", ""), ("State", "")):
        value = setup.received.get(name)
        if value is None or value.tag.channel is None:
            continue
        ends, _ = context.reached(item.name, value.tag.channel)
        if not any(end.kind == required or (not required and end.kind != "ETHERNET") for end, _ in ends):
            severity: Severity = "error" if name == "Stop" else "warning"
            yield Finding(
                "not-wired", severity, setup.at(name), f"{name} does nothing in the context",
                f"INDX {value.tag.channel} not wired", f"wired to {required or 'MAP2SEN_PREA or MAP2DIGOUT'}",
                "Wire it, or take the tag out",
            )  # fmt: skip


def commands_declared(setup: Setup) -> Iterator[Finding]:
    """Check that what is wired to ETHERNET's outputs is declared."""
    item, context = setup.ethernet, setup.context
    if item is None or context is None:
        return
    channels = {value.tag.channel for value in setup.received.values()}
    used = {(wire.output, other.name) for other in context.objects for wire in other.inputs if wire.source == item.name}
    for output, name in sorted(used):
        if output not in channels:
            yield Finding(
                "undeclared-channel", "error", f"{context.where}: {name}",
                "is wired to a channel that RECEIVE does not declare: RSI_CREATE fails",
                f"output {output} of {item.name}", "only declared channels",
                f'Declare INDX="{output}" in RECEIVE, or take the wire out',
            )  # fmt: skip


def wired_sent(setup: Setup) -> Iterator[Finding]:
    """Check that what SEND declares on a channel is wired; Stat comes from the correction object."""
    item, context = setup.ethernet, setup.context
    if item is None or context is None:
        return
    sources = {wire.index: wire for wire in item.inputs}
    for tag in setup.config.send:
        if tag.channel is None:
            continue
        wire = sources.get(tag.channel)
        if wire is None:
            yield Finding(
                "not-wired", "error" if tag.tag == "Enable" or tag.tag.endswith(".Stat") else "warning",
                setup.at(tag.tag), "nothing is wired to it: it always says 0",
                f"input {tag.channel} of {item.name} open", "wired", "Wire it, or take the tag out",
            )  # fmt: skip
        elif tag.tag == "Enable" and _sensor_side(context, wire):
            yield Finding(
                "wrong-wire", "error", setup.at(tag.tag),
                "the correction would be enabled by the sensor or by itself, not by the program",
                f"output {wire.output} of {wire.source}",
                "SEN_PREA, SEN_PINT or a digital signal that the program sets", "Correct the wiring",
            )  # fmt: skip
        elif tag.tag.endswith(".Stat"):
            source = context.named(wire.source)
            if source is None or source.kind not in ("POSCORR", "AXISCORR") or wire.output != 1:
                yield Finding(
                    "wrong-wire", "error", setup.at(tag.tag), "is not the status of a correction object",
                    f"output {wire.output} of {wire.source}", "output 1 of POSCORR or AXISCORR", "Correct the wiring",
                )  # fmt: skip


def sent_declared(setup: Setup) -> Iterator[Finding]:
    """Check that what is wired to ETHERNET's inputs is declared."""
    item, context = setup.ethernet, setup.context
    if item is None or context is None:
        return
    for wire in item.inputs:
        if wire.index not in {tag.channel for tag in setup.config.send}:
            yield Finding(
                "undeclared-channel", "error", f"{context.where}: {item.name}",
                "takes in a channel that SEND does not declare: RSI_CREATE fails", f"input {wire.index}",
                "only declared channels", f'Declare INDX="{wire.index}" in SEND, or take the wire out',
            )  # fmt: skip


def _sensor_side(context: RsiContextFile, wire: Input) -> bool:
    source = context.named(wire.source)
    kinds = ("ETHERNET", "POSCORR", "POSCORRMON", "AXISCORR", "AXISCORREXT", "AXISCORRMON")
    return source is not None and source.kind in kinds


def override_asked(setup: Setup) -> Iterator[Finding]:
    """The speed of the program is the loop's only where the cell says so."""
    item, context, value = setup.ethernet, setup.context, setup.received.get("Override")
    if item is None or context is None or setup.limits is None or setup.limits.override is not False:
        return
    if value is None or value.tag.channel is None:
        return
    for end, _ in context.reached(item.name, value.tag.channel)[0]:
        if end.kind == "MAP2OV_PRO":
            yield Finding(
                "override-unasked", "error", setup.within(end),
                "the loop sets the program's speed to 100 % in every cycle: the operator's own setting has no effect",
                f"wired to {value.name}, no table [override] in the cell file", "MAP2OV_PRO only with [override]",
                "Take the object and the tag out, or add [override] to the cell file",
            )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (
    wired_corrections, wired_commands, commands_declared, wired_sent, sent_declared, override_asked,
)  # fmt: skip
