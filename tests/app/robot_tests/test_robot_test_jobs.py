"""The jobs iso9283, iso230 and twin track from files to summary, and what they refuse."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from counterflex.app.proof.truth import truth_of
from counterflex.app.robot_tests import iso230, iso9283
from counterflex.app.simulated_cell import tracked_program
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.tracker_log import log_text
from counterflex.geometry import pose, rotation
from counterflex.twin.truth.family import WIDE
from counterflex.twin.truth.file import write_truth

SQUARE = np.array([(0, 0, 0), (40, 0, 0), (40, 40, 0), (0, 40, 0), (0, 0, 0)]) * MM
POSES = np.array([(0, 0, 0), (60, 0, 10), (50, 45, 0)]) * MM
TURN = rotation.about_y(90.0 * DEG)  # where Euler angles are singular


def table(file: Path, points: Float, more: str = "", head: str = "") -> Path:
    lines = ["x_mm,y_mm,z_mm" + head, *(",".join(f"{x / MM:.6g}" for x in p) + more for p in points)]
    file.write_text("\n".join(lines) + "\n")
    return file


def sampled(way: Float, step: float = 0.1 * MM) -> Float:
    parts = [
        a + (b - a) * np.linspace(0.0, 1.0, max(2, round(float(np.linalg.norm(b - a)) / step)), endpoint=False)[:, None]
        for a, b in itertools.pairwise(way)
    ]
    return np.concatenate([*parts, way[-1:]])


def log(file: Path, p: Float, R: Float | None = None, rate: float = 1000.0) -> Path:
    Ts = pose.make(np.eye(3) if R is None else R, p)
    text = log_text(np.arange(len(p)) / rate, Ts, 15.0 * UM)
    if R is None:
        keep = [0, 1, 2, 3, 8]
        text = "\n".join(",".join(np.array(line.split(","))[keep]) for line in text.splitlines()) + "\n"
    file.write_text(text)
    return file


@pytest.fixture(scope="module")
def square(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Commanded square at 100 mm/s, and a log of four cycles 50 um high with 10 um of noise."""
    folder = tmp_path_factory.mktemp("square")
    out = np.array([(-10.0, -10.0, 10.0)]) * MM
    way = np.concatenate([out, SQUARE[:1] - [5.0 * MM, 0.0, 0.0], SQUARE, out])
    p = np.concatenate([sampled(way) for _ in range(4)]) + np.array([0.0, 0.0, 50.0 * UM])
    p = p + 10.0 * UM * np.random.default_rng(1).standard_normal(p.shape)
    return table(folder / "square.csv", SQUARE, ",100", ",speed_mm_s"), log(folder / "log.csv", p)


def test_path_job(square: tuple[Path, Path], tmp_path: Path) -> None:
    path, measured = square
    summary = iso9283.run([measured], tmp_path / "out", path=path)
    assert (summary["test"], summary["cycles"], summary["corners"]) == ("path", 4, 3)
    assert summary["AT_um"]["low"] <= 50.0 <= summary["AT_um"]["high"]
    assert summary["velocity"]["commanded_mm_s"] == 100.0
    assert abs(summary["velocity"]["AV_percent"]["value"]) < 0.1
    written = {file.name for file in (tmp_path / "out").iterdir()}
    assert written == {"attained.csv", "attained.parquet", "figures.csv", "report.html", "summary.json"}
    raw = pl.read_parquet(tmp_path / "out" / "attained.parquet")
    assert raw.height == summary["places"] * 4
    at = raw.group_by("place").agg(pl.col("deviation_y_um").mean(), pl.col("deviation_z_um").mean())
    assert float(at["deviation_z_um"].mean()) == pytest.approx(50.0, abs=2.0)  # type: ignore[arg-type]
    figures = pl.read_csv(tmp_path / "out" / "figures.csv")
    assert {"AT", "RT", "AV", "RV", "FV", "CR", "CO"} <= set(figures["figure"])
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["AT_um"] == summary["AT_um"]


def test_fitted_frame_of_a_path(square: tuple[Path, Path]) -> None:
    """A fitted frame takes the 50 um of height, and says that it did."""
    path, measured = square
    summary = iso9283.run([measured], path=path, frame="fit")
    assert summary["frame_fitted"]
    assert summary["fitted_shift_mm"] == pytest.approx(0.05, abs=0.005)
    assert summary["AT_um"]["value"] < 25.0


def test_average_lowers_the_noise(square: tuple[Path, Path]) -> None:
    path, measured = square
    plain, averaged = (iso9283.run([measured], path=path, average_ms=ms) for ms in (0.0, 20.0))
    assert averaged["RT_um"]["value"] < 0.5 * plain["RT_um"]["value"]
    assert averaged["filter"] == "moving mean over 20 ms"


