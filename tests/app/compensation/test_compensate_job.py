"""The main job on files: what is written is what was planned, and nothing changes where no force acts."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation import compensate as job
from counterflex.app.compensation.compensate import Compensated, compensate
from counterflex.app.compensation.prediction import chatter, chatter_warnings, figures, path_error, prediction
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import read_plan
from counterflex.path.toolpath import FEED
from counterflex.plan.plan import Plan, across
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.reader import read_gcode

ProgramFile = Callable[..., Path]
TOLERANCE = 5 * UM
ROUNDING = 0.1 * UM  # the fourth decimal of a mm, in three axes
HEAD = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\n"
POCKET = HEAD + "G1 X20 F1500\nG3 X20 Y15 I0 J5\nG1 X52\nG0 Z60\nM2\n"


def distance(points: Float, polyline: Float) -> Float:
    """Distance of points from a polyline."""
    a, d = polyline[:-1], np.diff(polyline, axis=0)
    length2 = np.maximum(np.sum(d * d, axis=1), 1e-30)
    out = np.empty(len(points))
    for k, q in enumerate(points):
        t = np.clip(np.sum((q - a) * d, axis=1) / length2, 0.0, 1.0)
        out[k] = np.sqrt(np.min(np.sum((a + t[:, None] * d - q) ** 2, axis=1)))
    return out


def feed_command(found: Compensated) -> Float:
    """Commanded points of the feed motions."""
    plan = found.plan
    rows = plan.path.kind == FEED
    out: Float = (plan.path.p_part_tcp + plan.correction_part)[rows]
    return out


def read_back(found: Compensated) -> Float:
    text = next(iter(found.files.values()))
    out: Float = tool_path(read_gcode(text), step_m=5e-3, chord_m=5e-8).p_part_tcp
    return out


@pytest.mark.parametrize("text", [None, POCKET], ids=["groove", "arc"])
def test_gcode_runs_through_the_planned_points(small: Path, program: ProgramFile, text: str | None) -> None:
    file = program() if text is None else program(text)
    found = compensate(file, read_cell(small), predict=False)
    assert np.linalg.norm(found.plan.correction_part, axis=1).max() > 200 * UM
    assert distance(feed_command(found), read_back(found)).max() <= TOLERANCE + ROUNDING
    assert found.written["largest_written_error_um"] <= (TOLERANCE + ROUNDING) / UM
    assert found.written["moved_motions"] > 0


def test_a_coarse_tolerance_makes_a_short_program(small: Path, program: ProgramFile) -> None:
    file, cell = program(), read_cell(small)
    fine = compensate(file, cell, tolerance_m=2 * UM, predict=False)
    coarse = compensate(file, cell, tolerance_m=50 * UM, predict=False)
    assert coarse.written["vertices_added"] < fine.written["vertices_added"]
    assert distance(feed_command(coarse), read_back(coarse)).max() <= 50 * UM + ROUNDING


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_robot_languages_run_through_the_planned_points(small: Path, program: ProgramFile, language: str) -> None:
    found = compensate(program(POCKET), read_cell(small), language=language, predict=False)
    text = "\n".join(found.files.values())
    number = r"(-?[\d.]+(?:E[-+]?\d+)?)"
    pattern = {
        "krl": rf"LIN\s*\{{X {number}, ?Y {number}, ?Z {number}",
        "rapid": rf"MoveL\s*\[\[{number}, ?{number}, ?{number}\]",
    }[language]
    points = np.array([[float(v) for v in match] for match in re.findall(pattern, text)]) * MM
    assert len(points) > 20
    off = distance(feed_command(found), points).max()
    said = found.written["largest_position_error_um"] * UM
    assert off <= said + 1e-6
    # Points closer than feed times controller cycle (0.3 mm) are merged: coarser than the tolerance, and said so.
    assert said <= TOLERANCE or found.written["warnings"]
    assert off < 30 * UM
    assert np.abs(found.plan.rotvec_part).max() > 1e-5  # these languages turn the tool back, too


@pytest.mark.parametrize("text", [None, POCKET], ids=["groove", "arc"])
def test_a_rigid_robot_gets_its_program_back_byte_for_byte(stiff: Path, program: ProgramFile, text: str | None) -> None:
    file = program() if text is None else program(text)
    found = compensate(file, read_cell(stiff))
    assert found.plan.cutting.any()
    assert found.files[file.name].encode() == file.read_bytes()
    assert found.summary["prediction"]["peak_force_n"]["value"] > 50.0
    assert found.summary["prediction"]["predicted_nominal"]["max_mm"] == 0.0


def test_a_program_in_the_air_comes_back_byte_for_byte(small: Path, program: ProgramFile) -> None:
    text = HEAD.replace("G0 Z36", "G0 Z41").replace("\n", "\r\n") + "G1 X20 F1500 (keep)\r\nG2 X20 Y15 I3\r\nM30\r\n"
    file = program(text)
    found = compensate(file, read_cell(small))
    assert not found.plan.cutting.any()
    assert found.files[file.name].encode() == file.read_bytes()


def test_lines_that_cut_nothing_stay_as_they_are(small: Path, program: ProgramFile) -> None:
    tail = "G0 Z60\nG1 X-100 Y20 F3000 (far in the air)\nG1 X-90.5 F2000 ; and back\nG0 X0 Y0\nM5\nM2\n"
    found = compensate(program(HEAD + "G1 X52 F1500\n" + tail), read_cell(small), predict=False)
    assert found.files["part.ngc"].endswith(tail)


def test_loops_and_calls_are_unrolled(small: Path, program: ProgramFile) -> None:
    loop = "#1=0\no1 while [#1 lt 2]\nG0 X-12 Y[10+10*#1]\nG0 Z38\nG1 X52 F1500\nG0 Z60\n#1=[#1+1]\no1 endwhile\nM2\n"
    plain = "".join(f"G0 X-12 Y{y}\nG0 Z38\nG1 X52 F1500\nG0 Z60\n" for y in (10, 20)) + "M2\n"
    start = HEAD.replace("G0 X-12 Y15\nG0 Z36\n", "")
    cell = read_cell(small)
    looped = compensate(program(start + loop), cell, predict=False)
    straight = compensate(program(start + plain), cell, predict=False)
    assert looped.written["unrolled"]
    assert "while" not in looped.files["part.ngc"]
    assert distance(feed_command(straight), read_back(looped)).max() <= TOLERANCE + ROUNDING


def test_inch_programs_stay_inch_programs(small: Path, program: ProgramFile) -> None:
    inch = "G20 G17 G90\nM6 T1\nM3 S13000\nG0 Z2.4\nG0 X-0.472441 Y0.590551\nG0 Z1.417323\nG1 X2.047244 F59.0551\nM2\n"
    found = compensate(program(inch), read_cell(small), predict=False)
    text = found.files["part.ngc"]
    assert "G20" in text
    assert "G21" not in text
    assert distance(feed_command(found), read_back(found)).max() <= TOLERANCE + ROUNDING
    metric = compensate(program(), read_cell(small), predict=False)
    difference = found.plan.correction_part[found.plan.cutting][50:150].mean(axis=0)
    difference -= metric.plan.correction_part[metric.plan.cutting][50:150].mean(axis=0)
    assert np.abs(difference).max() < 5 * UM


@pytest.fixture
def even(small: Path, tmp_path: Path) -> Path:
    """The small cell with drives that its file states as nearly rigid: corrections without their steps."""
    rows = "".join(
        f"\n[[robot.servo]]\naxis = {axis}\nspeed_gain_nm_s = 4e6\nposition_gain_per_s = 30\nintegral_time_ms = 50\n"
        f"[[robot.play]]\naxis = {axis}\n"
        for axis in range(1, 7)
    )
    file = tmp_path / "even.toml"
    file.write_text(small.read_text(encoding="utf-8") + rows, encoding="utf-8")
    return file


def test_in_inverse_time_every_piece_keeps_the_speed(even: Path, program: ProgramFile) -> None:
    """G93 at 64 mm in 2.56 s (25 mm/s), ending in the material: the last piece takes the correction back."""
    text = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\nG93\nG1 X34 F32.6087\nG94\nG0 Z60\nM5\nM2\n"
    file = program(text)
    found = compensate(file, read_cell(even), predict=False)
    written = read_gcode(found.files[file.name], name="written")
    feeds = [motion for motion in written.motions if motion.kind == "feed"]
    assert len(feeds) > 5
    for motion in feeds:
        if float(np.linalg.norm(motion.p_end - motion.p_start)) > 50 * UM:
            assert motion.feed_m_s == pytest.approx(0.025, rel=0.3)


def test_arcs_stay_arcs_where_the_correction_is_even(even: Path, program: ProgramFile) -> None:
    """Three quarters of a circle, a light cut: the compensated points lie on arcs within the tolerance."""
    text = HEAD.replace("Z36", "Z39.8") + "G1 X14 F1500\nG3 X20 Y9 I6 J0 F1500\nG3 X26 Y15 I0 J6\nG1 X52\nM2\n"
    at_rest = "\n[dynamics]\ncorrection_smoothing_ms = 0\n"  # no mending of what a trial in motion leaves
    even.write_text(even.read_text(encoding="utf-8") + at_rest, encoding="utf-8")
    found = compensate(program(text), read_cell(even), predict=False, tolerance_m=20 * UM)
    assert found.written["arcs_as_lines"] == 0
    assert found.written["arcs_kept"] + found.written["arcs_split"] == 2
    assert found.written["arcs_kept"] >= 1
    assert found.files["part.ngc"].count("G3") >= 2
    assert distance(feed_command(found), read_back(found)).max() <= 20 * UM + ROUNDING


def test_all_files_are_written_and_say_the_same(small: Path, program: ProgramFile, tmp_path: Path) -> None:
    out = tmp_path / "out"
    summary = job.run(program(), small, out)
    assert {file.name for file in out.iterdir()} == {"part.ngc", "plan.parquet", "summary.json", "report.html"}
    stored = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert stored["format"] == "counterflex-summary"
    assert stored["version"] >= 1
    for key, value in json.loads(json.dumps(summary)).items():
        assert stored[key] == value
    assert set(stored) >= {
        "job", "program", "cell", "robot", "language", "files", "written", "prediction", "seconds", "counterflex",
    }  # fmt: skip
    plan, about = read_plan(out / "plan.parquet")
    plan = replace(plan, recut=compensate(program(), read_cell(small)).plan.recut)
    assert about["program"] == "part.ngc"
    found = stored["prediction"]
    assert found["points"] == len(plan.path)
    assert found["cutting_points"] == np.count_nonzero(plan.cutting)
    assert found["removed_mm3"] == pytest.approx(plan.volume_m3.sum() / MM**3, rel=1e-6)
    force = np.linalg.norm(plan.w_tcp_part[:, :3], axis=1)
    assert found["peak_force_n"]["value"] == pytest.approx(force.max(), abs=0.06)
    assert found["peak_force_n"]["line"] == plan.line[np.argmax(force)]
    bend = np.linalg.norm(plan.deflection_part[:, :3], axis=1)
    assert found["peak_deflection_um"]["value"] == pytest.approx(bend.max() / UM, abs=0.06)
    for name, deviation in (
        ("predicted_nominal", plan.deviation_nominal_part),
        ("predicted_compensated", plan.deviation_compensated_part),
    ):
        low, high = found[name]["p997_90_mm"]
        assert 0.0 < low < found[name]["p997_median_mm"] < high
        figures = {key: value for key, value in found[name].items() if key in ("max_mm", "p997_mm", "rms_mm")}
        assert figures == pytest.approx(recomputed(plan, deviation), abs=2e-4)
    assert next(iter(found)) == "headline"
    for key, name in (("before_mm", "nominal"), ("after_mm", "compensated")):
        error = found[f"predicted_{name}"]
        assert found["headline"][key] == [error["p997_median_mm"], *error["p997_90_mm"]]
    assert found["predicted_compensated"]["p997_mm"] < 0.6 * found["predicted_nominal"]["p997_mm"]


def recomputed(plan: Plan, deviation: Float) -> dict[str, float]:
    step = np.linalg.norm(np.diff(plan.path.p_part_tcp, axis=0, prepend=plan.path.p_part_tcp[:1]), axis=1)
    size = np.linalg.norm(across(deviation, plan.path.p_part_tcp), axis=1)
    return path_error(size[plan.judged], np.maximum(step[plan.judged], 1e-12))


def test_the_plan_file_gives_the_plan_back(small: Path, program: ProgramFile, tmp_path: Path) -> None:
    out = tmp_path / "out"
    file = program()
    job.run(file, small, out, report=False)
    assert not (out / "report.html").exists()
    stored, _ = read_plan(out / "plan.parquet")
    made = compensate(file, read_cell(small)).plan
    for name in Plan.__dataclass_fields__:
        if name not in ("path", "measured_part", "chip_m", "recut"):
            assert getattr(stored, name) == pytest.approx(getattr(made, name), rel=1e-12, abs=1e-15, nan_ok=True), name
    assert stored.measured_part is made.measured_part is None
    for name in made.path.__dataclass_fields__:
        assert getattr(stored.path, name) == pytest.approx(getattr(made.path, name), rel=1e-12, abs=1e-15), name


def test_two_runs_write_the_same_program(small: Path, program: ProgramFile) -> None:
    file, cell = program(POCKET), read_cell(small)
    assert compensate(file, cell).files == compensate(file, cell).files


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "empty"),
        ("G21\nM2\n", "moves nothing"),
        (HEAD + "G1 X52 F1500 Q7\nM2\n", "part.ngc:7"),
        (HEAD.replace("M3 S13000\n", "") + "G1 X52 F1500\nM2\n", "spindle"),
        (HEAD.replace("T1", "T9") + "G1 X52 F1500\nM2\n", "T9"),
        (HEAD + "G1 X5200 F1500\nM2\n", "reach|limit|singular"),
        (HEAD.replace("Z36", "Z1") + "G1 X52 F1500\nM2\n", "flute|bound|deep"),
    ],
)
def test_bad_input_ends_in_one_line_and_writes_nothing(
    small: Path, program: ProgramFile, tmp_path: Path, text: str, what: str
) -> None:
    out = tmp_path / "out"
    with pytest.raises(CounterflexError, match=what) as caught:
        job.run(program(text), small, out)
    assert "\n" not in str(caught.value)
    assert not out.exists()


def test_an_interrupted_run_writes_nothing(small: Path, program: ProgramFile, tmp_path: Path) -> None:
    def stop(fraction: float, what: str = "") -> None:
        if fraction > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        job.run(program(), small, tmp_path / "out", progress=stop)
    assert not (tmp_path / "out").exists()
    assert {file.name for file in tmp_path.iterdir()} == {"source"}


def test_unknown_language_is_refused(small: Path, program: ProgramFile) -> None:
    with pytest.raises(InputError, match="expected gcode, .*krl"):
        compensate(program(), read_cell(small), language="okuma")


def test_a_tool_that_swings_up_is_told_from_one_that_overshoots(small: Path, program: ProgramFile) -> None:
    """A force step bends an elastic tool to twice its rest at most; more is fed by the cut, and is no forecast."""
    plan = compensate(program(), read_cell(small)).plan
    assert chatter(plan) == []
    at_rest = np.linalg.norm(plan.deflection_part[:, :3] + plan.sag_part + plan.play_part, axis=1)[plan.cutting].max()
    row = int(np.flatnonzero(plan.cutting)[5])
    for key, quiet, loud in (("nominal", 1.9, 2.2), ("compensated", 0.9, 1.2)):
        for times, told in ((quiet, False), (loud, True)):
            off = getattr(plan, f"deviation_{key}_part").copy()
            off[row] = [0.0, times * at_rest, 0.0]  # the groove runs along x
            found = chatter(replace(plan, **{f"deviation_{key}_part": off}))
            assert bool(found) == told, (key, times)
            if told:
                assert [item["line"] for item in found] == [plan.line[row]]
                assert f"line {plan.line[row]}" in chatter_warnings(found)[0]


def test_lines_in_which_the_arm_keeps_swinging_are_warned_of(small: Path, program: ProgramFile) -> None:
    """A swing along the feed is no path error, but it is told."""
    cell, done = read_cell(small), compensate(program(), read_cell(small))
    assert done.summary["prediction"]["lasting_swings"] == []
    assert not any("does not come to rest" in text for text in done.summary["written"]["warnings"])
    slow = replace(done.plan.path, time_s=np.arange(len(done.plan.path), dtype=np.float64) * 0.016)
    swing = np.zeros_like(done.plan.deviation_compensated_part)
    swing[:, 0] = 3e-4 * np.sin(2.0 * np.pi * 8.0 * slow.time_s)
    plan = replace(done.plan, path=slow, deviation_compensated_part=swing)
    told = figures(plan)["lasting_swings"]
    assert told != []
    summary = {**done.summary, "prediction": {**done.summary["prediction"], "lasting_swings": told}}
    page = prediction(plan, cell, summary)
    assert any("does not come to rest" in note for note in page.notes)
