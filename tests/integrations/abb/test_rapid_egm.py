"""RAPID with EGM around a path: what is made passes its own judge, and what is dangerous does not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from counterflex.core.errors import FileFormatError, InputError, ProgramError
from counterflex.integrations.abb.language.egm import called, called_parts, part_with_egm, start_move, with_egm
from counterflex.integrations.abb.language.egm_switching import EgmSwitching
from counterflex.integrations.abb.link.calls import parse_egm_calls
from counterflex.integrations.abb.link.check import ExpectedEgm, check_egm

PATH = EgmSwitching("path", "UCdevice", "pathCorr", 24, 0.1)
POSE = EgmSwitching("pose", "UCdevice", "default", 4, 0.1)
WANTED = {
    "path": ExpectedEgm("path", 24, "UCdevice", "pathCorr"),
    "pose": ExpectedEgm("pose", 4, "UCdevice", "default"),
}
NO_EXTERNAL = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def move(x: float, zone: str = "z0", word: str = "MoveL") -> str:
    return f"    {word} [[{x:.1f},0,34],[0,0,1,0],[0,0,0,0],{NO_EXTERNAL}],v_p_1,{zone},t_p\\WObj:=w_p;"


def program(*body: str) -> str:
    lines = [
        "MODULE p_m",
        "  PERS tooldata t_p:=[TRUE,[[0,0,100],[1,0,0,0]],[10,[0,0,50],[1,0,0,0],0,0,0]];",
        '  PERS wobjdata w_p:=[FALSE,TRUE,"",[[1000,0,500],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
        "  CONST speeddata v_p_1:=[25,100,5000,1000];",
        "  PROC p()",
        "    ConfL \\Off;",
        f"    MoveAbsJ [[0,0,0,0,30,0],{NO_EXTERNAL}],[100,100,5000,1000],fine,t_p\\WObj:=w_p;",
        "    ! M3 S13000 ; started by hand",
        *body,
        "    ! M30",
        "  ENDPROC",
        "ENDMODULE",
        "",
    ]
    return "\n".join(lines)


SIMPLE = program(move(0, "fine"), move(0), move(10), move(20), move(30))


@pytest.mark.parametrize("switching", [PATH, POSE])
def test_what_is_made_passes_its_own_judge(switching: EgmSwitching) -> None:
    text = with_egm(SIMPLE, switching, "p.mod")
    assert check_egm(parse_egm_calls(text, "p.mod"), WANTED[switching.mode]) == ()
    assert text.count("EGMReset cfId;") >= 2
    assert "ERR_UDPUC_COMM" in text
    assert "\\CommTimeout:=0.1" in text
    assert text.index("EGMSetupUC") > text.index("Stop;")


def test_every_point_of_the_path_is_kept_and_its_ends_are_fine_points() -> None:
    text = with_egm(SIMPLE, PATH, "p.mod")
    calls = parse_egm_calls(text, "p.mod")
    moves = calls.of("MOVEL", "EGMMOVEL")
    # no movement of no length; behind the path, to its last point again, without a correction
    assert [item.name for item in moves] == ["MOVEL", "EGMMOVEL", "EGMMOVEL", "EGMMOVEL", "MOVEL"]
    assert [item.arguments[-2] for item in moves] == ["fine", "z0", "z0", "fine", "fine"]
    points = ["[[0.0,0,", "[[10.0,0", "[[20.0,0", "[[30.0,0", "[[30.0,0"]
    assert [item.arguments[-4][:8] for item in moves] == points
    assert [item.number("samplerate") for item in calls.of("EGMACTMOVE", "EGMSTREAMSTART")] == [24.0, 24.0]
    assert calls.of("EGMACTMOVE")[0].arguments[1] == "t_p.tframe"


def test_an_instruction_within_the_path_ends_the_corrected_movement_first() -> None:
    text = with_egm(program(move(0, "fine"), move(10), "    WaitTime 0.5;", move(20), move(30)), PATH, "p.mod")
    moves = parse_egm_calls(text, "p.mod").of("EGMMOVEL")
    assert [item.arguments[-2] for item in moves] == ["fine", "z0", "fine"]
    assert check_egm(parse_egm_calls(text, "p.mod"), WANTED["path"]) == ()


def test_guidance_takes_the_path_out_and_looks_where_it_ended() -> None:
    calls = parse_egm_calls(with_egm(SIMPLE, POSE, "p.mod"), "p.mod")
    assert [item.arguments[0][:8] for item in calls.of("MOVEL")] == ["[[0.0,0,", "[[30.0,0"]
    (act,) = calls.of("EGMACTPOSE")
    assert {"streamstart", "tool", "wobj", "maxspeeddeviation", "lpfilter", "x", "rz"} <= set(act.switches)
    assert [text for text in act.arguments if "FRAME" in text] == ["EGM_FRAME_WOBJ", "EGM_FRAME_WOBJ"]
    (run,) = calls.of("EGMRUNPOSE")
    assert {"x", "y", "z", "rx", "ry", "rz", "condtime", "rampintime"} <= set(run.switches)
    assert any("Distance(CPos" in item.arguments[0] and "[30.0,0,34]" in item.arguments[0] for item in calls.of("IF"))


def test_a_split_program_is_corrected_in_all_its_parts() -> None:
    main = program("    p_001;", "    p_002;")
    assert called_parts(main, "p.mod") == ("p_001", "p_002")
    text = with_egm(main, PATH, "p.mod", move(10))
    assert text.index("EGMActMove") < text.index("p_001;") < text.index("p_002;") < text.rindex("EGMReset")
    assert "MoveL [[10.0,0,34]" in text[text.index("p_002;") :]
    with pytest.raises(ProgramError, match="last motion"):
        with_egm(main, PATH, "p.mod")
    part = "\n".join(["MODULE p_001_m", "  PROC p_001()", move(0, "fine"), move(10), "  ENDPROC", "ENDMODULE", ""])
    first, second = part_with_egm(part, "p_001.mod", first=True), part_with_egm(part, "p_001.mod", first=False)
    assert [i.name for i in parse_egm_calls(first, "x").of("MOVEL", "EGMMOVEL")] == ["MOVEL", "EGMMOVEL"]
    assert [i.name for i in parse_egm_calls(second, "x").of("MOVEL", "EGMMOVEL")] == ["EGMMOVEL", "EGMMOVEL"]
    assert "RAISE;" in first  # an error of a part reaches the handler of the main procedure
    with pytest.raises(ProgramError, match="split"):
        with_egm(main, POSE, "p.mod")


@pytest.mark.parametrize("signal", ["", "diArmed"])
def test_nothing_is_waited_for_blindly(signal: str) -> None:
    """Before the path until it is armed, behind it until the correction is gone; too late ends the program."""
    switching = replace(PATH, armed_signal=signal, correction_signal="doCorrection")
    lines = [line.strip() for line in with_egm(SIMPLE, switching, "p.mod").splitlines()]

    def at(piece: str) -> int:
        return next(i for i, line in enumerate(lines) if line.startswith(piece))

    waits = at("WaitUntil diArmed=1\\MaxTime:=60;" if signal else "TPReadFK cfKey,")
    assert "\\MaxTime:=60" in lines[waits]
    assert at("SetDO doCorrection,0") < at("MoveAbsJ") < at("EGMStreamStart") < waits
    assert waits < at("SetDO doCorrection,1") < at("MoveL [[0.0") < at("EGMMoveL")
    if not signal:
        assert lines[waits + 1] == "IF cfKey<>5 THEN"
        assert "EXIT;" in lines[waits : waits + 6]
    loop = at("WHILE Distance(CPos(")
    assert "ClkRead(cfClock)<3" in lines[loop]
    back = at("MoveL [[30.0")
    assert max(i for i, line in enumerate(lines) if line.startswith("EGMMoveL")) < loop < back
    assert lines[back].startswith("MoveL [[30.0,0,34],[0,0,1,0],[0,0,0,0]")
    assert ",[5,5,5,5],fine," in lines[back]
    assert lines[back + 1].startswith("IF Distance(CPos(\\Tool:=t_p\\WObj:=w_p),[30.0,0,34])>0.05 THEN")
    assert lines[back + 3] == "EXIT;"
    assert lines[back + 5] == "SetDO doCorrection,0;"
    handler = lines[lines.index("ERROR") :]
    assert any("ERR_WAIT_MAXTIME" in line and "ERR_TP_MAXTIME" in line for line in handler)
    assert [line for line in lines if line.startswith("WaitTime")] == ["WaitTime 0.05;"]


def test_another_tool_on_the_path_is_refused() -> None:
    other = move(20).replace("t_p", "tMill6")
    with pytest.raises(ProgramError, match="p.mod:11: the tool or the work object is changed"):
        with_egm(program(move(0, "fine"), move(10), other), PATH, "p.mod")
    part = "\n".join(["MODULE p_002_m", "  PROC p_002()", other, move(30), "  ENDPROC", "ENDMODULE", ""])
    start = start_move(SIMPLE, "p.mod")
    with pytest.raises(ProgramError, match="p_002.mod:3: the tool"):
        part_with_egm(part, "p_002.mod", first=False, start=start)


def test_a_call_that_is_no_part_stays_a_call() -> None:
    text = program("    SpindleOn;", move(0, "fine"), move(10), move(20), "    SpindleOff;")
    assert called(text, "p.mod") == ("SpindleOn", "SpindleOff")
    assert called_parts(text, "p.mod") == ()
    made = with_egm(text, PATH, "p.mod")
    assert made.index("SpindleOn;") < made.index("EGMSetupUC") < made.index("EGMMoveL") < made.index("SpindleOff;")


def test_the_correction_is_gone_before_a_person_is_asked_to_stop_the_spindle() -> None:
    by_hand = ['    TPWrite "stop the spindle, then press start";', "    Stop;"]
    start = ['    TPWrite "start the spindle, then press start";', "    Stop;"]
    made = with_egm(program(*start, move(0, "fine"), move(10), move(20), *by_hand), PATH, "p.mod")
    lines = [line.strip() for line in made[: made.index("  ERROR")].splitlines()]
    stops = [i for i, line in enumerate(lines) if line == "Stop;"]
    assert len(stops) == 3  # for the spindle, for the run, for the spindle
    given_back = max(i for i, line in enumerate(lines) if line.startswith("EGMReset"))
    assert stops[1] < lines.index("EGMSetupUC" + next(x for x in lines if "EGMSetupUC" in x)[10:])
    assert max(i for i, line in enumerate(lines) if line.startswith("EGMMoveL")) < given_back < stops[2]


@pytest.mark.parametrize(
    ("text", "switching", "said"),
    [
        (program(move(0, "fine"), move(1), "    Stop;", move(2)), PATH, "p.mod:11: the program stops for the operator"),
        ("PROC p()\nENDPROC", PATH, "not a RAPID program"),
        (SIMPLE.replace("  ENDPROC", ""), PATH, "cut off"),
        (program(), PATH, "no path"),
        (program("    ! M3 S9000", move(0, "fine"), move(1)), PATH, "a comment alone"),
        (program(move(0, "fine")), POSE, "fewer than two"),
        (SIMPLE.replace("MoveAbsJ", "MoveX"), PATH, "first motion"),
        (program(move(0, "fine"), move(1, word="MoveC")), PATH, "MoveL is needed"),
        (program(move(0, "fine"), "    EGMReset x;", move(1)), PATH, "uses what EGM needs"),
        (program(move(0, "fine"), move(1), "    SetDO spindle,1;", move(2)), POSE, "in one go"),
    ],
)
def test_programs_that_cannot_run_under_egm_are_refused(text: str, switching: EgmSwitching, said: str) -> None:
    with pytest.raises(ProgramError, match=said):
        with_egm(text, switching, "p.mod")


def test_a_long_timeout_is_never_written() -> None:
    with pytest.raises(InputError, match="CommTimeout"):
        replace(PATH, timeout_s=1.0)
    with pytest.raises(InputError):
        replace(PATH, mode="joint")


@pytest.mark.parametrize(
    ("mode", "old", "new", "rule"),
    [
        ("path", "\\CommTimeout:=0.1", "\\CommTimeout:=1", "timeout"),
        ("path", "\\CommTimeout:=0.1", "", "timeout"),
        ("pose", "\\CommTimeout:=0.1", "\\CommTimeout:=nTimeout", "timeout"),
        ("path", "\\PathCorr\\APTR", "", "mode"),
        ("path", "\\PathCorr\\APTR", "\\Pose", "mode"),
        (
            "path",
            "EGMActMove cfId,t_p.tframe\\SampleRate:=24",
            "EGMActMove cfId,t_p.tframe\\SampleRate:=20",
            "sample-rate",
        ),
        ("path", "tframe\\SampleRate:=24", "tframe\\SampleRate:=48", "sample-rate"),
        ("pose", "\\SampleRate:=4", "\\SampleRate:=8", "sample-rate"),
        ("pose", "\\MaxSpeedDeviation:=20", "", "speed-deviation"),
        ("pose", "cfZero,EGM_FRAME_WOBJ,", "cfZero,EGM_FRAME_BASE,", "frame"),
        ("pose", "EGM_STOP_HOLD\\x", "EGM_STOP_HOLD", "axes"),
        ("pose", "\\PosCorrGain:=1", "\\PosCorrGain:=0", "velocity"),
        ("pose", "EGMRunPose cfId,EGM_STOP_HOLD", "EGMRunPose cfId,EGM_STOP_RAMP_DOWN", "stop"),
        ("pose", "\\CondTime:=30", "\\NoWaitCond", "no-wait"),
        ("path", "v_p_1,fine,t_p\\WObj:=w_p;\n    EGMMoveL", "v_p_1,z5,t_p\\WObj:=w_p;\n    EGMMoveL", "fine"),
        ("path", "ERR_UDPUC_COMM", "ERR_OTHER", "handler"),
        ("path", "EGMSetupUC", "EGMSetupAO", "setup"),
    ],
)
def test_every_danger_is_an_error(mode: str, old: str, new: str, rule: str) -> None:
    text = with_egm(SIMPLE, PATH if mode == "path" else POSE, "p.mod")
    assert old in text
    found = check_egm(parse_egm_calls(text.replace(old, new, 1), "p.mod"), WANTED[mode])
    assert rule in [item.rule for item in found if item.severity == "error"]
    assert all(item.safe and item.what and item.where.startswith("p.mod") for item in found)


def test_lesser_faults_are_warnings() -> None:
    text = with_egm(SIMPLE, POSE, "p.mod")
    short = check_egm(parse_egm_calls(text.replace("CondTime:=30", "CondTime:=1"), "p.mod"), WANTED["pose"])
    assert [(item.rule, item.severity) for item in short] == [("standing", "warning")]
    named = check_egm(parse_egm_calls(text.replace('"UCdevice"', '"Other:"'), "p.mod"), WANTED["pose"])
    assert [(item.rule, item.severity) for item in named] == [("name", "warning")]
    colon = check_egm(parse_egm_calls(text.replace('"UCdevice"', '"UCdevice:"'), "p.mod"), WANTED["pose"])
    assert colon == ()


def test_a_stop_for_a_person_under_correction_is_a_warning() -> None:
    text = with_egm(SIMPLE, PATH, "p.mod")
    last = text.index("\n", text.rindex("EGMMoveL"))
    found = check_egm(parse_egm_calls(text[:last] + "\n    Stop;" + text[last:], "p.mod"), WANTED["path"])
    assert [(item.rule, item.severity) for item in found] == [("stop-corrected", "warning")]


@pytest.mark.parametrize(
    ("begin", "end"), [("    TPReadFK", "    SetDO"), ("    WHILE Distance", "  ERROR")], ids=["before", "behind"]
)
def test_a_path_without_a_look_at_a_condition_is_a_warning(begin: str, end: str) -> None:
    text = with_egm(SIMPLE, replace(PATH, correction_signal="doCorrection"), "p.mod")
    first = text.index(begin)
    blind = text[:first] + "    WaitTime 5;\n" + text[text.index(end, first) :]
    found = check_egm(parse_egm_calls(blind, "p.mod"), WANTED["path"])
    assert ("blind-wait", "warning") in [(item.rule, item.severity) for item in found]


def test_comments_and_strings_are_no_instructions() -> None:
    body = '    ! EGMReset x;\n    TPWrite "EGMReset; MoveL";\n    WaitTime\n      1;\n'
    text = f"MODULE m\n  PROC a()\n{body}  ENDPROC\nENDMODULE\n"
    calls = parse_egm_calls(text, "m.mod")
    assert calls.of("EGMRESET", "MOVEL") == ()
    assert [(i.line, i.arguments) for i in calls.of("WAITTIME")] == [(5, ("1",))]
    with pytest.raises(FileFormatError, match="not a RAPID module"):
        parse_egm_calls("hello", "m.mod")


def test_guidance_keeps_stops_for_a_person_before_and_behind_the_path() -> None:
    """``Stop;`` looks like the call of a part: such a program was said to be split."""
    by_hand = program("    Stop;", move(0, "fine"), move(10), move(20), "    Stop;")
    text = with_egm(by_hand, POSE, "p.mod")
    assert text.count("Stop;") == 3
    assert check_egm(parse_egm_calls(text, "p.mod"), WANTED["pose"]) == ()


@pytest.mark.parametrize("switching", [PATH, POSE])
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("t_p\\", "MoveL\\", "cannot use this name; got MoveL"),
        ("w_p;", f"{'w' * 33};", "cannot use this name; got wwww"),
        ("PROC p()", "PROC WaitTime_()", ""),
        ("PROC p()", "PROC MoveL()", "cannot use this name; got MoveL"),
        ("MODULE p_m", "MODULE Proc", "cannot use this name; got Proc"),
        ("ENDMODULE", "", "no ENDMODULE"),
    ],
)
def test_names_that_no_controller_loads_are_refused(switching: EgmSwitching, old: str, new: str, said: str) -> None:
    text = SIMPLE.replace(old, new)
    if said:
        with pytest.raises(ProgramError, match=said):
            with_egm(text, switching, "p.mod")
    else:
        assert with_egm(text, switching, "p.mod")
