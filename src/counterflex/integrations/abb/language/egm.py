"""ABB RAPID: EGM put around a program that ``compensate`` wrote: its path corrected, or streamed from outside."""

from __future__ import annotations

import re
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language import LIMITS
from counterflex.integrations.abb.language.egm_switching import EgmSwitching
from counterflex.programs.limits import RESERVED
from counterflex.programs.robot_writer.machine_functions import refuse_only_said, stop_under_correction

IDENTITY: Final = "cfId"
_PROC: Final = re.compile(r"\s*PROC\s+(\w+)\s*\(\s*\)\s*$", re.IGNORECASE)
_END: Final = re.compile(r"\s*ENDPROC\s*$", re.IGNORECASE)
_MODULE: Final = re.compile(r"\s*MODULE\s+(\w+)\s*$", re.IGNORECASE)
_END_OF_MODULE: Final = re.compile(r"\s*ENDMODULE\s*$", re.IGNORECASE)
_LINEAR: Final = re.compile(r"(\s*)MoveL\s+(.*),([^,]+),([^,]+),([^,;]+);\s*$", re.IGNORECASE)
_JOINT: Final = re.compile(r"\s*Move(AbsJ|J)\b", re.IGNORECASE)
_CALL: Final = re.compile(r"\s*([A-Za-z]\w*)\s*;\s*$")
_NO_CALLS: Final = frozenset(("stop", "exit", "return", "tperase"))
_TOOL: Final = re.compile(r"\s*(\w+)\s*\\\s*WObj\s*:=\s*(\w+)\s*$", re.IGNORECASE)
_STOP: Final = re.compile(r"\s*Stop\b", re.IGNORECASE)
_WAIT: Final = re.compile(r"\s*WaitTime\b", re.IGNORECASE)
_TAKEN: Final = re.compile(r"\bEGM\w*|\bcf(?:Id|Zero|Window|Turn|Key|Clock)\b|\bERROR\b", re.IGNORECASE)
_PART: Final = re.compile(r"_\d{3}$")
_CIRCLE: Final = re.compile(r"\s*MoveC\b", re.IGNORECASE)


def with_egm(text: str, switching: EgmSwitching, where: str, last: str | None = None) -> str:
    """The main module of a RAPID program with EGM around its path.

    Path correction: every MoveL behind the first becomes EGMMoveL, the last one ends in a fine point. Before the path
    the program waits until the loop is said to be armed, behind it until the tool is where the path ends without a
    correction; what takes too long ends the program. Position guidance: start posture and first point stay, the path
    between is taken out, because it comes from outside, once the loop is armed.

    Args:
        last: Last MoveL of the path where it stands in another module, see :func:`last_move`.

    Raises:
        ProgramError: It is no program of a start posture and MoveL, it uses EGM itself or another tool on its path, or
            guidance cannot keep an instruction within its path.
    """
    lines = text.splitlines()
    begin, end, module = _routine(lines, where)
    body = lines[begin + 1 : end]
    start = next((i for i, line in enumerate(body) if _JOINT.match(_code(line))), None)
    if start is None:
        raise ProgramError("the first motion is not MoveAbsJ", where=where, hint="Give what compensate wrote")
    head, path = body[: start + 1], body[start + 1 :]
    _check(path, begin + start + 3, where, _frames(body[start]))
    declared = [f"  VAR egmident {IDENTITY};"]
    if switching.mode == "path":
        first = next((i for i, line in enumerate(path) if _begins(line)), len(path))
        after = max((i + 1 for i, line in enumerate(path) if _begins(line)), default=len(path))
        _refuse_stops(path[first:after], begin + start + 3 + first, where)
        corrected = _corrected(path[first:after], where, master=True)
        finish = last_move(text, where) or last
        inside = [
            *_signal(switching, on=False),
            *[*head, *path[:first]],
            *_path_on(switching, body[start]),
            *corrected,
            *_path_off(switching, finish, where),
            *path[after:],
        ]
        declared += ["  VAR num cfKey;", "  VAR clock cfClock;"]
    else:
        inside = [*_signal(switching, on=False), *head, *_guided(path, switching, where)]
        declared += [
            "  CONST pose cfZero:=[[0,0,0],[1,0,0,0]];",
            f"  CONST egm_minmax cfWindow:=[-{switching.window_mm:g},{switching.window_mm:g}];",
            f"  CONST egm_minmax cfTurn:=[-{switching.window_deg:g},{switching.window_deg:g}];",
        ]
    out = [*lines[: module + 1], *declared, *lines[module + 1 : begin + 1], *inside, *_handler(), *lines[end:], ""]
    return "\n".join(out)


