"""Rules about the context of a KUKA RSI set-up: precision, timeout, limits."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import PureWindowsPath
from typing import Final

from counterflex.integrations.kuka.link.context import ContextObject
from counterflex.integrations.kuka.link.whole_setup import Rule, Setup
from counterflex.protocols.finding import Finding

PRECISION_DEFAULT: Final = 1
TIMEOUT_DEFAULT: Final = 10
LIMIT_DEFAULT: Final = 5.0
MONITOR_DEFAULT: Final = 6.0
_BASE: Final = 1
_TIMEOUT_LEAST: Final = 5
_TIMEOUT_MS: Final = (100, 400)
_EXIT_MOVECORR: Final = 4
_STOP_MODES: Final = (0, 1, 2, 3, 4)
_WIDE: Final = 1.5
_WIDE_MONITOR: Final = 2.0
_ROUNDING: Final = 0.01
_LARGEST_LIMIT: Final = 20.0


def ethernet_object(setup: Setup) -> Iterator[Finding]:
    """There is one ETHERNET object, and it names this file."""
    if setup.context is None:
        return
    objects = setup.context.of_kind("ETHERNET")
    if len(objects) != 1:
        yield Finding(
            "ethernet-object", "error", setup.context.where, "the context needs one ETHERNET object", f"{len(objects)}",
            "1", "Correct the context",
        )  # fmt: skip
        return
    named = PureWindowsPath(objects[0].parameters.get("ConfigFile", "")).name
    file_name = PureWindowsPath(setup.config.where).name
    if named.lower() != file_name.lower():
        yield Finding(
            "config-file", "error", setup.within(objects[0], "ConfigFile"), "the context reads another file",
            named or "none", file_name, "Give the file that it names, or change ConfigFile",
        )  # fmt: skip


def precision(setup: Setup) -> Iterator[Finding]:
    """Decimals of what the robot sends; the default makes steps of 0.1 mm and 0.1 deg."""
    item = setup.ethernet
    if item is None:
        return
    value = setup.parameter(item, "Precision", PRECISION_DEFAULT)
    if value < 4:
        yield Finding(
            "precision", "error", setup.within(item, "Precision"),
            "poses come rounded" if value < 0 else f"poses come in steps of {10.0**-value:g} mm and deg", f"{value:g}",
            ">= 4", "Set Precision to 4",
        )  # fmt: skip


def timeout(setup: Setup) -> Iterator[Finding]:
    """Unanswered cycles until the controller stops by itself."""
    item = setup.ethernet
    if item is None:
        return
    value = setup.parameter(item, "Timeout", TIMEOUT_DEFAULT)
    cycle_ms = setup.program.cycle_ms if setup.program else setup.limits.period_ms if setup.limits else 4
    most = [int(ms / cycle_ms) for ms in _TIMEOUT_MS]
    where = setup.within(item, "Timeout")
    safe = f"{_TIMEOUT_LEAST} .. {max(most[0], 10)} cycles of {cycle_ms} ms"
    if value < _TIMEOUT_LEAST:
        yield Finding(
            "timeout", "error" if value < 1 else "warning", where, "a short stall stops the robot in the cut",
            f"{value:g}", safe, f"Set Timeout to {TIMEOUT_DEFAULT}",
        )  # fmt: skip
    elif value > max(most[0], 10):
        yield Finding(
            "timeout", "error" if value > max(most[1], 10) else "warning", where,
            f"the robot mills on for {value * cycle_ms:g} ms with a frozen correction after the last answer",
            f"{value:g}", safe, f"Set Timeout to {TIMEOUT_DEFAULT}",
        )  # fmt: skip


def correction_limits(setup: Setup) -> Iterator[Finding]:
    """Limits of POSCORR and AXISCORR have the right signs and lie inside their monitors."""
    if setup.context is None:
        return
    monitor = next(iter(setup.context.of_kind("POSCORRMON")), None)
    for item in setup.context.of_kind("POSCORR"):
        most = [
            MONITOR_DEFAULT if monitor is None else setup.parameter(monitor, name, MONITOR_DEFAULT)
            for name in ("MaxTrans", "MaxRotAngle")
        ]
        yield from _inside(setup, item, [(f"LowerLim{a}", f"UpperLim{a}", most[0], "mm") for a in "XYZ"], "POSCORRMON")
        angle = setup.parameter(item, "MaxRotAngle", LIMIT_DEFAULT)
        if angle > most[1]:
            yield _above(setup, item, "MaxRotAngle", angle, most[1], "deg", "POSCORRMON")
        system = setup.parameter(item, "RefCorrSys", _BASE)
        if system != _BASE:
            yield Finding(
                "reference-system", "error", setup.within(item, "RefCorrSys"),
                "corrections are sent in BASE (part) axes", f"{system:g}", "1 (Base)", "Set RefCorrSys to Base",
            )  # fmt: skip
    monitor = next(iter(setup.context.of_kind("AXISCORRMON")), None)
    for item in setup.context.of_kind("AXISCORR"):
        rows = []
        for i in range(1, 7):
            top = MONITOR_DEFAULT if monitor is None else setup.parameter(monitor, f"MaxA{i}", MONITOR_DEFAULT)
            rows.append((f"LowerLimA{i}", f"UpperLimA{i}", top, "deg"))
        yield from _inside(setup, item, rows, "AXISCORRMON")
    for item in setup.context.of_kind("AXISCORREXT"):
        yield Finding(
            "external-axes", "warning", setup.within(item), "RSI_ON ends with RSIBad on a robot without external axes",
            "AXISCORREXT", "only with external axes", "Take it out where the robot has none",
        )  # fmt: skip


def _inside(setup: Setup, item: ContextObject, rows: list[tuple[str, str, float, str]], name: str) -> Iterator[Finding]:
    for lower, upper, top, unit in rows:
        low, high = setup.parameter(item, lower, -LIMIT_DEFAULT), setup.parameter(item, upper, LIMIT_DEFAULT)
        if low > 0.0 or high < 0.0:
            yield Finding(
                "limit-sign", "error", setup.within(item, f"{lower} {upper}"),
                "no correction at all is outside these limits", f"{low:g} .. {high:g} {unit}", "lower <= 0 <= upper",
                "Correct the signs",
            )  # fmt: skip
        elif max(-low, high) > top:
            yield _above(setup, item, upper if high >= -low else lower, max(-low, high), top, unit, name)


def _above(
    setup: Setup, item: ContextObject, parameter: str, value: float, top: float, unit: str, name: str
) -> Finding:
    there = bool(setup.context and setup.context.of_kind(name))
    return Finding(
        "limit-above-monitor",
        "error",
        setup.within(item, parameter),
        f"{name} stops the robot in the cut before this limit acts"
        + ("" if there else " (its default holds where the context has none)"),
        f"{value:g} {unit}",
        f"<= {top:g} {unit}",
        f"Lower it, or raise {name}",
    )


def own_limits(setup: Setup) -> Iterator[Finding]:
    """Check that what the loop may send lies inside the limits of the controller."""
    limits = setup.limits
    if limits is None or setup.context is None or limits.axes:
        return
    for item in setup.context.of_kind("POSCORR"):
        sides = [
            abs(setup.parameter(item, f"{side}{axis}", sign * LIMIT_DEFAULT))
            for axis in "XYZ"
            for side, sign in (("LowerLim", -1.0), ("UpperLim", 1.0))
        ]
        angle = setup.parameter(item, "MaxRotAngle", LIMIT_DEFAULT)
        for name, least, own, unit in (
            ("LowerLim.. UpperLim..", min(sides), limits.correction_mm, "mm"),
            ("MaxRotAngle", angle, limits.correction_deg, "deg"),
        ):
            if least < own * limits.hard_factor - 1e-9:
                clamped = least < own - 1e-9
                yield Finding(
                    "own-limit",
                    "error" if clamped else "warning",
                    setup.within(item, name),
                    f"the cell may send {own:g} {unit}, which is clamped here in silence"
                    if clamped
                    else f"the controller clamps before the loop's hard limit of {own * limits.hard_factor:g} {unit}",
                    f"{least:g} {unit}",
                    f">= {own * limits.hard_factor:g} {unit}",
                    "Widen it, or lower [online] in the cell file",
                )
    monitor = next(iter(setup.context.of_kind("POSCORRMON")), None)
    most = MONITOR_DEFAULT if monitor is None else setup.parameter(monitor, "MaxTrans", MONITOR_DEFAULT)
    if setup.pose_values and limits.correction_mm >= most:
        yield Finding(
            "own-limit", "error",
            setup.within(monitor, "MaxTrans") if monitor else f"{setup.context.where}: POSCORRMON (default)",
            f"the cell may send {limits.correction_mm:g} mm, at which the robot stops in the cut", f"{most:g} mm",
            f"> {limits.correction_mm * limits.hard_factor:g} mm", "Raise it, or lower [online] in the cell file",
        )  # fmt: skip


def wide_limits(setup: Setup) -> Iterator[Finding]:
    """The limits of the controller are the last barrier behind the loop: they end near what the loop may send."""
    limits = setup.limits
    if limits is None or setup.context is None:
        return
    rows: list[tuple[ContextObject, str, float, float, float, str]] = []
    if not limits.axes:
        mm, deg = limits.correction_mm * limits.hard_factor, limits.correction_deg * limits.hard_factor
        for item in setup.context.of_kind("POSCORR"):
            rows += _sides(setup, item, "XYZ", mm, "mm")
            angle = setup.parameter(item, "MaxRotAngle", LIMIT_DEFAULT)
            rows.append((item, "MaxRotAngle", angle, deg, _WIDE * deg, "deg"))
        for item in setup.context.of_kind("POSCORRMON"):
            for name, own, unit in (("MaxTrans", mm, "mm"), ("MaxRotAngle", deg, "deg")):
                top = max(MONITOR_DEFAULT, _WIDE_MONITOR * own)
                rows.append((item, name, setup.parameter(item, name, MONITOR_DEFAULT), own, top, unit))
    else:
        for item in setup.context.of_kind("AXISCORR"):
            rows += _sides(setup, item, [f"A{i}" for i in range(1, 7)], limits.axis_deg * limits.hard_factor, "deg")
    for item, name, value, own, top, unit in rows:
        if value > top + _ROUNDING:
            yield Finding(
                "wide-limit",
                "error" if value > _LARGEST_LIMIT else "warning",
                setup.within(item, name),
                "a fault of the loop may move the tool further than the cell file allows"
                + ("" if _states(setup, item, name) else " (the default, nothing is written)"),
                f"{value:g} {unit}",
                f"{own:g} (hard limit of the cell's [online]) .. {top:g} {unit}",
                "Lower it, here or by RSI_SETPUBLICPAR",
            )


def _sides(
    setup: Setup, item: ContextObject, axes: Sequence[str], own: float, unit: str
) -> Iterator[tuple[ContextObject, str, float, float, float, str]]:
    for axis in axes:
        low = -setup.parameter(item, f"LowerLim{axis}", -LIMIT_DEFAULT)
        high = setup.parameter(item, f"UpperLim{axis}", LIMIT_DEFAULT)
        yield item, f"{'LowerLim' if low > high else 'UpperLim'}{axis}", max(low, high), own, _WIDE * own, unit


def _states(setup: Setup, item: ContextObject, name: str) -> bool:
    return name in item.parameters or (
        setup.program is not None and (item.name, name) in setup.program.public_parameters()
    )


def stop_mode(setup: Setup) -> Iterator[Finding]:
    """The STOP object must stop a programmed path."""
    if setup.context is None:
        return
    moved = setup.program is not None and setup.program.first("RSI_MOVECORR") is not None
    for item in setup.context.of_kind("STOP"):
        mode = setup.parameter(item, "Mode", _EXIT_MOVECORR)
        if mode not in _STOP_MODES:
            yield Finding(
                "stop-mode", "error", setup.within(item, "Mode"), "there is no such stop", f"{mode:g}",
                "1 (PathNormal), 2 (Velocity) or 3 (PathFast)", "Set Mode to 1",
            )  # fmt: skip
        elif mode == 0 or (mode == _EXIT_MOVECORR and not moved):
            yield Finding(
                "stop-mode", "error" if mode == 0 or setup.program is not None else "warning",
                setup.within(item, "Mode"),
                "only shows a message" if mode == 0 else "ends RSI_MOVECORR, but does not stop a programmed path",
                f"{mode:g}", "1 (PathNormal), 2 (Velocity) or 3 (PathFast)", "Set Mode to 1",
            )  # fmt: skip


def context_name(setup: Setup) -> Iterator[Finding]:
    """The name that RSI_CREATE takes is the name of the context."""
    create = setup.program.first("RSI_CREATE") if setup.program else None
    if setup.context is None or create is None or not create.arguments:
        return
    named = re.sub(r"\.rsix?$", "", create.arguments[0].strip('"'), flags=re.IGNORECASE)
    name = re.sub(r"\.(rsi\.xml|rsix)$", "", PureWindowsPath(setup.context.where).name, flags=re.IGNORECASE)
    if named.lower() != name.lower():
        yield Finding(
            "context-name", "error", setup.on_line(create.line), "RSI_CREATE loads another context", named, name,
            "Give the context that the program loads, or change the name",
        )  # fmt: skip
    ending = re.search(r"\.rsix?$", create.arguments[0].strip('"'), re.IGNORECASE)
    if ending is not None and setup.context.where.lower().endswith(".rsix"):
        yield Finding(
            "context-name", "error", setup.on_line(create.line),
            f"RSI 4 and later add .rsix themselves and look for {create.arguments[0].strip(chr(34))}.rsix",
            create.arguments[0], f'"{named}"', "Give RSI_CREATE the name without an ending",
        )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (
    ethernet_object,
    precision,
    timeout,
    correction_limits,
    own_limits,
    wide_limits,
    stop_mode,
    context_name,
)
