"""Rules about the variables between a KUKA RSI context and the KRL program: one writer each, and a reader."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from counterflex.integrations.kuka.link.whole_setup import Rule, Setup, message_variables
from counterflex.protocols.finding import Finding

_WRITERS: Final = {"MAP2SEN_PREA": "$SEN_PREA", "MAP2SEN_PINT": "$SEN_PINT"}
_READERS: Final = {"SEN_PREA": "$SEN_PREA", "SEN_PINT": "$SEN_PINT"}
_MOST: Final = 20
_MONITORED: Final = 6


def one_writer(setup: Setup) -> Iterator[Finding]:
    """Index of a variable: there is one, one object writes it, and none writes what the program says."""
    if setup.context is None:
        return
    seen: dict[str, str] = {}
    for item in setup.context.objects:
        word = {**_WRITERS, **_READERS}.get(item.kind)
        if word is None:
            continue
        index = setup.parameter(item, "Index", 1.0)
        if not 1 <= index <= _MOST or index != int(index):
            yield Finding(
                "index", "error", setup.within(item, "Index"), f"there is no {word} of this index", f"{index:g}",
                f"1 .. {_MOST}", "Correct the index",
            )  # fmt: skip
            continue
        variable = f"{word}[{int(index)}]"
        if item.kind in _WRITERS:
            if variable in seen:
                yield _twice(setup.within(item, "Index"), f"{seen[variable]} writes it too", variable)
            seen.setdefault(variable, item.name)
    for item in setup.context.objects:
        if item.kind in _READERS:
            variable = f"{_READERS[item.kind]}[{int(setup.parameter(item, 'Index', 1.0))}]"
            if variable in seen:
                what = f"{seen[variable]} writes it: what the program sets does not count"
                yield _twice(setup.within(item, "Index"), what, variable)


def _twice(place: str, what: str, variable: str) -> Finding:
    return Finding("two-writers", "error", place, what, variable, "a variable of its own for each", "Take a free index")


def variables_read(setup: Setup) -> Iterator[Finding]:
    """The program acts on FeedHold, and waits for nothing that nobody writes."""
    if setup.program is None or setup.context is None:
        return
    conditions = [item for item in setup.program.statements if item.what in ("INTERRUPT", "WAIT", "WHILE")]
    wired = message_variables(setup, "FeedHold")
    if wired and not any(
        name in item.arguments[0] for item in conditions for name in wired if item.what == "INTERRUPT"
    ):
        yield Finding(
            "unheard", "warning", setup.program.where,
            "the program does not act on the feed hold that the loop asks for: the robot mills on",
            f"no interrupt on {', '.join(wired)}", f"INTERRUPT DECL ... WHEN {wired[0]}>0.5 with BRAKE",
            "Correct the index of FeedHold in the context, or add the interrupt",
        )  # fmt: skip
    fed = {
        f"{_WRITERS[item.kind]}[{int(item.number('Index', 1.0))}]"
        for item in setup.context.objects
        if item.kind in _WRITERS
    }
    for item in conditions:
        for name in dict.fromkeys(re.findall(r"\$SEN_P(?:REA|INT)\[\d+\]", item.arguments[0])):
            if name not in fed:
                yield Finding(
                    "unheard", "error", setup.on_line(item.line),
                    "the program looks at a variable that nothing in the context writes", name,
                    ", ".join(sorted(fed)) or "a variable of MAP2SEN_PREA or MAP2SEN_PINT",
                    "Correct the index in the context or in the program",
                )  # fmt: skip


def monitored_values(setup: Setup) -> Iterator[Finding]:
    """Check that a program that is told the correction is told all six values of it."""
    if setup.context is None:
        return
    for monitor in (item for item in setup.context.objects if item.kind in ("POSCORRMON", "AXISCORRMON")):
        taken = {
            wire.output
            for item in setup.context.objects
            if item.kind.startswith("MAP2")
            for wire in item.inputs
            if wire.source == monitor.name
        }
        missing = [f"{i}" for i in range(1, _MONITORED + 1) if i not in taken]
        if taken and missing:
            yield Finding(
                "unwatched-value", "warning", setup.within(monitor),
                "the program sees a part of the correction only: it may take a correction for zero that is not",
                f"output {', '.join(missing)} not wired", f"outputs 1 .. {_MONITORED} wired to a variable each",
                "Correct the wiring",
            )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (one_writer, variables_read, monitored_values)
