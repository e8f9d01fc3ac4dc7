"""ABB RAPID: EGM put around a program that ``compensate`` wrote: its path corrected, or streamed from outside."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError, ProgramError

IDENTITY: Final = "cfId"
_PROC: Final = re.compile(r"\s*PROC\s+(\w+)\s*\(\s*\)\s*$", re.IGNORECASE)
_END: Final = re.compile(r"\s*ENDPROC\s*$", re.IGNORECASE)
_MODULE: Final = re.compile(r"\s*MODULE\s+\w+\s*$", re.IGNORECASE)
_LINEAR: Final = re.compile(r"(\s*)MoveL\s+(.*),([^,]+),([^,]+),([^,;]+);\s*$", re.IGNORECASE)
_JOINT: Final = re.compile(r"\s*Move(AbsJ|J)\b", re.IGNORECASE)
_CALL: Final = re.compile(r"\s*([A-Za-z]\w*)\s*;\s*$")
_TOOL: Final = re.compile(r"\s*(\w+)\s*\\\s*WObj\s*:=\s*(\w+)\s*$", re.IGNORECASE)
_WAIT: Final = re.compile(r"\s*WaitTime\b", re.IGNORECASE)
_TAKEN: Final = re.compile(r"\bEGM\w*|\bcf(?:Id|Zero|Window|Turn)\b|\bERROR\b", re.IGNORECASE)
_CIRCLE: Final = re.compile(r"\s*MoveC\b", re.IGNORECASE)


@dataclass(frozen=True)
class EgmSwitching:
    """What the RAPID program says to EGM.

    Attributes:
        mode: ``path`` or ``pose``.
        device: UDP Unicast Device.
        configuration: External Motion Interface Data.
        period_ms: SampleRate.
        timeout_s: CommTimeout.
        settle_s: Rest in which the loop settles and is armed.
        ramp_s: Time that ramping out takes at most.
        low_pass_hz: LpFilter; guidance only, as what follows.
        speed_deviation_deg_s: MaxSpeedDeviation.
        ramp_in_s: RampInTime.
        window_mm: egm_minmax of x, y, z, both ways.
        window_deg: Of rx, ry, rz.
        standing_s: CondTime.
        end_mm: Distance from the end of the path within which the movement may have ended.
    """

    mode: str
    device: str
    configuration: str
    period_ms: int
    timeout_s: float
    settle_s: float = 5.0
    ramp_s: float = 1.5
    low_pass_hz: float = 20.0
    speed_deviation_deg_s: float = 20.0
    ramp_in_s: float = 0.1
    window_mm: float = 0.05
    window_deg: float = 0.05
    standing_s: float = 30.0
    end_mm: float = 1.0

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            InputError: A value that is dangerous or that EGM does not take.
        """
        if self.mode not in ("path", "pose"):
            raise InputError("mode of EGM", value=self.mode, limit="path or pose")
        if not 0.0 < self.timeout_s <= 0.1:
            raise InputError(
                "CommTimeout of EGM",
                value=f"{self.timeout_s:g} s",
                limit="> 0 and <= 0.1 s",
                hint="While nothing comes the robot goes on with the last value it was sent",
            )
        for name in ("settle_s", "ramp_s", "speed_deviation_deg_s", "window_mm", "window_deg", "standing_s", "end_mm"):
            as_positive(name, getattr(self, name))


