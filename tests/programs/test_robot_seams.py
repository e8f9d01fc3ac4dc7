"""What a controller writes or adds beside a robot program, and the names of files in tables of several files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ProgramError
from counterflex.geometry import pose
from counterflex.integrations.abb.language.read.reader import read_rapid, read_rapid_file
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.reader import job_files, read_krl, read_krl_file
from counterflex.programs.difference import differences
from counterflex.programs.listing import listing
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.stated.two_readings import doubtful_readings

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


def test_a_program_of_an_archive_finds_its_controller_data_and_subprograms(tmp_path: Path) -> None:
    program, system = tmp_path / "KRC" / "R1" / "Program", tmp_path / "KRC" / "R1" / "System"
    for folder in (program / "sub", system):
        folder.mkdir(parents=True)
    config = "DEFDAT  $CONFIG\nDECL FRAME BASE_DATA[32]\nBASE_DATA[1]={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    (system / "$config.dat").write_text(config + "BASE_DATA[2]={X 5,Y 0,Z 40,A 90,B 0,C 0}\nENDDAT\n")
    (program / "part.src").write_text(f"{HEAD}cut( )\n$BASE=BASE_DATA[2]\nLIN {{X 1,Y 2,Z 3}}\nEND\n")
    (program / "sub" / "cut.src").write_text("DEF cut( )\nLIN {X 1,Y 0,Z 0}\nEND\n")
    job = read_krl_file(program / "part.src")
    assert [[round(x * 1000, 6) for x in motion.p_end] for motion in job.motions[1:]] == [[1, 0, 0], [3, 1, 43]]
    assert {path.name for path in job_files(program / "part.src")} == {"cut.src", "$config.dat"}
    (system / "$config.dat").unlink()
    with pytest.raises(ProgramError, match="how the two lie to each other is not known"):
        read_krl_file(program / "part.src")


def test_axes_that_are_left_out_stay_where_the_last_place_by_axes_had_them() -> None:
    seen: list[list[float]] = []

    def tip(axes_deg: list[float], external: dict[int, float]) -> Float:
        seen.append(list(axes_deg))
        return pose.make(None, np.array([axes_deg[0] / 1000, 0.0, 0.5]))

    about = {
        "where": "cell.toml", "tool_number": 1, "base_number": 1, "tools": [1], "tool_of_data": {},
        "T_flange_tcp": pose.make(None, np.array([0.0, 0.0, 0.2])), "T_base_part": pose.make(None, np.zeros(3)),
        "functions": MachineFunctions("krl", {3: [], 5: [], 6: []}), "tip_of_axes": tip,
    }  # fmt: skip
    body = "PTP {A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}\nPTP {A1 25}\nPTP {X 0,Y 0,Z 9,A 180,B 0,C 180}\nLIN {X 1}\nEND\n"
    program = read_krl(HEAD + body, name="part.src", cell=KrlCell(**about))  # type: ignore[arg-type]
    assert seen == [[0, -90, 90, 0, 10, 0], [25, -90, 90, 0, 10, 0]]
    assert len(program.motions) == 5
    with pytest.raises(ProgramError, match=r"part\.src:6: it goes there by some of its axes.*all axis angles"):
        read_krl(HEAD + body[body.index("PTP {A1 25") :], name="part.src", cell=KrlCell(**about))  # type: ignore[arg-type]


def test_a_work_object_that_the_program_moves_is_seen_from_the_first_one() -> None:
    frame = '[FALSE,TRUE,"",[[{},0,500],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
    declared = f"PERS wobjdata w1:={frame.format(1000)}PERS wobjdata w2:={frame.format(1000)}"
    body = "".join(f"w2.oframe.trans.z:={z};\nMoveL p0,v20,fine,tool0\\WObj:=w2;\n" for z in (10, 20))
    text = rapid(body).replace("fine,tool0;", "fine,tool0\\WObj:=w1;").replace(DATA, DATA + declared)
    assert [round(motion.p_end[2] * 1000) for motion in read_rapid(text, name="m.mod").motions] == [0, 10, 20]


def test_a_line_of_a_job_is_named_with_its_file(tmp_path: Path) -> None:
    (tmp_path / "part.src").write_text(f"{HEAD}cut( )\nLIN {{X 9}}\nEND\n")
    (tmp_path / "cut.src").write_text("DEF cut( )\nLIN {X 1}\nLIN {X 2}\n\nLIN {X 3}\nEND\n")
    job = read_krl_file(tmp_path / "part.src")
    assert [job.place(line) for line in (2, 7, 5)] == ["cut.src:2", "part.src:7", "cut.src:5 or part.src:5"]
    assert read_krl(f"{HEAD}LIN {{X 1}}\nEND\n", name="part.src").place(6) == "line 6"


def test_a_job_whose_next_run_goes_elsewhere_is_refused() -> None:
    data = "DEFDAT part\nDECL E6POS XP={X 1,Y 0,Z 0,A 180,B 0,C 180}\nDECL INT COUNT=4\nENDDAT\n"

    def read(body: str) -> list[float]:
        program = read_krl(f"{HEAD}{body}\nEND\n", name="part.src", data=data, data_name="part.dat")
        return [round(float(motion.p_end[0]) * 1000, 6) for motion in program.motions]

    assert read("COUNT=COUNT+1\nLIN XP") == [0, 1]  # counts parts, and the path does not depend on it
    assert read("XP.X=5\nLIN XP\nXP.X=XP.X+1\nLIN XP") == [0, 5, 6]  # begins with a value of its own
    for body in ("LIN XP\nXP.X=XP.X+1", "XP.Z=XP.Z-2\nLIN XP", "LIN {X COUNT}\nCOUNT=COUNT+1"):
        with pytest.raises(ProgramError, match=r"part\.dat: the next run of the program makes other motions"):
            read(body)


def test_a_path_that_a_sensor_corrects_is_named() -> None:
    body = "RET=RSI_ON(#ABSOLUTE)\nLIN {X 1}\nEND\n"
    (warning,) = doubtful_readings(read_krl(HEAD + body, name="part.src"))
    assert warning.startswith("part.src:6: RSI_ON")
    assert doubtful_readings(read_krl(f"{HEAD}; RSI_ON()\nLIN {{X 1}}\nEND\n", name="part.src")) == []
