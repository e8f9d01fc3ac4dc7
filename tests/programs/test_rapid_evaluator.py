"""RAPID that computes: data, routines, loops, conditions, frames; what is not known is refused with both lines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.frames import RapidCell
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.programs.approximation import approximation_m
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
P10 = f"CONST robtarget p10:=[[0,0,0],[0,1,0,0],{REST}];\n"
J10 = "CONST jointtarget j10:=[[10,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
START = "MoveJ p10,v100,fine,tool0;\n"


def read(body: str, declared: str = "", routines: str = "", cell: RapidCell | None = None) -> RapidProgram:
    """A module whose main routine begins at p10, the origin."""
    text = f"MODULE m\n{P10}{J10}{declared}\nPROC main()\n{START}{body}\nENDPROC\n{routines}\nENDMODULE\n"
    return read_rapid(text, name="m.mod", cell=cell)


def ends(program: RapidProgram) -> list[list[float]]:
    """Ends of the motions behind the first, mm."""
    return [[round(float(x) / MM, 6) for x in motion.p_end] for motion in program.motions[1:]]


def at(x: str, y: str = "0", z: str = "0") -> str:
    return f"MoveL Offs(p10,{x},{y},{z}),v20,fine,tool0;\n"


RECORD = (
    "RECORD hole\npos place;\nnum depth;\nENDRECORD\nVAR hole h:=[[1,2,3],4];\n"
    "VAR hole two{2}:=[[[1,0,0],1],[[2,0,0],2]];\n"
)


@pytest.mark.parametrize(
    ("body", "declared", "routines", "wanted"),
    [
        (f"d:=d+2*3;\n{at('d')}", "VAR num d:=1;", "", [[7, 0, 0]]),
        (at("-DEPTH", "DEPTH DIV 2", "DEPTH MOD 2"), "CONST num DEPTH:=5;", "", [[-5, 2, 1]]),
        (f"Incr n;\nAdd n,-3.5;\n{at('n')}Decr n;\n{at('n')}Clear n;\n{at('n')}", "VAR num n:=5;", "",
         [[2.5, 0, 0], [1.5, 0, 0], [0, 0, 0]]),
        (f"FOR i FROM 3 TO 1 DO\n{at('i')}ENDFOR\nFOR i FROM 0 TO 1 STEP 0.5 DO\n{at('0', 'i')}ENDFOR", "", "",
         [[3, 0, 0], [2, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0.5, 0], [0, 1, 0]]),
        (f"WHILE n<3 DO\nn:=n+1;\nIF n=2 GOTO on;\n{at('n')}on:\nENDWHILE", "VAR num n:=0;", "", [[1, 0, 0], [3, 0,
         0]]),
        (f"TEST n\nCASE 1,2:\n{at('1')}CASE 3:\n{at('3')}DEFAULT:\n{at('9')}ENDTEST", "VAR num n:=3;", "", [[3, 0, 0]]),
        (f"IF n>3 THEN\n{at('1')}ELSEIF n=3 AND NOT n=4 THEN\n{at('2')}ELSE\n{at('3')}ENDIF", "VAR num n:=3;", "",
         [[2, 0, 0]]),
        (f"IF deep Cut 5;\nIF NOT deep Cut 6;\nIF deep d:=20;\n{at('d')}", "VAR bool deep:=TRUE;\nVAR num d:=1;",
         f"PROC Cut(num x)\n{at('x')}ENDPROC", [[5, 0, 0], [20, 0, 0]]),
        ("Cut 1,2\\z:=3;\nCut 1,2\\up;\nCut 1,2;", "",
         f"PROC Cut(num x,num y\\num z|switch up)\nVAR num h:=0;\nIF Present(z) h:=z;\nIF Present(up) h:=50;\n"
         f"{at('x', 'y', 'h')}ENDPROC",
         [[1, 2, 3], [1, 2, 50], [1, 2, 0]]),
        (f"Twice n;\n{at('n')}Kept n;\n{at('n')}", "VAR num n:=4;",
         "PROC Twice(INOUT num x)\nx:=2*x;\nENDPROC\nPROC Kept(num x)\nx:=99;\nENDPROC", [[8, 0, 0], [8, 0, 0]]),
        (at("half(area(3,4))"), "",
         "FUNC num area(num a,num b)\nRETURN a*b;\nENDFUNC\nFUNC num half(num a)\nIF a<0 RETURN 0;\n"
         "RETURN a/2;\nENDFUNC",
         [[6, 0, 0]]),
        ("p20:=p10;\np20.trans.z:=7;\np20.trans:=p20.trans+[1,2,0];\nMoveL p20,v20,fine,tool0;\n"
        "MoveL p10,v20,fine,tool0;",
         "VAR robtarget p20;", "", [[1, 2, 7], [0, 0, 0]]),
        (f"{at('h.place.x', 'two{2}.depth', 'h.depth')}two{{1}}.place.y:=8;\n{at('two{1}.place.y')}", RECORD, "",
         [[1, 2, 4], [8, 0, 0]]),
        ("FOR i FROM 1 TO Dim(q,1) DO\nMoveL q{i},v20,z1,tool0;\nENDFOR",
         f"CONST robtarget q{{2}}:=[[[1,1,1],[0,1,0,0],{REST}],[[2,2,2],[0,1,0,0],{REST}]];", "", [[1, 1, 1], [2, 2,
          2]]),
        (at("m{2,1}"), "CONST num m{2,2}:=[[1,2],[3,4]];", "", [[3, 0, 0]]),
        (f"PDispSet [[0,0,10],[1,0,0,0]];\n{at('1')}PDispOff;\n{at('2')}", "", "", [[1, 0, 10], [2, 0, 0]]),
        (f"PDispSet [[5,0,0],OrientZYX(90,0,0)];\n{at('1', '2')}", "", "", [[3, 1, 0]]),
        (f"PDispOn \\ExeP:=Offs(p10,1,2,3),p10,tool0;\n{at('1')}", "", "", [[2, 2, 3]]),
        ("MoveL RelTool(p10,0,0,5),v20,fine,tool0;\nMoveL Offs(RelTool(p10,1,0,0\\Rz:=90),0,0,2),v20,fine,tool0;", "",
         "",
         [[0, 0, -5], [1, 0, 2]]),
        ("MoveL [PoseVect(PoseMult(a,PoseInv(a)),[3,4,5]),o,c,e],v20,fine,tool0;",
         "CONST pose a:=[[1,2,3],[0.5,0.5,0.5,0.5]];\nCONST orient o:=[0,1,0,0];\nVAR confdata c:=[0,0,0,0];\n"
         "VAR extjoint e:=[9E9,9E9,9E9,9E9,9E9,9E9];", "", [[3, 4, 5]]),
        ("f:=DefFrame(Offs(p10,1,0,0),Offs(p10,1,5,0),Offs(p10,1,0,5)\\Origin:=1);\nPDispSet f;\n" + at("1", "2", "3"),
         "VAR pose f;", "", [[4, 1, 2]]),
        (at("Round(2.346\\Dec:=2)", "Sqrt(16)+Abs(-1)", "ATan2(1,1)/45"), "", "", [[2.35, 5, 1]]),
        ('%"Cut"+NumToStr(2,0)%;\nCallByVar "Cut",1;', "",
         f"PROC Cut1()\n{at('1')}ENDPROC\nPROC Cut2()\n{at('2')}ENDPROC", [[2, 0, 0], [1, 0, 0]]),
        (f"again:\nn:=n+1;\n{at('n')}IF n<3 GOTO again;", "VAR num n:=0;", "", [[1, 0, 0], [2, 0, 0], [3, 0, 0]]),
        (f"{at('1')}EXIT;\n{at('2')}", "", "", [[1, 0, 0]]),
        (f"Cut;\n{at('3')}", "", f"PROC Cut()\n{at('1')}RETURN;\n{at('2')}ENDPROC", [[1, 0, 0], [3, 0, 0]]),
        ("MoveLDO Offs(p10,1,0,0),v20,z1,tool0,do1,1;\nTriggL Offs(p10,2,0,0),v20,t1\\T2:=t2,z1,tool0;\n"
         "MoveLSync Offs(p10,3,0,0),v20,z1,tool0,\"beep\";", "", "PROC beep()\nSet do1;\nENDPROC",
         [[1, 0, 0], [2, 0, 0], [3, 0, 0]]),
        ("Cut p10;", "",
         "PROC Cut(robtarget p)\np.trans.x:=4;\nMoveL p,v20,fine,tool0;\nMoveL p10,v20,fine,tool0;\nENDPROC",
         [[4, 0, 0], [0, 0, 0]]),
        (f"WHILE TestDI(di1) DO\nWaitTime 0.1;\nENDWHILE\nIF di2=1 THEN\nTPWrite \"x\";\nEXIT;\nENDIF\n{at('1')}", "",
         "",
         [[1, 0, 0]]),
        (f"wait:\nIF di2=0 GOTO wait;\n{at('1')}", "", "", [[1, 0, 0]]),
        ("ActUnit STN_1;\nMoveExtJ [[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine;\n" + at("1"), "", "", [[1, 0,
         0]]),
    ],
)  # fmt: skip
def test_what_the_text_determines_is_computed(
    body: str, declared: str, routines: str, wanted: list[list[float]]
) -> None:
    assert ends(read(body, declared, routines)) == wanted


@pytest.mark.parametrize(
    ("body", "declared", "routines", "says"),
    [
        (f"TPReadNum n,\"depth\";\n{at('n')}", "VAR num n:=5;", "", ("TPReadNum sets n in m.mod:7", "m.mod:8:16")),
        (f"IF TestDI(di1) n:=20;\n{at('n')}", "VAR num n:=2;", "", ("TestDI() asks the controller in m.mod:7",
         "m.mod:8:16")),
        (f"n:=di1;\n{at('2*n+1')}", "VAR num n;", "", ("di1 is declared nowhere", "m.mod:7")),
        (f"IF di1=1 THEN\n{at('1')}ENDIF", "", "", ("a motion inside IF (m.mod:7)", "m.mod:8:1")),
        ("IF di1=1 Cut;", "", f"PROC Cut()\n{at('1')}ENDPROC", ("a routine that moves inside IF", "m.mod:7")),
        ("IF deep Cut;", "PERS bool deep:=TRUE;", f"PROC Cut()\n{at('1')}ENDPROC", ("deep is PERS", "m.mod:4")),
        (f"{at('n')}n:=n+1;", "PERS num n:=1;", "", ("what the last run left", "m.mod:4")),
        (f"WHILE n<di1 DO\n{at('1')}ENDWHILE", "VAR num n;", "", ("a motion inside WHILE", "m.mod:8:1")),
        (f"FOR i FROM 1 TO GInput(gi1) DO\n{at('i')}ENDFOR", "", "", ("a motion inside FOR", "GInput()")),
        (f"TEST di1\nCASE 1:\nVelSet 50,1000;\nENDTEST\n{at('1')}", "", "", ("sets the motions inside TEST",
         "m.mod:9:1")),
        (f"Cut;\n{at('2')}", "", f"PROC Cut()\nIF di1=1 RETURN;\n{at('1')}ENDPROC", ("m.mod:13:1", "(m.mod:12)",
         "di1 is declared")),
        (f"IF di1=1 GOTO on;\n{at('1')}on:\n{at('2')}", "", "", ("a motion inside IF", "m.mod:8:1")),
        ("MoveL CRobT(),v20,fine,tool0;", "", "", ("the target is not known: CRobT() asks the controller",
         "m.mod:7:7")),
        ("p:=CRobT();\nMoveL Offs(p,0,0,9),v20,fine,tool0;", "VAR robtarget p;", "", ("CRobT() asks", "m.mod:7")),
        ("MoveL p10,vOwn,fine,tool0;", "", "", ("the speed is not known: vOwn is declared nowhere", "m.mod:7:11")),
        ("MoveL p10,vmax,fine,tool0;", "", "", ("the speed is not known", "largest speed of the robot")),
        ("v1.v_tcp:=AInput(ai1);\nMoveL p10,v1,fine,tool0;", "VAR speeddata v1:=v20;", "", ("AInput()", "m.mod:7")),
        ("VelSet GInput(gi1),1000;", "", "", ("what VelSet sets is not known: GInput()", "m.mod:7")),
        ("PDispOn p10,tool0;", "", "", ("measures from where the robot stands", "m.mod:7:1")),
        ("SearchL di1,p20,p10,v10,tool0;", "VAR robtarget p20;", "", ("ends where a sensor says", "m.mod:7:1")),
        ("CONNECT i1 WITH t;", "VAR intnum i1;", f"TRAP t\n{at('1')}ENDTRAP", ("may move the robot", "(m.mod:10)")),
        (f"CONNECT i1 WITH t;\n{at('n')}", "VAR intnum i1;\nVAR num n;", "TRAP t\nn:=n+1;\nENDTRAP",
         ("the interrupt t may change it", "m.mod:8")),
        ("t1.tframe.trans.z:=AInput(ai1);\nMoveL p10,v20,fine,t1;",
         "PERS tooldata t1:=[TRUE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];", "",
         ("the place of the tool t1 is not known", "m.mod:7")),
        ("WHILE TRUE DO\nWaitTime 1;\nENDWHILE", "", "", ("never ends", "m.mod:7:1")),
        ("again:\nSet do1;\nGOTO again;", "", "", ("never ends", "m.mod:9:1")),
        ("Cut 1;", "", "PROC Cut(num n)\nCut n+1;\nENDPROC", ("calls itself", "30 deep")),
        ("WHILE n>0 DO\nn:=n+1;\nENDWHILE", "VAR num n:=1;", "", ("does not end", "100000 without a motion")),
        ("FOR i FROM 1 TO 5 STEP 0 DO\nSet do1;\nENDFOR", "", "", ("never ends", "m.mod:7:1")),
        ("IF 0.1+0.2=0.3 Cut;", "", f"PROC Cut()\n{at('1')}ENDPROC", ("rounding of the controller", "m.mod:7")),
        (f"q{{GInput(gi1)}}:=5;\n{at('q{1}')}", "VAR num q{2};", "", ("GInput() asks the controller in m.mod:7",
         "m.mod:8")),
        ("p.extax.eax_a:=GInput(gi1);\nMoveL p,v20,fine,tool0;", "VAR robtarget p:=p10;", "", ("external axes",
         "m.mod:7")),
        (at("q{3}"), "VAR num q{2};", "", ("elements 1 to 2, 3 is none", "m.mod:7")),
        (at("h.deep"), RECORD, "", ("has no component deep", "m.mod:")),
        (at("1/0"), "", "", ("a division by zero", "m.mod:7")),
        (at('"a"'), "", "", ("is no number", "m.mod:7")),
        ("Cut 1,2;", "", "PROC Cut(num x)\nENDPROC", ("has no such argument", "m.mod:7")),
        ("Load \\Dynamic,\"HOME:/part.mod\";\n%\"part\"%;", "", "", ("the routine part is not in the files",
         "m.mod:8")),
        ("MoveL p10,v20,z1,tool0\\WObj:=wA;\nMoveL p10,v20,z1,tool0\\WObj:=wB;", "", "",
         ("where one lies in the other", "m.mod:")),
        ("EOffsSet [100,0,0,0,0,0];", "", "", ("moves external axes", "m.mod:7")),
        ("MoveLSync p10,v20,z1,tool0,\"Cut\";", "", f"PROC Cut()\n{at('1')}ENDPROC",
         ("runs in the middle of the motion", "m.mod:7")),
        ("RAISE 5;", "", "", ("the handler of errors", "m.mod:7")),
    ],
)  # fmt: skip
def test_what_is_not_known_is_refused_with_both_lines(
    body: str, declared: str, routines: str, says: tuple[str, ...]
) -> None:
    with pytest.raises(ProgramError) as fault:
        read(body, declared, routines)
    assert "\n" not in str(fault.value)
    for part in says:
        assert part in str(fault.value)
    assert fault.value.hint


def test_dividend_is_divisor_times_quotient_and_remainder() -> None:
    """For whole numbers of either sign; the quotient is cut towards zero, so the remainder has the dividend's sign."""
    pairs = [(a, b) for a in range(-7, 8) for b in (-3, -2, 2, 3)]
    body = "".join(f"a:={a};\nb:={b};\n{at('a MOD b', 'a DIV b')}" for a, b in pairs)
    for (a, b), (rest, quotient, _) in zip(pairs, ends(read(body, "VAR num a;\nVAR num b;")), strict=True):
        assert b * quotient + rest == a
        assert abs(rest) < abs(b)
        assert rest * a >= 0