def with_egm(text: str, switching: EgmSwitching, where: str) -> str:
    """The main module of a RAPID program with EGM around its path.

    Path correction: every MoveL behind the first becomes EGMMoveL, the last one ends in a fine point. Position
    guidance: start posture and first point stay, the path between is taken out, because it comes from outside.

    Args:
        text: Of the module.
        switching: See there.
        where: Its name, for messages.

    Returns:
        The text.

    Raises:
        ProgramError: It is no program of a start posture and MoveL, or it uses EGM itself, or guidance cannot keep an
            instruction within its path.
    """
    lines = text.splitlines()
    begin, end, module = _routine(lines, where)
    body = lines[begin + 1 : end]
    start = next((i for i, line in enumerate(body) if _JOINT.match(_code(line))), None)
    if start is None:
        raise ProgramError("the first motion is not MoveAbsJ", where=where, hint="Give what compensate wrote")
    head, path = body[: start + 1], body[start + 1 :]
    _check(path, begin + start + 2, where)
    if switching.mode == "path":
        corrected = _corrected(path, where, master=True)
        inside = [*head, *_path_on(switching, body[start]), *corrected, *_path_off(switching)]
        declared = [f"  VAR egmident {IDENTITY};"]
    else:
        inside = [*head, *_guided(path, switching, where)]
        declared = [
            f"  VAR egmident {IDENTITY};",
            "  CONST pose cfZero:=[[0,0,0],[1,0,0,0]];",
            f"  CONST egm_minmax cfWindow:=[-{switching.window_mm:g},{switching.window_mm:g}];",
            f"  CONST egm_minmax cfTurn:=[-{switching.window_deg:g},{switching.window_deg:g}];",
        ]
    out = [*lines[: module + 1], *declared, *lines[module + 1 : begin + 1], *inside, *_handler(), *lines[end:], ""]
    return "\n".join(out)


def part_with_egm(text: str, where: str, *, first: bool) -> str:
    """A module that the main one calls, for path correction.

    Args:
        text: Of the module.
        where: Its name, for messages.
        first: It holds the beginning of the path: its first MoveL stays as it is.

    Raises:
        ProgramError: As :func:`with_egm`.
    """
    lines = text.splitlines()
    begin, end, _ = _routine(lines, where)
    _check(lines[begin + 1 : end], begin + 2, where)
    corrected = _corrected(lines[begin + 1 : end], where, master=False, first=first)
    return "\n".join([*lines[: begin + 1], *corrected, "  ERROR", "    RAISE;", *lines[end:], ""])


def called_parts(text: str, where: str) -> tuple[str, ...]:
    """Procedures that the main procedure of a RAPID text calls without arguments, in order."""
    lines = text.splitlines()
    begin, end, _ = _routine(lines, where)
    found = (_CALL.match(_code(line)) for line in lines[begin + 1 : end])
    return tuple(match[1] for match in found if match and match[1].lower() not in ("stop", "exit", "return"))


def _routine(lines: list[str], where: str) -> tuple[int, int, int]:
    module = next((i for i, line in enumerate(lines) if _MODULE.match(_code(line))), None)
    begin = next((i for i, line in enumerate(lines) if _PROC.match(_code(line))), None)
    if module is None or begin is None:
        raise ProgramError("not a RAPID program: no MODULE with a PROC NAME()", where=where)
    end = next((i for i in range(begin + 1, len(lines)) if _END.match(_code(lines[i]))), None)
    if end is None:
        raise ProgramError("the program is cut off: no ENDPROC", where=where)
    return begin, end, module


def _code(line: str) -> str:
    return line.split("!")[0].rstrip()


def _check(path: list[str], number: int, where: str) -> None:
    for i, line in enumerate(map(_code, path)):
        at = f"{where}:{number + i}"
        if taken := _TAKEN.search(line):
            raise ProgramError("the program uses what EGM needs", where=at, value=taken[0], limit="free of EGM")
        if _JOINT.match(line) or _CIRCLE.match(line):
            raise ProgramError("a path of MoveL is needed", where=at, value=line.strip()[:40])


def _corrected(path: list[str], where: str, *, master: bool, first: bool = True) -> list[str]:
    """Lines with EGMMoveL in place of MoveL, but for the first of the path; ends in a fine point."""
    moves = [i for i, line in enumerate(path) if _LINEAR.match(_code(line))]
    calls = [line for line in path if _CALL.match(_code(line))]
    if not moves and not (master and calls):
        raise ProgramError("there is no path to correct: no MoveL", where=where)
    out = list(path)
    before = ""
    for k, i in enumerate(moves):
        match = _LINEAR.match(_code(path[i]))
        if match is None:
            continue
        space, target, speed, zone, tool = match.groups()
        same, before = target == before, target
        if k == 0 and first:
            continue
        if same and k < len(moves) - 1:
            out[i] = ""  # a movement of no length has no path frame
            continue
        following = [line for line in path[i + 1 :] if _code(line).strip()]
        stops = k == len(moves) - 1 or not (following and _LINEAR.match(_code(following[0])))
        out[i] = f"{space}EGMMoveL {IDENTITY},{target},{speed},{'fine' if stops else zone.strip()},{tool};"
    return [line for line in out if line]


