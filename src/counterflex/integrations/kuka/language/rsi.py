"""KUKA KRL: sensor correction switched on around the path of a program, and a program that only tries the link."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Final

from counterflex.core.errors import InputError, ProgramError
from counterflex.integrations.kuka.language import LIMITS, rsi_switching
from counterflex.programs.compensated import job_number, marks
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.machine_functions import refuse_only_said, stop_under_correction

_ROUTINE: Final = re.compile(r"\s*(?:GLOBAL\s+)?DEF\s+(\w+)\s*\(\s*\)\s*$", re.IGNORECASE)


_END: Final = re.compile(r"\s*END\s*$", re.IGNORECASE)


_POINT_TO_POINT: Final = re.compile(r"\s*S?PTP(_REL)?\b", re.IGNORECASE)


_PATH: Final = re.compile(r"\s*(LIN|CIRC)(_REL)?\b", re.IGNORECASE)


_CALL: Final = re.compile(r"\s*(\w+)\s*\(\s*\)\s*$")


_PART: Final = re.compile(r"_\d{3}$")


_HALT: Final = re.compile(r"\s*HALT\s*$", re.IGNORECASE)


_SPLINE: Final = re.compile(r"\s*(SLIN|SCIRC|SPL|SPLINE)\b", re.IGNORECASE)


_SENSOR: Final = re.compile(r"\bRSI_\w+\s*\(", re.IGNORECASE)


_TAKEN: Final = re.compile(
    rf"\bINTERRUPT\s+DECL\s+{rsi_switching._INTERRUPT}\b|\$SEN_PREA\b|\bcf(?:r|id)\b|\bCF_(?:CHECK|HOLD|ZERO)\b",
    re.IGNORECASE,
)


_DECLARATION: Final = re.compile(
    r"\s*(?:GLOBAL\s+)?(?:DECL|EXT|EXTFCT|SIGNAL|STRUC|ENUM|INT|REAL|BOOL|CHAR|FRAME|POS|E6POS|AXIS|E6AXIS)\b",
    re.IGNORECASE,
)


_INITIALISED: Final = re.compile(r"\bBAS\s*\(\s*#INITMOV\b", re.IGNORECASE)


_TOOL: Final = re.compile(r"\s*\$(?:TOOL|BASE|IPO_MODE)\s*=", re.IGNORECASE)


_OPENS: Final = re.compile(r"\s*(?:IF\b.*\bTHEN|LOOP|FOR|WHILE|REPEAT|SWITCH)\b", re.IGNORECASE)


_CLOSES: Final = re.compile(r"\s*(?:ENDIF|ENDLOOP|ENDFOR|ENDWHILE|UNTIL|ENDSWITCH)\b", re.IGNORECASE)


_LEAVES: Final = re.compile(r"\s*(?:GOTO|RETURN|EXIT)\b", re.IGNORECASE)


def with_correction(text: str, switching: rsi_switching.RsiSwitching, where: str, parts: Collection[str] = ()) -> str:
    """The main file of a KRL program with sensor correction along its path.

    RSI is created directly before the first path motion or part of the path behind the last PTP, and deleted directly
    behind the last one. What comes between start position and path and behind it (spindle, coolant, a person who stops
    the spindle) is done without it: nobody is asked for anything while the correction acts. The correction is
    enabled when the loop says that it is armed, and switched off when the controller itself says that it has gone back
    to zero; where that takes too long the program stops and cannot be led past. Where the program carries the mark of
    a job, it says its number by what it sets the enabling variable to
    (:func:`counterflex.programs.compensated.job_number`). Where it does not initialise its motion itself
    (``BAS(#INITMOV,0)``, interrupt 3), it is made to.

    Args:
        text: Of the ``.src`` file.
        parts: Routines that hold parts of the path; names that end in a number of three digits do too. Where neither
            motions nor such parts are there, every call without arguments does.

    Returns:
        The text, line ends as in the source.

    Raises:
        ProgramError: It is no program of a start position and a path of LIN and CIRC, it switches RSI itself, or it
            changes the tool or stops for a person on its path.
    """
    lines = text.splitlines()
    begin, end = _routine(lines, where)
    check_path(lines, where, first_only=True, output=switching.output)
    start, path, after = _found_path(lines, where, range(begin + 1, end), parts)
    _refuse_on_path(lines, where, range(path, end), after)
    _straight(lines, where, begin + 1, path, after)
    first = begin + 1
    while first < start and (not _code(lines[first]).strip() or _DECLARATION.match(lines[first])):
        first += 1
    initialised = any(_INITIALISED.search(_code(lines[i])) for i in range(begin + 1, start))
    out = [
        *lines[: begin + 1],
        *rsi_switching._DECLARED,
        *lines[begin + 1 : first],
        *([] if initialised else rsi_switching._INI),
        *switching.output_of(on=False),
        *lines[first:path],
        *switching.on_lines(),
        *switching.enable_lines(_says(text)),
        *lines[path:after],
        *switching.off_lines(),
        *lines[after:],
        *switching.routine_lines(),
    ]
    return ("\r\n" if "\r\n" in text else "\n").join([*out, ""])


def _routine(lines: list[str], where: str) -> tuple[int, int]:
    """Lines of the first DEF and of its END."""
    begin = _first(lines, _ROUTINE, range(len(lines)))
    if begin is None:
        raise ProgramError("not a KRL program: no DEF NAME( )", where=where)
    end = _first(lines, _END, range(begin + 1, len(lines)))
    if end is None:
        raise ProgramError("the program is cut off: no END", where=where)
    return begin, end


def _found_path(lines: list[str], where: str, body: range, parts: Collection[str]) -> tuple[int, int, int]:
    """Lines of the start position and of the first motion of the path, and the line behind its last one."""
    start = _first(lines, _POINT_TO_POINT, body)
    early = _first(lines, _PATH, body if start is None else range(body.start, start))
    if early is not None:
        raise ProgramError(
            "the first motion is not PTP", where=f"{where}:{early + 1}", hint="Begin with PTP to a start position"
        )
    # Calls before the start position change the tool.
    behind = range(0) if start is None else range(start + 1, body.stop)
    moves = [i for i in behind if _moves(_code(lines[i]), parts)] or [i for i in behind if _CALL.match(_code(lines[i]))]
    if start is None or not moves:
        raise ProgramError(
            "no path to correct: neither LIN, CIRC nor a call after a PTP to a start position", where=where
        )
    return start, moves[0], moves[-1] + 1


def _refuse_on_path(lines: list[str], where: str, behind: range, after: int) -> None:
    """Refuse a PTP, a change of tool and a stop for a person from the first motion of the path on."""
    late, changed = (_first(lines, form, behind[1:]) for form in (_POINT_TO_POINT, _TOOL))
    if late is not None:
        raise _no_ptp(where, late)
    if changed is not None:
        raise _one_tool(where, changed, lines[changed])
    halt = _first(lines, _HALT, range(behind.start, after))
    if halt is not None:
        raise stop_under_correction(lines[halt], f"{where}:{halt + 1}", "HALT")


def _first(lines: list[str], form: re.Pattern[str], among: range) -> int | None:
    """First line of a form."""
    return next((i for i in among if form.match(_code(lines[i]))), None)


def check_main(text: str, name: str, where: str) -> None:
    """Check that a controller loads a program: its file has the name of its main routine, and a name that KRL takes.

    Raises:
        ProgramError: They differ.
        InputError: The name is too long or holds other characters than letters, digits and underscores.
    """
    check_name(name, LIMITS, "KRL")
    routine = next((match[1] for line in text.splitlines() if (match := _ROUTINE.match(_code(line)))), None)
    if routine is not None and routine.lower() != name.lower():
        raise ProgramError(
            "the file does not have the name of its main routine: the controller does not load it", where=where,
            value=f"DEF {routine}( )", limit=f"DEF {name}( )", hint="Rename the file back to what compensate wrote",
        )  # fmt: skip


def called(text: str) -> tuple[str, ...]:
    """Names of the routines that the main routine of a KRL text calls without arguments, in order, each once."""
    results: dict[str, None] = {}
    inside = False
    for line in map(_code, text.splitlines()):
        if not inside:
            inside = bool(_ROUTINE.match(line))
        elif _END.match(line):
            break
        elif match := _CALL.match(line):
            results[match[1]] = None
    return tuple(results)


def _straight(lines: Sequence[str], where: str, begin: int, path: int, after: int) -> None:
    """Check that whoever enters the path leaves it at its end: what switches the correction off is always reached."""
    depth: list[int] = []
    for i in range(begin, after):
        line = _code(lines[i])
        if i == path and depth:
            raise _not_straight(where, depth[-1], lines[depth[-1]])
        if _OPENS.match(line):
            depth.append(i)
        elif _CLOSES.match(line) and depth:
            depth.pop()
        elif i >= path and _LEAVES.match(line):
            raise _not_straight(where, i, lines[i])
    if depth:
        raise _not_straight(where, depth[-1], lines[depth[-1]])


def _not_straight(where: str, index: int, line: str) -> ProgramError:
    return ProgramError(
        "the path is entered or left under a condition: the correction would not always be switched off behind it",
        where=f"{where}:{index + 1}", value=line.strip()[:60],
        limit="a path without branches, loops around it, GOTO, RETURN and EXIT",
        hint="Give the program as compensate wrote it",
    )  # fmt: skip


def check_path(lines: Sequence[str], where: str, *, first_only: bool = False, output: int | None = None) -> None:
    """Check that a file holds nothing that may not run under correction.

    Args:
        first_only: It is the main file: PTP, tools and stops are judged elsewhere.
        output: Number of $OUT that says whether the correction may act: nobody else may set it.

    Raises:
        ProgramError: PTP, a spline motion, another tool, a stop for a person, a call of RSI, a name or an interrupt
            that the correction uses, a spindle that is started by a comment.
    """
    refuse_only_said(lines, ";", where)
    for i, line in enumerate(map(_code, lines)):
        if not first_only and _POINT_TO_POINT.match(line):
            raise _no_ptp(where, i)
        if not first_only and _TOOL.match(line):
            raise _one_tool(where, i, line)
        if not first_only and _HALT.match(line):
            raise stop_under_correction(lines[i], f"{where}:{i + 1}", "HALT")
        if _SPLINE.match(line):
            raise ProgramError(
                "nothing is known of corrections on spline motions", where=f"{where}:{i + 1}", value=line.split()[0],
                limit="LIN or CIRC",
            )  # fmt: skip
        if _SENSOR.search(line):
            raise ProgramError(
                "the program switches RSI itself", where=f"{where}:{i + 1}", value=line.strip(),
                hint="Give the program as compensate wrote it",
            )  # fmt: skip
        if output is not None and re.search(rf"\$OUT\s*\[\s*0*{output}\s*\]", line, re.IGNORECASE):
            raise ProgramError(
                "the program uses the output that shows a safety PLC whether the correction may act",
                where=f"{where}:{i + 1}", value=line.strip()[:60], limit=f"$OUT[{output}] free",
                hint="Give controller.correction_output of the cell file another number",
            )  # fmt: skip
        if taken := _TAKEN.search(line):
            raise ProgramError(
                "the program uses what the correction needs", where=f"{where}:{i + 1}", value=taken[0],
                limit=f"interrupt {rsi_switching._INTERRUPT}, $SEN_PREA, cfr, cfid, CF_CHECK, CF_HOLD and CF_ZERO free",
            )  # fmt: skip


def link_test(name: str, switching: rsi_switching.RsiSwitching, *, tool: int, base: int, seconds: int = 60) -> str:
    """A program that stands still with RSI on, for watching the link: correction is never enabled.

    Raises:
        InputError: The name or the time cannot be used.
    """
    check_name(name, LIMITS, "KRL")
    if not 1 <= seconds <= 3600:
        raise InputError("time of the link test", value=seconds, limit="1 .. 3600 s")
    body = [
        "; stands still with RSI on: try the link, correction is not enabled",
        *rsi_switching._DECLARED,
        *rsi_switching._INI,
        *switching.output_of(on=False),
        f"$TOOL=TOOL_DATA[{tool}]",
        f"$BASE=BASE_DATA[{base}]",
        "PTP $AXIS_ACT_MEAS",
        *switching.on_lines(),
        f"WAIT SEC {seconds}.0",
        *switching.off_lines(),
    ]
    lines = ["&ACCESS RVP", "&REL 1", f"DEF {name}( )", *body, "END", *switching.routine_lines(), ""]
    return "\n".join(lines)


def _code(line: str) -> str:
    return line.split(";")[0].rstrip()


def _no_ptp(where: str, index: int) -> ProgramError:
    return ProgramError(
        "corrections are superposed on LIN and CIRC only", where=f"{where}:{index + 1}",
        value="PTP after the first path motion", hint="Split the program there",
    )  # fmt: skip


def _moves(line: str, parts: Collection[str]) -> bool:
    call = _CALL.match(line)
    return bool(_PATH.match(line) or (call and (call[1] in parts or _PART.search(call[1]))))


def _one_tool(where: str, index: int, line: str) -> ProgramError:
    return ProgramError(
        f"the {'tool' if '$TOOL' in line.upper() else 'frame'} is changed on the path, under correction",
        where=f"{where}:{index + 1}", value=line.strip(),
        limit="one tool and one base from the start position to the end",
        hint="Compensate the part of the program of each tool by itself, and make a set-up for each",
    )  # fmt: skip


def _says(text: str) -> float:
    """Value of Enable: the number of the job that a compensated program carries, else 1."""
    jobs = marks(text)
    return float(job_number(jobs[0])) if len(jobs) == 1 else 1.0