def last_move(text: str, where: str) -> str | None:
    """Line of the last MoveL of a RAPID text, without its comment; None where there is none."""
    lines = text.splitlines()
    begin, end, _ = _routine(lines, where)
    return next((_code(line) for line in reversed(lines[begin + 1 : end]) if _LINEAR.match(_code(line))), None)


def part_with_egm(text: str, where: str, *, first: bool, start: str = "") -> str:
    """A module that the main one calls, for path correction.

    Args:
        first: It holds the beginning of the path: its first MoveL stays as it is.
        start: Line of the main module that goes to the start posture: its tool and work object are those of the path.

    Raises:
        ProgramError: As :func:`with_egm`.
    """
    lines = text.splitlines()
    begin, end, _ = _routine(lines, where)
    _check(lines[begin + 1 : end], begin + 2, where, _frames(start) if start else None)
    _refuse_stops(lines[begin + 1 : end], begin + 2, where)
    corrected = _corrected(lines[begin + 1 : end], where, master=False, first=first)
    return "\n".join([*lines[: begin + 1], *corrected, "  ERROR", "    RAISE;", *lines[end:], ""])


def called(text: str, where: str) -> tuple[str, ...]:
    """Procedures that the main procedure of a RAPID text calls without arguments, in order, each once."""
    lines = text.splitlines()
    begin, end, _ = _routine(lines, where)
    return tuple(dict.fromkeys(name for line in lines[begin + 1 : end] if (name := _called(line))))


def _called(line: str) -> str:
    """Procedure that a line calls without arguments; empty for an instruction that looks like it (``Stop;``)."""
    match = _CALL.match(_code(line))
    return "" if match is None or match[1].lower() in _NO_CALLS else match[1]


def called_parts(text: str, where: str) -> tuple[str, ...]:
    """Those of them that are parts of a program that was split: their names end in a number of three digits."""
    return tuple(name for name in called(text, where) if _PART.search(name))


def start_move(text: str, where: str) -> str:
    """Line that goes to the start posture; empty where there is none."""
    lines = text.splitlines()
    begin, end, _ = _routine(lines, where)
    return next((line for line in lines[begin + 1 : end] if _JOINT.match(_code(line))), "")


def _routine(lines: list[str], where: str) -> tuple[int, int, int]:
    refuse_only_said(lines, "!", where)
    module = next((i for i, line in enumerate(lines) if _MODULE.match(_code(line))), None)
    begin = next((i for i, line in enumerate(lines) if _PROC.match(_code(line))), None)
    if module is None or begin is None:
        raise ProgramError("not a RAPID program: no MODULE with a PROC NAME()", where=where)
    end = next((i for i in range(begin + 1, len(lines)) if _END.match(_code(lines[i]))), None)
    if end is None:
        raise ProgramError("the program is cut off: no ENDPROC", where=where)
    if not any(_END_OF_MODULE.match(_code(line)) for line in lines[end:]):
        raise ProgramError("the program is cut off: no ENDMODULE", where=where)
    _check_names(lines, where)
    return begin, end, module


def _code(line: str) -> str:
    return line.split("!")[0].rstrip()


def _check_names(lines: list[str], where: str) -> None:
    """Refuse names of modules, procedures, tools and work objects that a controller does not load."""
    for number, line in enumerate(lines, start=1):
        code = _code(line)
        named = _PROC.match(code) or _MODULE.match(code)
        moves = _LINEAR.match(code) or _JOINT.match(code)
        names = (named[1],) if named else (_frames(line) or ()) if moves else ()
        for name in names:
            if len(name) > LIMITS.name_characters or name.upper() in RESERVED:
                raise ProgramError(
                    "RAPID cannot use this name", where=f"{where}:{number}", value=name,
                    limit=f"no word of the language, {LIMITS.name_characters} characters at most",
                )  # fmt: skip


def _frames(line: str) -> tuple[str, str] | None:
    """Tool and work object of a motion."""
    match = _TOOL.match(_code(line).rstrip(";").rsplit(",", 1)[-1])
    return (match[1], match[2]) if match else None


def _begins(line: str) -> bool:
    """Return whether the path begins here: a motion, or a part of it."""
    call = _CALL.match(_code(line))
    return bool(_LINEAR.match(_code(line)) or (call and _PART.search(call[1])))