def rest_log(file: Path, offset: Float, seed: int, cycles: int = 3) -> Path:
    """A log with rests at all poses, 0.6 s each, in a tracker frame that is turned and far away."""
    rng, at, parts = np.random.default_rng(seed), np.array([-20.0, -20.0, 20.0]) * MM, []
    for _ in range(cycles):
        for target in POSES + offset:
            share = (1.0 - np.cos(np.pi * np.arange(300) / 300))[:, None] / 2.0
            parts += [at + (target - at) * share, np.tile(target, (600, 1))]
            at = target
    p = np.concatenate(parts)
    p = p + 10.0 * UM * rng.standard_normal(p.shape)
    R = rotation.exp(30e-6 * rng.standard_normal((len(p), 3))) @ rotation.about_z(1e-3) @ TURN
    T = pose.make(rotation.about_x(0.3), np.array([1.0, 2.0, 3.0]))
    seen = pose.inverse(T) @ pose.make(R, p)
    return log(file, seen[:, :3, 3], seen[:, :3, :3])


FRAME = f"1000,2000,3000,0,0,{0.3 / DEG}"


def test_pose_job_with_orientation_and_directions(tmp_path: Path) -> None:
    """Orientation at B = 90 deg: 1 mrad about z is AP_c; two directions 30 um apart: vAP."""
    commanded = table(tmp_path / "poses.csv", POSES, ",0,90,0", ",a_deg,b_deg,c_deg")
    files = [
        rest_log(tmp_path / f"{name}.csv", np.array([x, 0.0, 0.0]) * UM, seed)
        for name, x, seed in (("left", 100.0, 1), ("right", 130.0, 2))
    ]
    summary = iso9283.run(files, tmp_path / "out", poses=commanded, frame=FRAME, by_direction=True)
    assert summary["cycles"] == 6
    for row in summary["poses"]:
        assert row["AP_x_um"]["value"] == pytest.approx(115.0, abs=3.0)
        assert row["AP_c_mdeg"]["value"] == pytest.approx(1e-3 / DEG * 1e3, abs=1.0)
        assert row["AP_a_mdeg"]["value"] == pytest.approx(0.0, abs=1.0)
        assert row["stabilisation_time_s"] == 0.0
    for row in summary["multi_directional"]:
        assert row["vAP_um"]["value"] == pytest.approx(30.0, abs=3.0)
    assert summary["distances"][0]["AD_um"]["value"] == pytest.approx(0.0, abs=3.0)
    fitted = iso9283.run(files[:1], poses=commanded, frame="fit")
    assert max(row["AP_um"]["value"] for row in fitted["poses"]) < 5.0


def test_dataset_that_states_its_poses(tmp_path: Path) -> None:
    """A spreadsheet of single readings: commanded poses, numbers and directions stand in its rows."""
    rows = ["pose;dir;cx;cy;cz;x;y;z"]
    for direction, shift in ((1, 0.0), (2, 0.04)):
        for _ in range(3):
            for k, p in enumerate(POSES / MM):
                rows.append(
                    ";".join([f"{k + 1}", f"{direction}", *(f"{v:g}" for v in p), *(f"{v + shift:.4f}" for v in p)])
                )
    (tmp_path / "points.csv").write_text("\n".join(rows).replace(".", ","))
    (tmp_path / "points.toml").write_text(
        'format = "counterflex-dataset"\nversion = 1\nname = "points"\nkind = "pose_test"\n'
        '[[files]]\npath = "points.csv"\nseparator = ";"\ndecimal = ","\n'
        '[channels.pose]\ncolumns = ["pose"]\nunit = "1"\n[channels.direction]\ncolumns = ["dir"]\nunit = "1"\n'
        '[channels.p_base_command]\ncolumns = ["cx", "cy", "cz"]\nunit = "mm"\n'
        '[channels.p_tracker_target]\ncolumns = ["x", "y", "z"]\nunit = "mm"\n'
    )
    summary = iso9283.run([tmp_path / "points.toml"])
    assert [row["AP_x_um"]["value"] for row in summary["poses"]] == pytest.approx([20.0] * 3, abs=0.1)
    assert [row["vAP_um"]["value"] for row in summary["multi_directional"]] == pytest.approx(
        [40.0 * 3**0.5] * 3, abs=0.1
    )


