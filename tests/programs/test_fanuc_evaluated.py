"""FANUC TP as an evaluator: values, branches, loops, calls, frames, offsets; what is not known is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.app import conversion
from counterflex.app.robot_programs import companions
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import MM, UM
from counterflex.geometry import pose
from counterflex.integrations.fanuc.language.in_place import write_fanuc_in_place
from counterflex.integrations.fanuc.language.program import FanucProgram
from counterflex.integrations.fanuc.language.read.reader import read_fanuc, read_fanuc_file
from counterflex.integrations.fanuc.language.read.table import TABLE
from counterflex.programs.statement_table import Treatment
from fanuc_listings import DOWN, cell, entry, listing
from robot_corrections import corrected, gap_to_polyline

PLACES = {1: (0, 0, 50), 2: (10, 0, 0), 3: (20, 0, 0), 4: (30, 10, 0)}
POINTS = "".join(entry(number, *place) for number, place in PLACES.items())
HEAD = ("UFRAME_NUM=1", "UTOOL_NUM=1", "J P[1] 20% FINE")
ZERO = ("PR[1]=P[1]", "PR[1]=PR[1]-PR[1]")


def read(*statements: str, entries: str = POINTS, with_cell: bool = False) -> FanucProgram:
    """A program behind the usual head."""
    text = listing(*HEAD, *statements, entries=entries)
    return read_fanuc(text, name="part.ls", cell=cell() if with_cell else None)


def ends(program: FanucProgram) -> list[tuple[float, ...]]:
    """Ends of the motions behind the first one, mm, and speeds, mm/s."""
    return [(*(np.round(m.p_end / MM, 6) + 0.0).tolist(), round(m.feed_m_s * 1e3, 6)) for m in program.motions[1:]]


EVALUATED = {
    "speed in a register": (("R[5:feed]=25", "L P[2] R[5:feed]mm/sec CNT100"), [(10, 0, 0, 25)]),
    "speed by time": (("L P[2] 9mm/sec FINE", "L P[3] 0.5sec FINE", "L P[2] 500msec FINE"),
                      [(10, 0, 0, 9), (20, 0, 0, 20), (10, 0, 0, 20)]),
    "max_speed is a rapid": (("L P[2] max_speed FINE",), [(10, 0, 0, 0)]),
    "override": (("OVERRIDE=30%", "L P[2] 100mm/sec FINE", "OVERRIDE=100%", "L P[3] 100mm/sec FINE"),
                 [(10, 0, 0, 30), (20, 0, 0, 100)]),
    "override by a system variable": (("$MCR.$GENOVERRIDE=50", "L P[2] 100mm/sec FINE"), [(10, 0, 0, 50)]),
    "largest speed": (("LINEAR_MAX_SPEED=40", "L P[2] 100mm/sec FINE"), [(10, 0, 0, 40)]),
    "position register": (("PR[3]=P[2]", "PR[3,3]=PR[3,3]+5", "L PR[3] 9mm/sec FINE"), [(10, 0, 5, 9)]),
    "elements alone": ((*(f"PR[7,{n}]={v}" for n, v in enumerate((1, 2, 3, 180, 0, 180), 1)), "L PR[7] 9mm/sec FINE"),
                       [(1, 2, 3, 9)]),
    "sum of registers": (("PR[2]=P[2]+P[4]", "L PR[2] 9mm/sec FINE"), [(40, 10, 0, 9)]),
    "index in a register": (("R[1]=3", "L P[R[1:n]] 9mm/sec FINE", "PR[4]=P[4]", "R[2]=4", "L PR[R[2]] 9mm/sec FINE"),
                            [(20, 0, 0, 9), (30, 10, 0, 9)]),
    "register of a register": (("R[1]=2", "R[2]=4", "L P[R[R[1]]] 9mm/sec FINE"), [(30, 10, 0, 9)]),
    "offset": ((*ZERO, "PR[1,3]=7", "L P[2] 9mm/sec FINE Offset,PR[1:up]", "L P[3] 9mm/sec FINE"),
               [(10, 0, 7, 9), (20, 0, 0, 9)]),
    "offset condition": ((*ZERO, "PR[1,1]=1", "OFFSET CONDITION PR[1]", "L P[2] 9mm/sec FINE Offset",
                          "L P[3] 9mm/sec FINE"), [(11, 0, 0, 9), (20, 0, 0, 9)]),
    "tool offset": ((*ZERO, "PR[1,3]=7", "L P[2] 9mm/sec FINE Tool_Offset,PR[1]"), [(10, 0, -7, 9)]),
    "tool offset condition": ((*ZERO, "PR[1,3]=7", "TOOL_OFFSET CONDITION PR[1]", "L P[2] 9mm/sec FINE Tool_Offset"),
                              [(10, 0, -7, 9)]),
    "increment": (("L P[2] 9mm/sec CNT100", *ZERO, "PR[1,2]=4", "L PR[1] 9mm/sec CNT100 INC",
                   "L PR[1] 9mm/sec FINE INC"), [(10, 0, 0, 9), (10, 4, 0, 9), (10, 8, 0, 9)]),
    "where it stands": (("L P[2] 9mm/sec FINE", "PR[3]=LPOS", "PR[3,3]=20", "L PR[3] 9mm/sec FINE"),
                        [(10, 0, 0, 9), (10, 0, 20, 9)]),
    "loop": (("FOR R[1]=2 TO 4", "L P[R[1]] 9mm/sec FINE", "ENDFOR", "L P[R[1]] 8mm/sec FINE"),
             [(10, 0, 0, 9), (20, 0, 0, 9), (30, 10, 0, 9), (30, 10, 0, 8)]),
    "loop downwards": (("FOR R[1]=3 DOWNTO 2", "L P[R[1]] 9mm/sec FINE", "ENDFOR"), [(20, 0, 0, 9), (10, 0, 0, 9)]),
    "loop that never runs": (("FOR R[1]=3 TO 2", "L P[R[1]] 9mm/sec FINE", "ENDFOR", "L P[4] 9mm/sec FINE"),
                             [(30, 10, 0, 9)]),
    "counted jump": (("R[1]=1", "LBL[1:again]", "R[1]=R[1]+1", "L P[R[1]] 9mm/sec FINE", "IF R[1]<3,JMP LBL[1]"),
                     [(10, 0, 0, 9), (20, 0, 0, 9)]),
    "jump over": (("JMP LBL[7]", "L P[2] 9mm/sec FINE", "LBL[7]", "L P[3] 9mm/sec FINE"), [(20, 0, 0, 9)]),
    "jump by a register": (("R[1]=7", "JMP LBL[R[1]]", "L P[2] 9mm/sec FINE", "LBL[7]", "L P[3] 9mm/sec FINE"),
                           [(20, 0, 0, 9)]),
    "block": (("R[1]=2", "IF (R[1]=2 AND R[1]<>3) THEN", "L P[2] 9mm/sec FINE", "ELSE", "L P[3] 9mm/sec FINE", "ENDIF"),
              [(10, 0, 0, 9)]),
    "other branch": (("F[1]=(OFF)", "IF (F[1]) THEN", "L P[2] 9mm/sec FINE", "ELSE", "L P[3] 9mm/sec FINE", "ENDIF"),
                     [(20, 0, 0, 9)]),
    "assignment under a condition": (("R[1]=2", "IF (R[1]=2),R[5]=(30)", "L P[2] R[5]mm/sec FINE"), [(10, 0, 0, 30)]),
    "select": (("R[1]=3", "SELECT R[1]=1,JMP LBL[1]", "=3,JMP LBL[2]", "ELSE,JMP LBL[1]", "LBL[1]",
                "L P[2] 9mm/sec FINE", "LBL[2]", "L P[3] 9mm/sec FINE"), [(20, 0, 0, 9)]),
    "select else": (("R[1]=9", "SELECT R[1]=1,JMP LBL[2]", "ELSE,JMP LBL[1]", "LBL[1]", "L P[2] 9mm/sec FINE", "END",
                     "LBL[2]"), [(10, 0, 0, 9)]),
    "whole numbers": (("R[1]=17 DIV 5", "R[2]=17 MOD 5", "L P[R[1]] 9mm/sec FINE", "L P[R[2]] 9mm/sec FINE"),
                      [(20, 0, 0, 9), (10, 0, 0, 9)]),
    "options that change nothing": (("L P[2] 9mm/sec CNT R[1] ACC R[2] PTH", "L P[3] 9mm/sec FINE COORD EV50% BREAK",
                                     "L P[4] 9mm/sec FINE ACC80 TB .10sec,DO[1]=ON"),
                                    [(10, 0, 0, 9), (20, 0, 0, 9), (30, 10, 0, 9)]),
    "dwell in a register": (("R[3]=2.5", "WAIT R[3]", "L P[2] 9mm/sec FINE"), [(0, 0, 50, 0), (10, 0, 0, 9)]),
}  # fmt: skip
FIVE = POINTS + entry(5, 1, 2, 3).replace("UF : 1", "UF : 2")


@pytest.mark.parametrize("name", EVALUATED)
def test_values_flow_and_displacements_are_evaluated(name: str) -> None:
    statements, expected = EVALUATED[name]
    assert ends(read(*statements, entries=FIVE)) == expected


UNKNOWN = {
    "signal in a speed": (("R[5]=AI[2]", "L P[2] R[5]mm/sec FINE"), r":9:.*speed.*AI\[2\] is a signal in part.ls:8"),
    "register of the controller": (("L P[2] R[5]mm/sec FINE",), r"R\[5\]: the program does not set it"),
    "position register": (("L PR[5] 9mm/sec FINE",), r"where a motion goes.*PR\[5\]"),
    "a register among elements": (("PR[3]=P[2]", "PR[3,3]=R[8]", "L PR[3] 9mm/sec FINE"), r":10:.*R\[8\].*part.ls:9"),
    "offset": (("L P[2] 9mm/sec FINE Offset,PR[9]",), r"Offset is not known: PR\[9\]"),
    "offset without condition": (("L P[2] 9mm/sec FINE Offset",), r"no OFFSET CONDITION"),
    "frame": (("UFRAME[1]=PR[9]", "L P[2] 9mm/sec FINE"), r":9:.*frame UFRAME\[1\].*PR\[9\].*part.ls:8"),
    "tool": (("UTOOL[1]=PR[9]", "L P[2] 9mm/sec FINE"), r":9:.*frame UTOOL\[1\].*PR\[9\].*part.ls:8"),
    "number of a frame": (("UFRAME_NUM=GI[1]",), r"active frame .UFRAME_NUM. is not known: GI\[1\]"),
    "override": (("OVERRIDE=R[1]%", "L P[2] 9mm/sec FINE"), r"override is not known: R\[1\]"),
    "branch": (("IF DI[1]=ON,JMP LBL[1]", "L P[2] 9mm/sec FINE", "LBL[1]"), r"runs inside IF \(line 8\).*DI\[1\]"),
    "block": (("IF (!DI[1]) THEN", "UTOOL_NUM=2", "ENDIF"), r"runs inside IF \(line 8\).*DI\[1\]"),
    "end": (("IF (DI[1]=ON),END", "L P[2] 9mm/sec FINE"), r"runs inside IF \(line 8\).*DI\[1\]"),
    "jump to the end": (("IF DI[1]=ON,JMP LBL[9]", "L P[2] 9mm/sec FINE", "LBL[9]", "DO[1]=ON"), r"runs inside IF"),
    "loop": (("FOR R[1]=1 TO GI[1]", "L P[2] 9mm/sec FINE", "ENDFOR"), r"runs inside FOR \(line 8\).*GI\[1\]"),
    "select": (("SELECT GI[1]=1,CALL CUT", "ELSE,JMP LBL[1]", "LBL[1]", "L P[2] 9mm/sec FINE"), r"inside SELECT"),
    "set under a condition": (("R[5]=9", "IF (DI[1]),R[5]=(20)", "L P[2] R[5]mm/sec FINE"),
                              r":10:.*set under a condition: DI\[1\].*part.ls:9"),
    "set while it moves": (("R[5]=9", "L P[2] 9mm/sec FINE DB 5mm,R[5]=20", "L P[3] R[5]mm/sec FINE"),
                           r":10:.*while a motion runs.*part.ls:9"),
    "where it stands on the way": (("L P[2] 9mm/sec CNT100", "PR[3]=LPOS", "L PR[3] 9mm/sec FINE"), r"still moves"),
    "turn by an increment": (("L P[2] 9mm/sec FINE INC",), r"increment that turns the tool"),
    "second user frame": (("L P[2] 9mm/sec FINE", "UFRAME_NUM=2", "L P[5] 9mm/sec FINE"), r"user frame changes"),
    "skip": (("SKIP CONDITION DI[1]=ON", "L P[2] 9mm/sec FINE Skip,LBL[1]"), r"an input ends the motion"),
    "remote tool": (("L P[2] 9mm/sec FINE RTCP",), r"tool stands still"),
    "values that do not fit": (("FOR R[1]=P[1] TO 3", "L P[2] 9mm/sec FINE", "ENDFOR"), r":8:.*does not fit"),
    "override of a position": (("OVERRIDE=P[1]", "L P[2] 9mm/sec FINE"), r":9:.*does not fit"),
    "branch of a signal": (("R[1]=2", "SELECT R[1]=GI[1],JMP LBL[1]", "LBL[1]"), r"value of SELECT is not known"),
    "division by zero": (("R[1]=0", "R[2]=5/R[1]"), r"division by zero"),
    "negative MOD": (("R[1]=(-7) MOD 5", "L P[R[1]] 9mm/sec FINE"), r"number of a position is not known.*MOD"),
    "label": (("JMP LBL[9]",), r"no LBL\[9\]"),
    "macro": (("OPEN HAND 1",), r"an unknown statement, or a macro"),
    "no folder": (("CALL CUT",), r"another program is called.*Put CUT.ls beside"),
    "itself": (("CALL PART",), r"call each other without end"),
    "loop without end": (("LBL[1]", "L P[2] 9mm/sec FINE", "JMP LBL[1]"), r"repeats from line 8 on without end"),
    "count without end": (("R[1]=0", "LBL[1]", "R[1]=R[1]+1", "JMP LBL[1]"), r"repeats from line 9 on without end"),
    "condition that never comes": (("R[1]=0", "LBL[1]", "R[1]=R[1]+1", "IF R[1]>(-1),JMP LBL[1]"),
                                   r"does not end within.*without a motion"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNKNOWN)
def test_what_is_not_known_is_refused_with_both_lines(name: str) -> None:
    statements, match = UNKNOWN[name]
    with pytest.raises(ProgramError, match=match) as caught:
        read(*statements, entries=FIVE)
    assert "\n" not in str(caught.value)


PASSED = {
    "alarm": (("IF DI[1]=OFF,JMP LBL[99]", "L P[2] 9mm/sec FINE", "END", "LBL[99]", "UALM[1]", "ABORT"),
              [(10, 0, 0, 9)]),
    "abort": (("IF (DI[1]=OFF),ABORT", "L P[2] 9mm/sec FINE"), [(10, 0, 0, 9)]),
    "wait in a loop": (("LBL[5]", "DO[1]=ON", "IF DI[1]=OFF,JMP LBL[5]", "L P[2] 9mm/sec FINE"), [(10, 0, 0, 9)]),
    "timeout": (("WAIT DI[1]=ON TIMEOUT,LBL[9]", "L P[2] 9mm/sec FINE", "END", "LBL[9]", "UALM[1]", "ABORT"),
                [(10, 0, 0, 9)]),
    "waiting again": (("LBL[1]", "WAIT (DI[1]) TIMEOUT,LBL[5]", "L P[2] 9mm/sec FINE", "END", "LBL[5]", "R[9]=R[9]+1",
                       "JMP LBL[1]"), [(10, 0, 0, 9)]),
    "outputs": (("IF (DI[1]) THEN", "DO[1]=ON", "R[9]=3", "ELSE", "MESSAGE[x]", "ENDIF", "L P[2] 9mm/sec FINE"),
                [(10, 0, 0, 9)]),
    "home of the controller": (("L P[2] 9mm/sec FINE", "J PR[1:HOME] 20% FINE"), [(10, 0, 0, 9)]),
}  # fmt: skip


@pytest.mark.parametrize("name", PASSED)
def test_unknown_branches_without_motion_are_passed_and_named(name: str) -> None:
    statements, expected = PASSED[name]
    program = read(*statements)
    assert ends(program) == expected
    assert program.acting or "home" in name


BASE = (
    *HEAD, "R[1]=2", "FOR R[2]=1 TO 2", "L P[R[1]] 9mm/sec FINE", "R[1]=R[1]+1", "ENDFOR", "PR[1]=P[4]", "PR[1,3]=5",
    "L PR[1] 20mm/sec CNT100", "C P[2]\n    :  P[3] 9mm/sec FINE",
)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(TABLE.of(Treatment.NEUTRAL)), st.integers(0, len(BASE)))
def test_a_neutral_statement_anywhere_changes_nothing(row, at: int) -> None:  # type: ignore[no-untyped-def]
    """The same motions, speeds and orientations, whatever neutral statement stands wherever between them."""
    plain = read_fanuc(listing(*BASE, entries=POINTS))
    for sample in row.samples:
        program = read_fanuc(listing(*BASE[:at], sample, *BASE[at:], entries=POINTS))
        assert [(m.kind, m.feed_m_s) for m in program.motions] == [(m.kind, m.feed_m_s) for m in plain.motions]
        np.testing.assert_array_equal([m.p_end for m in program.motions], [m.p_end for m in plain.motions])
        np.testing.assert_array_equal(program.Rs_part_tcp, plain.Rs_part_tcp)


@pytest.mark.parametrize("row", TABLE.of(Treatment.REFUSED), ids=lambda row: row.word)
def test_a_refused_statement_refuses_with_its_remedy(row) -> None:  # type: ignore[no-untyped-def]
    for sample in row.samples:
        with pytest.raises(ProgramError) as caught:
            read(sample)
        assert row.remedy.split()[0] in str(caught.value)


NUMBERS = st.integers(-40, 40).map(lambda n: n / 4)


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> str:
    """Arithmetic in brackets, as mixed logic has it; the same text is Python's."""
    if depth == 0 or draw(st.booleans()):
        value = draw(NUMBERS)
        return f"({value})" if value < 0 else f"{value}"
    a, b = draw(expressions(depth - 1)), draw(expressions(depth - 1))
    return f"({a}{draw(st.sampled_from('+-*'))}{b})"


