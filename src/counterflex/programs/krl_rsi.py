"""KUKA KRL: sensor correction switched on around the path of a program, and a program that only tries the link."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import InputError, ProgramError
from counterflex.programs.job_mark import job_number, marks
from counterflex.programs.limits import KRL, check_name

_ROUTINE: Final = re.compile(r"\s*(?:GLOBAL\s+)?DEF\s+(\w+)\s*\(\s*\)\s*$", re.IGNORECASE)
_END: Final = re.compile(r"\s*END\s*$", re.IGNORECASE)
_POINT_TO_POINT: Final = re.compile(r"\s*S?PTP(_REL)?\b", re.IGNORECASE)
_PATH: Final = re.compile(r"\s*(LIN|CIRC)(_REL)?\b", re.IGNORECASE)
_CALL: Final = re.compile(r"\s*(\w+)\s*\(\s*\)\s*$")
_SPLINE: Final = re.compile(r"\s*(SLIN|SCIRC|SPL|SPLINE)\b", re.IGNORECASE)
_SENSOR: Final = re.compile(r"\bRSI_\w+\s*\(", re.IGNORECASE)
_INTERRUPT: Final = 21
_TAKEN: Final = re.compile(
    rf"\bINTERRUPT\s+DECL\s+{_INTERRUPT}\b|\$SEN_PREA\b|\bcf(?:r|id)\b|\bCF_(?:CHECK|HOLD)\b", re.IGNORECASE
)


@dataclass(frozen=True)
class RsiSwitching:
    """How correction is switched on and off.

    Attributes:
        context: Name that RSI_CREATE takes: ``counterflex.rsi``.
        parameters: Object, parameter and value for RSI_SETPUBLICPAR, in mm and deg.
        cycle_ms: 4 (#IPO_FAST) or 12 (#IPO).
        enable_index: $SEN_PREA that says that the correction may act.
        feed_hold_index: $SEN_PREA through which the sensor asks for a feed hold.
        ramp_s: Time that ramping out takes at most.
    """

    context: str
    parameters: tuple[tuple[str, str, float], ...]
    cycle_ms: int
    enable_index: int
    feed_hold_index: int
    ramp_s: float


def with_correction(text: str, switching: RsiSwitching, where: str) -> str:
    """The main file of a KRL program with sensor correction from its start position to its end.

    RSI is created behind the last PTP before the first path motion or call, and deleted before END. Where the program
    carries the mark of a job, it says its number by what it sets the enabling variable to
    (:func:`counterflex.programs.job_mark.job_number`).

    Args:
        text: Of the ``.src`` file.
        switching: See there.
        where: Its name, for messages.

    Returns:
        The text, line ends as in the source.

    Raises:
        ProgramError: It is no program of a start position and a path of LIN and CIRC, or it switches RSI itself.
    """
    end_of_line = "\r\n" if "\r\n" in text else "\n"
    lines = text.splitlines()
    begin = next((i for i, line in enumerate(lines) if _ROUTINE.match(_code(line))), None)
    if begin is None:
        raise ProgramError("not a KRL program: no DEF NAME( )", where=where)
    end = next((i for i in range(begin + 1, len(lines)) if _END.match(_code(lines[i]))), None)
    if end is None:
        raise ProgramError("the program is cut off: no END", where=where)
    body = range(begin + 1, end)
    check_path(lines, where, first_only=True)
    path = next((i for i in body if _PATH.match(_code(lines[i])) or _CALL.match(_code(lines[i]))), None)
    starts = [i for i in body if _POINT_TO_POINT.match(_code(lines[i]))]
    if path is None:
        raise ProgramError("there is no path to correct: neither LIN, CIRC nor a call", where=where)
    if not starts or starts[0] > path:
        raise ProgramError(
            "the first motion is not PTP", where=f"{where}:{path + 1}", hint="Begin with PTP to a start position"
        )
    late = next((i for i in starts if i > path), None)
    if late is not None:
        raise _no_ptp(where, late)
    out = [
        *lines[: begin + 1],
        "DECL INT cfr",
        "DECL INT cfid",
        *lines[begin + 1 : starts[-1] + 1],
        *_on(switching, _says(text)),
        *lines[starts[-1] + 1 : end],
        *_off(switching),
        *lines[end:],
        *_routines(switching),
    ]
    return end_of_line.join([*out, ""])


def called(text: str) -> tuple[str, ...]:
    """Names of the routines that the main routine of a KRL text calls without arguments, in order, each once."""
    found: dict[str, None] = {}
    inside = False
    for line in map(_code, text.splitlines()):
        if not inside:
            inside = bool(_ROUTINE.match(line))
        elif _END.match(line):
            break
        elif match := _CALL.match(line):
            found[match[1]] = None
    return tuple(found)


def check_path(lines: Sequence[str], where: str, *, first_only: bool = False) -> None:
    """Check that a file holds nothing that may not run under correction.

    Args:
        lines: Of the file.
        where: Its name, for messages.
        first_only: It is the main file: PTP is judged elsewhere.

    Raises:
        ProgramError: PTP, a spline motion, a call of RSI, a name or an interrupt that the correction uses.
    """
    for i, line in enumerate(map(_code, lines)):
        if not first_only and _POINT_TO_POINT.match(line):
            raise _no_ptp(where, i)
        if _SPLINE.match(line):
            raise ProgramError(
                "nothing is known of corrections on spline motions",
                where=f"{where}:{i + 1}",
                value=line.split()[0],
                limit="LIN or CIRC",
            )
        if _SENSOR.search(line):
            raise ProgramError(
                "the program switches RSI itself",
                where=f"{where}:{i + 1}",
                value=line.strip(),
                hint="Give the program as compensate wrote it",
            )
        if taken := _TAKEN.search(line):
            raise ProgramError(
                "the program uses what the correction needs",
                where=f"{where}:{i + 1}",
                value=taken[0],
                limit=f"interrupt {_INTERRUPT}, $SEN_PREA, cfr, cfid, CF_CHECK and CF_HOLD free",
            )


def link_test(name: str, switching: RsiSwitching, *, tool: int, base: int, seconds: int = 60) -> str:
    """A program that stands still with RSI on, for watching the link: correction is never enabled.

    Args:
        name: Of the program.
        switching: See there.
        tool: Number of TOOL_DATA.
        base: Number of BASE_DATA.
        seconds: How long it stands.

    Raises:
        InputError: The name or the time cannot be used.
    """
    check_name(name, KRL, "KRL")
    if not 1 <= seconds <= 3600:
        raise InputError("time of the link test", value=seconds, limit="1 .. 3600 s")
    enable = f"$SEN_PREA[{switching.enable_index}]"
    on = [line for line in _on(switching, 1.0) if not line.startswith(f"{enable}=1")]
    body = [
        "; stands still with RSI on: try the link, correction is not enabled",
        "DECL INT cfr",
        "DECL INT cfid",
        "BAS(#INITMOV,0)",
        f"$TOOL=TOOL_DATA[{tool}]",
        f"$BASE=BASE_DATA[{base}]",
        "PTP $AXIS_ACT_MEAS",
        *on,
        f"WAIT SEC {seconds}.0",
        *_off(switching),
    ]
    lines = ["&ACCESS RVP", "&REL 1", f"DEF {name}( )", *body, "END", *_routines(switching), ""]
    return "\n".join(lines)


def _code(line: str) -> str:
    return line.split(";")[0].rstrip()


def _no_ptp(where: str, index: int) -> ProgramError:
    return ProgramError(
        "corrections are superposed on LIN and CIRC only",
        where=f"{where}:{index + 1}",
        value="PTP behind the first path motion",
        hint="Split the program there",
    )


def _says(text: str) -> float:
    """What Enable is set to: the number of the job that a compensated program carries, else 1."""
    jobs = marks(text)
    return float(job_number(jobs[0])) if len(jobs) == 1 else 1.0


def _on(switching: RsiSwitching, says: float) -> list[str]:
    rate = "#IPO" if switching.cycle_ms == 12 else "#IPO_FAST"
    hold, enable = f"$SEN_PREA[{switching.feed_hold_index}]", f"$SEN_PREA[{switching.enable_index}]"
    lines = [
        "; sensor correction on",
        f"{hold}=0.0",
        f"{enable}=0.0",
        f'cfr=RSI_CREATE("{switching.context}",cfid,TRUE)',
        "CF_CHECK(cfr)",
    ]
    for item, parameter, value in switching.parameters:
        lines += [f'cfr=RSI_SETPUBLICPAR(cfid,"{item}","{parameter}",{value:.3f})', "CF_CHECK(cfr)"]
    return [
        *lines,
        "HALT ; start counterflex run, then press start",
        f"cfr=RSI_ON(#ABSOLUTE,{rate})",
        "CF_CHECK(cfr)",
        f"INTERRUPT DECL {_INTERRUPT} WHEN {hold}>0.5 DO CF_HOLD( )",
        f"INTERRUPT ON {_INTERRUPT}",
        f"{enable}={says:.1f}",
    ]


def _off(switching: RsiSwitching) -> list[str]:
    return [
        "; sensor correction off: let it ramp out first",
        "WAIT SEC 0",
        f"$SEN_PREA[{switching.enable_index}]=0.0",
        f"WAIT SEC {switching.ramp_s:.1f}",
        f"INTERRUPT OFF {_INTERRUPT}",
        "cfr=RSI_OFF()",
        "CF_CHECK(cfr)",
        "cfr=RSI_DELETE(cfid)",
        "CF_CHECK(cfr)",
    ]


def _routines(switching: RsiSwitching) -> list[str]:
    return [
        "",
        "DEF CF_CHECK(cfresult:IN)",
        "; no way past a call of RSI that failed: reset the program",
        "DECL INT cfresult",
        "IF cfresult<>RSIOK THEN",
        "LOOP",
        "HALT",
        "ENDLOOP",
        "ENDIF",
        "END",
        "",
        "DEF CF_HOLD( )",
        "; the sensor asks for a feed hold: stand on the path until it takes that back",
        "BRAKE",
        f"WAIT FOR $SEN_PREA[{switching.feed_hold_index}]<0.5",
        "END",
    ]