def _setup(switching: EgmSwitching, way: str) -> list[str]:
    return [
        f"    EGMReset {IDENTITY};",
        f"    EGMGetId {IDENTITY};",
        f'    EGMSetupUC ROB_1,{IDENTITY},"{switching.configuration}","{switching.device}"{way}'
        f"\\CommTimeout:={switching.timeout_s:g};",
    ]


def _ready(switching: EgmSwitching) -> list[str]:
    return [
        "    ! the loop settles and is armed in this time",
        f"    WaitTime {switching.settle_s:g};",
    ]


def _path_on(switching: EgmSwitching, start: str) -> list[str]:
    tool = _TOOL.match(_code(start).rstrip(";").rsplit(",", 1)[-1])
    frame = f"{tool[1]}.tframe" if tool else "tool0.tframe"
    return [
        '    TPWrite "start counterflex run --egm, then press start";',
        "    Stop;",
        *_setup(switching, "\\PathCorr\\APTR"),
        f"    EGMActMove {IDENTITY},{frame}\\SampleRate:={switching.period_ms};",
        f"    EGMStreamStart {IDENTITY}\\SampleRate:={switching.period_ms};",
        *_ready(switching),
    ]


def _path_off(switching: EgmSwitching) -> list[str]:
    return [
        "    ! the correction ramps out",
        f"    WaitTime {switching.ramp_s:.1f};",
        f"    EGMReset {IDENTITY};",
    ]


def _guided(path: list[str], switching: EgmSwitching, where: str) -> list[str]:
    if any(_CALL.match(_code(line)) for line in path):
        raise ProgramError(
            "the program is split, its path lies in other modules",
            where=where,
            hint='Guidance needs the program in one module; or set [egm] mode = "path"',
        )
    moves = [i for i, line in enumerate(path) if _LINEAR.match(_code(line))]
    if len(moves) < 2:
        raise ProgramError("there is no path to guide along: fewer than two MoveL", where=where, value=len(moves))
    for line in path[moves[0] + 1 : moves[-1]]:
        code = _code(line).strip()
        if code and not _LINEAR.match(_code(line)) and not _WAIT.match(code):
            raise ProgramError(
                "guidance runs the path in one go, and an instruction stands within",
                where=where,
                value=code[:60],
                hint='Switch the spindle before the program, or set [egm] mode = "path"',
            )
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
        '    TPWrite "start counterflex run --egm, then press start";',
        "    Stop;",
        *_setup(switching, "\\Pose"),
        f"    EGMActPose {IDENTITY}\\StreamStart\\Tool:={name}\\WObj:={frame},cfZero,EGM_FRAME_WOBJ,cfZero,"
        f"EGM_FRAME_WOBJ{minmax}\\LpFilter:={switching.low_pass_hz:g}\\SampleRate:={switching.period_ms}"
        f"\\MaxSpeedDeviation:={switching.speed_deviation_deg_s:g};",
        *_ready(switching),
        "    ! the path comes from counterflex; ends when the tool has stood still for CondTime",
        f"    EGMRunPose {IDENTITY},EGM_STOP_HOLD\\x\\y\\z\\rx\\ry\\rz\\CondTime:={switching.standing_s:g}"
        f"\\RampInTime:={switching.ramp_in_s:g}\\PosCorrGain:=1;",
        f"    EGMReset {IDENTITY};",
        f"    IF Distance(CPos(\\Tool:={name}\\WObj:={frame}),{_position(last[2], where)})>{switching.end_mm:g} THEN",
        '      TPWrite "counterflex: the guided movement ended before the end of the path";',
        "      EXIT;",
        "    ENDIF",
        f"    MoveL {last[2]},{last[3]},fine,{last[5]};",
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
        "    RAISE;",
    ]