def test_circularity_and_straightness_jobs(square: tuple[Path, Path], tmp_path: Path) -> None:
    """A ring 20 um too large that breathes by +-10 um, both ways, with the program's circle and without."""
    angle = np.concatenate([np.linspace(0.0, 7.0, 7000), np.linspace(7.0, 0.0, 7000)])
    r = 30.0 * MM + (20.0 + 10.0 * np.cos(2.0 * angle)) * UM
    measured = log(tmp_path / "ring.csv", np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle]))
    corners = np.linspace(0.0, 2.0 * np.pi, 181)
    nominal = table(
        tmp_path / "ring_path.csv", 30.0 * MM * np.column_stack([np.cos(corners), np.sin(corners), 0.0 * corners])
    )
    summary = iso230.circular([measured], tmp_path / "out", path=nominal)
    assert [row["direction"] for row in summary["turns"]] == ["ccw", "cw"]
    for row in summary["turns"]:
        assert (row["G_um"], row["F_max_um"], row["F_min_um"]) == pytest.approx((20.0, 30.0, 10.0), abs=0.1)
    (both,) = summary["bi_directional"]
    assert (both["G_b_um"], both["D_um"], both["H_um"]) == pytest.approx((20.0, 20.0, 0.0), abs=0.1)
    bare = iso230.circular([measured])
    assert bare["turns"][0]["F_max_um"] is None
    assert bare["turns"][0]["G_um"] == pytest.approx(20.0, abs=0.1)
    path, straight = square
    lines = iso230.straight([straight], tmp_path / "lines", path=path)
    assert len(lines["stretches"]) == 16
    assert all(row["horizontal_um"] < 90.0 for row in lines["stretches"])  # +-4 sigma of 10 um
    assert (tmp_path / "lines" / "report.html").is_file()


PROGRAM = "G17 G21 G40 G49 G54 G80 G90\nT1 M6\nG43 H1\nG0 Z60\nG0 X10 Y20\nG1 X35 F3000\nG1 Y40\nG0 Z70\nM30\n"


def test_a_program_tracked_on_the_simulated_cell(tmp_path: Path, small: Path) -> None:
    """The nominal cell keeps the path but for corners and noise; a wide truth does not; the log names no truth."""
    (tmp_path / "angle.ngc").write_text(PROGRAM)
    cell = read_cell(small)
    figures: dict[str, dict[str, Any]] = {}
    for name, seed in (("nominal", None), ("wide", 5)):
        truth = truth_of(cell, seed, WIDE)
        write_truth(tmp_path / f"{name}.toml", truth)
        made = tracked_program.run(tmp_path / "angle.ngc", small, tmp_path / f"{name}.toml", tmp_path / name, cycles=2)
        assert made["readings_per_s"] == 250.0
        figures[name] = iso9283.run([tmp_path / name / "tracker.csv"], path=tmp_path / "angle.ngc")
    assert figures["nominal"]["cycles"] == figures["wide"]["cycles"] == 2
    assert figures["nominal"]["AT_um"]["value"] < figures["wide"]["AT_um"]["value"]
    assert figures["wide"]["velocity"]["commanded_mm_s"] == 50.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "square.csv", "poses": "square.csv"}, "poses and a path are given"),
        ({}, "commanded poses are not known"),
        ({"path": "far.csv"}, "no attained path"),
        ({"path": "square.csv", "frame": "here"}, "no frame"),
        ({"path": "square.csv", "frame": "1,2,3"}, "no frame"),
        ({"path": "line.csv", "frame": "fit"}, "cannot be fitted to a straight path"),
        ({"path": "words.csv"}, "not a finite number"),
        ({"path": "columns.csv"}, "other columns"),
        ({"path": "speeds.csv"}, "one value above 0"),
        ({"path": "point.csv"}, "needs two points"),
        ({"poses": "far.csv"}, "no cycle goes through all commanded poses"),
        ({"path": "none.ngc"}, "no feed moves"),
        ({"poses": "none.ngc"}, "dwells nowhere"),
        ({"path": "two.ngc"}, "different paths"),
        ({"path": "square.csv", "average_ms": 1e6}, "shorter than the filter"),
    ],
)
def test_refused(square: tuple[Path, Path], tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path, measured = square
    (tmp_path / "square.csv").write_text(path.read_text())
    table(tmp_path / "far.csv", SQUARE + 1.0)
    table(tmp_path / "line.csv", SQUARE[:2])
    table(tmp_path / "point.csv", SQUARE[[0, 0]])
    (tmp_path / "words.csv").write_text("x_mm,y_mm,z_mm\n1,2,three\n")
    (tmp_path / "columns.csv").write_text("x,y,z\n1,2,3\n")
    (tmp_path / "speeds.csv").write_text("x_mm,y_mm,z_mm,speed_mm_s\n1,2,3,5\n4,5,6,7\n")
    head = "G17 G21 G40 G49 G54 G80 G90\n"
    (tmp_path / "none.ngc").write_text(head + "G0 X1\nM30\n")
    (tmp_path / "two.ngc").write_text(head + "G0 X0 Y0 Z0\nG1 X9 F100\nG0 Z5\nG1 X0 F100\nM30\n")
    files = {key: tmp_path / value if key in ("path", "poses") else value for key, value in change.items()}
    with pytest.raises(CounterflexError, match=message) as fault:
        iso9283.run([measured], tmp_path / "out", **files)
    assert "\n" not in str(fault.value)
    assert not (tmp_path / "out").exists()