def _check(path: list[str], number: int, where: str, frames: tuple[str, str] | None) -> None:
    for i, line in enumerate(map(_code, path)):
        at = f"{where}:{number + i}"
        if taken := _TAKEN.search(line):
            raise ProgramError("the program uses what EGM needs", where=at, value=taken[0], limit="free of EGM")
        if _JOINT.match(line) or _CIRCLE.match(line):
            raise ProgramError("a path of MoveL is needed", where=at, value=line.strip()[:40])
        other = _frames(line) if _LINEAR.match(line) else None
        if frames is not None and other is not None and other != frames:
            raise ProgramError(
                "the tool or the work object is changed on the path, under correction", where=at,
                value=f"{other[0]}, {other[1]}", limit=f"{frames[0]}, {frames[1]} from the start posture to the end",
                hint="Compensate the part of the program of each tool by itself, and make a program for each",
            )  # fmt: skip


def _refuse_stops(path: list[str], number: int, where: str) -> None:
    for i, line in enumerate(map(_code, path)):
        if _STOP.match(line):
            raise stop_under_correction(line, f"{where}:{number + i}", "Stop")


def _corrected(path: list[str], where: str, *, master: bool, first: bool = True) -> list[str]:
    """Lines with EGMMoveL in place of MoveL, but for the first of the path; ends in a fine point."""
    moves = [(i, match.groups()) for i, line in enumerate(path) if (match := _LINEAR.match(_code(line))) is not None]
    if not moves and not (master and any(_CALL.match(_code(line)) for line in path)):
        raise ProgramError("no path to correct: no MoveL", where=where)
    out, before = list(path), ""
    for k, (i, (space, target, speed, zone, tool)) in enumerate(moves):
        same, before = target == before, target
        if k == 0 and first:
            continue
        if same and k < len(moves) - 1:
            out[i] = ""  # a movement of no length has no path frame
            continue
        stops = k == len(moves) - 1 or not _LINEAR.match(_following(path, i))
        out[i] = f"{space}EGMMoveL {IDENTITY},{target},{speed},{'fine' if stops else zone.strip()},{tool};"
    return list(filter(None, out))


def _following(path: list[str], index: int) -> str:
    """Code of the next statement behind a line; empty where none comes."""
    return next((code for line in path[index + 1 :] if (code := _code(line)).strip()), "")


def _setup(switching: EgmSwitching, way: str) -> list[str]:
    return [
        f"    EGMReset {IDENTITY};",
        f"    EGMGetId {IDENTITY};",
        f'    EGMSetupUC ROB_1,{IDENTITY},"{switching.configuration}","{switching.device}"{way}'
        f"\\CommTimeout:={switching.timeout_s:g};",
    ]


def _signal(switching: EgmSwitching, *, on: bool) -> list[str]:
    """Signal for a safety PLC: 1 from before the path until the correction is back at zero."""
    name = switching.correction_signal
    return [f"    SetDO {name},{int(on)};"] if name else []


def _armed(switching: EgmSwitching) -> list[str]:
    """Waits until the loop is armed; not in time ends the program (by the error handler)."""
    if switching.armed_signal:
        return [f"    WaitUntil {switching.armed_signal}=1\\MaxTime:={switching.armed_s:g};"]
    return [
        '    TPReadFK cfKey,"counterflex run: is it armed?",stEmpty,stEmpty,stEmpty,"no","yes"'
        f"\\MaxTime:={switching.armed_s:g};",
        "    IF cfKey<>5 THEN",
        '      TPWrite "counterflex: the loop is not armed";',
        f"      EGMReset {IDENTITY};",
        "      EXIT;",
        "    ENDIF",
    ]


def _path_on(switching: EgmSwitching, start: str) -> list[str]:
    frames = _frames(start)
    frame = f"{frames[0]}.tframe" if frames else "tool0.tframe"
    return [
        '    TPWrite "start counterflex run --egm --arm, then press start";',
        "    Stop;",
        *_setup(switching, "\\PathCorr\\APTR"),
        f"    EGMActMove {IDENTITY},{frame}\\SampleRate:={switching.period_ms};",
        f"    EGMStreamStart {IDENTITY}\\SampleRate:={switching.period_ms};",
        *_armed(switching),
        *_signal(switching, on=True),
    ]