@settings(max_examples=80, deadline=None)
@given(expressions())
def test_arithmetic_is_that_of_another_evaluator(text: str) -> None:
    program = read("PR[1]=P[2]", f"PR[1,1]={text}", "L PR[1] 9mm/sec FINE")
    np.testing.assert_allclose(program.motions[-1].p_end[0] / MM, eval(text), atol=1e-9)  # own text


@settings(max_examples=40, deadline=None)
@given(*(st.tuples(*(st.floats(-80, 80) for _ in range(6))) for _ in range(2)))
def test_offsets_are_those_of_scipy(target: tuple[float, ...], offset: tuple[float, ...]) -> None:
    """Offset adds each component, Tool_Offset turns in the tool's axes (measured in ROBOGUIDE by others)."""
    set_both = [f"PR[{n},{i}]=({v:.4f})" for n, values in ((1, target), (2, offset)) for i, v in enumerate(values, 1)]
    a, b = ([round(v, 4) for v in values] for values in (target, offset))
    added = read(*set_both, "L PR[1] 9mm/sec FINE Offset,PR[2]")
    total = [x + y for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(added.motions[-1].p_end / MM, total[:3], atol=1e-6)
    assert added.Rs_part_tcp is not None
    np.testing.assert_allclose(
        added.Rs_part_tcp[-1], Rotation.from_euler("xyz", total[3:], True).as_matrix(), atol=1e-9
    )
    turned = read(*set_both, "L PR[1] 9mm/sec FINE Tool_Offset,PR[2]")
    R = Rotation.from_euler("xyz", a[3:], True)
    np.testing.assert_allclose(turned.motions[-1].p_end / MM, a[:3] + R.apply(b[:3]), atol=1e-6)
    assert turned.Rs_part_tcp is not None
    R_both = R * Rotation.from_euler("xyz", b[3:], True)
    np.testing.assert_allclose(turned.Rs_part_tcp[-1], R_both.as_matrix(), atol=1e-9)


def test_the_cell_knows_where_a_frame_stands() -> None:
    """A user frame that the program sets is seen from the part frame; that of the cell must be the cell's."""
    moved = (*ZERO, "PR[1,1]=100", "PR[1,6]=90", "UFRAME[2]=PR[1]", "UFRAME_NUM=2", "L P[5] 9mm/sec FINE")
    assert ends(read(*moved, entries=FIVE, with_cell=True)) == [(98, 1, 3, 9)]
    with pytest.raises(ProgramError, match=r"UFRAME_NUM=1 is not the part frame"):
        read(*ZERO, "PR[1,1]=100", "UFRAME[1]=PR[1]", "L P[2] 9mm/sec FINE", with_cell=True)
    with pytest.raises(ProgramError, match=r"tip of UTOOL_NUM=1"):
        read(*ZERO, "PR[1,1]=100", "UTOOL[1]=PR[1]", "L P[2] 9mm/sec FINE", with_cell=True)


def test_a_place_by_axes_between_cuts_follows_from_the_cell() -> None:
    axes = "P[9]{\n   GP1:\n\tUF : 1, UT : 1,\n" + ",\n".join(f"\tJ{n}= {n}.0 deg" for n in range(1, 7)) + "\n};\n"
    asked: list[tuple[float, ...]] = []

    def tip(axes_deg, external):  # type: ignore[no-untyped-def]
        asked.append(tuple(axes_deg))
        return pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))

    text = listing(*HEAD, "L P[2] 9mm/sec FINE", "J P[9] 20% FINE", "L P[3] 9mm/sec FINE", entries=POINTS + axes)
    program = read_fanuc(text, cell=cell(tip_of_axes=tip))
    assert ends(program) == [(10, 0, 0, 9), (500, 250, 125, 0), (20, 0, 0, 9)]
    assert asked == [(1, 2, 3, 4, 5, 6)]
    with pytest.raises(ProgramError, match="by axes"):
        read_fanuc(text)


