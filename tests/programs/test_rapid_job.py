"""A RAPID program of several files: parts, data, system modules, program lists; and how it is written back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.geometry import pose
from counterflex.integrations.abb.language.in_place import write_rapid_in_place
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.reader import read_rapid, read_rapid_file
from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode

REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
P10 = f"CONST robtarget p10:=[[0,0,0],[0,1,0,0],{REST}];\n"
START = "MoveJ p10,v100,fine,tool0;\n"


def at(x: str, y: str = "0", z: str = "0") -> str:
    return f"MoveL Offs(p10,{x},{y},{z}),v20,fine,tool0;\n"


def ends(program: RapidProgram) -> list[list[float]]:
    """Ends of the motions behind the first, mm."""
    return [[round(float(x) / MM, 4) + 0.0 for x in motion.p_end] for motion in program.motions[1:]]


def write(folder: Path, **files: str) -> Path:
    """Files of a folder; the first one is the program. A name is its stem and ending with an underscore."""
    folder.mkdir(exist_ok=True)
    paths = []
    for name, text in files.items():
        stem, _, ending = name.rpartition("_")
        paths.append(folder / f"{stem}.{ending}")
        paths[-1].write_text(text, newline="")
    return paths[0]


def module(name: str, body: str) -> str:
    return f"MODULE {name}\n{body}ENDMODULE\n"


MAIN = module("job", f"PROC main()\n{START}part_1;\n{at('5')}ENDPROC\n")
PART = module("part_m", f"PROC part_1()\n{at('1')}ENDPROC\n")
DATA = module("data(SYSMODULE)", P10)


def test_parts_and_data_come_from_the_folder(tmp_path: Path) -> None:
    other = module("other", f"PROC main()\n{at('9')}ENDPROC\nPERS num unused:=1;\n")
    main = write(tmp_path, job_mod=MAIN, part_1_mod=PART, user_sys=DATA, other_mod=other)
    made = read_rapid_file(main)
    assert ends(made) == [[1, 0, 0], [5, 0, 0]]
    assert [name for name, _, _ in made.files] == ["job.mod", "user.sys", "part_1.mod"]


def test_a_fault_names_its_own_file_and_line(tmp_path: Path) -> None:
    broken = module("part_m", "PROC part_1()\nSet do1;\nMoveL nowhere,v20,fine,tool0;\nENDPROC\n")
    main = write(tmp_path, job_mod=MAIN, part_1_mod=broken, user_sys=DATA)
    with pytest.raises(ProgramError, match=r"part_1\.mod:4:7: where nowhere is"):
        read_rapid_file(main)


def test_a_routine_in_several_files_is_refused(tmp_path: Path) -> None:
    main = write(tmp_path, job_mod=MAIN, part_1_mod=PART, old_mod=PART, user_sys=DATA)
    with pytest.raises(ProgramError, match=r"part_1 stands in several modules .*old\.mod, part_1\.mod"):
        read_rapid_file(main)
    list_of = "<?xml version='1.0'?><Program>\n<Module>job.mod</Module>\n<Module>part_1.mod</Module>\n</Program>"
    (tmp_path / "job.pgf").write_text(list_of)
    assert ends(read_rapid_file(main)) == [[1, 0, 0], [5, 0, 0]]
    assert ends(read_rapid_file(tmp_path / "job.pgf")) == [[1, 0, 0], [5, 0, 0]]


def test_local_names_stay_in_their_module(tmp_path: Path) -> None:
    main = write(
        tmp_path,
        job_mod=module("job", f"{P10}LOCAL CONST num d:=1;\nPROC main()\n{START}cut;\n{at('d')}ENDPROC\n"),
        cut_mod=module(
            "cut_m", f"LOCAL CONST num d:=7;\nPROC cut()\nhelp;\nENDPROC\nLOCAL PROC help()\n{at('d')}ENDPROC\n"
        ),
    )
    assert ends(read_rapid_file(main)) == [[7, 0, 0], [1, 0, 0]]


def test_modules_that_are_loaded_while_it_runs(tmp_path: Path) -> None:
    """As the Robots plug-in writes long programs: each part has a Main of its own, called with its module."""
    calls = "".join(
        f'Load\\Dynamic, "HOME:/job/job_T_ROB1_{i:03}.MOD";\n%"job_T_ROB1_{i:03}:Main"%;\n'
        f'UnLoad "HOME:/job/job_T_ROB1_{i:03}.MOD";\n'
        for i in range(2)
    )
    declared = (
        "VAR extjoint extj := [9E9,9E9,9E9,9E9,9E9,9E9];\nVAR confdata conf := [0,0,0,0];\n"
        "PERS tooldata Mill:=[TRUE,[[0.000,0.000,120.000],[1,0,0,0]],[1.000,[0,0,0.001],[1,0,0,0],0,0,0]];\n"
        'TASK PERS wobjdata Table:=[FALSE,TRUE,"",[[800.000,0.000,500.000],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
        "TASK PERS speeddata Speed000:=[20.000,180.000,5000.000,1080.000];\n"
        "TASK PERS zonedata Zone000:=[FALSE,1.000,1.000,1.000,0.100,1.000,0.100];\n"
    )
    files = {
        f"job_T_ROB1_{i:03}_MOD": module(
            f"job_T_ROB1_{i:03}",
            "PROC Main()\nConfL \\Off;\nMoveAbsJ [[0,0,0,0,90,0],extj],Speed000,fine,Mill;\n" * (i == 0)
            + ("PROC Main()\nConfL \\Off;\n" * (i > 0))
            + f"MoveL [[{i},0,0],[0,1,0,0],conf,extj],Speed000,Zone000,Mill \\WObj:=Table;\n"
            f"MoveL [[{i},5,0],[0,0.70711,0.70711,0],conf,extj],Speed000,fine,Mill \\WObj:=Table;\nENDPROC\n",
        )
        for i in range(2)
    }
    main = write(tmp_path, job_T_ROB1_mod=module("job_T_ROB1", f"{declared}PROC Main()\n{calls}ENDPROC\n"), **files)
    made = read_rapid_file(main)
    assert ends(made) == [[0, 5, 0], [1, 0, 0], [1, 5, 0]]
    # The tool turns by 90 deg at 180 deg/s: half a second for each way
    assert [motion.feed_m_s for motion in made.motions] == pytest.approx([0.0, 0.01, 0.01 * 1.04**0.5, 0.01])


def moved(program: RapidProgram, x_mm: float) -> CompensatedPath:
    """Every cut displaced along x."""
    path = tool_path(program, step_m=0.5 * MM)
    shift = np.zeros((len(path), 3))
    shift[path.kind == 1, 0] = x_mm * MM
    return CompensatedPath.from_correction(path, shift)


def rewritten(program: RapidProgram, folder: Path, x_mm: float = 0.1) -> RapidProgram:
    """The program written with a correction into a folder, and read from there."""
    text = write_rapid_in_place(program, moved(program, x_mm), tolerance_m=5 * UM, cycle_s=1e-4)
    folder.mkdir()
    for name, content in text.files.items():
        (folder / name).write_text(content, newline="")
    return read_rapid_file(folder / program.name)


def test_each_target_is_written_into_its_own_file(tmp_path: Path) -> None:
    named = module(
        "part_m",
        f"CONST robtarget pEnd:=[[1,2,0],[0,1,0,0],{REST}];\nPROC part_1()\nMoveL pEnd,v20,fine,tool0;\nENDPROC\n",
    )
    main = write(tmp_path / "a", job_mod=MAIN, part_1_mod=named, user_sys=DATA)
    program = read_rapid_file(main)
    back = rewritten(program, tmp_path / "b")
    cuts = [end for end, motion in zip(ends(back), back.motions[1:], strict=True) if motion.kind == "feed"]
    assert [1.1, 2.0, 0.0] in cuts
    assert cuts[-1] == [5.1, 0.0, 0.0]
    assert "[[1.1000,2,0]" in (tmp_path / "b" / "part_1.mod").read_text()
    assert (tmp_path / "b" / "user.sys").read_bytes() == (tmp_path / "a" / "user.sys").read_bytes()
    again = rewritten(back, tmp_path / "c", 0.0)
    assert ends(again) == ends(back)


def test_what_the_writer_divides_is_one_program_again(tmp_path: Path) -> None:
    lines = "".join(f"X{i} Y{i % 3}\n" for i in range(1, 30))
    gcode = read_gcode(f"G21 G90 G17 G94\nG0 X0 Y0 Z50\nG1 Z34 F600\n{lines}G0 Z60\nM30\n")
    path = tool_path(gcode)
    Ts = pose.make(tool_orientation(path.axis_part, 0.5), path.p_part_tcp)
    files = {}
    for count in (12, 1000):
        options = RapidSettings(
            name="long", start_axes_rad=[0.0] * 6, T_flange_tcp=np.eye(4), T_base_part=np.eye(4), points_per_file=count
        )
        files[count] = RapidWriter(gcode, path, Ts, options).text().files
    assert [len(files[count]) for count in files] == [3, 1]
    (tmp_path / "a").mkdir()
    for name, text in files[12].items():
        (tmp_path / "a" / name).write_text(text)
    program = read_rapid_file(tmp_path / "a" / "long.mod")
    assert ends(program) == ends(read_rapid(files[1000]["long.mod"]))
    back = rewritten(program, tmp_path / "b")
    cuts = [m for m in back.motions if m.kind == "feed"]
    assert float(cuts[-1].p_end[0]) / MM == pytest.approx(29.1)


ONE = (
    f"MODULE m\n{P10}CONST robtarget q{{2}}:=[[[10,0,0],[0,1,0,0],{REST}],[[20,0,0],[0,1,0,0],{REST}]];\n"
    f"VAR bool deep:=TRUE;\nPROC main()\n{START}"
)


@pytest.mark.parametrize(
    ("body", "holds"),
    [
        ("MoveL Offs(p10,1+1,0,0),v20,fine,tool0;\n",
         "[[2.1000,0,0],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v20"),
        ("IF deep MoveL Offs(p10,20,0,0),v20,fine,tool0;\n", "Offs(p10,20.1000,0,0)"),
        ("VelSet 50,1000;\nMoveL Offs(p10,20,0,0),v20,fine,tool0;\n", "20.1000"),
        ("PDispSet [[0,0,5],OrientZYX(90,0,0)];\nMoveL Offs(p10,0,20,0),v20,fine,tool0;\n", "Offs(p10,0,19.9000,0)"),
        ("MoveL Offs(p10,20,0,0),v20\\T:=2,fine,tool0;\n", "20.1000"),
        ("cut p10;\n", "[[0.1000,0,0]"),
    ],
)  # fmt: skip
def test_computed_targets_are_written_back(tmp_path: Path, body: str, holds: str) -> None:
    """A computed target is written out, others where they stand; read back, the path is the commanded one."""
    text = (
        f"{ONE}{body}ENDPROC\nPROC cut(robtarget p)\nMoveL Offs(p10,9,0,0),v20,fine,tool0;\n"
        f"MoveL p,v20,fine,tool0;\nENDPROC\nENDMODULE\n"
    )
    main = write(tmp_path / "a", m_mod=text)
    program = read_rapid_file(main)
    back = rewritten(program, tmp_path / "b")
    assert holds in (tmp_path / "b" / "m.mod").read_text()
    np.testing.assert_allclose([back.motions[-1].p_end], [np.add(program.motions[-1].p_end, [1e-4, 0, 0])], atol=1e-7)
    np.testing.assert_allclose(back.motions[-1].feed_m_s, program.motions[-1].feed_m_s, rtol=0.02)


def test_points_of_an_array_are_written_where_they_stand(tmp_path: Path) -> None:
    """A loop over declared targets: each pass has a target of its own, so the loop stays."""
    body = "MoveJ Offs(p10,5,0,0),v100,fine,tool0;\nFOR i FROM 1 TO 2 DO\nMoveL q{i},v20,z1,tool0;\nENDFOR\n"
    program = read_rapid(f"{ONE}{body}ENDPROC\nENDMODULE\n", name="m.mod")
    path = tool_path(program, step_m=0.5 * MM)
    shift = np.zeros((len(path), 3))
    shift[path.motion > 0, 1] = 1e-4
    text = write_rapid_in_place(program, CompensatedPath.from_correction(path, shift), cycle_s=1e-4).files["m.mod"]
    assert "[[[10,0.1000,0]" in text
    assert "MoveL q{i},v20" in text
    assert ends(read_rapid(text)) == [[5, 0.1, 0], [10, 0.1, 0], [20, 0.1, 0]]


def waved(program: RapidProgram) -> CompensatedPath:
    """A correction that needs points between."""
    path = tool_path(program, step_m=0.25 * MM)
    shift = np.zeros((len(path), 3))
    cut = path.kind == 1
    shift[cut, 1] = 0.1 * MM * np.sin(path.p_part_tcp[cut, 0] / MM)
    return CompensatedPath.from_correction(path, shift)


def test_points_are_added_within_a_compact_if(tmp_path: Path) -> None:
    program = read_rapid(
        f"{ONE}    IF deep MoveL Offs(p10,20,0,0),v20\\T:=2,fine,tool0; ! cut\nENDPROC\nENDMODULE\n", name="m.mod"
    )
    text = write_rapid_in_place(program, waved(program), tolerance_m=5 * UM, cycle_s=1e-4)
    assert text.vertices_added > 5
    back = read_rapid(text.files["m.mod"])
    assert len(back.motions) == 2 + text.vertices_added
    np.testing.assert_allclose(back.motions[-1].p_end[0], 0.02, atol=1e-9)
    assert {round(m.feed_m_s, 4) for m in back.motions[1:]} <= {0.01, 0.0101, 0.0102}


def test_passes_of_a_loop_that_need_different_corrections_are_refused() -> None:
    body = "FOR i FROM 1 TO 3 DO\nMoveL Offs(p10,10*i,0,0),v20,z1,tool0;\nENDFOR\n"
    program = read_rapid(f"{ONE}{body}ENDPROC\nENDMODULE\n", name="m.mod")
    with pytest.raises(
        ProgramError, match=r"m\.mod:8: a loop makes this motion several times.*convert m\.mod --to rapid"
    ):
        write_rapid_in_place(program, waved(program), tolerance_m=5 * UM, cycle_s=1e-4)
    called = f"{ONE}FOR i FROM 1 TO 2 DO\ncut;\nENDFOR\nENDPROC\nPROC cut()\n{at('0')}{at('15')}ENDPROC\nENDMODULE\n"
    program = read_rapid(called, name="m.mod")
    path = tool_path(program, step_m=0.5 * MM)
    shift = np.zeros((len(path), 3))
    shift[path.motion > 2, 1] = 1e-4
    with pytest.raises(ProgramError, match="a loop calls cut several times"):
        write_rapid_in_place(program, CompensatedPath.from_correction(path, shift), cycle_s=1e-4)


def test_blocks_name_the_file_of_their_line(tmp_path: Path) -> None:
    part = module("part_m", f"PROC part_1()\nSet do1;\n{at('1')}ENDPROC\n")
    made = read_rapid_file(write(tmp_path, job_mod=MAIN, part_1_mod=part, user_sys=DATA))
    blocks = [made.blocks[motion.block] for motion in made.motions]
    assert [(block.file, block.line) for block in blocks] == [("", 3), ("part_1.mod", 4), ("", 5)]
    assert made.acting == (4,)
    assert len(made.lines) == len(MAIN.splitlines()) + 1
