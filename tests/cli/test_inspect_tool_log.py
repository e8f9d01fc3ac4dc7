"""``inspect --tool-log``: a known path gives its deviation back, as in ``evaluate``; bad logs are one clear line."""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import read_job
from counterflex.app.proof import judge
from counterflex.core.arrays import Float
from counterflex.files import parquet_table
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.summary_file import read_run
from counterflex.files.tool_path_file import KIND, LAYOUT, VERSION, ToolPathRows
from counterflex.geometry import pose, rotation
from counterflex.runtime.record_ring import WIDTH, column

PROGRAM = """G17 G54 G40 G49 G80 G90 G21
M6 T1
M3 S13000
G0 Z40
G0 X-12 Y9
G0 Z22
G1 Z17 F3000
G1 X24 F1500
G1 Y40
G0 Z40
M2
"""
"""A groove along x that turns to y and leaves the blank."""
OTHER = PROGRAM.replace("G1 X24 F1500\nG1 Y40", "G1 X12 Y20 F1500\nG1 X52 Y8")
LEFT, UP = 0.12, 0.05
"""Of the tool as it ran, mm: to the left of the feed, and too high."""
TRACKER = (2500.0, -1200.0, 600.0, 40.0, -3.0, 5.0)
"""Where the tracker stands in the part frame: mm and deg, z-y'-x''."""
COMMAND = ("inspect", "angle.ngc", "--cell", "cell.toml", "--out", "out/deep")
PERIOD_S = 0.004


@functools.cache
def ran(program: str = PROGRAM, left: float = LEFT) -> Float:
    """(n, 4): time s, and x, y, z mm of the tool in the part frame, at even steps; the program's path moved aside."""
    p, shift = [np.array([-12.0, 9.0, 40.0])], []
    for line in program.splitlines():
        words = {word[0]: float(word[1:]) for word in line.split() if word[0] in "XYZ"}
        if words and line.startswith("G"):
            p.append(np.array([words.get(axis, p[-1][k]) for k, axis in enumerate("XYZ")]))
    corners, steps = np.array(p), []
    for a, b in itertools.pairwise(corners):
        length = float(np.linalg.norm(b - a))
        if length > 0.0:
            n = max(2, round(length / (25.0 * PERIOD_S)))
            t = (b - a) / length
            aside = np.array([-t[1], t[0], 0.0])
            steps.append(a + np.linspace(0.0, 1.0, n, endpoint=False)[:, None] * (b - a))
            shift.append(np.tile(left * aside + np.array([0.0, 0.0, UP]), (n, 1)))
    points = np.concatenate(steps) + np.concatenate(shift)
    return np.column_stack([PERIOD_S * np.arange(len(points)), points])


def noisy(points: Float, noise_mm: float = 0.02, seed: int = 1) -> Float:
    """Points with noise."""
    out: Float = points + np.random.default_rng(seed).normal(scale=noise_mm, size=points.shape)
    return out


def seen(points_mm: Float) -> Float:
    """Points of the part frame as the tracker sees them."""
    T = pose.from_xyz_zyx(np.array(TRACKER[:3]), np.radians(TRACKER[3:]))
    return pose.transform(pose.inverse(T), points_mm)


def write(path: Path, time_s: Float, points_mm: Float, head: str = "time_s,x_mm,y_mm,z_mm") -> None:
    """A tracker's log."""
    rows = np.column_stack([time_s, points_mm])
    lines = [",".join(f"{v:.6f}" for v in row) for row in rows]
    path.write_text("\n".join([head, *lines]) + "\n")


@pytest.fixture
def work(folder: Path) -> Path:
    """A folder with the program beside the cell, and a good log."""
    (folder / "angle.ngc").write_text(PROGRAM)
    rows = ran()
    write(folder / "log.csv", rows[:, 0], noisy(rows[:, 1:]))
    return folder


def feature(summary: dict[str, Any], name: str, quantity: str) -> dict[str, float]:
    """A measured quantity."""
    entry: dict[str, float] = next(
        row["part"] for row in summary["features"] if (row["feature"], row["quantity"]) == (name, quantity)
    )
    return entry


