"""KRL and RAPID programs, parsed back by small strict parsers that share no code with the writers."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.integrations.kuka.language import LIMITS as KRL
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.robot_writer.points import RobotText

DATA = Path(__file__).resolve().parents[1] / "data" / "writer"
START = (0.0, -1.5, 1.6, 0.1, 0.5, -0.2)
SPINDLE = {
    "krl": MachineFunctions("krl", {3: ("$ANOUT[1]={s}/24000.0", "$OUT[17]=TRUE"), 5: ("$OUT[17]=FALSE",)}),
    "rapid": MachineFunctions("rapid", {3: ("SetAO aoSpeed,{s};", "SetDO doSpindle,1;"), 5: ("SetDO doSpindle,0;",)}),
}
DOWN = np.diag([1.0, -1.0, -1.0])
NUMBER = r"-?\d+\.\d+"
TEXT = """G21 G90
(pocket)
M3 S13000
G0 X0 Y0 Z20
G1 Z-1 F600
G1 X40 F1500
G4 P0.5
G1 Y30
M0
G0 Z20
M5
M2
"""


def job(text: str = TEXT, step_m: float = 1e-3, size_m: float = 3e-4) -> tuple[Program, ToolPath, Float]:
    """A program, its path, and commanded poses with a smooth correction of position and orientation."""
    program = read_gcode(text, name="part.ngc")
    path = tool_path(program, step_m=step_m)
    x = path.p_part_tcp
    shift = size_m * np.stack([np.sin(60 * x[:, 0]), np.cos(50 * x[:, 1]), np.sin(40 * x[:, 2])], axis=1)
    turn = np.stack([1e-3 * np.sin(30 * x[:, 0]), 1e-3 * np.cos(20 * x[:, 1]), 0 * x[:, 2]], axis=1)
    shift[path.kind == RAPID] = turn[path.kind == RAPID] = 0.0
    commanded = CompensatedPath.from_correction(path, shift, turn)
    return program, path, commanded.poses(np.broadcast_to(DOWN, (len(path), 3, 3)))


def krl_points(text: str) -> tuple[Float, list[bool]]:
    """Poses of all Cartesian instructions of a .src, and which of them blend; refuses every line it does not know."""
    poses, blends = [], []
    for line in text.split("\n"):
        if match := re.fullmatch(r"(LIN|PTP) \{(X .*)\}( C_DIS)?", line):
            words = dict(part.split(" ") for part in match[2].split(","))
            assert list(words)[:6] == ["X", "Y", "Z", "A", "B", "C"]
            assert all(re.fullmatch(NUMBER, words[c]) for c in "XYZABC")
            T = np.eye(4)
            T[:3, 3] = [float(words[c]) * 1e-3 for c in "XYZ"]
            T[:3, :3] = Rotation.from_euler("ZYX", [float(words[c]) for c in "ABC"], degrees=True).as_matrix()
            poses.append(T)
            blends.append(match[3] is not None)
        else:
            known = r"|&ACCESS RVP|&REL 1|DEF \w+\( \)|END|;.*|\$[A-Z_.0-9]+(\[\d+\])?=.+|PTP XSTART|\w+\( \)"
            assert re.fullmatch(known + r"|WAIT SEC \d+\.\d+|HALT", line), line
    return np.array(poses), blends


def rapid_points(text: str) -> tuple[Float, list[str]]:
    """Poses of all MoveL of a module and their zones."""
    poses, zones = [], []
    before = np.zeros(4)
    n = NUMBER
    form = rf"    MoveL \[\[({n}),({n}),({n})\],\[({n}),({n}),({n}),({n})\],\[-?\d,-?\d,-?\d,\d\],"
    form += r"\[9E9,9E9,9E9,9E9,9E9,9E9\]\],(\w+),(\w+),(\w+)\\WObj:=(\w+);"
    for line in text.split("\n"):
        if "MoveL" in line:
            match = re.fullmatch(form, line)
            assert match is not None, line
            values = [float(v) for v in match.groups()[:7]]
            assert before @ values[3:7] >= 0.0, "the sign of the quaternion flips"
            before = np.array(values[3:7])
            T = np.eye(4)
            T[:3, 3] = np.array(values[:3]) * 1e-3
            T[:3, :3] = Rotation.from_quat([*values[4:7], values[3]]).as_matrix()
            poses.append(T)
            zones.append(match[9])
    return np.array(poses), zones


def all_points(result: RobotText, language: str) -> Float:
    """Poses of all files in the order in which the master calls them."""
    names = list(result.files)
    parts = [n for n in names if re.search(r"_\d{3}\.(src|mod)$", n)] or [
        n for n in names if n.endswith(("src", "mod"))
    ]
    read = krl_points if language == "krl" else rapid_points
    return np.concatenate([read(result.files[name])[0] for name in parts])


def krl(**changes: Any) -> KrlSettings:
    return replace(KrlSettings(name="pocket", start_axes_rad=START), **changes)


def rapid(**changes: Any) -> RapidSettings:
    T_base_part = np.eye(4)
    T_base_part[:3, 3] = [1.5, 0.2, 0.6]
    base = RapidSettings(name="pocket", start_axes_rad=START, T_flange_tcp=np.eye(4), T_base_part=T_base_part)
    return replace(base, **changes)


def write(language: str, text: str = TEXT, step_m: float = 1e-3, **changes: Any) -> RobotText:
    program, path, Ts_part_tcp = job(text, step_m)
    if language == "krl":
        return KrlWriter(program, path, Ts_part_tcp, krl(**changes), block_lines=SPINDLE["krl"].lines).text()
    return RapidWriter(program, path, Ts_part_tcp, rapid(**changes), block_lines=SPINDLE["rapid"].lines).text()


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_every_commanded_row_lies_on_the_written_path(language: str) -> None:
    _, path, Ts_part_tcp = job()
    result = write(language, cycle_s=1e-4)
    poses = all_points(result, language)
    assert len(poses) == result.points
    assert result.merged_points == 0
    at, written = [], []
    row = 0
    for pose in poses:  # every written pose is a commanded row, in order
        near = np.linalg.norm(Ts_part_tcp[row:, :3, 3] - pose[:3, 3], axis=1) < 1.2e-7
        row += int(np.argmax(near))
        assert near.any()
        angle = Rotation.from_matrix(pose[:3, :3].T @ Ts_part_tcp[row, :3, :3]).magnitude()
        assert angle < 3e-7
        at.append(row)
        written.append(pose)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    line = np.stack([np.interp(way, way[at], np.array(written)[:, c, 3]) for c in range(3)], axis=1)
    feed = (path.kind == FEED) & (path.feed_m_s > 0.0)
    gap = np.linalg.norm(line - Ts_part_tcp[:, :3, 3], axis=1)[feed]
    assert gap.max() <= 1e-5 + 2e-7
    assert result.largest_position_error_m == pytest.approx(gap.max(), abs=2e-7)


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_any_orientation_survives(quaternion: tuple[float, ...], position: tuple[float, ...]) -> None:
    norm = math.sqrt(sum(c * c for c in quaternion))
    if norm < 0.1:
        return
    program = read_gcode("G21 G90\nG0 X0 Y0 Z0\nG1 X5 F900\nM2\n")
    path = tool_path(program, step_m=1e-2)
    Ts_part_tcp = np.broadcast_to(np.eye(4), (len(path), 4, 4)).copy()
    Ts_part_tcp[:, :3, :3] = Rotation.from_quat(np.array(quaternion) / norm).as_matrix()
    Ts_part_tcp[:, :3, 3] += position
    Ts_part_tcp[-1, 0, 3] += 0.005
    for result, language in (
        (KrlWriter(program, path, Ts_part_tcp, krl()).text(), "krl"),
        (RapidWriter(program, path, Ts_part_tcp, rapid()).text(), "rapid"),
    ):
        poses = all_points(result, language)
        for pose in poses:
            turn = Rotation.from_matrix(pose[:3, :3].T @ Ts_part_tcp[0, :3, :3]).magnitude()
            assert turn < 6e-7
        assert poses[-1][:3, 3] == pytest.approx(Ts_part_tcp[-1, :3, 3], abs=1e-7)


def test_krl_speed_stops_dwells_and_comments_are_in_their_place() -> None:
    lines = write("krl").files["pocket.src"].split("\n")
    stop, dwell = lines.index("HALT"), lines.index("WAIT SEC 0.500")
    speeds = [(i, float(line[8:])) for i, line in enumerate(lines) if line.startswith("$VEL.CP=")]
    plunge = next(i for i, value in speeds if 0.009 < value < 0.0125)
    feed = next(i for i, value in speeds if 0.02 < value < 0.035)
    assert lines.index("; (pocket)") < lines.index("; M3 S13000") < plunge < feed < dwell < stop
    # The robot must really stand before it waits, halts and ends.
    motions = [i for i, line in enumerate(lines) if line.startswith("LIN")]
    for event in (dwell, stop, lines.index("; M5")):
        before = max(i for i in motions if i < event)
        assert not lines[before].endswith("C_DIS")
    blended = [lines[i].endswith("C_DIS") for i in motions]
    assert sum(blended) > 0.5 * len(blended)


def test_rapid_speed_stops_dwells_and_comments_are_in_their_place() -> None:
    text = write("rapid", zone="z1").files["pocket.mod"]
    lines = [line.strip() for line in text.split("\n")]
    declared = [float(line.split("[")[1].split(",")[0]) for line in lines if line.startswith("CONST speeddata")]
    assert any(9.0 < v < 11.0 for v in declared)
    assert any(24.0 < v < 26.0 for v in declared)
    assert len(declared) < 60
    assert lines.index("! M3 S13000") < lines.index("WaitTime 0.500;") < lines.index("Stop;") < lines.index("ENDPROC")
    zones = rapid_points(text)[1]
    assert zones[-1] == "fine"
    assert zones.count("z1") > 0.5 * len(zones)
    assert lines[0] == "MODULE pocket_m"
    assert lines[-2] == "ENDMODULE"


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_long_programs_are_split_and_called_in_order(language: str) -> None:
    whole = write(language, cycle_s=1e-4)
    split = write(language, cycle_s=1e-4, points_per_file=7)
    assert np.array_equal(all_points(whole, language), all_points(split, language))
    suffix = "src" if language == "krl" else "mod"
    parts = [name for name in split.files if re.search(rf"_\d{{3}}\.{suffix}$", name)]
    assert len(parts) == math.ceil(whole.points / 7) > 1
    master = split.files[f"pocket.{suffix}"]
    calls = re.findall(r"^\s*(pocket_\d{3})(?:\( \)|;)$", master, flags=re.MULTILINE)
    assert [f"{call}.{suffix}" for call in calls] == parts == sorted(parts)
    assert any("split" in warning for warning in split.warnings)
    if language == "krl":
        assert {name.replace(".src", ".dat") for name in split.files if name.endswith("src")} <= set(split.files)


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_points_closer_than_the_cycle_are_merged_and_said(language: str) -> None:
    # 25 mm/s and 40 ms: 1 mm between points (Berger2013 eq. 5); the wiggle below would need one every 0.2 mm.
    x = np.arange(0.2, 30.0, 0.2)
    text = "G21 G90\nG0 X0 Y0 Z0\n" + "".join(f"G1 X{v:.3f} Y{0.3 * math.sin(9 * v):.4f} F1500\n" for v in x) + "M2\n"
    result = write(language, text, cycle_s=0.040)
    points = all_points(result, language)[1:-1, :3, 3]
    path_way = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert result.merged_points > 50
    assert "merged" in result.warnings[0]
    assert len(points) * 1.0e-3 <= 0.06
    assert result.largest_position_error_m > 1e-5
    assert path_way.min() > 0.2e-3


def test_frames_by_number_or_by_value() -> None:
    T_flange_tcp = np.eye(4)
    T_flange_tcp[:3, 3] = [0.1, 0.0, 0.35]
    text = write("krl", tool=T_flange_tcp, base=7, status=2, turn=35).files["pocket.src"]
    assert "$TOOL={X 100.0000,Y 0.0000,Z 350.0000,A 0.00000,B 0.00000,C 0.00000}" in text
    assert "$BASE=BASE_DATA[7]" in text
    assert re.search(r"^PTP \{X .*,S 2,T 35\}$", text, flags=re.MULTILINE)
    module = write("rapid").files["pocket.mod"]
    assert 'PERS wobjdata w_pocket:=[FALSE,TRUE,"",[[1500.0000,200.0000,600.0000],[1.00000000,' in module


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_lines_stay_within_the_controllers_limit(language: str) -> None:
    long = "(" + "x" * 400 + ")\n"
    result = write(language, TEXT.replace("M2\n", long + "M2\n"))
    for text in result.files.values():
        assert max(len(line) for line in text.split("\n")) <= KRL.line_characters
        assert text.isascii()


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"name": "9lives"}, "cannot use this name"),
        ({"name": "a" * 25}, "too long"),
        ({"name": "tool path"}, "cannot use this name"),
        ({"start_axes_rad": (0.0, 1.0)}, "start_axes_rad"),
        ({"cycle_s": 0.0}, "cycle_s"),
        ({"blend_m": -1.0}, "blend_m"),
        ({"status": 2}, "S and T"),
        ({"axis_percent": 0}, "axis_percent"),
        ({"points_per_file": 0}, "points_per_file"),
        ({"name": "a" * 22, "points_per_file": 5}, "too long"),
        ({"tool": np.full((4, 4), np.nan)}, "not finite"),
    ],
)
def test_krl_refusals(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        write("krl", **changes)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"name": "a" * 40}, "too long"),
        ({"zone": "z3"}, "zone"),
        ({"tool_mass_kg": 0.0}, "tool_mass_kg"),
        ({"T_base_part": np.eye(3)}, "T_base_part"),
        ({"points_per_file": 0}, "points_per_file"),
    ],
)
def test_rapid_refusals(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        write("rapid", **changes)


@pytest.mark.parametrize(("language", "file"), [("krl", "pocket.src"), ("krl", "pocket.dat"), ("rapid", "pocket.mod")])
def test_golden_files(language: str, file: str) -> None:
    text = "G21 G90\n(slot)\nM3 S8000\nG0 X0 Y0 Z10\nG1 Z-1 F600\nG1 X40 F1500\nG0 Z10\nM5\nM2\n"
    result = write(language, text, step_m=5e-3, cell="KR 300")
    made = re.sub(r"counterflex \S+", "counterflex VERSION", result.files[file])
    assert made == (DATA / f"golden_{file}").read_text(encoding="ascii")
