"""Exports of trackers: one set of readings in every format, a published line of DTrack, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM
from counterflex.files.logs.tracker_exports.formats import FORMATS, DTrackLines, Readings, collected
from counterflex.files.logs.tracker_exports.point_table import PointTableLines, stamp_ns
from counterflex.files.logs.tracker_log import log_text
from counterflex.geometry import pose, rotation
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE, NO_ORIENTATION, TrackerPose

SAMPLES = Path(__file__).parents[3] / "examples" / "tracker_exports"
POINTS = np.array(
    [
        (1200.1234, -850.5678, 310.25),
        (1200.2234, -850.4678, 310.26),
        (1210.5, -840.25, 312.0),
        (1225.75, -830.125, 315.5),
        (1240.0, -820.0, 320.0),
    ]
)
ROWS = (
    ("spatial_analyzer.txt", "spatial-analyzer", False),
    ("table_decimal_comma.csv", "point-table", False),
    ("table_polar_gon.csv", "point-table", False),
    ("table_inch_clock.txt", "point-table", True),
    ("dtrack.log", "dtrack", True),
)


@pytest.mark.parametrize(("file", "form", "oriented"), ROWS)
def test_the_same_readings_in_every_format(file: str, form: str, oriented: bool) -> None:
    found = Readings.read(SAMPLES / file, form)
    assert found.Ts_tracker_target[:, :3, 3] / MM == pytest.approx(POINTS, abs=2e-4)
    assert found.oriented is oriented
    if oriented:
        assert rotation.log(found.Ts_tracker_target[:, :3, :3]) / DEG == pytest.approx(
            np.tile([0.0, 0.0, 10.0], (5, 1)), abs=1e-4
        )
    if form == "spatial-analyzer":
        assert found.time_s is None  # stamps of whole seconds give no times
    else:
        assert found.time_s == pytest.approx(0.004 * np.arange(5), abs=1e-6)
    if file == "table_decimal_comma.csv":
        assert found.sigma_m == pytest.approx(0.012 * MM)


def test_published_line_of_dtrack() -> None:
    """The angles beside the matrix in the manual's example: R = Rx(19.6522) Ry(-57.3530) Rz(116.5992) deg."""
    lines = DTrackLines("manual")
    assert lines.measured("ts 39596.024831") is None
    measured = lines.measured(
        "6d 1 [0 1.000][261.103 116.520 41.085 19.6522 -57.3530 116.5992][-0.241543 0.968868 -0.054332 -0.482366 "
        "-0.168461 -0.859619 -0.842010 -0.181427 0.508039]"
    )
    assert measured is not None
    a, b, c = np.array([19.6522, -57.3530, 116.5992]) * DEG
    expected = rotation.about_x(a) @ rotation.about_y(b) @ rotation.about_z(c)
    assert measured.T_tracker_target[:3, :3] == pytest.approx(expected, abs=2e-6)
    assert measured.T_tracker_target[:3, 3] / MM == pytest.approx([261.103, 116.520, 41.085])


def test_no_other_target_of_dtrack_takes_the_place_of_a_hidden_one() -> None:
    """Manual of DTrack2, B.2.3: a line holds all *tracked* bodies; a marker (3d) is another target, too."""
    turned = "[1 0 0 0 1 0 0 0 1]"
    lines = (
        "ts 1.0", f"6d 2 [3 1.000][1 2 3 0 0 0]{turned}[7 1.000][9 9 9 0 0 0]{turned}", "3d 1 [1 1.000][5 5 5]",
        "ts 1.1", f"6d 1 [7 1.000][9 9 9 0 0 0]{turned}",
        "ts 1.2", f"6d 2 [7 1.000][9 9 9 0 0 0]{turned}[3 1.000][2 2 3 0 0 0]{turned}",
    )  # fmt: skip
    reader = DTrackLines("a")
    found = [one for line in lines if (one := reader.measured(line)) is not None]
    assert [(one.frame_id, one.time_ns, round(float(one.T_tracker_target[0, 3] / MM))) for one in found] == [
        (3, 1_000_000_000, 1),
        (3, 1_200_000_000, 2),
    ]


@pytest.mark.parametrize("line", ["P, 1.0, 2.0, 3.0, 0.5, 0.5", "A, B, P, 1, 2, 3, 0, 0", "P 1.0 2.0 3.0 0.5 0.5 0.5"])
def test_offsets_behind_a_point_are_not_taken_for_its_coordinates(line: str) -> None:
    reader = FORMATS["spatial-analyzer"][0]("a")
    reader.measured("// AXES = CARTESIAN: X, Y, Z (mm)")
    assert reader.measured("A, B, 12, 1.0, 2.0, 3.0,") is not None
    with pytest.raises(FileFormatError, match="more numbers than three coordinates"):
        reader.measured(line)
    with pytest.raises(FileFormatError, match="other axes; got X, Z, Y; expected X, Y, Z"):
        reader.measured("// AXES = CARTESIAN: X, Z, Y (mm)")


def test_stamps() -> None:
    second = 10**9
    assert stamp_ns("16:56:08.25", "") == (16 * 3600 + 56 * 60 + 8) * second + second // 4
    days = {
        stamp_ns(f"{day} 00:00:01", "") for day in ("2026-05-12", "2026/05/12", "12.05.2026", "05/12/26", "05/12/2026")
    }
    assert days == {1778544001 * second}