def test_the_path_of_a_simulated_part_is_judged_as_evaluate_judges_it(
    machined: Any, work: Path, counterflex: Callable[..., Any]
) -> None:
    """The independent truth is the simulated cell: its tool's path, seen with noise by a tracker that stands aside."""
    run, _ = read_run(machined.folder / "run" / "run.parquet")
    compared = judge.ProgramComparison.of([machined.folder / "run"])
    judged = compared.judged["nominal"]
    expected = judged.variant.path
    assert judged.surface is not None
    write(work / "twin.csv", run.time_s, seen(noisy(run.p_part_tcp * 1e3, 0.015)))
    frame = ",".join(str(v) for v in TRACKER)
    ended = counterflex(
        "inspect", "part.ngc", "--cell", "cell.toml", "--out", "out/deep", "--tool-log", "twin.csv", "--frame", frame,
        "--cut", "--json",
    )  # fmt: skip
    assert ended.status == 0, ended.err
    summary = json.loads(ended.out)
    assert summary["judged"] == "tool path"
    part = summary["parts"]["part"]
    assert abs(part["path"]["path"]["p997_mm"] - expected.path.p997_m * 1e3) < 0.02
    assert abs(part["path"]["path"]["max_mm"] - expected.path.max_m * 1e3) < 0.02
    assert abs(part["floor"]["rms_mm"] - judged.surface.floor.rms_m * 1e3) < 0.01
    assert 12.0 < part["log"]["noise_um"] < 18.0
    for row in judge.features(compared.reference, {"nominal": judged}):
        other = feature(summary, row.feature, row.quantity)
        if row.quantity != "flatness":
            assert abs(other["mean_mm"] - row.mean_m["nominal"] * 1e3) < 0.01, row.quantity
    page = Path("out/deep/report.html").read_text()
    assert "The path of the tool was measured, not the surface" in page
    assert "Path of the tool" in page


def test_a_known_deviation_comes_back_by_surface(work: Path, counterflex: Callable[..., Any]) -> None:
    ended = counterflex(*COMMAND, "--tool-log", "log.csv", "--frame", "as-measured", "--cut")
    assert ended.status == 0, ended.err
    assert "the path of the tool" in " ".join(ended.out.split())
    assert "not measured" in " ".join(ended.out.split())
    data, about = parquet_table.read(Path("out/deep/tool-path.parquet"), KIND, VERSION, LAYOUT)
    rows = ToolPathRows(**data)
    assert (about["program"], about["source"], about["frame_fitted"]) == ("angle.ngc", "log.csv", False)
    cutting = rows.cutting == 1
    assert 0.3 < np.mean(cutting) < 0.8
    middle = cutting & (np.abs(rows.nominal[:, 0] - 10e-3) < 8e-3) & (np.abs(rows.nominal[:, 1] - 9e-3) < 1e-6)
    assert np.count_nonzero(middle) > 100
    for values, true in ((rows.deviation_m[:, 0], LEFT), (rows.deviation_m[:, 1], UP)):
        off = values[middle] * 1e3 - true
        assert np.sqrt(np.mean(off**2)) < 0.008
        # a straight stretch is smoothed as one: its stations are off by nearly the same, within what is stated
        stated = rows.standard_deviation_m[middle]
        assert np.sqrt(np.mean((off * 1e-3 / stated) ** 2)) < 2.0
        assert np.median(stated) < 5e-6
    floor, wall_left, wall_right = (np.nanmean(rows.normal_m[middle], axis=0) * 1e3).tolist()
    assert abs(floor - UP) < 0.005
    assert abs(wall_left + LEFT) < 0.005  # too far to the left: too much taken there
    assert abs(wall_right - LEFT) < 0.005
    summary = json.loads(Path("out/deep/summary.json").read_text())
    assert abs(feature(summary, "groove 1", "depth")["mean_mm"] - (3.0 - UP)) < 0.01
    assert abs(feature(summary, "groove 1", "width")["mean_mm"] - 16.0) < 0.01
    assert not Path("out/deep/deviations.parquet").exists()  # no surface was measured


def test_a_log_in_any_frame_is_fitted_to_the_path(work: Path, counterflex: Callable[..., Any]) -> None:
    """Without a deviation that a frame can have, the fit finds the pose within its standard deviation."""
    rows = ran()
    aside = rows[:, 1:].copy()
    aside[:, 2] -= UP
    approach: Float = np.linspace([60.0, -30.0, 90.0], aside[0], 200, endpoint=False).astype(np.float64)
    points = noisy(np.concatenate([approach, aside]))
    write(work / "far.csv", PERIOD_S * np.arange(len(points), dtype=np.float64), seen(points))
    ended = counterflex(*COMMAND, "--tool-log", "far.csv", "--frame", "fit", "--json")
    assert ended.status == 0, ended.err
    part = json.loads(ended.out)["parts"]["part"]
    assert part["log"]["frame_fitted"]
    assert part["log"]["cutting"].startswith("not known")
    assert set(part["path"]) == {"path", "along", "normal"}
    T = np.array(part["registration"]["T_part_scan_mm"])
    true = pose.from_xyz_zyx(np.array(TRACKER[:3]), np.radians(TRACKER[3:]))
    middle = np.array([10.0, 20.0, 20.0])
    back = pose.transform(T, pose.transform(pose.inverse(true), middle[None]))[0]
    assert (
        np.linalg.norm(back - middle) < 0.25
    )  # the deviation of 0.12 mm to the left is no frame's, and bends it a little
    assert np.linalg.norm(rotation.log(T[:3, :3] @ true[:3, :3].T)) < 0.02
    page = Path("out/deep/report.html").read_text()
    assert "was fitted to the program" in page