AWAY = "P[9]{\n   GP1:\n\tUF : 1, UT : 1,\n" + ",\n".join(f"\tJ{n}= {n}.0 deg" for n in range(1, 7)) + "\n};\n"


def by_axes(*statements: str) -> FanucProgram:
    """A program for a cell that knows where axes lead: P[9] to (500, 250, 125) mm."""
    T = pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))
    text = listing(*HEAD[:2], *statements, entries=POINTS + AWAY)
    return read_fanuc(text, cell=cell(tip_of_axes=lambda *_: T))


def test_rest_postures_around_the_path_are_no_motions_of_it() -> None:
    """Before the first Cartesian target and behind the last one, waits there included."""
    path = ("J P[1] 20% FINE", "L P[2] 9mm/sec FINE")
    plain = by_axes(*path)
    rested = by_axes("J P[9] 10% FINE", "WAIT 1.0(sec)", "J P[9] 10% FINE", *path, "J P[9] 10% FINE", "WAIT 2.0(sec)")
    assert [m.kind for m in rested.motions] == [m.kind for m in plain.motions] == ["rapid", "feed"]
    for a, b in zip(rested.motions, plain.motions, strict=True):
        np.testing.assert_array_equal(a.p_start, b.p_start)
        np.testing.assert_array_equal(a.p_end, b.p_end)
    assert plain.left_out == ()
    assert [rested.lines[int(one.rpartition(":")[2]) - 1].count("J P[9]") for one in rested.left_out] == [1, 1, 1]


