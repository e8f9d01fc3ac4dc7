"""VAL3 as an evaluator: values, geometry, branches, loops, calls; what is not known is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.app import conversion
from counterflex.app.robot_programs import companions
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.geometry import pose
from counterflex.integrations.staubli.language.in_place import write_val3_in_place
from counterflex.integrations.staubli.language.program import Val3Program
from counterflex.integrations.staubli.language.read.reader import read_val3, read_val3_file
from counterflex.integrations.staubli.language.read.table import TABLE
from counterflex.programs.statement_table import Treatment
from robot_corrections import corrected, gap_to_polyline
from val3_files import at, cell, data, program

PLACES = [at(0, 0, 50), at(10, 0, 0), at(20, 0, 0), at(30, 10, 0)]
MORE = """    <Data name="nI" access="private" xsi:type="array" type="num" size="1"/>
    <Data name="nS" type="num" size="2"><Value key="0" value="3"/><Value key="1" value="7"/></Data>
    <Data name="fB" type="frame" size="1"><Value key="0" x="5" rz="90" fatherId="fPart[0]"/></Data>
    <Data name="fW" type="frame" size="1"><Value key="0" x="5" rz="90" fatherId="world[0]"/></Data>
    <Data name="tr" type="trsf" size="1"><Value key="0" z="-10"/></Data>
    <Data name="pQ" type="pointRx" size="1"><Value key="0" x="1" fatherId="fB[0]" ry="180"/></Data>
    <Data name="jA" type="jointRx" size="1"><Value key="0" j1="1" j2="2" j3="3" j4="4" j5="5" j6="6"/></Data>
    <Data name="diX" type="dio" size="1"/>
  </Datas>"""
HEAD = "movej(p[0],tMill,mRun)"
END = ",tMill,mRun)"


def files(points: list[str] = PLACES) -> str:
    """The data file with further variables."""
    return data(points).replace("  </Datas>", MORE)


def read(*lines: str, with_cell: bool = False, head: bool = True) -> Val3Program:
    """A program behind a rapid to the first point."""
    text = program(HEAD, *lines) if head else program(*lines)
    return read_val3(text, name="part.pgx", data=files(), data_name="part.dtx", cell=cell() if with_cell else None)


def ends(made: Val3Program) -> list[tuple[float, ...]]:
    """Ends of the motions behind the first one, mm, and speeds, mm/s."""
    return [(*(np.round(m.p_end / MM, 6) + 0.0).tolist(), round(m.feed_m_s * 1e3, 6)) for m in made.motions[1:]]


def to(point: str) -> str:
    """A straight motion."""
    return f"movel({point}{END}"


EVALUATED = {
    "index": (("nI=2", to("p[nI]"), to("p[nI+1]")), [(20, 0, 0, 50), (30, 10, 0, 50)]),
    "appro": ((to("appro(p[1],{0,0,-10,0,0,0})"), to("appro(p[1],tr)")), [(10, 0, 10, 50), (10, 0, 10, 50)]),
    "compose": ((to("compose(p[1],fPart,{0,0,10,0,0,90})"),), [(0, 10, 10, 50)]),
    "component": (("p[1].trsf.x=nS[1]", "p[1].trsf.y=p[1].trsf.y+1", to("p[1]")), [(7, 1, 0, 50)]),
    "whole point": (("p[1]=appro(p[2],{1,2,3,0,0,0})", to("p[1]")), [(19, 2, -3, 50)]),
    "product and inverse": (("tr=!tr*{1,0,0,0,0,0}", "p[1].trsf=p[1].trsf*tr", to("p[1]")), [(9, 0, -10, 50)]),
    "speed": (("mRun.tvel=30*nS[0]", to("p[1]")), [(10, 0, 0, 90)]),
    "copy of a speed": (("mRun[1].tvel=12", "mRun[0]=mRun[1]", to("p[1]")), [(10, 0, 0, 12)]),
    "speed of no limit": (("mRun.tvel=99999", to("p[1]")), [(10, 0, 0, 0)]),
    "for": (("for nI=1 to 3", to("p[nI]"), "endFor"), [(10, 0, 0, 50), (20, 0, 0, 50), (30, 10, 0, 50)]),
    "for downwards": (("for nI=3 to 1 step -2", to("p[nI]"), "endFor"), [(30, 10, 0, 50), (10, 0, 0, 50)]),
    "for that never runs": (("for nI=3 to 1", to("p[nI]"), "endFor", to("p[2]")), [(20, 0, 0, 50)]),
    "while": (("nI=1", "while (nI<3 and true)", to("p[nI]"), "nI=nI+1", "endWhile"), [(10, 0, 0, 50), (20, 0, 0, 50)]),
    "until": (("nI=0", "do", "nI=nI+1", to("p[nI]"), "until (nI>=2)"), [(10, 0, 0, 50), (20, 0, 0, 50)]),
    "if": (("nI=2", "if nI==1", to("p[1]"), "elseIf (nI==2)", to("p[2]"), "else", to("p[3]"), "endIf"),
           [(20, 0, 0, 50)]),
    "else": (("if !true", to("p[1]"), "else", to("p[3]"), "endIf", to("p[1]")), [(30, 10, 0, 50), (10, 0, 0, 50)]),
    "switch": (("switch nS[0]", "case 1,2", to("p[1]"), "break", "case 3", to("p[2]"), "break", "default", to("p[3]"),
                "break", "endSwitch"), [(20, 0, 0, 50)]),
    "default": (("switch nS[1]", "case 1", to("p[1]"), "break", "default", to("p[3]"), "break", "endSwitch"),
                [(30, 10, 0, 50)]),
    "functions": (("nI=abs(-2)*cos(60)", to("p[nI]"), "nI=round(sqrt(4))", to("p[nI]"), "nI=sel(true,3,1)", to("p[nI]"),
                   "nI=size(p)-3", to("p[nI]")),
                  [(10, 0, 0, 50), (20, 0, 0, 50), (30, 10, 0, 50), (10, 0, 0, 50)]),
    "frame of a frame": ((to("pQ"),), [(5, 1, 0, 50)]),
    "link": (("link(p[1],fB)", to("p[1]")), [(5, 10, 0, 50)]),
    "setFrame": (("nI=setFrame(p[1],p[2],p[3],fB)", to("pQ"), to("p[nI+1]")), [(11, 0, 0, 50), (10, 0, 0, 50)]),
    "return": ((to("p[1]"), "return", to("p[2]")), [(10, 0, 0, 50)]),
    "monitor speed of 100": (("setMonitorSpeed(100)", to("p[1]")), [(10, 0, 0, 50)]),
    "distance": (("nI=distance(p[1],p[2])/10", to("p[nI]")), [(10, 0, 0, 50)]),
}  # fmt: skip


@pytest.mark.parametrize("name", EVALUATED)
def test_values_flow_and_geometry_are_evaluated(name: str) -> None:
    lines, expected = EVALUATED[name]
    assert ends(read(*lines)) == expected


UNKNOWN = {
    "speed": (("mRun.tvel=nSpeed", to("p[1]")), r"part.pgx:7:3.*speed.*nSpeed is in no data file.*part.pgx:6"),
    "signal": (("mRun.tvel=aioGet(diX)", to("p[1]")), r":7:3.*aioGet\(\) is the controller's in part.pgx:6"),
    "monitor speed": (("setMonitorSpeed(30)", to("p[1]")), r":6:3.*changes the speed of every motion.*expected 100"),
    "place of the robot": (("pQ=here(tMill,fPart)", to("pQ")), r":7:3.*here\(\) is the controller's in part.pgx:6"),
    "component of the place of the robot": (
        ("pQ=here(tMill,fPart)", "pQ.trsf.z=pQ.trsf.z+5", to("pQ")), r":8:3.*here\(\) is the controller's in part.pgx:6"
    ),
    "axis of the robot": (("jA=herej()", "jA.j1=jA.j1+1", f"movej(jA{END}", to("p[1]")), r"herej\(\).*part.pgx:6"),
    "frame by setFrame": (("nI=setFrame(p[1],p[2],here(tMill,fB),fB)", to("pQ")), r"computed by setFrame: .*here"),
    "tool": (("tMill.trsf.z=nLength", to("p[1]")), r":7:3.*tool tMill is not known: nLength.*part.pgx:6"),
    "branch": (("if diX==true", to("p[1]"), "endIf"), r"runs inside if \(line 6\).*diX is a signal"),
    "loop": (("while (diX)", to("p[1]"), "endWhile"), r"runs inside while \(line 6\).*diX"),
    "count": (("for nI=0 to aioGet(diX)", to("p[1]"), "endFor"), r"runs inside for \(line 6\)"),
    "switch": (("switch getKey()", "case 1", to("p[1]"), "break", "endSwitch"), r"runs inside switch \(line 6\)"),
    "return": (("if diX", "return", "endIf", to("p[1]")), r"runs inside if \(line 6\)"),
    "set under a condition": (("if diX", "nI=1", "endIf", to("p[nI]")), r":9:3.*set under a condition: diX.*:6"),
    "index": (("p[getKey()].trsf.x=5", to("p[1]")), r":7:3.*index is not known"),
    "motions that are cancelled": (("resetMotion()",), r"cancels motions that are not finished"),
    "in an expression": (("if setFrame(p[1],p[2],p[3],fB)==0", "endIf"), r"setFrame\(\) stands within an expression"),
    "no function": (("nI=frobnicate(2)",), r"no function of VAL3"),
    "no folder": (("call cut()",), r"subprogram is called.*Put its .pgx beside"),
    "library": (("call lib:cut()",), r"subprogram is called"),
    "loop without end": (("do", to("p[1]"), "until (false)"), r"repeats from line 7 on without end"),
    "count without end": (("while true", "nI=nI+1", "endWhile"), r"repeats from line 6 on without end"),
    "condition that never comes": (("while nI>-1", "nI=nI+1", "endWhile"), r"does not end within.*without a motion"),
    "step of nothing": (("for nI=0 to 3 step 0", "endFor"), r"its step is 0"),
    "another part frame": (("link(p[1],fW)", to("p[1]")), None),
}  # fmt: skip


@pytest.mark.parametrize("name", UNKNOWN)
def test_what_is_not_known_is_refused_with_both_lines(name: str) -> None:
    lines, match = UNKNOWN[name]
    with pytest.raises(ProgramError, match=match or r"frame fW is not the part frame") as caught:
        read(*lines, with_cell=match is None)
    assert "\n" not in str(caught.value)


PASSED = {
    "outputs": ("if diX", 'putln("a")', "nI=3", "diX=true", "endIf", to("p[1]")),
    "waiting": ("while (!diX)", "delay(0.1)", "endWhile", to("p[1]")),
    "a job that cannot go on": ("if !diX", 'popUpMsg("no part")', "return", "endIf", to("p[1]")),
    "result of an instruction": ('nI=dioSet(diX,1)', "bOk=watch(diX,2)", to("p[1]")),
}  # fmt: skip


@pytest.mark.parametrize("name", PASSED)
def test_unknown_branches_without_motion_are_passed_and_named(name: str) -> None:
    made = read(*PASSED[name])
    assert ends(made) == [(10, 0, 0, 50)]
    assert made.acting


BASE = (HEAD, "nI=1", "for nI=1 to 2", to("p[nI]"), "endFor", "waitEndMove()", "mRun.tvel=20", to("appro(p[3],tr)"),
        "movec(p[1],p[2],tMill,mRun)")  # fmt: skip
OWN = {"nA": 'type="num"', "sA": 'type="string"', "bA": 'type="bool"', "jA": 'type="jointRx"', "pA": 'type="pointRx"',
       "tA": 'type="trsf"', "cA": 'type="configRx"'}  # fmt: skip
DECLARED = "".join(f'<Data name="{n}" {k} size="1"/>' for n, k in OWN.items() if n != "jA")


@settings(max_examples=120, deadline=None)
@given(st.sampled_from(TABLE.of(Treatment.NEUTRAL)), st.integers(0, len(BASE)))
def test_a_neutral_statement_anywhere_changes_nothing(row, at: int) -> None:  # type: ignore[no-untyped-def]
    """The same motions, speeds and orientations, whatever neutral statement stands wherever between them."""
    listed = files().replace("  </Datas>", DECLARED + "  </Datas>")
    plain = read_val3(program(*BASE), data=listed)
    for sample in row.samples:
        made = read_val3(program(*BASE[:at], sample, *BASE[at:]), data=listed)
        assert [(m.kind, m.feed_m_s) for m in made.motions] == [(m.kind, m.feed_m_s) for m in plain.motions]
        np.testing.assert_array_equal([m.p_end for m in made.motions], [m.p_end for m in plain.motions])
        np.testing.assert_array_equal(made.Rs_part_tcp, plain.Rs_part_tcp)


@pytest.mark.parametrize("row", TABLE.of(Treatment.REFUSED), ids=lambda row: row.word)
def test_a_refused_statement_refuses_with_its_remedy(row) -> None:  # type: ignore[no-untyped-def]
    for sample in row.samples:
        with pytest.raises(ProgramError) as caught:
            read(sample)
        assert row.remedy in str(caught.value)


ANGLES = st.tuples(*(st.floats(-80, 80).map(lambda v: round(v, 3)) for _ in range(6)))


def matrix(values: tuple[float, ...]) -> tuple[np.ndarray, Rotation]:
    """Place and rotation of x y z rx ry rz by scipy: about x, then the new y, then the new z."""
    return np.array(values[:3]), Rotation.from_euler("XYZ", values[3:], True)


@settings(max_examples=40, deadline=None)
@given(ANGLES, ANGLES, ANGLES)
def test_geometry_is_that_of_scipy(frame: tuple[float, ...], point: tuple[float, ...], by: tuple[float, ...]) -> None:
    """Appro turns in the axes of the point, compose in those of the frame, a father comes before its child."""
    names = ("x", "y", "z", "rx", "ry", "rz")
    lines = [f"fB.trsf.{n}={v}" for n, v in zip(names, frame, strict=True)]
    lines += [f"pQ.trsf.{n}={v}" for n, v in zip(names, point, strict=True)]
    lines += ["tr={" + ",".join(map(str, by)) + "}", to("appro(pQ,tr)"), to("compose(pQ,fPart,tr)")]
    made = read(*lines)
    (a, A), (b, B), (c, C) = matrix(frame), matrix(point), matrix(by)
    p, R = a + A.apply(b), A * B
    assert made.Rs_part_tcp is not None
    np.testing.assert_allclose(made.motions[1].p_end / MM, p + R.apply(c), atol=1e-6)
    np.testing.assert_allclose(made.Rs_part_tcp[1], (R * C).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(made.motions[2].p_end / MM, c + C.apply(p), atol=1e-6)
    np.testing.assert_allclose(made.Rs_part_tcp[2], (C * R).as_matrix(), atol=1e-9)


def test_a_joint_between_cuts_follows_from_the_cell() -> None:
    asked: list[tuple[float, ...]] = []

    def tip(axes_deg, external):  # type: ignore[no-untyped-def]
        asked.append(tuple(axes_deg))
        return pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))

    text = program(HEAD, to("p[1]"), "movej(jA,tMill,mRun)", to("p[2]"))
    made = read_val3(text, data=files(), cell=cell(tip_of_axes=tip))
    assert ends(made) == [(10, 0, 0, 50), (500, 250, 125, 0), (20, 0, 0, 50)]
    assert asked == [(1, 2, 3, 4, 5, 6)]
    with pytest.raises(ProgramError, match="by axes"):
        read_val3(text, data=files())


def by_axes(*lines: str) -> Val3Program:
    """A program for a cell that knows where axes lead: jA to (500, 250, 125) mm."""
    T = pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))
    return read_val3(program(*lines), data=files(), cell=cell(tip_of_axes=lambda *_: T))


AWAY = "movej(jA,tMill,mRun)"


def test_rest_postures_around_the_path_are_no_motions_of_it() -> None:
    """Before the first Cartesian target and behind the last one, waits there included."""
    wait = ("waitEndMove()", "delay(1)")
    plain, rested = by_axes(HEAD, to("p[1]")), by_axes(AWAY, *wait, AWAY, HEAD, to("p[1]"), AWAY, *wait)
    assert [m.kind for m in rested.motions] == [m.kind for m in plain.motions] == ["rapid", "feed"]
    for a, b in zip(rested.motions, plain.motions, strict=True):
        np.testing.assert_array_equal(a.p_start, b.p_start)
        np.testing.assert_array_equal(a.p_end, b.p_end)


def test_between_cuts_every_stop_by_axes_is_a_motion_of_its_own_line() -> None:
    made = by_axes(HEAD, to("p[1]"), AWAY, "waitEndMove()", "delay(1.5)", AWAY, "diX=true", to("p[2]"))
    assert [(m.kind, m.duration_s) for m in made.motions[2:]] == [
        ("rapid", 0),
        ("dwell", 1.5),
        ("rapid", 0),
        ("feed", 0),
    ]
    assert [move.word for move in made.moves] == ["movej", "movel", "movej", "delay", "movej", "movel"]
    for index, (motion, move) in enumerate(zip(made.motions, made.moves, strict=True)):
        block = made.blocks[motion.block]
        assert block.line == move.line
        assert (block.first_motion, block.motion_count) == (index, 1)
    assert sum(block.motion_count for block in made.blocks) == len(made.motions)


@pytest.mark.parametrize(
    ("before", "joint"),
    [
        ("jA=jA+{1,1,1,0,0,0}", "jA"),
        ("", "{2,3,4,4,5,6}"),
        ("jA={3,4,5,4,5,6}", "jA-{1,1,1,0,0,0}"),
    ],
)
def test_joints_are_added_and_written_in_braces(before: str, joint: str) -> None:
    asked: list[tuple[float, ...]] = []

    def tip(axes_deg, external):  # type: ignore[no-untyped-def]
        asked.append(tuple(axes_deg))
        return pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.25, 0.125]))

    text = program(HEAD, *([before] if before else []), f"movej({joint},tMill,mRun)", to("p[1]"))
    read_val3(text, data=files(), cell=cell(tip_of_axes=tip))
    assert asked == [(2, 3, 4, 4, 5, 6)]


# ---- a job of several files --------------------------------------------------------------------------------------


def sub(name: str, parameters: str, *lines: str) -> str:
    """A program with parameters and a local variable."""
    head = f'<Parameters xmlns="x">\n{parameters}</Parameters>\n<Locals>\n<Local name="l_nK" type="num" '
    head += 'xsi:type="array" size="1"/>\n</Locals>\n'
    return program(*lines).replace('name="part"', f'name="{name}"').replace("<Code>", f"{head}<Code>")


def job(folder: Path, **texts: str) -> Path:
    """Program files with the data file of the first one."""
    for name, text in texts.items():
        (folder / f"{name}.pgx").write_text(text)
    (folder / f"{next(iter(texts))}.dtx").write_text(files())
    return folder / f"{next(iter(texts))}.pgx"


def test_programs_take_values_and_references(tmp_path: Path) -> None:
    cut = sub(
        "cut", '<Parameter name="x_nFeed" type="num" use="value" xsi:type="element"/>\n'
        '<Parameter name="x_p" type="pointRx" use="reference" xsi:type="array"/>\n',
        "l_nK=x_nFeed", "x_nFeed=0", "mRun.tvel=l_nK", to("x_p"), "x_p.trsf.z=x_p.trsf.z+1",
    )  # fmt: skip
    main = job(tmp_path, main=program(HEAD, "nI=20", "call cut(nI,p[1])", "call cut(nI+1,p[1])", to("p[1]")), cut=cut)
    made = read_val3_file(main)
    assert ends(made) == [(10, 0, 0, 20), (10, 0, 1, 21), (10, 0, 2, 21)]
    assert list(made.sources) == ["main.pgx", "cut.pgx"]
    with pytest.raises(ProgramError, match="has 2 parameters"):
        read_val3_file(job(tmp_path, main=program(HEAD, "call cut(nI)"), cut=cut))


def test_a_library_has_variables_of_its_own(tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    job(folder, other=program(to("p[2]")), start=program(to("p[3]"), "return"))
    main = job(tmp_path, main=program(HEAD, 'nI=lib:libLoad("./other")', "lib:p[3].trsf.z=4", "call lib:start()"))
    assert ends(read_val3_file(main)) == [(30, 10, 4, 50)]


def test_a_task_beside_may_neither_move_nor_set_what_matters(tmp_path: Path) -> None:
    lines = (HEAD, 'taskCreate "watch",10,watch()', to("p[1]"))
    assert ends(read_val3_file(job(tmp_path, main=program(*lines), watch=program("diX=true")))) == [(10, 0, 0, 50)]
    with pytest.raises(ProgramError, match="inside taskCreate"):
        read_val3_file(job(tmp_path, main=program(*lines), watch=program(to("p[1]"))))


def test_what_is_converted_in_parts_reads_back_and_is_corrected_in_its_files(tmp_path: Path) -> None:
    """Together the parts are the corrected path of the whole; nothing but points and speeds differs."""
    source = tmp_path / "long.ngc"
    moves = "".join(f"X{n} Y{n % 3}\n" for n in range(1, 31))
    source.write_text(f"G21 G90 G17 G94\nT1 M6\nS13000 M3\nG0 X0 Y0 Z50\nG1 Z34 F600\n{moves}G0 Z60\nM5\nM2\n")
    out = tmp_path / "out"
    shop = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
    conversion.run(source, shop, out, "val3", points_per_file=12)
    made = read_val3_file(out / "long.pgx")
    assert len(made.sources) == 4
    parts = [name for name in made.sources if name != "long.pgx"]
    assert [file.name for file in companions(out / "long.pgx")] == ["long.dtx", *parts]
    whole = np.array([(n, n % 3, 34.0) for n in range(1, 31)])
    np.testing.assert_allclose(np.array([m.p_end for m in made.motions])[-31:-1] / MM, whole, atol=1e-3)
    compensated = corrected(made, 200.0 * UM, 9.0)
    text = write_val3_in_place(made, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    assert set(text.files) == {*made.sources, "long.dtx"}
    for name, content in text.files.items():
        (out / name).write_text(content)
    reached = np.array([motion.p_end for motion in read_val3_file(out / "long.pgx").motions])
    fed = np.array([motion.kind == "feed" for motion in made.motions])[compensated.path.motion]
    assert gap_to_polyline(compensated.p_part_command[fed], reached) < 5.1 * UM


def test_speeds_that_the_program_changes() -> None:
    """A monitor speed and a computed tvel: the force depends on them, so they are refused."""
    lines = ("setMonitorSpeed(30)", to("p[1]"))
    with pytest.raises(ProgramError, match=r"part.pgx:6:3: setMonitorSpeed"):
        read(*lines)
    with pytest.raises(ProgramError, match=r"part.pgx:7:3: the speed of a motion .mRun\[1\]. is not known: nSpeed"):
        read("mRun[1].tvel=nSpeed", "nI=movel(p[1],tMill[0],mRun[1])")


def test_a_computed_target_is_written_as_a_point() -> None:
    made = read(to("appro(p[1],tr)"), to("p[2]"), to("pQ"))
    compensated = corrected(made, 300.0 * UM, 0.0)
    text = write_val3_in_place(made, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    assert "appro" not in text.files["part.pgx"]
    back = read_val3(text.files["part.pgx"], data=text.files["part.dtx"])
    reached = np.array([motion.p_end for motion in back.motions])
    assert gap_to_polyline(compensated.p_part_command[1:], reached) < 5.1 * UM


def test_a_statement_that_runs_twice_is_not_corrected() -> None:
    made = read("for nI=1 to 3", to("p[nI]"), "endFor")
    assert not made.straight
    with pytest.raises(ProgramError, match="runs more than once is corrected.*convert"):
        write_val3_in_place(made, corrected(made, 3000.0 * UM, 3.0))


# ---- the form of s6 ----------------------------------------------------------------------------------------------

OLD_DATA = """<?xml version="1.0" encoding="utf-8"?>
<dataList xmlns="DataNameSpace">
  <dioSection><dio size="1" name="dOut" public="false" /></dioSection>
  <frameSection>
    <frame name="fPart" public="false">
      <fFather alias="" name="world" fatherIndex="0" />
      <valueFrame index="0"><tfValue x="100" y="0" z="0" rx="0" ry="0" rz="90" /></valueFrame>
    </frame>
  </frameSection>
  <mdescSection>
    <mdesc name="mRun" public="true">
      <valueMdesc index="0"><mdescValue vel="75" tmax="50" rmax="9" blend="off" leave="1" reach="1" />
      </valueMdesc>
    </mdesc>
  </mdescSection>
  <numSection><num name="nI" public="false"><valueNum value="2" index="0" /></num></numSection>
  <pointSection>
    <point name="p" public="false">
      <pFather alias="" name="fPart" fatherIndex="0" />
      <valuePoint index="0"><tpValue x="0" y="0" z="50" rx="180" ry="0" rz="0" />
        <cpValue shoulder="righty" elbow="esame" wrist="wsame" /></valuePoint>
      <valuePoint index="1"><tpValue x="10" y="0" z="0" rx="180" ry="0" rz="0" />
        <cpValue shoulder="righty" /></valuePoint>
      <valuePoint index="2"><tpValue x="10" y="10" z="0" rx="180" ry="0" rz="0" />
        <cpValue shoulder="righty" /></valuePoint>
    </point>
  </pointSection>
  <toolSection>
    <tool name="tMill" public="false">
      <tFather alias="" name="flange" fatherIndex="0" />
      <valueTool index="0"><ttValue x="0" y="0" z="100" rx="0" ry="0" rz="0" /><io alias="io" name="valve1" open="0" />
      </valueTool>
    </tool>
  </toolSection>