@functools.cache
def run_rows() -> Float:
    """Records of a run: commanded path, the controller's own position 0.03 mm aside, the tracker's 0.12 mm."""
    rows = ran()
    out = np.zeros((len(rows), WIDTH))
    aside = rows[:, 1:] - np.array([0.0, 0.0, UP])
    command = aside.copy()
    straight = np.abs(np.diff(aside, axis=0, append=aside[-1:])[:, 0]) > 0.05
    command[straight, 1] = 9.0
    out[:, column("counter_ms")] = 4.0 * np.arange(len(rows))
    out[:, column("received_ns")] = 1e9 + 4e6 * np.arange(len(rows))
    out[:, column("cycle")] = 1.0 + np.arange(len(rows))
    out[:, column("elapsed")] = 1.0
    out[:, column("flag_reported")] = 1.0
    out[::2, column("flag_tracker_new")] = 1.0
    for k, axis in enumerate("xyz"):
        out[:, column(f"nominal_{axis}")] = command[:, k] * 1e-3
        out[:, column(f"reported_{axis}")] = command[:, k] * 1e-3 + (3e-5 if axis == "z" else 0.0)
        out[:, column(f"actual_{axis}")] = noisy(rows[:, 1:], 0.01)[:, k] * 1e-3
    return out


@pytest.mark.parametrize(("position", "up"), [(None, UP), ("reported", 0.03), ("commanded", 0.0)])
def test_a_run_log_says_which_position_is_judged(
    work: Path, counterflex: Callable[..., Any], position: str | None, up: float
) -> None:
    log = RunLogWriter(work / "run", {"counterflex": "0.1.0"})
    log.add(run_rows(), 1.0)
    log.close()
    more = () if position is None else ("--position", position)
    ended = counterflex(*COMMAND, "--tool-log", "run", *more, "--json")
    assert ended.status == 0, ended.err
    part = json.loads(ended.out)["parts"]["part"]
    assert part["log"]["position"].startswith(position or "measured")
    assert part["log"]["along_counts_from"] == "command"
    assert abs(part["path"]["normal"]["floor"]["mean_mm"] - up) < 0.004
    assert part["path"]["along"]["rms_mm"] < 0.1