def test_speeds_times_overrides_and_zones() -> None:
    made = read(
        "MoveJ Offs(p10,0,0,9),vmax,z50,tool0;\nVelSet 50,300;\nMoveL Offs(p10,10,0,9),v100,z10,tool0;\n"
        "MoveL Offs(p10,20,0,9),v1000,zOwn,tool0;\nVelSet 100,5000;\nMoveL Offs(p10,30,0,9),v20\\T:=2,z1\\Z:=3,tool0;\n"
        "MoveC Offs(p10,35,5,9),Offs(p10,40,0,9),v20\\T:=2,fine,tool0;\nWaitTime\\InPos,0.5;\nWaitTime \\InPos,wait;\n",
        "CONST zonedata zOwn:=[FALSE,7,7,7,0.7,7,0.7];\nCONST num wait:=0.25;",
    )
    assert [motion.kind for motion in made.motions] == [
        "rapid",
        "rapid",
        "feed",
        "feed",
        "feed",
        "arc",
        "dwell",
        "dwell",
    ]
    np.testing.assert_allclose([m.feed_m_s for m in made.motions[2:6]], [0.05, 0.3, 0.005, 0.005 * math.pi / 2])
    assert [motion.duration_s for motion in made.motions[6:]] == [0.5, 0.25]
    np.testing.assert_allclose(approximation_m(made)[:6], np.array([0.0, 50, 10, 7, 3, 0]) * MM)