def test_own_log_comes_back(tmp_path: Path) -> None:
    before = Readings.read(SAMPLES / "dtrack.log", "dtrack")
    assert before.time_s is not None
    (tmp_path / "log.csv").write_text(log_text(before.time_s, before.Ts_tracker_target, 15e-6))
    after = Readings.read(tmp_path / "log.csv")
    assert after.Ts_tracker_target == pytest.approx(before.Ts_tracker_target, abs=1e-8)
    assert after.sigma_m == pytest.approx(15e-6)
    assert after.oriented


@pytest.mark.parametrize(
    ("form", "text", "message"),
    [
        ("spatial-analyzer", "A, 1, 2.0, 3.0, 4.0\n", "which unit"),
        ("spatial-analyzer", "// AXES = SPHERICAL: R, T, P (mm)\n1, 2, 3\n", "Cartesian"),
        ("spatial-analyzer", "// AXES = CARTESIAN: X, Y, Z (furlong)\n1, 2, 3\n", "unit is not one"),
        ("spatial-analyzer", "// AXES = CARTESIAN: X, Y, Z (mm)\nA, 1, 2\n", "not a point"),
        ("point-table", "a,b,c\n1,2,3\n" * 30, "no header"),
        ("point-table", "Time [s],X,Y [mm],Z [mm]\n0,1,2,3\n", "has no unit"),
        ("point-table", "Time,X [mm],Y [mm],Z [mm]\n0,1,2,3\n", "times has no unit"),
        ("point-table", "Time [s],X [mm],Y [mm],Z [mm]\n0,1,2\n", "values in a line"),
        ("point-table", "Time [s];X [mm];Y [mm];Z [mm]\n0;1.000,5;2;3\n", "not a finite number"),
        ("point-table", "Time [s],X [mm],Y [mm],Z [mm]\n1,1,2,3\n0,1,2,3\n", "runs backwards"),
        ("dtrack", "fr 1\n6d 1 [0 1.0][1 2 3 0 0 0][1 0 0 0 1 0 0 0 1]\n", "before the first time stamp"),
        ("dtrack", "ts 1.0\n6d 1 [0 1.0][1 2 3 0 0 0][1 0 0 0 1 0 0 0 2]\n", "no rotation"),
        ("dtrack", "ts 1.0\n6d 1 [0 -1.0][0 0 0 0 0 0][0 0 0 0 0 0 0 0 0]\n", "no usable reading"),
        ("counterflex", "// SpatialAnalyzer SA 2024\n", "spatial-analyzer"),
        ("counterflex", "time_s,x_mm,y_mm,z_mm\n", "no usable reading"),
    ],
)
def test_bad_exports(tmp_path: Path, form: str, text: str, message: str) -> None:
    file = tmp_path / "export.txt"
    file.write_text(text)
    with pytest.raises(FileFormatError, match=message) as fault:
        Readings.read(file, form)
    assert "\n" not in str(fault.value)
    assert "export.txt" in str(fault.value)


@settings(max_examples=40)
@given(st.lists(st.sampled_from([0, BEAM_BROKEN, INACCURATE, BEAM_BROKEN | INACCURATE]), min_size=1), st.booleans())
def test_readings_that_the_tracker_doubts_are_left_out_and_counted(doubts: list[int], bare: bool) -> None:
    """Neither their place, nor their time, nor their standard deviation counts, wherever they stand in the record."""
    more = NO_ORIENTATION if bare else 0
    everything = [
        TrackerPose(k, 1000 + 3000 * k, doubt | more, 0, pose.make(p=np.array([k, 0.0, 0.0])), 0.5 + k)
        for k, doubt in enumerate(doubts)
    ]
    good = [k for k, doubt in enumerate(doubts) if doubt == 0]
    if not good:
        with pytest.raises(FileFormatError, match=f"no usable reading; got {len(doubts)} readings"):
            collected(everything, "x")
        return
    found = collected(everything, "x")
    assert found.Ts_tracker_target[:, 0, 3].tolist() == good
    assert found.left_out == len(doubts) - len(good)
    assert found.oriented is not bare
    assert found.sigma_m == 0.5 + np.median(good)
    assert (found.time_s is None) == (len(good) == 1)
    if found.time_s is not None:
        assert found.time_s == pytest.approx(3e-6 * (np.array(good) - good[0]), abs=1e-15)


@settings(max_examples=40)
@given(st.floats(0.5, 20.0), st.floats(-180.0, 180.0), st.floats(-89.0, 89.0), st.booleans())
def test_a_point_by_its_angles(distance: float, azimuth: float, elevation: float, from_zenith: bool) -> None:
    """Elevation counts from the horizon up, zenith from the vertical down: one point by both, and its closed form."""
    name, angle = ("V", 90.0 - elevation) if from_zenith else ("Elevation", elevation)
    lines = PointTableLines("x")
    assert lines.measured(f"Time [s],Distance [m],Hz [deg],{name} [deg]") is None
    found = lines.measured(f"0.5,{distance!r},{azimuth!r},{angle!r}")
    assert found is not None
    a, e = azimuth * DEG, elevation * DEG
    expected = distance * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    np.testing.assert_allclose(found.T_tracker_target[:3, 3], expected, atol=1e-9)


def test_names_at_the_command_line() -> None:
    from counterflex.cli.commands.standards import options

    assert set(options.FORMATS) == set(FORMATS)