</dataList>
"""
OLD_PROGRAM = """<?xml version="1.0" encoding="utf-8"?>
<programList xmlns="ProgramNameSpace">
  <program name="start" public="false">
    <description /><paramSection /><localSection />
    <source>
      <code>begin
  putln(&quot;begin&quot;)
  movej(p[0],tMill,mRun)
  if nI&gt;1 and nI&lt;3
    movel(p[1],tMill,mRun)
  endIf
  movel(p[nI],tMill,mRun)
end
      </code>
    </source>
  </program>
</programList>
"""


def test_the_form_of_s6_is_read_and_written_back() -> None:
    made = read_val3(OLD_PROGRAM, name="start.pgx", data=OLD_DATA, data_name="app.dtx", cell=cell())
    assert ends(made) == [(10, 0, 0, 50), (10, 10, 0, 50)]
    compensated = corrected(made, 300.0 * UM, 9.0)
    text = write_val3_in_place(made, compensated, tolerance_m=5.0 * UM, cycle_s=1e-4)
    back = read_val3(text.files["start.pgx"], data=text.files["app.dtx"], cell=cell())
    reached = np.array([motion.p_end for motion in back.motions])
    assert gap_to_polyline(compensated.p_part_command[1:], reached) < 5.1 * UM
    assert text.vertices_added > 0
    assert "<point name=" in text.files["app.dtx"].split("pCounterflex")[0]


def test_a_point_of_the_world_by_link() -> None:
    by_name = read("link(p[1],world)", to("p[1]"))
    by_frame = read("fW.trsf={0,0,0,0,0,0}", "link(p[1],fW)", to("p[1]"))
    assert ends(by_name) == ends(by_frame)
    assert ends(by_name) != ends(read(to("p[1]")))
