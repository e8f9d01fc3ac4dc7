"""Rules about the KRL program of a KUKA RSI set-up."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from counterflex.integrations.kuka.link.calls import KrlStatement, RsiCalls
from counterflex.integrations.kuka.link.whole_setup import Rule, Setup, message_variables
from counterflex.protocols.finding import Finding

_POINT_TO_POINT: Final = ("PTP", "PTP_REL", "SPTP")
_SPLINE: Final = ("SLIN", "SCIRC", "SPL", "SPLINE")
_PATH: Final = ("LIN", "LIN_REL", "CIRC", "CIRC_REL")
_CHECKED: Final = ("RSI_CREATE", "RSI_ON")


def order_of_calls(setup: Setup) -> Iterator[Finding]:
    """RSI is created, switched on and off again."""
    if setup.program is None:
        return
    for what, severe in (("RSI_CREATE", True), ("RSI_ON", True), ("RSI_OFF", False)):
        if setup.program.first(what) is None:
            yield Finding(
                "missing-call", "error" if severe else "warning", setup.program.where, f"{what} is not called",
                "no call", f"{what} called", "Add the call" if severe else "Switch RSI off before the program ends",
            )  # fmt: skip


def total_corrections(setup: Setup) -> Iterator[Finding]:
    """The loop sends total corrections."""
    on = setup.program.first("RSI_ON") if setup.program else None
    if on is not None and setup.program is not None and setup.program.mode == "relative" and setup.corrections:
        yield Finding(
            "relative",
            "error",
            setup.on_line(on.line),
            "the controller adds up what it is sent and does not tell which answers it took: one lost answer would "
            "stay in the cut; counterflex sends the total correction in every cycle",
            "#RELATIVE",
            "#ABSOLUTE",
            "Write RSI_ON(#ABSOLUTE, #IPO_FAST)",
        )


def cycle(setup: Setup) -> Iterator[Finding]:
    """Controller and loop have one cycle."""
    on = setup.program.first("RSI_ON") if setup.program else None
    if on is None or setup.program is None or setup.limits is None:
        return
    if setup.program.cycle_ms != setup.limits.period_ms:
        yield Finding(
            "cycle",
            "error",
            setup.on_line(on.line),
            "the loop's filters and limits are made for another cycle",
            f"{'#IPO' if setup.program.cycle_ms == 12 else '#IPO_FAST'}: {setup.program.cycle_ms} ms",
            f"online.period_ms = {setup.limits.period_ms}",
            f"Write {'#IPO' if setup.limits.period_ms == 12 else '#IPO_FAST'}, or change online.period_ms",
        )


def gate(setup: Setup) -> Iterator[Finding]:
    """The program waits for the sensor computer before RSI_ON."""
    on = setup.program.first("RSI_ON") if setup.program else None
    if on is None or setup.program is None:
        return
    before = [item for item in setup.program.statements if item.line < on.line]
    if not any(item.what in ("HALT", "WAIT") and not item.guarded for item in before):
        yield Finding(
            "gate", "warning", setup.on_line(on.line),
            "RSI_ON runs at once: it stops with RSITimeout where nobody answers yet", "no HALT or WAIT FOR before it",
            "a HALT or WAIT FOR before RSI_ON", "Add HALT, and start counterflex run there",
        )  # fmt: skip


def results_checked(setup: Setup) -> Iterator[Finding]:
    """Results of RSI_CREATE and RSI_ON are looked at."""
    if setup.program is None:
        return
    items = setup.program.statements
    for what in _CHECKED:
        call = setup.program.first(what)
        if call is None:
            continue
        later = [item for item in items if item.line > call.line]
        until = next((item.line for item in later if item.what.startswith("RSI_")), 1 << 30)
        looked = any(
            item.what == "RSIOK" or (item.what == "CALL" and call.result in item.arguments[1:])
            for item in later
            if item.line < until
        )
        if not looked:
            yield Finding(
                "unchecked", "warning", setup.on_line(call.line),
                f"the result of {what} is not looked at: the program goes on without correction",
                "no comparison with RSIOK", "IF result <> RSIOK THEN HALT ENDIF", "Add it",
            )  # fmt: skip


def motions(setup: Setup) -> Iterator[Finding]:
    """First motion PTP."""
    if setup.program is None:
        return
    items = setup.program.statements
    first = next((item for item in items if item.what in _POINT_TO_POINT + _PATH + _SPLINE), None)
    if first is not None and first.what not in _POINT_TO_POINT:
        yield Finding(
            "first-motion", "warning", setup.on_line(first.line), "the first motion of a program must be PTP",
            first.what, "PTP", "Begin with PTP, for example PTP $AXIS_ACT_MEAS",
        )  # fmt: skip


def corrected_motions(setup: Setup) -> Iterator[Finding]:
    """Only LIN and CIRC under correction, and no stop for a person."""
    if setup.program is None:
        return
    under = setup.program.between("RSI_ON", "RSI_OFF")
    path = next((item.line for item in under if item.what in _PATH), None)
    for item in under:
        if item.what == "HALT" and not item.guarded and path is not None and item.line > path:
            yield Finding(
                "stop-corrected", "warning", setup.on_line(item.line),
                "the program stops for a person behind its first path motion, before RSI_OFF: the robot may move there",
                "HALT", "the correction at zero and RSI_OFF before HALT", "Move it behind RSI_OFF",
            )  # fmt: skip
        if item.what in _POINT_TO_POINT:
            yield Finding(
                "ptp-corrected", "error", setup.on_line(item.line), "corrections are superposed on LIN and CIRC only",
                item.what, "LIN or CIRC between RSI_ON and RSI_OFF", "Move it before RSI_ON",
            )  # fmt: skip
        elif item.what in _SPLINE:
            yield Finding(
                "spline-corrected", "warning", setup.on_line(item.line),
                "nothing is known of corrections on spline motions", item.what, "LIN or CIRC",
                "Use LIN and CIRC, or try it out in air",
            )  # fmt: skip
        elif item.what == "RSI_MOVECORR":
            yield Finding(
                "movecorr", "warning", setup.on_line(item.line),
                "the program waits here and moves by the sensor alone: no path is milled", "RSI_MOVECORR",
                "LIN and CIRC between RSI_ON and RSI_OFF", "Take it out",
            )  # fmt: skip


def _writes(setup: Setup) -> list[KrlStatement]:
    """Statements that set the variable that Enable is wired to."""
    name = _enable_variable(setup)
    items = () if setup.program is None or name is None else setup.program.statements
    return [item for item in items if item.what == "WRITE" and item.arguments[0] == name]


def _waits(setup: Setup, variables: Sequence[str] = ()) -> list[int]:
    """Lines that wait for a condition, on one of the variables where some are given."""
    items = () if setup.program is None else setup.program.statements
    waits = [item for item in items if item.what in ("WAIT", "WHILE") and not item.guarded]
    return [item.line for item in waits if not variables or any(name in item.arguments[0] for name in variables)]


def enable_written(setup: Setup) -> Iterator[Finding]:
    """The program sets the variable that Enable is wired to."""
    name = _enable_variable(setup)
    if setup.program is not None and name is not None and not _writes(setup):
        yield Finding(
            "enable-unset", "warning", setup.program.where,
            "the program never sets what Enable is wired to: the correction is never switched on", f"no {name} = ...",
            f"{name} = 1 before the path, 0 behind it", "Add both lines",
        )  # fmt: skip


def armed_before_enable(setup: Setup) -> Iterator[Finding]:
    """The program enables the correction before the path, and behind a look whether the loop is armed."""
    name, written = _enable_variable(setup), _writes(setup)
    on = None if setup.program is None else setup.program.first("RSI_ON")
    if setup.program is None or on is None or not written:
        return
    path = _path_behind(setup.program, on.line)
    switched = [item.line for item in written if on.line < item.line < (path or math.inf) and item.sets()]
    state = message_variables(setup, "State")
    if switched and not any(on.line < line < switched[0] for line in _waits(setup, state)):
        yield Finding(
            "blind-wait", "warning", setup.on_line(switched[0]),
            "the correction is enabled without a look whether the loop is armed: the path may run without it",
            f"no condition{' on ' * bool(state)}{', '.join(state)} between RSI_ON and {name} = ...",
            "WAIT FOR, or WHILE with a time-out, on the tag State", "Wire State to $SEN_PREA and wait until it is 2",
        )  # fmt: skip
    elif path is not None and not switched:
        yield Finding(
            "enable-unset", "warning", setup.on_line(path),
            "the program never sets what Enable is wired to: the correction is never switched on",
            f"no {name} = 1 between RSI_ON and the first path motion", f"{name} = 1 before the path, 0 behind it",
            "Set it there, or correct the wiring",
        )  # fmt: skip


def _path_behind(program: RsiCalls, line: int) -> int | None:
    return next((item.line for item in program.statements if item.line > line and item.what in _PATH), None)


def zero_before_off(setup: Setup) -> Iterator[Finding]:
    """The program waits until the correction is back at zero before RSI_OFF."""
    written, off = _writes(setup), None if setup.program is None else setup.program.first("RSI_OFF")
    if off is None or not written or written[-1].line >= off.line:
        return
    if not any(written[-1].line < line < off.line for line in _waits(setup)):
        yield Finding(
            "blind-wait", "warning", setup.on_line(off.line),
            "RSI_OFF comes without a look whether the correction is back at zero",
            f"no condition between {_enable_variable(setup)} = 0 and RSI_OFF",
            "WAIT FOR, or WHILE with a time-out, on the outputs of POSCORRMON or AXISCORRMON",
            "Wire them to $SEN_PREA and wait until they are zero",
        )  # fmt: skip


def _enable_variable(setup: Setup) -> str | None:
    """Variable of the program that Enable is wired to."""
    enable, item = setup.sent.get("Enable"), setup.ethernet
    if setup.context is None or item is None or enable is None:
        return None
    wire = next((wire for wire in item.inputs if wire.index == enable.tag.channel), None)
    source = setup.context.named(wire.source) if wire else None
    variable = {"SEN_PREA": "$SEN_PREA", "SEN_PINT": "$SEN_PINT", "DIGOUT": "$OUT"}.get(source.kind if source else "")
    return None if source is None or variable is None else f"{variable}[{int(source.number('Index', 1.0))}]"


def known_parameters(setup: Setup) -> Iterator[Finding]:
    """RSI_SETPUBLICPAR names parameters that the context has and marks public."""
    if setup.program is None or setup.context is None:
        return
    for (name, parameter), (_, line) in setup.program.public_parameters().items():
        item = setup.context.named(name)
        if item is None or parameter not in item.parameters:
            yield Finding(
                "unknown-parameter",
                "error",
                setup.on_line(line),
                "RSI_SETPUBLICPAR fails: the context has no such parameter",
                f"{name} {parameter}",
                ", ".join(other.name for other in setup.context.objects)
                if item is None
                else ", ".join(sorted(item.public)) or f"a parameter of {name} that is written out and public",
                "Correct the name",
            )
        elif parameter not in item.public:
            yield Finding(
                "not-public", "error", setup.on_line(line),
                "RSI_SETPUBLICPAR fails: the context does not mark the parameter public", f"{name} {parameter}",
                'IsPublic="true" on the parameter', "Mark it public in the context, or take the call out",
            )  # fmt: skip


def whole_calls(setup: Setup) -> Iterator[Finding]:
    """RSI_SETPUBLICPAR has its four arguments: context, object, parameter, value."""
    if setup.program is None:
        return
    for item in setup.program.statements:
        if item.what == "RSI_SETPUBLICPAR" and len(item.arguments) != 4:
            yield Finding(
                "unknown-parameter", "error", setup.on_line(item.line),
                "RSI_SETPUBLICPAR has another number of arguments", f"{len(item.arguments)}",
                "4: identifier, object, parameter, value", "Correct the call",
            )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (
    order_of_calls,
    total_corrections,
    cycle,
    gate,
    results_checked,
    motions,
    corrected_motions,
    enable_written,
    armed_before_enable,
    zero_before_off,
    known_parameters,
    whole_calls,
)
