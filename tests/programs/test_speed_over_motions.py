"""Speeds over random series of settings and motions: every motion runs at what was set last, in every language.

The references know the rule of one word each and share no code with the readers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.integrations.fanuc.language.read.reader import read_fanuc
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.integrations.staubli.language.read.reader import read_val3
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Program
from fanuc_listings import entry, listing

QUICK = settings(max_examples=100)
Op = TypeVar("Op")
speed = st.integers(1, 900)
percent = st.integers(1, 100)


def each_moved(ops: Sequence[Op], move: Op) -> list[Op]:
    """A motion behind every operation, so that each of them shows."""
    return [one for op in ops for one in (op, move)]


def speeds(program: Program, skipped: int = 1) -> list[float]:
    """mm/s of the motions behind the first ones; 0 for a rapid."""
    return [0.0 if m.kind == "rapid" else m.feed_m_s / MM for m in program.motions[skipped:]]


GCODE = st.lists(
    st.one_of(
        st.tuples(st.just("F"), speed), st.tuples(st.just("unit"), st.sampled_from([20, 21])),
        st.tuples(st.just("mode"), st.sampled_from([94, 95])), st.tuples(st.just("S"), st.integers(1, 9000)),
        st.tuples(st.just("G1"), st.just(0)), st.tuples(st.just("G0"), st.just(0)),
        st.tuples(st.just("G93"), st.integers(1, 60)),
    ),
    max_size=14,
)  # fmt: skip


@QUICK
@given(GCODE)
def test_gcode_feeds_in_the_unit_and_mode_they_were_given_in(ops: list[tuple[str, int]]) -> None:
    """F keeps the unit in which it was read; another mode needs an F of its own; G93 counts for its block alone."""
    lines, expected = ["G21 G90 G94 M3 S600", "G0 X0 Y0 Z0", "F60"], []
    unit, of_feed, feed, mode, rpm, way = 1.0, 1.0, 60, 94, 600, 0.0
    for word, value in each_moved(ops, ("G1", 0)):
        if word == "F":
            feed, of_feed = value, unit
            lines.append(f"F{value}")
        elif word == "unit":
            unit = 25.4 if value == 20 else 1.0
            lines.append(f"G{value}")
        elif word == "mode":
            if value != mode:  # a feed per minute is none per revolution
                feed, of_feed = 7, unit
                lines += [f"G{value}", "F7"]
            mode = value
        elif word == "S":
            rpm = value
            lines.append(f"S{value}")
        elif word == "G93":
            way += 2.54
            feed, of_feed = 7, unit
            lines += [f"G93 G1 X{way / unit:.6f} F{value}", f"G{mode}", "F7"]
            expected.append(2.54 * value / 60)
        else:
            way += 2.54
            lines.append(f"{word} X{way / unit:.6f}")
            per_minute = feed * of_feed * (rpm if mode == 95 else 1)
            expected.append(0.0 if word == "G0" else per_minute / 60)
    assert speeds(read_gcode("\n".join([*lines, "M2"]))) == pytest.approx(expected, rel=1e-4)


OFFSETS = st.lists(
    st.tuples(
        st.sampled_from(
            ["G92", "G52", "G92.1", "G92.2", "G92.3", "move", "G20", "G21", "G43.1", "G43.1Z", "G10", "step"]
        ),
        st.integers(-40, 40),
    ),
    max_size=20,
)


@QUICK
@given(OFFSETS)
def test_gcode_offsets_count_from_where_the_tool_stands_or_from_zero(ops: list[tuple[str, int]]) -> None:
    """G92 makes the place be called so, G52 shifts zero by so much; G92.2 forgets, and G92.3 brings back."""
    lines, expected = ["G21 G90 G92 X0", "G0 X0 Y0 Z0"], []
    unit, here, shift, saved, length, zero = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for word, value in [*ops, ("step", 3), ("move", 7)]:
        mm = value * unit
        if word in ("G20", "G21"):
            unit = 25.4 if word == "G20" else 1.0
            lines.append(word)
        elif word == "G92":
            shift = saved = here - mm - zero
            lines.append(f"G92 X{value}")
        elif word == "G52":
            shift = saved = mm
            lines.append(f"G52 X{value}")
        elif word == "G92.1":
            shift = saved = 0.0
            lines.append(word)
        elif word == "G92.2":
            shift = 0.0
            lines.append(word)
        elif word == "G92.3":
            shift = saved
            lines.append(word)
        elif word == "G43.1":  # the tip is where it was called to be, whatever the length
            here, length = here + length - mm, mm
            lines.append(f"G43.1 X{value}")
        elif word == "G43.1Z":  # the length along another axis
            lines.append(f"G43.1 Z{value}")
        elif word == "G10":  # zero of the work offset, so that the place is called so with the other offsets in force
            zero = here - shift - mm
            lines.append(f"G10 L20 P1 X{value}")
        elif word == "step":  # whatever the place is called, it moves on by so much
            here += mm
            lines.append(f"G91 G0 X{value}\nG90")
            expected.append(here)
        else:
            here = mm + shift + zero
            lines.append(f"G0 X{value}")
            expected.append(here)
    found = [m.p_end[0] / MM for m in read_gcode("\n".join([*lines, "M2"])).motions[1:]]
    assert found == pytest.approx(expected, abs=1e-9)


@QUICK
@given(st.floats(-20.0, 20.0), st.integers(1, 30), st.sampled_from(["G2", "G3"]), st.integers(1, 3))
def test_a_helix_in_inverse_time_lasts_its_time(rise: float, per_minute: int, word: str, turns: int) -> None:
    """The length is that of the helix: the speed of the tip is it by the time, however steep."""
    text = f"G21 G90 M3 S100\nG0 X10 Y0 Z0\nG93 {word} X10 Y0 Z{rise:.6f} I-10 P{turns} F{per_minute}\nM2"
    (_, helix) = read_gcode(text).motions
    length = np.hypot(2 * np.pi * 10 * turns, round(rise, 6))
    assert helix.feed_m_s / MM == pytest.approx(length * per_minute / 60, rel=1e-9)


@pytest.mark.parametrize("change", ["G95", "G93"])
def test_a_feed_of_another_mode_is_no_feed(change: str) -> None:
    with pytest.raises(ProgramError, match="feed"):
        read_gcode(f"G21 G90 G94 F100 M3 S100\nG1 X1\n{change}\nG1 X2\nM2")


SPINDLE = st.lists(st.sampled_from(["M3 S500", "M4 S700", "M5", "S900", "T1 M6", "T2", "M6", "move"]), max_size=14)


@QUICK
@given(SPINDLE)
def test_gcode_spindle_turns_as_it_was_told_and_stands_after_a_change(words: list[str]) -> None:
    lines, expected, rpm, turns, tool, prepared = ["G21 G90 F600", "G0 X0 Y0 Z0"], [], 0, 0, 0, 0
    for k, word in enumerate(each_moved(words, "move")):
        if word == "M6" and not prepared:
            continue
        lines.append(f"G1 X{k + 1}" if word == "move" else word)
        if word == "move":
            expected.append((turns * rpm * 2 * np.pi / 60, tool))
        if "S" in word:
            rpm = int(word.split("S")[1])
        if word[:2] in ("M3", "M4", "M5"):
            turns = {"M3": 1, "M4": -1, "M5": 0}[word[:2]]
        if word.startswith("T"):
            prepared = int(word[1])
        if word.endswith("M6"):
            tool, turns = prepared, 0
    found = read_gcode("\n".join([*lines, "M2"])).motions[1:]
    assert [m.tool for m in found] == [t for _, t in expected]
    assert [m.spindle_rad_s for m in found] == pytest.approx([v for v, _ in expected])


APT = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(["FEDRAT", "SPINDL"]), speed),
        st.tuples(st.sampled_from(["RAPID", "GOTO"]), st.just(0)),
    ),
    min_size=8, max_size=24,
)  # fmt: skip


@QUICK
@given(APT)
def test_an_apt_rapid_lasts_one_motion_and_a_feed_cancels_it(ops: list[tuple[str, int]]) -> None:
    lines, expected = ["UNITS/MM", "SPINDL/RPM,100,CLW", "FEDRAT/60,MMPM", "GOTO/0,0,0"], []
    feed, rapid, rpm = 60, False, 100
    for k, (word, value) in enumerate(ops):  # a rapid is one-shot: what stands between it and the motion is drawn
        if word == "FEDRAT":
            feed, rapid = value, False
            lines.append(f"FEDRAT/{value},MMPM")
        elif word == "SPINDL":
            rpm = value
            lines.append(f"SPINDL/RPM,{value},CLW")
        elif word == "RAPID":
            rapid = True
            lines.append("RAPID")
        else:
            lines.append(f"GOTO/{k + 1},0,0")
            expected.append((0.0 if rapid else feed / 60, rpm * 2 * np.pi / 60))
            rapid = False
    program = read_apt("\n".join([*lines, "FINI"]))
    assert speeds(program) == pytest.approx([v for v, _ in expected])
    assert [m.spindle_rad_s for m in program.motions[1:]] == pytest.approx([v for _, v in expected])


REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
RAPID = st.lists(
    st.one_of(
        st.tuples(st.just("VelSet"), percent, speed), st.tuples(st.just("MoveL"), speed, st.just(0)),
        st.tuples(st.just("T"), st.integers(1, 20), st.just(0)), st.tuples(st.just("PDispSet"), speed, st.just(0)),
        st.tuples(st.just("PDispOff"), st.just(0), st.just(0)),
        st.tuples(st.just("arc"), st.integers(1, 20), st.just(0)),
    ),
    max_size=12,
)  # fmt: skip


@QUICK
@given(RAPID)
def test_rapid_override_and_largest_speed_hold_until_they_are_set_again(ops: list[tuple[str, int, int]]) -> None:
    """A speed is limited behind its override, a time stretched by it; a displacement ends where it is switched off."""
    lines, expected, ends = [], [], []
    override, largest, way, off, before = 1.0, float("inf"), 0, 0, 0
    for word, one, two in each_moved(ops, ("MoveL", 40, 0)):
        if word == "VelSet":
            override, largest = one / 100, float(two)
            lines.append(f"VelSet {one},{two};")
        elif word == "PDispSet":
            off = one
            lines.append(f"PDispSet [[0,{one},0],[1,0,0,0]];")
        elif word == "PDispOff":
            off = 0
            lines.append("PDispOff;")
        else:
            way += 10
            target = f"Offs(p10,{way},0,0)"
            length = float(np.hypot(10, off - before))
            if word == "MoveL":
                lines.append(f"MoveL {target},v5\\V:={one},fine,tool0;")
                expected.append(min(one * override, largest))
            elif word == "T" or off != before:
                lines.append(f"MoveL {target},v5\\T:={one},fine,tool0;")
                expected.append(length / one * override)
            else:  # a half circle is longer than its chord
                lines.append(f"MoveC Offs(p10,{way - 5},5,0),{target},v5\\T:={one},fine,tool0;")
                expected.append(5.0 * np.pi / one * override)
            ends.append((way, off))
            before = off
    text = f"MODULE m\nCONST robtarget p10:=[[0,0,0],[0,1,0,0],{REST}];\nPROC main()\nMoveJ p10,v100,fine,tool0;\n"
    program = read_rapid("\n".join([text, *lines, "ENDPROC\nENDMODULE\n"]), name="m.mod")
    assert speeds(program) == pytest.approx(expected, rel=1e-6)
    assert [(m.p_end[0] / MM, m.p_end[1] / MM) for m in program.motions[1:]] == pytest.approx(
        [pytest.approx(end, abs=1e-6) for end in ends]
    )


KRL = st.lists(
    st.one_of(
        st.tuples(st.just("$VEL.CP"), speed), st.tuples(st.just("$OV_PRO"), percent),
        st.tuples(st.just("LIN"), st.just(0)),
        st.tuples(st.just("WITH"), speed), st.tuples(st.just("BAS"), speed),
    ),
    max_size=14,
)  # fmt: skip


@QUICK
@given(KRL)
def test_krl_speeds_hold_and_those_of_one_motion_do_not(ops: list[tuple[str, int]]) -> None:
    lines, expected, told, now, override, fresh = [], [], [], 20, 1.0, False
    for k, (word, value) in enumerate(each_moved(ops, ("LIN", 0))):
        target = f"{{X {k + 1},Y 0,Z 10,A 0,B 0,C 180}}"
        if word == "$VEL.CP":
            now, fresh = value, True
            lines.append(f"$VEL.CP={value / 1000}")
        elif word == "BAS":
            now, fresh = value, True
            lines.append(f"BAS(#VEL_CP,{value / 1000})")
        elif word == "$OV_PRO":
            override = value / 100
            lines.append(f"$OV_PRO={value}")
        else:
            own = word == "WITH"
            lines.append(f"SLIN {target} WITH $VEL.CP={value / 1000}" if own else f"LIN {target}")
            expected.append((value if own else now) * override)
            told.append(fresh)
            fresh = False
    head = "DEF p( )\n$BASE=BASE_DATA[1]\n$TOOL=TOOL_DATA[1]\n$VEL.CP=0.02\nPTP {X 0,Y 0,Z 10,A 0,B 0,C 180}\n"
    program = read_krl(head + "\n".join([*lines, "END\n"]), name="p.src")
    assert speeds(program) == pytest.approx(expected, rel=1e-6)
    assert [move.speed_set for move in program.moves[1:]] == told  # set by the program between two motions


FANUC = st.lists(
    st.one_of(
        st.tuples(st.just("OVERRIDE"), percent), st.tuples(st.just("LINEAR_MAX_SPEED"), speed),
        st.tuples(st.just("L"), speed), st.tuples(st.just("sec"), st.integers(1, 20)),
    ),
    max_size=14,
)  # fmt: skip


@QUICK
@given(FANUC)
def test_fanuc_override_and_largest_speed_hold_until_they_are_set_again(ops: list[tuple[str, int]]) -> None:
    lines, expected, override, largest, here = ["UFRAME_NUM=1", "UTOOL_NUM=1", "J P[1] 20% FINE"], [], 1.0, 2000, 0
    for word, value in each_moved(ops, ("L", 500)):
        if word == "OVERRIDE":
            override = value / 100
            lines.append(f"OVERRIDE={value}%")
        elif word == "LINEAR_MAX_SPEED":
            largest = value
            lines.append(f"LINEAR_MAX_SPEED={value}")
        else:
            here = 1 - here
            unit = "mm/sec" if word == "L" else "sec"
            lines.append(f"L P[{here + 1}] {value}{unit} FINE")
            expected.append(min((value if word == "L" else 300 / value) * override, largest))
    entries = entry(1, 0, 0, 50) + entry(2, 300, 0, 50)
    program = read_fanuc(listing(*lines, entries=entries), name="part.ls")
    assert speeds(program) == pytest.approx(expected, rel=1e-6)


RAPID_HEAD = """MODULE m
PERS tooldata t:=[TRUE,[[0,0,150],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
CONST robtarget p:=[[0,0,50],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PROC main()
MoveL p,v20,fine,t;
"""
TURNS_RAPID = """MoveL RelTool(p,10,0,0\\Ry:=20),[20,1,5,5],fine,t;
MoveL RelTool(p,10,0,0\\Rz:=20),[20,1,5,5],fine,t;
MoveL RelTool(p,20,0,0\\Rz:=40),[20,10,5,5]\\V:=30,fine,t;
VelSet 50,1000;
MoveL RelTool(p,30,0,0\\Rz:=20),[20,10,5,5],fine,t;
MoveL RelTool(p,40,0,0\\Rz:=20),[20,10,5,5],fine,t;
MoveL RelTool(p,50,0,0\\Rz:=21),v20,fine,t;
ENDPROC
ENDMODULE
"""
TURNS_KRL = """DEF p( )
$BASE=BASE_DATA[1]
$TOOL=TOOL_DATA[1]
$VEL.CP=0.02
LIN {X 0,Y 0,Z 10,A 0,B 0,C 180}
$VEL.ORI1=2
$VEL.ORI2=4
LIN {X 10,Y 0,Z 10,A 0,B 20,C 180}
LIN {X 20,Y 0,Z 10,A 0,B 20,C 180}
$OV_PRO=50
LIN {X 30,Y 0,Z 10,A 0,B 0,C 180}
LIN {X 40,Y 0,Z 10,A 20,B 0,C 180}
$VEL={CP 0.02,ORI1 200,ORI2 $VEL_MA.ORI2}
LIN {X 50,Y 0,Z 10,A 40,B 0,C 180}
END
"""
VAL3_TURNS = (
    '<Program name="p"><Code>\nbegin\nmovel(p[0],t,m)\nm.rvel=2\nmovel(p[1],t,m)\nm.rvel=100\nmovel(p[0],t,m)\nend\n'
    "</Code></Program>"
)
VAL3_DATA = """<Database><Datas>
<Data name="t" type="tool"><Value key="0" fatherId="flange[0]"/></Data>
<Data name="m" type="mdesc"><Value key="0" tmax="20" rmax="100"/></Data>
<Data name="p" type="pointRx"><Value key="0" ry="180" fatherId="world[0]"/>
<Value key="1" x="10" rx="20" ry="180" fatherId="world[0]"/></Data></Datas></Database>
"""


def test_a_turn_that_takes_longer_than_the_way_slows_the_tip() -> None:
    """10 mm while the tool turns by 20 deg: at 1 deg/s that is 0.5 mm/s, whatever the speed along the path says."""
    rapid = read_rapid(RAPID_HEAD + TURNS_RAPID, name="p.mod")
    assert speeds(rapid) == pytest.approx([0.5, 20.0, 5.0, 2.5, 10.0, 10.0], rel=1e-4)
    krl = read_krl(TURNS_KRL, name="p.src")
    assert speeds(krl) == pytest.approx([1.0, 20.0, 0.5, 1.0, 10.0], rel=1e-4)
    val3 = read_val3(VAL3_TURNS, data=VAL3_DATA)
    assert speeds(val3) == pytest.approx([1.0, 20.0], rel=1e-4)