def half(rows: Float) -> Float:
    """The first half of a log."""
    return rows[: len(rows) // 2]


def bad(change: Callable[[Float], Float], left: float = LEFT) -> Callable[[Path], None]:
    """A log of points that were changed."""

    def made(folder: Path) -> None:
        rows = ran(left=left)
        points = change(noisy(rows[:, 1:]))
        write(folder / "bad.csv", rows[: len(points), 0], points)

    return made


def text(content: str) -> Callable[[Path], None]:
    """A log of this text."""

    def made(folder: Path) -> None:
        (folder / "bad.csv").write_text(content)

    return made


def other_program(folder: Path) -> None:
    """The log of another program."""
    rows = ran(OTHER)
    write(folder / "bad.csv", rows[:, 0], noisy(rows[:, 1:]))


def straight(folder: Path) -> None:
    """A program of one straight move, and its log."""
    (folder / "angle.ngc").write_text(PROGRAM.replace("G0 Z22\nG1 Z17 F3000\n", "").replace("G1 Y40\nG0 Z40\n", ""))
    x: Float = np.linspace(-12.0, 24.0, 500)
    write(
        folder / "bad.csv",
        PERIOD_S * np.arange(500, dtype=np.float64),
        np.column_stack([x, np.full(500, 9.0), np.full(500, 40.0)]),
    )


def two_runs(folder: Path) -> None:
    """A folder with two runs."""
    for _ in range(2):
        log = RunLogWriter(folder / "bad", {})
        log.add(run_rows()[:100], 1.0)
        log.close()


def empty_folder(folder: Path) -> None:
    (folder / "bad").mkdir()


AS, FIT = ("--frame", "as-measured"), ("--frame", "fit")
HEAD = "time_s,x_mm,y_mm,z_mm\n"
BAD: dict[str, tuple[Callable[[Path], None], tuple[str, ...], list[str]]] = {
    "empty": (text(""), AS, ["bad.csv", "no usable reading"]),
    "only a head": (text(HEAD), AS, ["bad.csv", "no usable reading"]),
    "not a number": (text(HEAD + "0,1,2,3\n0.1,nan,2,3\n"), AS, ["bad.csv:3", "not a finite number"]),
    "three readings": (text(HEAD + "0,1,2,3\n0.1,2,2,3\n0.2,3,2,3\n"), AS, ["too few readings", "got 3"]),
    "a column without a unit": (text("time_s,x,y,z\n0,1,2,3\n"), AS, ["bad.csv:1", "'x'", "x_mm"]),
    "time runs backwards": (text(HEAD + "0,1,2,3\n1,1,2,3\n0.5,1,2,3\n"), AS, ["reading 3", "backwards"]),
    "inches": (bad(lambda p: p / 25.4), AS, ["another unit", "inch"]),
    "inches, to be fitted": (bad(lambda p: seen(p) / 25.4), FIT, ["another unit", "inch"]),
    "metres": (bad(lambda p: p / 1000.0), AS, ["another unit", "it is in m"]),
    "mirrored": (bad(lambda p: p * [1.0, -1.0, 1.0]), AS, ["mirrored", "right-handed"]),
    "mirrored, to be fitted": (bad(lambda p: seen(p) * [1.0, -1.0, 1.0]), FIT, ["mirrored", "right-handed"]),
    "half a path": (bad(half), AS, ["only a part of the program's path", "% of its feed motion"]),
    "half a path, to be fitted": (bad(lambda p: seen(half(p))), FIT, ["only a part of the program's path"]),
    "another program": (other_program, AS, ["the program's path", "expected >= 90 %"]),
    "another program, to be fitted": (other_program, FIT, ["the program's path", ">= 90 %"]),
    "another frame": (bad(lambda p: p + np.array([0.0, 30.0, 0.0])), AS, ["frame that was given", "deg it would"]),
    "scale": (bad(lambda p: seen(p) * 1.006, left=0.0), FIT, ["scale of the log is wrong", "1.00"]),
    "noise alone": (bad(lambda p: np.random.default_rng(0).normal(scale=30.0, size=p.shape)), AS, ["scatter too much"]),
    "one place": (bad(lambda p: 0.0 * p), AS, ["bad.csv"]),
    "a straight path": (straight, FIT, ["freedoms of the frame open", "--frame"]),
    "no frame": (bad(lambda p: p), (), ["in which frame", "--frame"]),
    "no such frame": (bad(lambda p: p), ("--frame", "here"), ["--frame", "here"]),
    "option of a scan": (bad(lambda p: p), (*AS, "--unit", "mm"), ["--unit", "a log of the tool has no such option"]),
    "option of run logs": (bad(lambda p: p), (*AS, "--run", "1"), ["--run", "tracker log"]),
    "a scan too": (bad(lambda p: p), (*AS, "--scan", "bad.csv"), ["--scan and --tool-log", "one of them"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_is_one_clear_line(work: Path, refused: Callable[..., str], name: str) -> None:
    make, options, words = BAD[name]
    make(work)
    line = refused(*COMMAND, "--tool-log", "bad.csv", *options)
    for word in words:
        assert word in line, line


def test_bad_run_logs_are_one_clear_line(work: Path, refused: Callable[..., str]) -> None:
    empty_folder(work)
    assert "no run log in this folder" in refused(*COMMAND, "--tool-log", "bad")
    two_runs(work)
    assert "several runs" in refused(*COMMAND, "--tool-log", "bad")
    assert "no such run" in refused(*COMMAND, "--tool-log", "bad", "--run", "7")
    assert "part frame" in refused(*COMMAND, "--tool-log", "bad", "--frame", "fit")
    assert "nothing measured is given" in refused(*COMMAND)


def test_the_job_reads_the_program_once(work: Path) -> None:
    """The path that the log is laid on is the program's own."""
    job = read_job(work / "angle.ngc", read_cell(work / "cell.toml"))
    assert np.allclose(job.path.p_part_tcp[-1], [24e-3, 40e-3, 40e-3])
