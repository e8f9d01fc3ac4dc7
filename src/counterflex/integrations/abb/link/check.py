"""Check a RAPID program for uses of EGM that are dangerous or useless."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.integrations.abb.link.calls import EgmCalls, Instruction
from counterflex.protocols.finding import Finding, Severity

MOST_TIMEOUT_S: Final = 0.1
PATH_MS: Final = 24
GUIDANCE_MS: Final = 4
SHORTEST_STANDING_S: Final = 5.0
_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")
_MOVES: Final = ("MOVEABSJ", "MOVEJ", "MOVEL", "MOVEC", "EGMMOVEL", "EGMMOVEC")
_CORRECTED: Final = ("EGMMOVEL", "EGMMOVEC")
_LOOKS: Final = ("WAITUNTIL", "WAITDI", "TPREADFK", "UIMESSAGEBOX", "IF", "WHILE")


@dataclass(frozen=True)
class ExpectedEgm:
    """Facts of the cell file that a RAPID program is checked against."""

    mode: str  # ``path`` or ``pose``
    period_ms: int  # Cycle of the loop
    device: str  # Name of the UDP Unicast Device
    configuration: str  # Name of the External Motion Interface Data
    in_part: bool = True  # Poses are in the work object, which is the part frame


def check_egm(calls: EgmCalls, expected: ExpectedEgm | None = None) -> tuple[Finding, ...]:
    """Judge a program.

    Args:
        expected: What the cell file says, or None.

    Returns:
        Findings, errors first, in the order of the file.
    """
    findings = [item for rule in _BY_ITSELF for item in rule(calls)]
    findings += [item for rule in _AGAINST_CELL for item in rule(calls, expected)]
    return tuple(sorted(findings, key=lambda item: item.severity != "error"))


def _at(calls: EgmCalls, item: Instruction | None) -> str:
    return calls.where if item is None else f"{calls.where}:{item.line}"


def _finding(
    rule: str, severity: Severity, where: str, what: str, value: object, safe: object, hint: str = ""
) -> Finding:
    return Finding(rule, severity, where, what, str(value), str(safe), hint)


def _timeout(calls: EgmCalls) -> Iterator[Finding]:
    hint = "Without messages the robot continues with the last value received"
    for item in calls.of("EGMSETUPUC"):
        where, safe = _at(calls, item), f"\\CommTimeout:= at most {MOST_TIMEOUT_S:g} s"
        seconds = item.number("commtimeout")
        if "commtimeout" not in item.switches:
            yield _finding("timeout", "error", where, "no CommTimeout: it is 1 s then", "none", safe, hint)
        elif seconds is None:
            yield _finding(
                "timeout", "error", where, "CommTimeout is not a number", item.switches["commtimeout"], safe, hint
            )
        elif not 0.0 < seconds <= MOST_TIMEOUT_S:
            yield _finding("timeout", "error", where, "CommTimeout is too long", f"{seconds:g} s", safe, hint)
    if not calls.of("EGMSETUPUC"):
        yield _finding("setup", "error", calls.where, "EGM is not set up", "no EGMSetupUC", "one EGMSetupUC")


def _mode(calls: EgmCalls, settings: ExpectedEgm | None) -> Iterator[Finding]:
    for item in calls.of("EGMSETUPUC"):
        path, posed = "pathcorr" in item.switches, "pose" in item.switches
        where = _at(calls, item)
        if path == posed:
            yield _finding(
                "mode", "error", where, "the way of correcting is not clear", "none or both", "\\PathCorr or \\Pose"
            )
            continue
        needed = _CORRECTED if path else ("EGMRUNPOSE",)
        if not calls.of(*needed):
            yield _finding(
                "mode", "warning", where, "no movement here is corrected", "none", " or ".join(needed),
                "Perhaps it stands in another module",
            )  # fmt: skip
        if settings is None:
            continue
        if path != (settings.mode == "path"):
            yield _finding(
                "mode", "error", where, "the cell file says otherwise", "\\PathCorr" if path else "\\Pose",
                f'[egm] mode = "{settings.mode}"',
            )  # fmt: skip
        names = tuple(text.strip('"') for text in item.arguments[2:4])
        for name, expected in zip(names, (settings.configuration, settings.device), strict=False):
            if name.rstrip(":") != expected.rstrip(":"):
                yield _finding("name", "warning", where, "another name than in the cell file", name, expected)


def _rate(calls: EgmCalls, expected: ExpectedEgm | None) -> Iterator[Finding]:
    for item in calls.of("EGMACTMOVE", "EGMACTPOSE", "EGMSTREAMSTART"):
        unit = PATH_MS if item.name == "EGMACTMOVE" else GUIDANCE_MS
        where = _at(calls, item)
        rate = item.number("samplerate")
        if "samplerate" in item.switches and (rate is None or rate <= 0.0 or rate % unit):
            yield _finding(
                "sample-rate", "error", where, "no such SampleRate", item.switches["samplerate"],
                f"multiples of {unit} ms",
            )  # fmt: skip
            continue
        rate = float(unit) if rate is None else rate
        if expected is not None and rate != expected.period_ms:
            yield _finding(
                "sample-rate", "error", where, "the loop runs in another cycle", f"{rate:g} ms",
                f"[online] period_ms = {expected.period_ms}",
            )  # fmt: skip


def _guidance(calls: EgmCalls, expected: ExpectedEgm | None) -> Iterator[Finding]:
    """Activation and motions of a guided path."""
    for item in calls.of("EGMACTPOSE"):
        where = _at(calls, item)
        if "maxspeeddeviation" not in item.switches:
            yield _finding(
                "speed-deviation", "error", where, "MaxSpeedDeviation is 1 deg/s then", "none",
                "\\MaxSpeedDeviation:= what the path needs", "The robot would not follow",
            )  # fmt: skip
        frames = [text.upper() for text in item.arguments if text.upper().startswith("EGM_FRAME")]
        if expected is not None and expected.in_part and frames != ["EGM_FRAME_WOBJ"] * 2:
            yield _finding(
                "frame", "error", where, "poses are in another frame", ", ".join(frames) or "none",
                "EGM_FRAME_WOBJ twice", 'Or set [egm] frame = "base"',
            )  # fmt: skip
    for item in calls.of("EGMRUNPOSE"):
        yield from _guided(item, _at(calls, item))


def _guided(item: Instruction, where: str) -> Iterator[Finding]:
    """EGMRunPose: all directions, with a timeout, to the pose itself, holding at its end."""
    free = [axis for axis in _AXES if axis not in item.switches]
    if free:
        yield _finding(
            "axes", "error", where, "not every direction is guided", "without " + ", ".join(free),
            "\\x\\y\\z\\rx\\ry\\rz",
        )  # fmt: skip
    if "nowaitcond" in item.switches:
        yield _finding(
            "no-wait", "error", where, "a timeout cannot be handled with NoWaitCond", "\\NoWaitCond", "without it"
        )
    if item.number("poscorrgain") == 0.0:
        yield _finding(
            "velocity", "error", where, "only the speed is followed: nothing brings the robot back",
            "\\PosCorrGain:=0", "\\PosCorrGain:=1",
        )  # fmt: skip
    if "EGM_STOP_HOLD" not in (text.upper() for text in item.arguments):
        yield _finding(
            "stop", "error", where, "at its end the robot would go back to where it began",
            ", ".join(item.arguments[1:2]) or "none", "EGM_STOP_HOLD",
        )  # fmt: skip
    standing = item.number("condtime")
    if standing is None or standing < SHORTEST_STANDING_S:
        yield _finding(
            "standing", "warning", where, "the movement may end while the robot waits for its path",
            "none" if standing is None else f"{standing:g} s", f"\\CondTime:= {SHORTEST_STANDING_S:g} s or more",
        )  # fmt: skip


def _fine(calls: EgmCalls) -> Iterator[Finding]:
    before: Instruction | None = None
    for item in calls.of(*_MOVES, "EGMRUNPOSE"):
        begins = item.name == "EGMRUNPOSE" or (
            item.name in _CORRECTED and (before is None or before.name not in _CORRECTED)
        )
        ends = before is not None and before.name in _CORRECTED and item.name not in _CORRECTED
        if before is not None and (begins or ends) and not _stops(before):
            yield _finding(
                "fine", "error", _at(calls, before), "a corrected movement begins and ends in a fine point",
                _zone(before), "fine",
            )  # fmt: skip
        before = item
    if before is not None and before.name in _CORRECTED and not _stops(before):
        yield _finding(
            "fine", "error", _at(calls, before), "a corrected movement ends in a fine point", _zone(before), "fine"
        )


def _zone(item: Instruction) -> str:
    return item.arguments[-2] if len(item.arguments) >= 2 else "none"


def _stops(item: Instruction) -> bool:
    return _zone(item).lower() == "fine"


def _handler(calls: EgmCalls) -> Iterator[Finding]:
    if not calls.of("EGMSETUPUC"):
        return
    handled = any("ERR_UDPUC_COMM" in " ".join(item.arguments).upper() for item in calls.of("IF", "ELSEIF"))
    if not calls.of("ERROR") or not handled:
        yield _finding(
            "handler", "error", calls.where, "nothing is done when the sensor computer falls silent",
            "no ERROR with ERR_UDPUC_COMM", "an error handler that ends the program",
        )  # fmt: skip
    if not calls.of("EGMRESET"):
        yield _finding("reset", "warning", calls.where, "EGM is never given back", "no EGMReset", "EGMReset at the end")


def _waits(calls: EgmCalls) -> Iterator[Finding]:
    """A corrected path begins and ends with a look at a condition, not after a time."""
    setup, moves = calls.of("EGMSETUPUC"), calls.of(*_CORRECTED)
    if not setup or not moves or "pathcorr" not in setup[0].switches:
        return
    place = {id(item): k for k, item in enumerate(calls.instructions)}
    first, last = place[id(moves[0])], place[id(moves[-1])]
    handler = min((place[id(item)] for item in calls.of("ERROR") if place[id(item)] > last), default=len(place))
    looks = [k for item in calls.of(*_LOOKS) if (k := place[id(item)]) < handler]
    if not any(place[id(setup[0])] < k < first for k in looks):
        yield _finding(
            "blind-wait", "warning", _at(calls, moves[0]),
            "the path begins without a look whether the loop is armed: it may run uncorrected",
            "no condition between EGMSetupUC and the path", "WaitUntil with MaxTime, or TPReadFK with MaxTime",
        )  # fmt: skip
    if not any(k > last for k in looks):
        yield _finding(
            "blind-wait", "warning", _at(calls, moves[-1]),
            "the path ends without a look whether the correction is gone", "no condition behind the path",
            "the distance of the tool from the last point, in WHILE or IF",
        )  # fmt: skip


def _halts(calls: EgmCalls) -> Iterator[Finding]:
    """Nobody is asked for anything while the path is corrected."""
    items = calls.instructions
    moves = [k for k, item in enumerate(items) if item.name in _CORRECTED]
    end = next((k for k, item in enumerate(items) if moves and k > moves[-1] and item.name == "EGMRESET"), len(items))
    for k, item in enumerate(items):
        if item.name == "STOP" and moves and moves[0] < k < end:
            yield _finding(
                "stop-corrected", "warning", _at(calls, item),
                "the program stops for a person before EGM is given back: the robot may move there", "Stop",
                "the correction at zero and EGMReset before Stop",
            )  # fmt: skip


_BY_ITSELF: Final = (_timeout, _fine, _handler, _waits, _halts)
_AGAINST_CELL: Final = (_mode, _rate, _guidance)