def test_between_cuts_every_stop_by_axes_is_a_motion_of_its_own_line() -> None:
    made = by_axes("J P[1] 20% FINE", "L P[2] 9mm/sec FINE", "J P[9] 10% FINE", "WAIT 1.5(sec)", "J P[9] 10% FINE",
                   "DO[1]=ON", "L P[3] 9mm/sec FINE")  # fmt: skip
    assert [(m.kind, m.duration_s) for m in made.motions[2:]] == [
        ("rapid", 0),
        ("dwell", 1.5),
        ("rapid", 0),
        ("feed", 0),
    ]
    assert [move.word for move in made.moves] == ["J", "L", "J", "WAIT", "J", "L"]
    for index, (motion, move) in enumerate(zip(made.motions, made.moves, strict=True)):
        block = made.blocks[motion.block]
        assert block.line == move.line
        assert (block.first_motion, block.motion_count) == (index, 1)
    firsts = [block.first_motion for block in made.blocks]
    assert firsts == sorted(firsts)
    assert sum(block.motion_count for block in made.blocks) == len(made.motions)


def test_where_the_robot_is_after_axes_is_not_known_to_inc() -> None:
    with pytest.raises(ProgramError, match="INC counts from"):
        by_axes("J P[1] 20% FINE", "J P[9] 10% FINE", "L P[2] 9mm/sec FINE INC")