def _path_off(switching: EgmSwitching, last: str | None, where: str) -> list[str]:
    match = _LINEAR.match(last or "")
    tool = _TOOL.match(match[5]) if match else None
    if match is None or tool is None:
        raise ProgramError("the last motion of the path names no point, tool and work object", where=where, value=last)
    away = f"Distance(CPos(\\Tool:={tool[1]}\\WObj:={tool[2]}),{_position(match[2], where)})>{switching.zero_mm:g}"
    return [
        "    ! the correction returns to zero; the remainder is removed slowly, and checked",
        "    ClkReset cfClock;",
        "    ClkStart cfClock;",
        f"    WHILE {away} AND ClkRead(cfClock)<{switching.zero_s:g} DO",
        "      WaitTime 0.05;",
        "    ENDWHILE",
        f"    EGMReset {IDENTITY};",
        f"    MoveL {match[2]},[5,5,5,5],fine,{match[5]};",
        f"    IF {away} THEN",
        '      TPWrite "counterflex: the correction is not back at zero";',
        "      EXIT;",
        "    ENDIF",
        *_signal(switching, on=False),
    ]


def _guided(path: list[str], switching: EgmSwitching, where: str) -> list[str]:
    if any(_called(line) for line in path):
        raise ProgramError(
            "the program is split, its path lies in other modules",
            where=where,
            hint='Guidance needs the program in one module; or set [egm] mode = "path"',
        )
    moves = [i for i, line in enumerate(path) if _LINEAR.match(_code(line))]
    if len(moves) < 2:
        raise ProgramError("no path for guidance: fewer than two MoveL", where=where, value=len(moves))
    for line in path[moves[0] + 1 : moves[-1]]:
        code = _code(line).strip()
        if code and not _LINEAR.match(_code(line)) and not _WAIT.match(code):
            raise ProgramError(
                "guidance runs the path in one go, and an instruction stands within", where=where, value=code[:60],
                hint='Switch the spindle before the program, or set [egm] mode = "path"',
            )  # fmt: skip
    first, last = (_LINEAR.match(_code(path[i])) for i in (moves[0], moves[-1]))
    if first is None or last is None:
        raise ProgramError("not a MoveL", where=where)
    tool = _TOOL.match(first[5])
    if tool is None:
        raise ProgramError("a motion names no tool and work object", where=where, value=first[5].strip())
    name, frame = tool.groups()
    minmax = "\\x:=cfWindow\\y:=cfWindow\\z:=cfWindow\\rx:=cfTurn\\ry:=cfTurn\\rz:=cfTurn"
    return [
        *path[: moves[0]],
        f"    MoveL {first[2]},{first[3]},fine,{first[5]};",
        '    TPWrite "start counterflex run --egm --arm, then press start";',
        "    Stop;",
        *_setup(switching, "\\Pose"),
        f"    EGMActPose {IDENTITY}\\StreamStart\\Tool:={name}\\WObj:={frame},cfZero,EGM_FRAME_WOBJ,cfZero,"
        f"EGM_FRAME_WOBJ{minmax}\\LpFilter:={switching.low_pass_hz:g}\\SampleRate:={switching.period_ms}"
        f"\\MaxSpeedDeviation:={switching.speed_deviation_deg_s:g};",
        *_signal(switching, on=True),
        "    ! the path comes from counterflex once it is armed; ends when the tool has stood still for CondTime",
        f"    EGMRunPose {IDENTITY},EGM_STOP_HOLD\\x\\y\\z\\rx\\ry\\rz\\CondTime:={switching.standing_s:g}"
        f"\\RampInTime:={switching.ramp_in_s:g}\\PosCorrGain:=1;",
        f"    EGMReset {IDENTITY};",
        f"    IF Distance(CPos(\\Tool:={name}\\WObj:={frame}),{_position(last[2], where)})>{switching.end_mm:g} THEN",
        '      TPWrite "counterflex: the guided movement ended before the end of the path";',
        "      EXIT;",
        "    ENDIF",
        f"    MoveL {last[2]},[5,5,5,5],fine,{last[5]};",
        *_signal(switching, on=False),
        *path[moves[-1] + 1 :],
    ]


def _position(target: str, where: str) -> str:
    match = re.match(r"\s*\[\s*(\[[^\]]*\])", target)
    if match is None:
        raise ProgramError("the last point is not written out", where=where, value=target.strip()[:40])
    return match[1]


def _handler() -> list[str]:
    return [
        "  ERROR",
        "    IF ERRNO=ERR_UDPUC_COMM THEN",
        "      ! no way on: begin anew, with the tool clear of the part",
        '      TPWrite "counterflex: nothing came from the sensor computer";',
        f"      EGMReset {IDENTITY};",
        "      EXIT;",
        "    ENDIF",
        "    IF ERRNO=ERR_WAIT_MAXTIME OR ERRNO=ERR_TP_MAXTIME THEN",
        '      TPWrite "counterflex: something that the program waits for did not come in time";',
        f"      EGMReset {IDENTITY};",
        "      EXIT;",
        "    ENDIF",
        "    RAISE;",
    ]
