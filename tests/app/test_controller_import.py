"""Data of controllers as the start of a cell file: the same frames in it, and a pose that does not fit is told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.controller_import import job
from counterflex.app.controller_import.job import JOINTS, POSE
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ModelError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.integrations.kuka.machine_data import read_kuka, read_kuka_machine
from counterflex.robot.elasticity.chain import ElasticChain, flange
from counterflex.robot.model import catalog

ROBOT = "kuka_kr300_r2500_ultra"
ABB = "abb_irb6700_235_265"
TOOL = (240.0, 0.0, 150.0, 0.0, 90.0, 0.0)
BASE = (1350.0, -30.0, 1000.0, 12.5, -0.25, 1.5)


def of(values: tuple[float, ...]) -> Float:
    """(4, 4) m of x y z in mm and a b c in deg."""
    return pose.make(rotation.from_zyx(np.array(values[3:]) * DEG), np.array(values[:3]) * MM)


def krl(values: tuple[float, ...]) -> str:
    return "{" + ",".join(f"{c} {v}" for c, v in zip("XYZABC", values, strict=True)) + "}"


def config(tool: tuple[float, ...] = TOOL, base: tuple[float, ...] = BASE) -> str:
    """A ``$config.dat``, with what else stands in one."""
    zero = krl((0.0,) * 6)
    return (
        "&ACCESS RVO\nDEFDAT  $CONFIG\nBOOL B_FTOOL=FALSE\nDECL FRAME TOOL_DATA[32]\n"
        f"TOOL_DATA[1]={krl(tool)}\nTOOL_DATA[2]={zero}\nTOOL_DATA[3]={krl((0, 0, 99.5, 0, 0, 0))}\n"
        'DECL CHAR TOOL_NAME[32,24]\nTOOL_NAME[1,]="spindle"\nTOOL_NAME[2,]=" "\n'
        f"BASE_DATA[1]={zero}\nBASE_DATA[7]={krl(base)} ; vice\n"
        "LOAD_DATA[1]={M 86.0,CM {X 104.6,Y 0.0,Z 137.2,A 0.0,B 0.0,C 0.0},J {X 1.0,Y 1.0,Z 1.0}}\n"
        "LOAD_DATA[2]={M -1.0,CM {X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0},J {X 0.0,Y 0.0,Z 0.0}}\nENDDAT\n"
    )


def rapid(values: tuple[float, ...]) -> str:
    T = of(values)
    q = rotation.quat_wxyz(T[:3, :3])
    return f"[[{','.join(f'{v / MM:.6f}' for v in T[:3, 3])}],[{','.join(f'{v:.9f}' for v in q)}]]"


def poses(robot: str, T_base: Float, T_tool: Float, count: int = 8, tool: str = "", base: str = "") -> str:
    """Rows as a controller would show them, six decimals."""
    rng = np.random.default_rng(4)
    q = np.array([0.0, -95.0, 110.0, 0.0, 40.0, 0.0]) * DEG + rng.uniform(-0.5, 0.5, (count, 6))
    Ts = np.linalg.inv(T_base) @ flange(ElasticChain.build(catalog.load(robot)), q) @ T_tool
    rows = [",".join((*JOINTS, *POSE, *(("tool", "base") if tool else ())))]
    for angles, T in zip(q, Ts, strict=True):
        numbers = [*angles / DEG, *T[:3, 3] / MM, *rotation.to_zyx(T[:3, :3]) / DEG]
        rows.append(",".join([*(f"{value:.6f}" for value in numbers), *((tool, base) if tool else ())]))
    return "\n".join([*rows, ""])


def write(folder: Path, **texts: str) -> dict[str, Path]:
    """Files of a folder, by name without ending."""
    out = {}
    for name, text in texts.items():
        out[name] = folder / {"config": "$config.dat", "moc": "MOC.cfg", "poses": "poses.csv"}.get(name, f"{name}.sys")
        out[name].write_text(text, encoding="utf-8")
    return out


def test_a_kuka_backup_becomes_a_cell(tmp_path: Path) -> None:
    files = write(tmp_path, config=config(), poses=poses(ROBOT, of(BASE), of(TOOL)))
    out = tmp_path / "cell.toml"
    with pytest.raises(InputError, match=r"which tool.*1 \(spindle\), 3"):
        job.run([files["config"]], out, ROBOT)
    answer = job.run([files["config"]], out, ROBOT, tool="1", poses=files["poses"])
    assert answer["tools"] == ["1", "3"]
    assert answer["bases"] == ["7"]
    assert answer["poses"][0]["largest_mm"] < 1e-4
    cell = read_cell(out)
    np.testing.assert_allclose(cell.controller_chain.T_flange_tcp, of(TOOL), atol=1e-9)
    np.testing.assert_allclose(cell.T_base_part, of(BASE), atol=1e-8)
    assert (cell.tables.controller.tool_number, cell.tables.controller.base_number) == (1, 7)
    assert sum(body.mass_kg for body in cell.end_effector.segments) == 86.0
    with pytest.raises(InputError, match="already there"):
        job.run([files["config"]], out, ROBOT, tool="1")


def test_an_abb_backup_becomes_a_cell(tmp_path: Path) -> None:
    """Work objects are in the world; MOC.cfg says where the robot stands in it, in m."""
    world = (500.0, -200.0, 630.0, 90.0, 0.0, 0.0)
    q = rotation.quat_wxyz(of(world)[:3, :3])
    moc = (
        'MOC:CFG_1.0:6:0::\n#\nARM:\n\n      -name "rob1_1" -upper_joint_bound 2.9\n\n#\nROBOT:\n\n'
        f'      -name "ROB_1" -base_frame_pos_x 0.5 -base_frame_pos_y -0.2 \\\n      -base_frame_pos_z 0.63 '
        f"-base_frame_orient_u0 {q[0]:.9f} -base_frame_orient_u3 {q[3]:.9f}\n"
    )
    module = (
        f"MODULE user(SYSMODULE)\nPERS tooldata tMill:=[TRUE,{rapid(TOOL)},[86,[104.6,0,137.2],[1,0,0,0],0,0,0]];\n"
        "PERS tooldata tFixed:=[FALSE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        f'TASK PERS wobjdata wVice:=[FALSE,TRUE,"",{rapid(BASE)},[[0,0,10],[1,0,0,0]]];\nENDMODULE\n'
    )
    lifted = of(BASE) @ pose.make(np.eye(3), np.array([0.0, 0.0, 0.01]))
    in_robot = np.linalg.inv(of(world)) @ lifted
    files = write(tmp_path, user=module, moc=moc, poses=poses(ABB, in_robot, of(TOOL), tool="TMILL", base="wvice"))
    answer = job.run([files["user"], files["moc"]], tmp_path / "cell.toml", ABB, poses=files["poses"])
    assert answer["poses"][0]["largest_mm"] < 1e-3
    assert any("tFixed stands beside" in note for note in answer["notes"])
    cell = read_cell(tmp_path / "cell.toml")
    np.testing.assert_allclose(cell.T_base_part, in_robot, atol=1e-8)
    assert cell.tables.controller.work_object == "wVice"


def test_a_robodk_station_becomes_a_cell(tmp_path: Path) -> None:
    def rows(T: Float) -> list[list[float]]:
        scaled = T.copy()
        scaled[:3, 3] /= MM
        out: list[list[float]] = scaled.tolist()
        return out

    (tmp_path / "station.json").write_text(
        json.dumps({"tools": {'Mill "16"\n': rows(of(TOOL))}, "frames": {"Vice": rows(of(BASE))}})
    )
    job.run([tmp_path / "station.json"], tmp_path / "cell.toml", ROBOT)
    cell = read_cell(tmp_path / "cell.toml")
    np.testing.assert_allclose(cell.T_base_part, of(BASE), atol=1e-8)
    (tmp_path / "station.rdk").write_bytes(b"binary")
    with pytest.raises(FileFormatError, match=r"station \(.rdk\) is a binary file.*script"):
        job.run([tmp_path / "station.rdk"], tmp_path / "x.toml", ROBOT)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(["tool", "base"]), st.integers(0, 5), st.floats(2.0, 20.0))
def test_the_frame_that_is_off_is_named(which: str, component: int, size: float) -> None:
    """A tool, or a base, that was another when the poses were shown: by 2 to 20 mm, or a tenth of that in deg."""
    import tempfile

    def moved(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(v + (size * (0.1 if i > 2 else 1.0)) * (i == component) for i, v in enumerate(values))

    tool, base = (moved(TOOL), BASE) if which == "tool" else (TOOL, moved(BASE))
    with tempfile.TemporaryDirectory() as name:
        files = write(Path(name), config=config(), poses=poses(ROBOT, of(base), of(tool)))
        with pytest.raises(
            ModelError, match=rf"{which} {'1' if which == 'tool' else '7'} does not fit.*off by the same"
        ):
            job.run([files["config"]], Path(name) / "cell.toml", ROBOT, tool="1", poses=files["poses"])
        assert not (Path(name) / "cell.toml").exists()


def test_another_robot_blames_no_frame(tmp_path: Path) -> None:
    files = write(tmp_path, config=config(), poses=poses("kuka_kr210_r2700_extra", of(BASE), of(TOOL)))
    with pytest.raises(ModelError, match=r"poses.csv:\d+: tool 1 in base 7 does not fit.*Check the robot"):
        job.run([files["config"]], tmp_path / "cell.toml", ROBOT, tool="1", poses=files["poses"])


@settings(max_examples=30, deadline=None)
@given(st.tuples(*(st.floats(-2000.0, 2000.0).map(lambda v: round(v, 3)) for _ in range(3))),
       st.tuples(*(st.floats(-179.0, 179.0).map(lambda v: round(v, 4)) for _ in range(3))))  # fmt: skip
def test_frames_of_a_kuka_are_what_they_say(p: tuple[float, ...], angles: tuple[float, ...]) -> None:
    values = (*p, *angles)
    if any(values):
        np.testing.assert_allclose(
            read_kuka(config(base=values), "c").bases.get("7", np.eye(4)), of(values), atol=1e-12
        )


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("config", config().replace("X 240.0", "X nine"), r"config.dat:5.*frame is damaged"),
        ("config", config() + f"TOOL_DATA[1]={krl(TOOL)}\n", "TOOL_DATA.1. is there twice"),
        ("config", config().replace("{M 86.0", "{K 86.0"), "load data are damaged"),
        ("user", "MODULE m\nPERS tooldata t:=[TRUE,5];\nENDMODULE\n", "no tooldata that is read"),
        ("user", "hello\n", "of no kind that is read"),
        ("moc", "MOC:CFG_1.0::\nROBOT:\n  -base_frame_orient_u0 0.5\n", "no rotation"),
        ("user", '{"tools": {"t": [[1, 2], [3]]}}', "not a pose"),
        ("user", '{"a": 1}', "holds no tools"),
    ],
)
def test_damaged_files_are_refused_with_their_place(name: str, text: str, match: str, tmp_path: Path) -> None:
    files = write(tmp_path, **{name: text})
    with pytest.raises(CounterflexError, match=match) as caught:
        job.run([files[name]], tmp_path / "cell.toml", ROBOT, tool="1", base="7")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "cell.toml").exists()


@pytest.mark.parametrize(("text", "match"), [("x_mm\n1\n", "columns are missing"), ("", "columns are missing")])
def test_tables_without_their_columns_are_refused(text: str, match: str, tmp_path: Path) -> None:
    files = write(tmp_path, config=config(), poses=text)
    with pytest.raises(FileFormatError, match=match):
        job.run([files["config"]], tmp_path / "cell.toml", ROBOT, tool="1", poses=files["poses"])


MACHINE = (
    "&ACCESS RVO\nDEFDAT  $MACHINE PUBLIC\nCHAR $TRAFONAME[32]\n"
    '$TRAFONAME[]="#KR300R2500 ULTRA C4 FLR"\nINT $NUM_AX=6\n$SOFTN_END[1]=-120.0\n$SOFTP_END[1]=120.0\n'
    "$SOFTN_END[2]=-140.0\n$SOFTP_END[2]=-5.0\n$LENGTH_A=350.0\n$ABS_ACCUR=#ACTIVE\n"
    "DECL FRAME $ROBROOT={X 100.0,Y -200.0,Z 300.0,A 30.0,B 0.0,C 0.0}\nENDDAT\n"
)


def test_machine_data_place_the_robot_in_its_world(tmp_path: Path) -> None:
    (tmp_path / "config.dat").write_text(config(), encoding="ascii")
    (tmp_path / "machine.dat").write_text(MACHINE, encoding="ascii")
    answer = job.run(
        [tmp_path / "config.dat", tmp_path / "machine.dat"], tmp_path / "cell.toml", ROBOT, tool="1", base="7"
    )
    cell = read_cell(tmp_path / "cell.toml")
    T_world_base = of((100.0, -200.0, 300.0, 30.0, 0.0, 0.0))
    np.testing.assert_allclose(T_world_base @ cell.T_base_part, of(BASE), atol=1e-8)
    stands = cell.tables.controller.robot_in_world
    assert stands is not None
    np.testing.assert_allclose(stands.matrix(), T_world_base, atol=1e-9)
    notes = " ".join(answer["notes"])
    assert "software limits of axis 1 are -120 to 120 deg, the catalogue has -185 to 185" in notes
    assert "software limits of axis 2" not in notes
    assert "$ABS_ACCUR is set" in notes
    assert "$NUM_AX" not in notes.split("other machine data")[0]
    assert "taken to stand at the origin" not in notes


def test_a_world_that_no_file_gives_is_named(tmp_path: Path) -> None:
    (tmp_path / "config.dat").write_text(config(), encoding="ascii")
    answer = job.run([tmp_path / "config.dat"], tmp_path / "cell.toml", ROBOT, tool="1", base="7")
    assert any("$ROBROOT is in $machine.dat" in note for note in answer["notes"])


def test_two_roots_of_one_controller_are_refused(tmp_path: Path) -> None:
    for name, text in (("a.dat", MACHINE), ("b.dat", MACHINE.replace("X 100.0", "X 101.0")), ("c.dat", config())):
        (tmp_path / name).write_text(text, encoding="ascii")
    with pytest.raises(InputError, match="say differently where the robot stands"):
        job.run([tmp_path / f"{name}.dat" for name in "cab"], tmp_path / "cell.toml", ROBOT, tool="1", base="7")


def test_bounds_and_calibration_of_an_abb_are_read_or_named(tmp_path: Path) -> None:
    moc = (
        'MOC:CFG_1.0::\n\nROBOT:\n\n      -name "ROB_1" -base_frame_pos_z 0.5\n\n#\nARM:\n\n'
        '      -name "rob1_1" -use_arm_type "ARM1_6700" -upper_joint_bound 1.5 \\\n      -lower_joint_bound -1.5\n\n'
        '      -name "rob1_2" -upper_joint_bound 1.483529864 -lower_joint_bound -1.134464014\n\n#\nARM_CALIB:\n\n'
        '      -name "rob1_1" -rot_x_error_ 0.001\n\n#\nMOTOR_CALIB:\n\n      -name "rob1_1" -com_offset 1.5\n'
    )
    (tmp_path / "MOC.cfg").write_text(moc, encoding="ascii")
    (tmp_path / "user.sys").write_text(
        "MODULE user\n"
        f"  PERS tooldata tMill:=[TRUE,{rapid(TOOL)},[10,[0,0,100],[1,0,0,0],0,0,0]];\n"
        f'  PERS wobjdata wPart:=[FALSE,TRUE,"",{rapid(BASE)},[[0,0,0],[1,0,0,0]]];\nENDMODULE\n',
        encoding="ascii",
    )
    answer = job.run([tmp_path / "user.sys", tmp_path / "MOC.cfg"], tmp_path / "cell.toml", ABB)
    notes = " ".join(answer["notes"])
    assert "software limits of axis 1 are -85.9437 to 85.9437 deg" in notes
    assert "software limits of axis 2" not in notes
    assert "arm_calib" in notes
    assert "MOTOR_CALIB" in notes
    np.testing.assert_allclose(read_cell(tmp_path / "cell.toml").T_base_part[2, 3], BASE[2] * MM - 0.5, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("Z 150.0", "Z 150,5", "a frame is damaged"),
        ("Z 150.0", "Z 150.0,Z 151.0", "a frame is damaged"),
        ("Z 137.2", "Z 137,2", "load data are damaged"),
    ],
)
def test_half_a_number_is_no_frame_of_a_kuka(old: str, new: str, match: str) -> None:
    text = config()
    assert old in text
    with pytest.raises(FileFormatError, match=match):
        read_kuka(text.replace(old, new, 1), "config.dat")


def test_a_frame_with_its_type_is_read() -> None:
    T = read_kuka(config().replace("TOOL_DATA[1]={", "TOOL_DATA[1]={FRAME: "), "config.dat").tools["1"]
    np.testing.assert_allclose(T, of(TOOL), atol=1e-12)


@pytest.mark.parametrize("line", ["$SOFTN_END[1]=-185,5", "$LENGTH_A=350,0"])
def test_half_a_number_is_no_machine_datum(line: str) -> None:
    with pytest.raises(FileFormatError, match="a number is damaged"):
        read_kuka_machine(f"DEFDAT $MACHINE PUBLIC\n{line}\nENDDAT\n", "machine.dat")