@pytest.mark.parametrize("rail", ["E1= 100.0 mm", "J7= 100.0 mm"])
@pytest.mark.parametrize("way", [("J P[8] 5% FINE",), ("PR[1]=P[8]", "J PR[1] 5% FINE")])
def test_a_rail_moved_by_axes_between_cuts_goes_to_another_place(rail: str, way: tuple[str, ...]) -> None:
    """Elsewhere the rest posture may have the rail anywhere: the robot does not cut there."""
    T = pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))
    entries = POINTS + AWAY.replace("P[9]", "P[8]").replace("\tJ6= 6.0 deg", f"\tJ6= 6.0 deg,\n\t{rail}")
    at = cell(tip_of_axes=lambda *_: T, external_axes={1: 0.0})
    around = listing(*HEAD, "L P[2] 9mm/sec FINE", *way, entries=entries)
    assert len(read_fanuc(around, cell=at).motions) == 2
    between = listing(*HEAD, "L P[2] 9mm/sec FINE", *way, "L P[3] 9mm/sec FINE", entries=entries)
    moved = read_fanuc(between, cell=at)
    assert moved.external == {2: {1: 100.0}}
    assert tuple(moved.axes_deg[2]) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def test_an_axis_that_a_posture_leaves_out_is_not_taken_for_zero() -> None:
    T = pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))
    entries = POINTS + AWAY.replace(",\n\tJ6= 6.0 deg", "")
    text = listing(*HEAD, "L P[2] 9mm/sec FINE", "J P[9] 5% FINE", "L P[3] 9mm/sec FINE", entries=entries)
    with pytest.raises(ProgramError, match=r"P\[9\] has no J1 to J6"):
        read_fanuc(text, cell=cell(tip_of_axes=lambda *_: T))


