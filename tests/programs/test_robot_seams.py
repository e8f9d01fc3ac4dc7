"""What a controller writes or adds beside a robot program, and the names of files in tables of several files."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import InputError, ProgramError
from counterflex.programs.difference import differences
from counterflex.programs.krl.read.reader import read_krl, read_krl_file
from counterflex.programs.listing import listing
from counterflex.programs.rapid.read.reader import read_rapid, read_rapid_file

POINT = "[[0,0,0],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
DATA = f"CONST robtarget p0:={POINT};\nVAR num n:=1;\nVAR intnum i1;\nVAR byte raw{{2}}:=[1,2];\n"
CUT = "MoveL Offs(p0,{},0,0),v20,fine,tool0;\n"
HEAD = "DEF part( )\n$BASE=BASE_DATA[1]\n$TOOL=TOOL_DATA[1]\n$VEL.CP=0.02\nPTP {X 0,Y 0,Z 9,A 180,B 0,C 180}\n"


def rapid(body: str, more: str = "") -> str:
    return f"MODULE m\n{DATA}PROC main()\nMoveJ p0,v100,fine,tool0;\n{body}ENDPROC\n{more}ENDMODULE\n"


@pytest.mark.parametrize(
    ("statement", "used", "why"),
    [
        ("SocketReceiveFrom s1\\Data:=raw,a,p;", "raw{1}", "SocketReceiveFrom sets raw"),
        ('SocketReceiveFrom s1\\Str:=a,"b",n;', "n", "SocketReceiveFrom sets n"),
        ("SocketReceive s1\\Data:=raw\\NoRecBytes:=n;", "n", "SocketReceive sets n"),
        ('IVarValue "sen1:",1,n,i1;', "n", "IVarValue may change it at any time"),
        ('IVarValue "sen1:",1,n,i1;\nn:=2;', "n", "IVarValue may change it at any time"),
        ('IF di1=1 THEN\nIVarValue "sen1:",1,n,i1;\nENDIF', "n", "di1"),
        ("SiGetCyclic s1,n,10;", "n", "SiGetCyclic may change it at any time"),
    ],
)
def test_what_the_controller_writes_into_is_not_known(statement: str, used: str, why: str) -> None:
    with pytest.raises(ProgramError, match=rf"m\.mod.*{why}.*m\.mod"):
        read_rapid(rapid(f"{statement}\n{CUT.format(used)}"), name="m.mod")


@pytest.mark.parametrize(
    "body",
    ["n:=other(n);\n" + CUT.format("1"), "IF di1=1 THEN\nn:=other(n);\nENDIF\n" + CUT.format("1")],
)
def test_a_function_of_another_module_is_refused_like_a_procedure(body: str) -> None:
    with pytest.raises(ProgramError, match=r"m\.mod:\d+:1: .*other\(n\)"):
        read_rapid(rapid(body), name="m.mod")


def test_words_before_a_parenthesis_are_no_functions() -> None:
    body = 'IF di1=1 AND (n=2 OR NOT (n=3)) THEN\nn:=7 DIV (n+1);\nTPWrite "no(n)";\nENDIF\n' + CUT.format("1")
    assert len(read_rapid(rapid(body), name="m.mod").motions) == 2


def test_an_interrupt_changes_data_of_its_own_module_alone(tmp_path: Path) -> None:
    (tmp_path / "m.mod").write_text(rapid(f"CONNECT i1 WITH broken;\n{CUT.format('n')}cut;\n"))
    other = "MODULE b\nLOCAL VAR num n:=7;\nTRAP broken\nn:=9;\nENDTRAP\nPROC cut()\n" + CUT.format("n")
    (tmp_path / "b.mod").write_text(f"{other}ENDPROC\nENDMODULE\n")
    with pytest.raises(ProgramError, match=r"b\.mod:7:.*the interrupt broken may change it"):
        read_rapid_file(tmp_path / "m.mod")
    (tmp_path / "b.mod").write_text(f"{other}ENDPROC\nENDMODULE\n".replace("Offs(p0,n,", "Offs(p0,5,"))
    program = read_rapid_file(tmp_path / "m.mod")
    assert [round(motion.p_end[0] * 1000) for motion in program.motions] == [0, 1, 5]


@pytest.mark.parametrize(
    "statement",
    [
        "$TECH[1].MODE=#CYCLE", "$TECH_C[1].MODE=#SINGLE", "$TECH[1]={MODE #CYCLE,CLASS #PATH}", "$PAL_MODE=TRUE",
        "$ASYNC_AXIS=1", "$PAL_MODE=$IN[1]", "IF $IN[1] THEN\n$TECH[1].MODE=#CYCLE\nENDIF",
        "TRIGGER WHEN DISTANCE=0 DELAY=0 DO CHIPS( ) PRIO=-1",
        "INTERRUPT DECL 4 WHEN $IN[5]==TRUE DO BROKEN( )",
    ],
)  # fmt: skip
def test_what_adds_to_the_path_is_refused(statement: str) -> None:
    with pytest.raises(ProgramError, match=r"part\.src:[67]:1: "):
        read_krl(f"{HEAD}{statement}\nLIN {{X 1}}\nEND\n", name="part.src")


@pytest.mark.parametrize(
    "statement",
    ["$TECH[1].MODE=#OFF", "$TECH[1].CLASS=#PATH", "$PAL_MODE=FALSE", "$ASYNC_AXIS=0",
     "TRIGGER WHEN DISTANCE=0 DELAY=0 DO CHIPS( ) PRIO=-1"],
)  # fmt: skip
def test_what_leaves_the_path_is_read(statement: str) -> None:
    program = read_krl(f"{HEAD}{statement}\nLIN {{X 1}}\nEND\nDEF CHIPS( )\n$OUT[5]=TRUE\nEND\n", name="part.src")
    assert len(program.motions) == 2


def test_tables_and_errors_of_a_job_name_the_file_of_a_line(tmp_path: Path) -> None:
    (tmp_path / "part.src").write_text(f"{HEAD}cut( )\nLIN {{X 9}}\nEND\n")
    (tmp_path / "cut.src").write_text("DEF cut( )\nLIN {X 1}\nLIN {X 2}\nEND\n")
    job = read_krl_file(tmp_path / "part.src")
    table = listing(job)
    assert table["file"].to_list() == ["part.src", "cut.src", "cut.src", "part.src"]
    assert table["line"].to_list() == [5, 2, 3, 7]
    alone = read_krl(f"{HEAD}LIN {{X 1}}\nEND\n", name="part.src")
    assert "file" not in listing(alone).columns
    (tmp_path / "part.src").write_text(f"{HEAD[: HEAD.index('PTP')]}cut( )\nEND\n")
    (tmp_path / "cut.src").write_text("DEF cut( )\nPTP {X 0,Y 0,Z 9,A 180,B 0,C 180}\nLIN {X 1}\nLIN {X 2}\nEND\n")
    with pytest.raises(InputError, match=r"cut\.src:3"):
        differences(read_krl_file(tmp_path / "part.src"), alone)