def test_orientations_are_those_of_another_library() -> None:
    made = read(
        "MoveL [[0,0,0],OrientZYX(30,-20,10),c,e],v20,fine,tool0;\n"
        "MoveL RelTool([[0,0,0],OrientZYX(30,-20,10),c,e],1,2,3\\Rx:=5\\Ry:=-6\\Rz:=7),v20,fine,tool0;\n"
        "MoveL [[0,0,0],OrientZYX(EulerZYX(\\Z,o),EulerZYX(\\Y,o),EulerZYX(\\X,o)),c,e],v20,fine,tool0;",
        "VAR confdata c;\nVAR extjoint e:=[9E9,9E9,9E9,9E9,9E9,9E9];\nCONST orient o:=[0.5,-0.5,0.5,0.5];",
    )
    assert made.Rs_part_tcp is not None
    first = Rotation.from_euler("ZYX", [30, -20, 10], degrees=True)
    np.testing.assert_allclose(made.Rs_part_tcp[1], first.as_matrix(), atol=1e-12)
    turned = first * Rotation.from_euler("XYZ", [5, -6, 7], degrees=True)
    np.testing.assert_allclose(made.Rs_part_tcp[2], turned.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(made.motions[2].p_end / MM, first.apply([1, 2, 3]), atol=1e-9)
    np.testing.assert_allclose(made.Rs_part_tcp[3], Rotation.from_quat([-0.5, 0.5, 0.5, 0.5]).as_matrix(), atol=1e-9)


def test_work_objects_without_a_cell_lie_where_they_are_declared() -> None:
    """Most motions are in the part frame; a motion in another declared work object is brought into it."""
    frames = "".join(
        f'PERS wobjdata {name}:=[FALSE,TRUE,"",[[{x},0,0],[1,0,0,0]],[[0,0,{z}],[1,0,0,0]]];\n'
        for name, x, z in (("wA", 100, 0), ("wB", 150, 5))
    )
    body = "".join(f"MoveL Offs(p10,{x},0,0),v20,z1,tool0\\WObj:={w};\n" for x, w in ((1, "wB"), (2, "wA"), (3, "wA")))
    made = read_rapid(f"MODULE m\n{P10}{frames}PROC main()\n{body}ENDPROC\nENDMODULE\n")
    assert [[round(float(x) / MM, 6) for x in m.p_end] for m in made.motions] == [[51, 0, 5], [2, 0, 0], [3, 0, 0]]


def cell_with_robot() -> RapidCell:
    """A robot whose tip moves 1 mm along x for each degree of axis 1."""
    return RapidCell(
        where="cell.toml", tools=[1], tool_of_data={}, work_object="", T_base_tcp=None, T_flange_tcp=np.eye(4),
        T_base_part=np.eye(4), functions=MachineFunctions("rapid", {}),
        tip_of_axes=lambda axes, _: pose.make(Rotation.from_euler("x", 180, degrees=True).as_matrix(),
         np.array([axes[0] * MM, 0, 0])),
    )  # fmt: skip


def test_axes_between_cuts_are_a_place_of_the_cell() -> None:
    body = f"{at('1')}MoveAbsJ j10,v100,fine,tool0;\n{at('20')}MoveAbsJ j10\\NoEOffs,v100,fine,tool0;"
    made = read(body, cell=cell_with_robot())
    assert ends(made) == [[1, 0, 0], [10, 0, 0], [20, 0, 0]]
    assert [motion.kind for motion in made.motions] == ["rapid", "feed", "rapid", "feed"]
    assert len(made.moves) == len(made.motions)
    with pytest.raises(ProgramError, match="Give --cell"):
        read(body)


def test_each_stop_by_axes_between_cuts_is_a_motion_and_one_behind_is_left_out() -> None:
    rest = "MoveAbsJ [[30,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"
    body = f"{at('1')}\nMoveAbsJ j10,v100,fine,tool0;\n{rest}{at('20')}\n{rest}"
    made = read(body, cell=cell_with_robot())
    assert ends(made) == [[1, 0, 0], [10, 0, 0], [30, 0, 0], [20, 0, 0]]
    texts = [made.lines[int(place.rpartition(":")[2]) - 1] for place in made.left_out]
    assert [text.strip() for text in texts] == [rest.strip()]


# ---- against Python ------------------------------------------------------------------------------------------------


@st.composite
def computations(draw: st.DrawFn) -> tuple[str, str]:
    """The same program in RAPID and in Python: assignments, branches, loops, a routine; both note positions."""
    names = ["a", "b", "c"]
    value = st.one_of(st.integers(-9, 9).map(str), st.sampled_from(names))
    term = st.builds(lambda x, op, y: f"({x}{op}{y})", value, st.sampled_from("+-*"), value)

    def block(depth: int) -> list[tuple[str, str]]:
        out = []
        for _ in range(draw(st.integers(1, 3))):
            kind = draw(st.sampled_from(["set", "move", "if", "for", "call"] if depth else ["set", "move"]))
            name, expression = draw(st.sampled_from(names)), draw(term)
            capped = f"Min(50,Max(-50,{expression}))"
            if kind == "set":
                out.append((f"{name}:={capped};", f"{name}={capped.lower()}"))
            elif kind == "move":
                out.append((at(name, expression).strip(), f"note({name},{expression})"))
            elif kind == "call":
                out.append((f"Cut {name},{expression};", f"{name}=cut({name},{expression})"))
            else:
                inner = block(depth - 1)
                rapid = "\n".join(line for line, _ in inner)
                python = "\n".join("    " + line.replace("\n", "\n    ") for _, line in inner)
                if kind == "if":
                    other = draw(st.sampled_from(names))
                    out.append((f"IF {name}<{other} THEN\n{rapid}\nENDIF", f"if {name}<{other}:\n{python}"))
                else:
                    last = draw(st.integers(0, 3))
                    out.append(
                        (f"FOR i FROM 1 TO {last} STEP 1 DO\n{rapid}\nENDFOR", f"for i in range(1,{last}+1):\n{python}")
                    )
        return out

    made = block(2)
    return "\n".join(line for line, _ in made), "\n".join(line for _, line in made)


@settings(max_examples=60, deadline=None)
@given(computations())
def test_programs_do_what_the_same_in_python_does(both: tuple[str, str]) -> None:
    rapid, python = both
    noted: list[list[float]] = []

    def cut(x: float, y: float) -> float:
        noted.append([x, y, 1])
        return x - 1

    exec(
        python,
        {"note": lambda x, y: noted.append([x, y, 0]), "cut": cut, "min": min, "max": max, "a": 1, "b": 2, "c": 3},
    )
    routine = f"PROC Cut(INOUT num x,num y)\n{at('x', 'y', '1')}x:=x-1;\nENDPROC"
    assert ends(read(rapid, "VAR num a:=1;\nVAR num b:=2;\nVAR num c:=3;", routine)) == noted


# ---- routines, arguments, machine functions ------------------------------------------------------------------------


def test_arguments_that_are_passed_on_or_left_out() -> None:
    frames = (
        "PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        'PERS wobjdata wA:=[FALSE,TRUE,"",[[100,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
        'PERS wobjdata wB:=[FALSE,TRUE,"",[[100,0,7],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
    )
    routines = (
        "PROC outer(robtarget p,PERS tooldata t\\PERS wobjdata w|switch none\\num v)\ninner p,t\\w?w\\v?v;\nENDPROC\n"
        "PROC inner(robtarget p,PERS tooldata t\\PERS wobjdata w\\num v)\nVAR speeddata s:=v20;\n"
        "IF Present(v) s.v_tcp:=v;\nMoveL p,s,fine,t\\WObj?w;\nENDPROC\n"
    )
    body = "outer p10,tA\\w:=wA\\v:=33;\nouter p10,tA\\w:=wB;\nouter Offs(p10,1,0,0),tA\\w:=wA;\n"
    text = (
        f"MODULE m\n{P10}{frames}PROC main()\nMoveJ p10,v100,fine,tA\\WObj:=wA;\n{body}ENDPROC\n{routines}ENDMODULE\n"
    )
    made = read_rapid(text)
    assert ends(made) == [[0, 0, 0], [0, 0, 7], [1, 0, 0]]
    np.testing.assert_allclose([m.feed_m_s / MM for m in made.motions[1:]], [33, 20, 20])


def spindle() -> RapidCell:
    return RapidCell(
        where="cell.toml", tools=[1], tool_of_data={"TOOL0": 1}, work_object="", T_base_tcp=None,
        T_flange_tcp=np.eye(4), T_base_part=np.eye(4),
        functions=MachineFunctions("rapid", {3: ["SetAO aoSpeed,{s};", "Set doOn;"], 5: ["Reset doOn;"]}),
    )  # fmt: skip


def test_a_spindle_speed_that_is_computed() -> None:
    declared = "VAR num rpm:=9000;\nVAR bool mill:=TRUE;"
    body = (
        f"SetAO aoSpeed,rpm;\nSet doOn;\n{at('1')}rpm:=rpm/2;\nSetAO aoSpeed,rpm+500;\nSet doOn;\n{at('2')}"
        f"IF mill Reset doOn;\n{at('3')}"
    )
    made = read(body, declared, cell=spindle())
    np.testing.assert_allclose([m.spindle_rad_s * 30 / math.pi for m in made.motions], [0, 9000, 5000, 0])
    with pytest.raises(
        ProgramError, match=r"number of this machine function is not known: GInput\(\) asks .* m\.mod:8"
    ):
        read(f"rpm:=GInput(gi1);\nSetAO aoSpeed,rpm;\nSet doOn;\n{at('1')}", declared, cell=spindle())
    with pytest.raises(ProgramError, match="sets the motions inside IF"):
        read(f"IF di1=1 Reset doOn;\n{at('1')}", declared, cell=spindle())


def test_only_what_the_program_may_execute_makes_persistent_data_unknown() -> None:
    declared = "PERS num depth:=3;"
    unused = "PROC calibrate()\ndepth:=depth+1;\nENDPROC"
    assert ends(read(at("depth"), declared, unused)) == [[3, 0, 0]]
    with pytest.raises(ProgramError, match="what the last run left"):
        read(f"{at('depth')}calibrate;", declared, unused)


def test_persistent_data_is_known_where_every_run_is_the_same() -> None:
    """Set to a number behind its first use, the second run is as the first if that number is the declared one."""
    declared = "PERS num depth:=3;"
    assert ends(read(f"{at('depth')}depth:=5-2;\n{at('depth')}", declared)) == [[3, 0, 0], [3, 0, 0]]
    for change in ("depth:=4;", "depth:=depth+1;", "Incr depth;"):
        with pytest.raises(ProgramError, match="what the last run left"):
            read(f"{at('depth')}{change}\n", declared)


def test_many_points_of_an_array_take_no_longer_each() -> None:
    """The array is divided once, not for each point: 1500 points of one loop."""
    points = ",".join(f"[[{i},0,0],[0,1,0,0],{REST}]" for i in range(1500))
    made = read(
        "FOR i FROM 1 TO Dim(q,1) DO\nMoveL q{i},v20,z1,tool0;\nENDFOR", f"CONST robtarget q{{1500}}:=[{points}];"
    )
    assert len(made.motions) == 1501
    assert not any(move.target.shared for move in made.moves[1:] if move.target is not None)