# ---- a job of several files --------------------------------------------------------------------------------------


def job(folder: Path, **files: str) -> Path:
    """Listings in a folder; the first one is the main program."""
    for name, text in files.items():
        (folder / f"{name}.ls").write_text(text)
    return folder / f"{next(iter(files))}.ls"


def test_programs_of_the_folder_are_called_with_arguments(tmp_path: Path) -> None:
    part = listing("L P[1] AR[1]mm/sec FINE", "IF (AR[2]=1),END", "L P[2] 8mm/sec FINE",
                   entries=entry(1, 7, 7, 7) + entry(2, 8, 8, 8)).replace("PART", "CUT")  # fmt: skip
    main = job(tmp_path, main=listing(*HEAD, "CALL CUT(20,1)", "CALL CUT(30,2)", entries=POINTS), CUT=part, other="x")
    program = read_fanuc_file(main)
    assert ends(program) == [(7, 7, 7, 20), (7, 7, 7, 30), (8, 8, 8, 8)]
    assert {block.file for block in program.blocks} == {"", "CUT.ls"}
    assert list(program.listings) == ["main.ls", "CUT.ls"]


def test_the_form_of_a_plug_in_is_read(tmp_path: Path) -> None:
    """Lines without numbers, a main program without /POS that calls parts, axes first, CNT with decimals."""
    main = '/PROG job\n/ATTR\nCOMMENT = "Fanuc LS code" ;\n/MN\n: UTOOL_NUM=1 ;\n! Tool 1 ;\n: UFRAME_NUM=1 ;\n'
    main += ": CALL job_000 ;\n: CALL job_001 ;\n/END\n"
    axes = ", ".join(f"J{n}  =  {n}.000 deg" for n in range(1, 7))
    first = "/PROG job_000\n/ATTR\n/MN\n:J P[9] 10% FINE ;\n:J P[1] 10% CNT0.5 ;\n:L P[2] 50mm/sec CNT0.5  ;\n/POS\n"
    first += f"P[9]{{\n   GP1:\n    UF : 1, UT : 1,\n   {axes}\n}};\n{POINTS}/END\n"
    second = f"/PROG job_001\n/ATTR\n/MN\n:DO[1]=ON ;\n:L P[3] 50mm/sec FINE  ;\n/POS\n{POINTS}/END\n"
    path = job(tmp_path, job=main, job_000=first, job_001=second)
    program = read_fanuc_file(path)
    assert ends(program) == [(10, 0, 0, 50), (20, 0, 0, 50)]
    text = write_fanuc_in_place(program, corrected(program, 200.0 * UM, 3.0), tolerance_m=5.0 * UM, cycle_s=1e-4)
    for name, content in text.files.items():
        (tmp_path / name).write_text(content)
    assert len(read_fanuc_file(path).motions) == len(program.motions) + text.vertices_added


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    part = listing("L P[2] 9mm/sec FINE", entries=POINTS)
    main = job(tmp_path, main=listing(*HEAD, "CALL CUT", entries=POINTS), CUT=part, cut=part)
    with pytest.raises(ProgramError, match="several files of the folder are called CUT"):
        read_fanuc_file(main)


