"""KRL jobs as an evaluator reads them: values, routines, loops, conditions, frames, several files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.program import KrlProgram
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.reader import job_files, read_krl, read_krl_file
from counterflex.integrations.kuka.language.read.table import TABLE
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.statement_table import Treatment

DOWN = "A 0.0,B 0.0,C 180.0"
FRAMES = "$BASE=BASE_DATA[1]\n$TOOL=TOOL_DATA[1]\n$VEL.CP=0.02\n"
FIRST = f"LIN {{X 0,Y 0,Z 10,{DOWN}}}\n"
PART = pose.make(None, np.array([1.35, -0.03, 1.0]))
TOOL = pose.make(None, np.array([0.0, 0.0, 0.2]))


def cell(**changes: object) -> KrlCell:
    """A cell whose part stands at X 1350, Y -30, Z 1000 and whose tool is 200 mm long."""
    about = {
        "where": "cell.toml", "tool_number": 1, "base_number": 1, "tools": [1], "tool_of_data": {},
        "T_flange_tcp": TOOL, "T_base_part": PART, "functions": MachineFunctions("krl", {3: [], 5: [], 6: []}),
    }  # fmt: skip
    return KrlCell(**(about | changes))  # type: ignore[arg-type]


def job(body: str, *, data: str = "", frames: str = FRAMES, subs: str = "", at: KrlCell | None = None,
        folder: dict[str, str] | None = None) -> KrlProgram:  # fmt: skip
    """A program with its frames and speed set."""
    text = f"DEF p( )\n{frames}{body}\nEND\n{subs}"
    listed = f"DEFDAT p\n{data}\nENDDAT\n" if data else None
    return read_krl(text, name="p.src", data=listed, data_name="p.dat", cell=at, folder=folder)


def ends(program: KrlProgram) -> list[list[float]]:
    """X Y Z in mm of the end of each motion."""
    return [[round(float(v) * 1e3, 6) for v in motion.p_end] for motion in program.motions]


def xs(program: KrlProgram) -> list[float]:
    """X in mm of the end of each motion."""
    return [end[0] for end in ends(program)]


def refusal(body: str, **options: object) -> str:
    """The message with which a program is refused, one line."""
    with pytest.raises(ProgramError) as fault:
        job(body, **options)  # type: ignore[arg-type]
    assert "\n" not in str(fault.value)
    return str(fault.value)


# ---- values ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "x"),
    [
        ("N=10/4\nLIN {X N}", 2.0),  # INT / INT
        ("N=10.0/4\nLIN {X N}", 2.5),
        ("DECL INT C\nC=10.0/4.0\nLIN {X C}", 3.0),  # INT rounds
        ("N='HF'\nLIN {X N}", 15.0),
        ("N='B101' B_OR 'B10'\nLIN {X N}", 7.0),
        ("N=2+3*4\nLIN {X N}", 14.0),
        ("N=-2\nLIN {X -N+3}", 5.0),
        ("N=SQRT(16.0)+ABS(-1)\nLIN {X N}", 5.0),
        ("N=10*SIN(30)\nLIN {X N}", 5.0),
        ("N=ATAN2(-1,0)\nLIN {X N}", 270.0),
        ("DECL FRAME F\nF={X 7,Y 1,Z 2,A 0,B 0,C 180}\nLIN F", 7.0),
        (f"DECL FRAME F[3]\nF[2]={{X 7,Y 0,Z 0,{DOWN}}}\nI=2\nLIN F[I]", 7.0),
        (f"P={{X 7,Y 0,Z 0,{DOWN}}}\nP.X=P.X+1\nLIN P", 8.0),
        (f"P={{X 7,Y 0,Z 0,{DOWN}}}\nQ=P\nP.X=1\nLIN Q", 7.0),  # records are copied
        (f"S.P={{X 7,Y 0,Z 0,{DOWN}}}\nLIN S.P", 7.0),
        (f"LIN {{X 5,Y 0,Z 10,{DOWN}}}:{{X 2}}", 7.0),
        (f"LIN {{X 5,Y 0,Z 10,{DOWN}}}:INV_POS({{X 2}})", 3.0),
        ("IF (1==1) AND NOT (2<1) THEN\nLIN {X 1}\nELSE\nLIN {X 2}\nENDIF", 1.0),
        ("SWITCH 3\nCASE 1,2\nLIN {X 1}\nCASE 3,4\nLIN {X 3}\nDEFAULT\nLIN {X 9}\nENDSWITCH", 3.0),
        ("M=#FAST\nSWITCH M\nCASE #SLOW\nLIN {X 1}\nCASE #FAST\nLIN {X 3}\nENDSWITCH", 3.0),
        ("SWITCH 7\nCASE 1\nLIN {X 1}\nDEFAULT\nLIN {X 9}\nENDSWITCH", 9.0),
        ("GOTO OVER\nLIN {X 1}\nOVER:\nLIN {X 2}", 2.0),
        ("N=1\nAGAIN:\nN=N+1\nIF N<4 THEN\nGOTO AGAIN\nENDIF\nLIN {X N}", 4.0),
        ("LIN {X 4}\nLIN_REL {X 3}", 7.0),
        ("LIN {X 4}\nLIN_REL {X 3} C_DIS #BASE", 7.0),
        ("LIN {X 4}\nP=$POS_ACT\nP.X=P.X+3\nLIN P", 7.0),
        ("LIN {X 4}\nPTP $POS_ACT", 4.0),
        ("WAIT SEC(0.0)\nIF(1==1)THEN\nLIN {X 4}\nENDIF", 4.0),
    ],
)  # fmt: skip
def test_values_are_computed(body: str, x: float) -> None:
    assert xs(job(FIRST + body))[-1] == pytest.approx(x)


@settings(max_examples=60, deadline=None)
@given(
    base=st.tuples(*(st.floats(-500, 500),) * 3, *(st.floats(-170, 170),) * 3),
    target=st.tuples(*(st.floats(-500, 500),) * 3, *(st.floats(-170, 170),) * 3),
)
def test_the_geometric_operator_composes_poses(base: Sequence[float], target: Sequence[float]) -> None:
    """``base:target`` as a product of rotations about z, y and x that are written out here."""

    def matrix(values: Sequence[float]) -> Float:
        a, b, c = (math.radians(v) for v in values[3:])
        about_z = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
        about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
        about_x = np.array([[1, 0, 0], [0, math.cos(c), -math.sin(c)], [0, math.sin(c), math.cos(c)]])
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = about_z @ about_y @ about_x, values[:3]
        return out

    def literal(values: Sequence[float]) -> str:
        return "{" + ",".join(f"{letter} {value:.9f}" for letter, value in zip("XYZABC", values, strict=True)) + "}"

    made = job(f"{FIRST}B={literal(base)}\nLIN B:{literal(target)}\n$BASE=BASE_DATA[1]:B\nLIN {literal(target)}")
    wanted = matrix(base) @ matrix(target)
    np.testing.assert_allclose(ends(made)[1], wanted[:3, 3], atol=1e-4)
    np.testing.assert_allclose(ends(made)[2], wanted[:3, 3], atol=1e-4)
    assert made.Rs_part_tcp is not None
    np.testing.assert_allclose(made.Rs_part_tcp[1], wanted[:3, :3], atol=1e-7)
    np.testing.assert_allclose(made.Rs_part_tcp[2], wanted[:3, :3], atol=1e-7)


def test_routines_take_values_and_references_and_functions_return() -> None:
    subs = (
        "DEF CUT(X:IN,N:OUT)\nREAL X\nINT N\nN=N+1\nX=X+1\nLIN {X X}\nEND\n"
        "DEFFCT REAL TWICE(V:IN)\nREAL V\nRETURN 2*V\nENDFCT\n"
        "DEFFCT FRAME MOVED(F:IN,D:IN)\nFRAME F\nREAL D\nF.X=F.X+D\nRETURN F\nENDFCT\n"
    )
    body = (
        f"{FIRST}N=5\nV=3\nCUT(V,N)\nCUT(TWICE(V),N)\nLIN {{X N}}\n"
        f"LIN MOVED({{X 1,Y 0,Z 0,{DOWN}}},TWICE(N))\nLIN {{X V}}"
    )
    assert xs(job(body, subs=subs)) == [0, 4, 7, 7, 15, 3]


def test_local_variables_begin_anew_and_those_of_the_data_list_stay() -> None:
    subs = "DEF CUT()\nINT I\nI=4\nK=K+1\nLIN {X K}\nEND\n"
    assert xs(job(FIRST + "K=1\nCUT()\nCUT()", data="INT K=7", subs=subs)) == [0, 2, 3]


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ("FOR I=1 TO 3\nLIN {X I}\nENDFOR", [1, 2, 3]),
        ("FOR I=3 TO 1 STEP -1\nLIN {X I}\nENDFOR", [3, 2, 1]),
        ("FOR I=1 TO 0\nLIN {X I}\nENDFOR\nLIN {X 9}", [9]),
        ("FOR I=1 TO 2\nFOR J=1 TO 2\nLIN {X 10*I+J}\nENDFOR\nENDFOR", [11, 12, 21, 22]),
        ("I=0\nWHILE I<3\nI=I+1\nLIN {X I}\nENDWHILE", [1, 2, 3]),
        ("I=0\nREPEAT\nI=I+1\nLIN {X I}\nUNTIL I>=3", [1, 2, 3]),
        ("I=0\nLOOP\nI=I+1\nIF I>3 THEN\nEXIT\nENDIF\nLIN {X I}\nENDLOOP", [1, 2, 3]),
        ("FOR I=1 TO 9\nIF I==3 THEN\nEXIT\nENDIF\nLIN {X I}\nENDFOR", [1, 2]),
        ("LIN {X 5}\nRETURN\nLIN {X 6}", [5]),
        ("FOR I=1 TO 2\nLIN P[I]\nENDFOR", [7, 8]),
    ],
)  # fmt: skip
def test_loops(body: str, wanted: list[float]) -> None:
    data = f"DECL E6POS P[2]\nP[1]={{X 7,Y 0,Z 0,{DOWN}}}\nP[2]={{X 8,Y 0,Z 0,{DOWN}}}"
    assert xs(job(FIRST + body, data=data))[1:] == wanted


@pytest.mark.parametrize(
    "body",
    [
        f"LOOP\n{FIRST}ENDLOOP",
        f"WHILE TRUE\n{FIRST}ENDWHILE",
        f"N=1\nWHILE N<5\n{FIRST}ENDWHILE",
        f"REPEAT\n{FIRST}UNTIL FALSE",
        f"AGAIN:\n{FIRST}GOTO AGAIN",
        "N=1\nLOOP\nN=N+1\nIF N<0 THEN\nEXIT\nENDIF\nENDLOOP",
        "N=1\nWHILE N<>0\nN=N+1\nENDWHILE",
        "MYSELF()",
        f"FOR I=1 TO 2000000000\n{FIRST}ENDFOR",
    ],
)
def test_a_program_without_end_ends_in_one_line(body: str) -> None:
    message = refusal(body, subs="DEF MYSELF()\nMYSELF()\nEND\n")
    assert any(says in message for says in ("never end", "calls itself", "more passes than any part"))


# ---- speeds and modes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "feed"),
    [
        ("$VEL.CP=CUT", 0.025),
        ("$VEL.CP=SPEEDS[2]", 0.05),
        ("$VEL.CP=CUT*2", 0.05),
        ("$VEL={CP CUT,ORI1 200}", 0.025),
        ("BAS(#VEL_CP,CUT)", 0.025),
        ("BAS(# VEL_CP, 0.1)", 0.1),
        ("LDAT_ACT=LCP1\nBAS(#CP_DAT)", 0.02),
        ("LDAT_ACT=LCP1\nBAS(#CP_PARAMS,0.3)", 0.3),
        ("BAS(#CP_PARAMS,0.3)\nLDAT_ACT=LCP1\nBAS(#CP_DAT)", 0.02),
        ("LCP1.VEL=0.2\nLDAT_ACT=LCP1\nBAS(#CP_DAT)", 0.2),
        ("LDAT_ACT={VEL 0.3,ACC 100}\nBAS(#CP_DAT)", 0.3),
        ("LDAT_ACT.VEL=0.3\nBAS(#CP_DAT)", 0.3),
        ("$OV_PRO=30", 0.006),
        ("$OV_PRO=100", 0.02),
        ("$OV_PRO=30\n$OV_PRO=100", 0.02),
        ("IF $IN[1] THEN\n$VEL.CP=0.02\nENDIF", 0.02),  # it has that value already
    ],
)
def test_speeds(body: str, feed: float) -> None:
    data = "DECL REAL CUT=0.025\nDECL REAL SPEEDS[2]\nSPEEDS[2]=0.05\nDECL LDAT LCP1={VEL 0.02,ACC 100.0,ORI_TYP #VAR}"
    assert job(f"{FIRST}{body}\nLIN {{X 50}}", data=data).motions[-1].feed_m_s == pytest.approx(feed)


@pytest.mark.parametrize(
    ("body", "cause"),
    [
        ("$VEL.CP=$ANIN[1]", "$ANIN"),
        ("IF $IN[1] THEN\n$VEL.CP=0.1\nENDIF", "IF in line 6"),
        ("$OV_PRO=N", "N is not declared"),
        ("IF $T1 THEN\n$OV_PRO=30\nENDIF", "IF in line 6"),
        ("$IPO_MODE=M", "M is not declared"),
        ("$BASE=B", "B is not declared"),
        ("$BASE.Z=5", "BASE_DATA[1] is stored on the controller"),
        ("BASE_DATA[1].Z=BASE_DATA[1].Z+30\nBAS(#BASE,1)", "keeps such a change from run to run"),
        ("BAS(#INITMOV,0)\nBAS(#BASE,1)", "DEF_VEL_CP"),
        ("INTERRUPT DECL 5 WHEN $IN[1] DO SLOW( )", "an interrupt does it"),
        ("TRIGGER WHEN DISTANCE=0 DELAY=0 DO SLOW( )", "a TRIGGER does it"),
        ("RET=EKI_GETREAL(\"X\",\"Y\",V)\n$VEL.CP=V", "EKI_GETREAL gives it"),
    ],
)  # fmt: skip
def test_what_is_not_known_is_refused_with_both_lines(body: str, cause: str) -> None:
    message = refusal(f"{FIRST}{body}\nLIN {{X 50}}", subs="DEF SLOW()\n$VEL.CP=0.001\nEND\n", data="REAL V=1")
    used = 6 + body.count("\n") + 1
    assert f"p.src:{used}:" in message or f"p.src:{used} " in message or "BAS" in message
    assert cause in message
    assert message.count("p.src:") >= 1


@pytest.mark.parametrize(
    "body",
    [
        "IF $IN[1] THEN\n$OUT[1]=TRUE\nWAIT FOR $IN[2]\nWAIT SEC 1\nELSE\nHALT\nN=5\nENDIF",
        "WHILE NOT $IN[1]\nWAIT SEC 0.1\nENDWHILE",
        "REPEAT\nWAIT SEC 0.1\nUNTIL $IN[1]",
        "LOOP\nIF $IN[1] THEN\nEXIT\nENDIF\nWAIT SEC 0.1\nENDLOOP",
        "SWITCH $MODE_OP\nCASE #T1\n$OUT[1]=TRUE\nCASE #EX\n$OUT[2]=TRUE\nENDSWITCH",
        "IF $T1 THEN\nPTP $POS_ACT\nENDIF",
        "IF $IN[1] THEN\nRETURN\nENDIF",
        "INTERRUPT DECL 5 WHEN $IN[1] DO NOTE( )\nINTERRUPT ON 5",
        "FOR I=1 TO $ANIN[1]\n$OUT[I]=TRUE\nENDFOR",
        "NOTE( )",
    ],
)
def test_what_does_not_matter_to_motion_is_passed(body: str) -> None:
    made = job(f"{FIRST}{body}\nLIN {{X 50}}", subs="DEF NOTE()\n$OUT[7]=TRUE\nEND\n")
    assert [end[0] for end, motion in zip(ends(made), made.motions, strict=True) if motion.kind != "dwell"] == [0, 50]
    assert made.acting or "T1" in body


@pytest.mark.parametrize(
    "body",
    [
        "IF $IN[1] THEN\nLIN {X 50}\nENDIF",
        "IF $IN[1] THEN\nCUT()\nENDIF",
        "WHILE $IN[1]\nLIN {X 50}\nENDWHILE",
        "LOOP\nLIN {X 1}\nIF $IN[1] THEN\nEXIT\nENDIF\nENDLOOP",
        "REPEAT\nLIN {X 50}\nUNTIL $IN[1]",
        "SKIP()",
        "IF $IN[1] THEN\nGOTO OVER\nENDIF\nLIN {X 50}\nOVER:",
        "INTERRUPT DECL 5 WHEN $IN[1] DO CUT( )",
        "SWITCH $IN[1]\nCASE TRUE\nLIN {X 50}\nENDSWITCH",
    ],
)
def test_a_motion_of_which_it_is_not_known_whether_it_is_made_is_refused(body: str) -> None:
    subs = "DEF CUT()\nLIN {X 50}\nEND\nDEF SKIP()\nIF $IN[1] THEN\nRETURN\nENDIF\nLIN {X 50}\nEND\n"
    message = refusal(FIRST + body, subs=subs)
    assert "whether it is executed is not known" in message
    assert "$IN" in message or "interrupt" in message


def test_constant_orientation_keeps_that_of_the_start() -> None:
    body = "$ORI_TYPE=#CONSTANT\nLIN {X 50,Y 0,Z 10,A 0,B 20,C 180}\nLIN {X 60}\n$ORI_TYPE=#VAR\nLIN {X 70,B 20}"
    made = job(FIRST + body)
    assert made.Rs_part_tcp is not None
    np.testing.assert_allclose(made.Rs_part_tcp[1], made.Rs_part_tcp[0], atol=1e-12)
    np.testing.assert_allclose(made.Rs_part_tcp[2], made.Rs_part_tcp[0], atol=1e-12)
    assert float(np.abs(made.Rs_part_tcp[3] - made.Rs_part_tcp[0]).max()) > 0.3
    assert "turns with the circle" in refusal(f"{FIRST}$ORI_TYPE=#CONSTANT\nCIRC {{X 5,Y 5}},{{X 10,Y 0}}")


def test_modes_of_a_with_clause_hold_for_its_motion_or_block_alone() -> None:
    held, free = "LIN {X 50,Y 0,Z 10,A 0,B 20,C 180}\n", "LIN {X 70,B 0}\nLIN {X 80,B 20}\n"
    block = f"SPLINE WITH $VEL.CP=0.03, $ORI_TYPE=#CONSTANT\nS{held}ENDSPLINE\n"
    for with_ in (block, "SLIN {X 50,B 20} WITH $ORI_TYPE=#CONSTANT\n"):
        made = job(FIRST + with_ + free)
        assert made.Rs_part_tcp is not None
        turned = [round(math.degrees(math.acos(-float(R[2, 2])))) for R in made.Rs_part_tcp]
        assert turned == [0, 0, 0, 20]
    assert made.motions[-1].feed_m_s == 0.02
    assert "TOOL_DATA[9]" in refusal(f"{FIRST}SPLINE WITH $VEL.CP=0.03, $TOOL=TOOL_DATA[9]\nS{held}", at=cell())


def test_initmov_resets_base_and_speed() -> None:
    assert "before it sets the base again" in refusal("BAS(#INITMOV,0)\n" + FIRST)
    again = "BAS(#INITMOV,0)\nBAS(#BASE,1)\n"
    assert "DEF_VEL_CP" in refusal(f"{again}{FIRST}LIN {{X 5}}")
    assert xs(job(f"{again}$VEL.CP=0.03\n{FIRST}LIN {{X 5}}")) == [0, 5]
    config = {"$config.dat": "DEFDAT  $CONFIG\nREAL DEF_VEL_CP=2.0\nENDDAT\n"}
    assert job(f"{again}{FIRST}LIN {{X 5}}", folder=config).motions[-1].feed_m_s == 2.0


# ---- frames ----------------------------------------------------------------------------------------------------

LINE = f"LIN {{X 50,Y 0,Z 10,{DOWN}}}"


@pytest.mark.parametrize(
    ("frames", "z"),
    [
        ("$BASE=BASE_DATA[1]", 10),
        ("$BASE={X 1350,Y -30,Z 1000,A 0,B 0,C 0}", 10),
        ("$BASE=BASE_DATA[1]:{X 0,Y 0,Z 5,A 0,B 0,C 0}", 15),
        ("$BASE=BASE_DATA[1]\n$BASE.Z=$BASE.Z+5", 15),
        ("$BASE={X 1350,Y -30,Z 1000,A 0,B 0,C 0}\n$BASE.Z=$BASE.Z+5", 15),
        ("$BASE=BASE_DATA[1]\n$BASE.Z=1005", 15),
        ("FR={X 0,Y 0,Z 5,A 0,B 0,C 0}\n$BASE=BASE_DATA[1]:FR", 15),
        ("BASE_DATA[1]={X 1350,Y -30,Z 1000,A 0,B 0,C 0}\nBAS(#BASE,1)", 10),
        ("BASE_DATA[3]={X 1350,Y -30,Z 1000,A 0,B 0,C 0}\nBAS(#BASE,3)", 10),
    ],
)
def test_bases_with_a_cell(frames: str, z: float) -> None:
    made = job(f"{FIRST}{frames}\n{LINE}", at=cell())
    assert ends(made)[-1] == pytest.approx([50, 0, z])


@pytest.mark.parametrize(
    ("frames", "says"),
    [
        ("$BASE={X 1350,Y -30,Z 1005,A 0,B 0,C 0}", "$BASE is not the part frame of the cell"),
        ("$BASE=BASE_DATA[2]", "another frame than the part frame"),
        ("BASE_DATA[1].Z=BASE_DATA[1].Z+30\nBAS(#BASE,1)", "keeps such a change from run to run"),
        ("BASE_DATA[1]={X 0,Y 0,Z 0,A 0,B 0,C 0}\nBAS(#BASE,1)", "$BASE is not the part frame of the cell"),
        ("$BASE=EK($ROBROOT,#EASYS,{X 0})", "$BASE is not known"),
        ("$TOOL.Z=$TOOL.Z+1", "the tip of $TOOL is not where the cell has it"),
        ("$TOOL=TOOL_DATA[1]:{Z 1}", "the tip of $TOOL is not where the cell has it"),
        ("$TOOL={X 0,Y 0,Z 201,A 0,B 0,C 0}", "the tip of $TOOL is not where the cell has it"),
        ("TOOL_DATA[1].Z=201\nBAS(#TOOL,1)", "keeps such a change from run to run"),
        ("BAS(#BASE,0)", "$BASE is not the part frame of the cell"),
        ("$IPO_MODE=#TCP", "holds the part"),
        ("FDAT_ACT={TOOL_NO 1,BASE_NO 4,IPO_FRAME #BASE}\nBAS(#FRAMES)", "BASE_DATA[4]"),
        ("FDAT_ACT=FP9\nBAS(#FRAMES)", "FP9 is not declared"),
    ],
)
def test_frames_that_are_not_those_of_the_cell(frames: str, says: str) -> None:
    assert says in refusal(f"{FIRST}{frames}\n{LINE}", at=cell())
    if "_DATA[1]" not in frames:  # nothing is wrong as long as no Cartesian motion uses it
        job(f"{FIRST}{frames}\n{FRAMES}$IPO_MODE=#BASE\n{LINE}", at=cell())


def test_bases_without_a_cell() -> None:
    """The first base is the part frame; another one whose place is not known is not cut on top of it."""
    shift = "$BASE=BASE_DATA[1]:{X 0,Y 0,Z 5,A 0,B 0,C 0}"
    assert ends(job(f"{FIRST}{shift}\n{LINE}"))[-1] == [50, 0, 15]
    assert "how the two lie to each other is not known" in refusal(f"{FIRST}$BASE=BASE_DATA[2]\n{LINE}")
    two = "$BASE={{X 0,Y 0,Z {z},A 0,B 0,C 0}}\n"
    assert ends(job(f"{two.format(z=100)}{FIRST}{two.format(z=103)}{LINE}"))[-1] == [50, 0, 13]
    config = "DEFDAT  $CONFIG\nFRAME BASE_DATA[4]\nBASE_DATA[1]={X 1,Y 0,Z 0,A 0,B 0,C 0}\n" \
        "BASE_DATA[2]={X 1,Y 0,Z 7,A 0,B 0,C 0}\nENDDAT\n"  # fmt: skip
    made = job(f"{FIRST}$BASE=BASE_DATA[2]\n{LINE}", folder={"$config.dat": config})
    assert ends(made)[-1] == [50, 0, 17]


def test_a_data_list_of_the_controller_gives_other_bases() -> None:
    """Where it has the part frame as the cell has it, its other bases lie in the part as it says."""
    config = "DEFDAT  $CONFIG\nBASE_DATA[1]={{X 1350,Y -30,Z {z},A 0,B 0,C 0}}\n" \
        "BASE_DATA[2]={{X 1350,Y -30,Z 1007,A 0,B 0,C 0}}\nENDDAT\n"  # fmt: skip
    body = f"{FIRST}BAS(#BASE,2)\n{LINE}"
    made = job(body, folder={"$config.dat": config.format(z=1000)}, at=cell())
    assert ends(made)[-1] == pytest.approx([50, 0, 17])
    assert "not the part frame of the cell" in refusal(body, folder={"$config.dat": config.format(z=1001)}, at=cell())


def test_axis_angles_between_cuts_lead_where_the_cell_says() -> None:
    """A rapid to the place of the robot of the cell; without a cell the place is not known."""
    axes = "PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}"
    T = pose.make(np.diag([1.0, -1.0, -1.0]), np.array([0.4, 0.5, 0.6]))
    made = job(f"{FIRST}{axes}\nLIN {{X 1}}\n{axes}", at=cell(tip_of_axes=lambda *_: T))
    assert ends(made) == [[0, 0, 10], [400, 500, 600], [1, 500, 600]]
    assert [motion.kind for motion in made.motions] == ["rapid", "rapid", "feed"]
    assert [made.blocks[motion.block].line for motion in made.motions] == [5, 6, 7]
    assert all(b.first_motion <= len(made.motions) for b in made.blocks)
    assert "Give the cell file" in refusal(f"{FIRST}{axes}\nLIN {{X 1}}")


# ---- several files -----------------------------------------------------------------------------------------------


def test_a_job_of_a_folder(tmp_path: Path) -> None:
    """Parts, public data, imports and a function of another file; what is not called is not read."""
    (tmp_path / "main.src").write_text("DEF main( )\nBAS(#INITMOV,0)\nSTART(2)\nmain_1()\nLIN {X ADD(1,2)}\nEND\n")
    (tmp_path / "Main_1.SRC").write_text(f"DEF main_1( )\n{FIRST}LIN XP1\nEND\n")
    (tmp_path / "MAIN_1.dat").write_text(
        f"DEFDAT MAIN_1\nDECL E6POS XP1={{X 5,Y 0,Z 0,{DOWN}}}\nIMPORT FRAME MILL IS /R1/FRAMES..TIP\nENDDAT\n"
    )
    (tmp_path / "start.src").write_text("DEF start(N:IN)\nINT N\n$TOOL=mill\n$BASE=fr\n$VEL.CP=V[N]\nEND\n")
    (tmp_path / "data.dat").write_text(
        "DEFDAT data PUBLIC\nDECL GLOBAL FRAME mill={X 0,Y 0,Z 200,A 0,B 0,C 0}\n"
        "DECL GLOBAL FRAME fr={X 1350,Y -30,Z 1000,A 0,B 0,C 0}\nDECL GLOBAL REAL V[2]\nV[2]=0.04\nENDDAT\n"
    )
    (tmp_path / "lib.src").write_text(
        "DEF lib( )\nEND\nGLOBAL DEFFCT INT ADD(A:IN,B:IN)\nINT A,B\nRETURN A+B\nENDFCT\n"
    )
    (tmp_path / "other.src").write_text("no program at all")
    (tmp_path / "broken.dat").write_text("DEFDAT broken PUBLIC\nDECL GLOBAL REAL SPEED=1\n")
    (tmp_path / "binary.dat").write_bytes(b"\0\1\2" * 40)
    made = read_krl_file(tmp_path / "main.src", cell=cell())
    assert xs(made) == [0, 5, 3]
    assert [motion.feed_m_s for motion in made.motions] == [0, 0.04, 0.04]
    assert job_files(tmp_path / "main.src")
    assert set(made.files) == {"main.src", "Main_1.SRC", "MAIN_1.dat", "start.src", "data.dat", "lib.src"}
    assert [block.file for block in made.blocks if block.motion_count] == ["Main_1.SRC", "Main_1.SRC", ""]
    (tmp_path / "data2.dat").write_text("DEFDAT data2 PUBLIC\nDECL GLOBAL FRAME fr={X 0,Y 0,Z 0,A 0,B 0,C 0}\nENDDAT\n")
    with pytest.raises(ProgramError, match="several data lists give FR"):
        read_krl_file(tmp_path / "main.src", cell=cell())


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("SPINDLE(3000)", "no file of the folder has SPINDLE"),
        ("V=MEASURE(1)", "no file of the folder has MEASURE"),
        ("RSI_MOVECORR()", "moves the robot as a sensor says"),
        ("$FOO=1", "$FOO is no system variable that is known"),
        ("$MAMES[1]=0", "moves the zero of an axis"),
        ("ASYPTP {E1 10}", "moves external axes beside the program"),
        ("CIRC_REL {X 5,Y 5},{X 10}", "relative circle"),
        ("LIN_REL {B 5}", "that turn the tool in $BASE"),
        ("N=5 5", "follows the expression"),
        ("N=(5", "is missing"),
        ("IF THEN\nENDIF", "a condition is missing"),
    ],
)
def test_what_is_refused_says_why(body: str, says: str) -> None:
    assert says in refusal(FIRST + body)


# ---- the table ---------------------------------------------------------------------------------------------------

VALID = (
    f"DECL INT K\nHALT\n{FIRST}LIN {{X 5}} C_DIS\nK=2\nFOR K=1 TO 2\nLIN {{Y K}}\nENDFOR\nCUT(7.0)\n"
    "IF K>0 THEN\nLIN {Z 20}\nENDIF\nWAIT SEC 0.5\nCIRC {X 10,Y 10},{X 20,Y 0}\n"
)
SUB = "DEF CUT(V:IN)\nREAL V\nLIN {X V}\nEND\n"
DATA = "DECL INT N,I\nDECL INT RET,ERR,DUMMY\nDECL FRAME FR,PT\nDECL AXIS AX\nREAL R"
NEUTRAL = [row for row in TABLE.rows if row.treatment is Treatment.NEUTRAL]


@settings(max_examples=250, deadline=None)
@given(row=st.sampled_from(NEUTRAL), place=st.integers(0, 15))
def test_neutral_statements_change_nothing_anywhere(row: object, place: int) -> None:
    lines = VALID.splitlines()
    wanted = job(VALID, subs=SUB, data=DATA)
    sample = row.samples[0]  # type: ignore[attr-defined]
    made = job("\n".join([*lines[:place], sample, *lines[place:]]), subs=SUB, data=DATA)
    assert ends(made) == ends(wanted)
    for one, other in zip(made.motions, wanted.motions, strict=True):
        assert (one.kind, one.feed_m_s, one.duration_s) == (other.kind, other.feed_m_s, other.duration_s)
    np.testing.assert_array_equal(made.Rs_part_tcp, wanted.Rs_part_tcp)


@pytest.mark.parametrize("row", [row for row in TABLE.rows if row.treatment is Treatment.REFUSED], ids=lambda r: r.word)
def test_refused_statements_are_refused_with_their_remedy(row: object) -> None:
    assert row.remedy.split(":")[0] in refusal(f"{FIRST}{row.samples[0]}\nLIN {{X 5}}", data=DATA)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("body", "subs", "says"),
    [
        # an interrupt may set it again at any time
        (
            "INTERRUPT DECL 5 WHEN $IN[1] DO SLOW( )\n$VEL.CP=0.02", "DEF SLOW()\n$VEL.CP=0.001\nEND\n",
            "an interrupt does it",
        ),
        # without :IN or :OUT it is not known whether the caller's variable changes
        ("V=0.02\nTWICE(V)\n$VEL.CP=V", "DEF TWICE(X)\nREAL X\nX=2*X\nEND\n", "whether X is IN or OUT"),
        ("$VEL.CP=CHIPS", "", "CHIPS is an input or output"),
    ],
)  # fmt: skip
def test_values_that_only_seem_known(body: str, subs: str, says: str) -> None:
    assert says in refusal(f"SIGNAL CHIPS $OUT[4]\n{FIRST}{body}\nLIN {{X 50}}", subs=subs)


def test_arrays_are_passed_by_reference_and_parameters_without_a_word_by_value() -> None:
    subs = "DEF FILL(P[]:OUT)\nREAL P[]\nP[2]=7\nEND\nDEF CUT(X)\nREAL X\nLIN {X X}\nEND\n"
    assert xs(job(f"{FIRST}FILL(Q[])\nCUT(Q[2])\nLIN {{X Q[2]+1}}", subs=subs, data="DECL REAL Q[3]")) == [0, 7, 8]