def test_a_task_beside_may_neither_move_nor_set_what_matters(tmp_path: Path) -> None:
    watch = listing("LBL[1]", "DO[1]=DI[1]", "R[50]=R[50]+1", "JMP LBL[1]").replace("JMP LBL[1] ;", "END ;")
    main = job(tmp_path, main=listing(*HEAD, "RUN WATCH", "L P[2] 9mm/sec FINE", entries=POINTS), watch=watch)
    assert ends(read_fanuc_file(main)) == [(10, 0, 0, 9)]
    job(tmp_path, watch=listing("L P[1] 9mm/sec FINE", entries=POINTS))
    with pytest.raises(ProgramError, match="inside RUN"):
        read_fanuc_file(main)


def test_what_is_converted_in_parts_reads_back_and_is_corrected_in_its_files(tmp_path: Path) -> None:
    """Each part gets its own points; together they are the corrected path of the whole."""
    examples = Path(__file__).parents[2] / "examples"
    source = tmp_path / "long.ngc"
    moves = "".join(f"X{n} Y{n % 3}\n" for n in range(1, 31))
    source.write_text(f"G21 G90 G17 G94\nT1 M6\nS13000 M3\nG0 X0 Y0 Z50\nG1 Z34 F600\n{moves}G0 Z60\nM5\nM2\n")
    out = tmp_path / "out"
    shop = examples / "cells" / "kr300_d16_small.toml"
    conversion.run(source, shop, out, "fanuc", points_per_file=12)
    main = out / "long.ls"
    program = read_fanuc_file(main)
    assert len(program.listings) == 4
    assert [file.name for file in companions(main)] == [name for name in program.listings if name != "long.ls"]
    whole = np.array([(n, n % 3, 34.0) for n in range(1, 31)])
    np.testing.assert_allclose(np.array([m.p_end for m in program.motions])[-31:-1] / MM, whole, atol=1e-3)
    compensated = corrected(program, 200.0 * UM, 9.0)
    text = write_fanuc_in_place(program, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    assert set(text.files) == set(program.listings)
    for name, content in text.files.items():
        (out / name).write_text(content)
        assert "counterflex job" not in program.listings[name].text
    back = read_fanuc_file(main)
    reached = np.array([motion.p_end for motion in back.motions])
    fed = np.array([motion.kind == "feed" for motion in program.motions])[compensated.path.motion]
    assert gap_to_polyline(compensated.p_part_command[fed], reached) < 5.1 * UM


def test_a_loop_is_written_out_in_its_own_language(tmp_path: Path) -> None:
    """The remedy that is printed for instructions that run more than once."""
    shop = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
    lines = ("!change to tool T1", "PAUSE", *HEAD, "FOR R[1]=2 TO 4", "L P[R[1]] 20mm/sec FINE", "ENDFOR")
    main = job(tmp_path, turns=listing(*lines, entries=POINTS))
    conversion.run(main, shop, tmp_path / "flat", "fanuc")
    flat = read_fanuc_file(tmp_path / "flat" / "turns.ls")
    assert flat.straight
    assert ends(flat)[-3:] == [(10, 0, 0, 20), (20, 0, 0, 20), (30, 10, 0, 20)]
    with pytest.raises(InputError, match="in that language already"):
        conversion.run(tmp_path / "flat" / "turns.ls", shop, tmp_path / "again", "fanuc")


def test_a_computed_target_is_written_out_without_its_offset() -> None:
    program = read(*ZERO, "PR[1,3]=7", "L P[2] 9mm/sec FINE ACC50 Offset,PR[1]", "L P[3] 9mm/sec FINE")
    compensated = corrected(program, 300.0 * UM, 0.0)
    text = write_fanuc_in_place(program, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    after = text.files["part.ls"]
    assert "Offset" not in after
    assert "ACC50" in after
    back = read_fanuc(after, name="part.ls")
    reached = np.array([motion.p_end for motion in back.motions])
    assert gap_to_polyline(compensated.p_part_command[1:], reached) < 5.1 * UM


def in_two_frames() -> FanucProgram:
    """A program that sets both user frames before it moves."""
    return read_fanuc(
        listing(*ZERO, "UFRAME[1]=PR[1]", "PR[1,1]=100", "PR[1,6]=90", "UFRAME[2]=PR[1]", *HEAD, "L P[2] 9mm/sec FINE",
                "UFRAME_NUM=2", "L P[5] 9mm/sec FINE", entries=FIVE), name="part.ls",
    )  # fmt: skip


def test_a_second_user_frame_is_seen_from_the_first() -> None:
    assert ends(in_two_frames()) == [(10, 0, 0, 9), (98, 1, 3, 9)]


def test_points_are_written_in_the_user_frame_that_is_active() -> None:
    program = in_two_frames()
    compensated = corrected(program, 300.0 * UM, 3.0)
    text = write_fanuc_in_place(program, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    reached = np.array([motion.p_end for motion in read_fanuc(text.files["part.ls"]).motions])
    assert gap_to_polyline(compensated.p_part_command[1:], reached) < 5.1 * UM


def test_a_statement_that_runs_twice_is_not_corrected() -> None:
    program = read("FOR R[1]=1 TO 2", "L P[2] 9mm/sec FINE", "L P[3] 9mm/sec FINE", "ENDFOR")
    assert not program.straight
    with pytest.raises(ProgramError, match="runs more than once is corrected.*convert"):
        write_fanuc_in_place(program, corrected(program, 300.0 * UM, 3.0))


def test_a_speed_in_a_register_and_an_override_are_written_as_numbers() -> None:
    """The written speed times the override is the planned one."""
    program = read("OVERRIDE=50%", "R[1]=40", "L P[2] R[1]mm/sec FINE", "L P[4] 100mm/sec FINE")
    compensated = corrected(program, 3000.0 * UM, 0.0)
    text = write_fanuc_in_place(program, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    assert text.speeds_changed > 0
    back = read_fanuc(text.files["part.ls"])
    speeds = [motion.feed_m_s for motion in back.motions if motion.kind == "feed"]
    assert all(0.01 < speed < 0.06 for speed in speeds)


def test_a_positioner_at_rest_is_carried() -> None:
    groups = "\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1= 5.0 deg\n};"
    program = read("L P[2] 9mm/sec FINE COORD", entries=POINTS.replace("\n};", groups))
    assert ends(program) == [(10, 0, 0, 9)]


def test_angles_of_positions_stay_those_of_the_listing() -> None:
    assert DOWN == (180.0, 0.0, 180.0)
    program = read("L P[2] 9mm/sec FINE")
    assert program.Rs_part_tcp is not None
    np.testing.assert_allclose(program.Rs_part_tcp[-1], Rotation.from_euler("xyz", DOWN, True).as_matrix(), atol=1e-12)
