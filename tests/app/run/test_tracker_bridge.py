"""Tracker logs as text, spherical as a tracker measures, and the bridge that sends them on."""

from __future__ import annotations

import math
import socket
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.app.run.tracker_bridge import forward
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.files.logs.tracker_log import measurements, read_tracker_log
from counterflex.files.logs.wrench_log import read_wrench_log
from counterflex.geometry import rotation
from counterflex.protocols.tracker.telegram import NO_ORIENTATION, read_pose

SPHERICAL = "time_s,distance_mm,azimuth_deg,zenith_deg,qw,qx,qy,qz"


def test_spherical_lines_become_poses() -> None:
    half = math.sqrt(0.5)
    lines = [SPHERICAL, "0.001,2000,90,90,1,0,0,0", "# a comment", "", f"0.002,1000,0,60,{half},0,0,{half}"]
    found = list(measurements(lines, "x"))
    assert [one.time_ns for one in found] == [1_000_000, 2_000_000]
    assert found[0].T_tracker_target[:3, 3] == pytest.approx([0.0, 2.0, 0.0], abs=1e-12)
    assert found[1].T_tracker_target[:3, 3] == pytest.approx([math.sin(math.pi / 3), 0.0, 0.5])
    assert found[1].T_tracker_target[:3, :3] == pytest.approx(rotation.about_z(math.pi / 2))
    assert [one.sequence for one in found] == [1, 2]


@given(
    st.floats(100.0, 1e5),
    st.floats(-179.0, 179.0),
    st.floats(1.0, 179.0),
    st.tuples(*[st.floats(-1.0, 1.0) for _ in range(4)]).filter(lambda q: np.linalg.norm(q) > 0.1),
)
def test_spherical_and_cartesian_say_the_same(
    distance: float, azimuth: float, zenith: float, quat: tuple[float, float, float, float]
) -> None:
    """Against the closed inverse: range, and the two angles by atan2."""
    q = np.array(quat) / np.linalg.norm(quat)
    line = f"1,{distance!r},{azimuth!r},{zenith!r}," + ",".join(repr(float(v)) for v in q)
    T = next(iter(measurements([SPHERICAL, line], "x"))).T_tracker_target
    x, y, z = T[:3, 3] * 1e3
    assert math.sqrt(x * x + y * y + z * z) == pytest.approx(distance)
    assert math.degrees(math.atan2(y, x)) == pytest.approx(azimuth, abs=1e-6)
    assert math.degrees(math.atan2(math.hypot(x, y), z)) == pytest.approx(zenith, abs=1e-6)
    assert abs(float(np.dot(rotation.quat_wxyz(T[:3, :3]), q))) == pytest.approx(1.0)


def test_a_reflector_has_no_orientation() -> None:
    found = next(iter(measurements(["time_ns,x_mm,y_mm,z_mm,sigma_mm", "5,1,2,3,0.015"], "x")))
    assert found.status == NO_ORIENTATION
    assert found.sigma_m == pytest.approx(15e-6)
    assert found.T_tracker_target[:3, 3] == pytest.approx([1e-3, 2e-3, 3e-3])


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["time_s,x_mm,y_mm,zmm"], "Did you mean z_mm"),
        (["time_s,x_mm,y_mm"], "a column is missing; got z_mm"),
        (["x_mm,y_mm,z_mm"], "time must be given once"),
        (["time_s,time_ns,x_mm,y_mm,z_mm"], "time must be given once"),
        (["time_s"], "position must be given once"),
        (["time_s,x_mm,y_mm,z_mm,distance_mm,azimuth_deg,zenith_deg"], "position must be given once"),
        (["time_s,x_mm,x_mm,y_mm,z_mm"], "twice"),
        ([SPHERICAL, "1,2,3"], "x:2: values in a line; got 3"),
        ([SPHERICAL, "1,-2,0,0,1,0,0,0"], "distance is negative"),
        ([SPHERICAL, "1,2,0,0,1,1,0,0"], "unit length"),
        ([SPHERICAL, "1,2,nan,0,1,0,0,0"], "not a finite number"),
        ([SPHERICAL, "-1,2,0,0,1,0,0,0"], "out of range"),
    ],
)
def test_what_is_wrong_is_said(lines: list[str], said: str) -> None:
    with pytest.raises(FileFormatError, match=said):
        list(measurements(lines, "x"))


@given(st.text(max_size=60), st.text(max_size=60))
def test_any_lines_are_poses_or_one_clear_error(head: str, line: str) -> None:
    for first in (head, SPHERICAL):
        try:
            found = list(measurements([first, line], "x"))
        except CounterflexError:
            continue
        assert len(found) <= 1


def test_a_log_whose_clock_stands_still_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text("time_s,x_mm,y_mm,z_mm\n1,0,0,0\n2,0,0,0\n2,0,0,0\n")
    with pytest.raises(FileFormatError, match="measurement 3"):
        read_tracker_log(file)
    file.write_text("time_s,x_mm,y_mm,z_mm\n")
    with pytest.raises(FileFormatError, match="without rows"):
        read_tracker_log(file)
    with pytest.raises(FileFormatError, match="Did you mean log.csv"):
        read_tracker_log(tmp_path / "lag.csv")


def test_the_bridge_sends_line_by_line_and_leaves_out_what_it_cannot_use() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(10.0)
        said: list[str] = []
        lines = [SPHERICAL, "1,2000,0,90,1,0,0,0", "1.001,broken", "1.002,2000,1,90,1,0,0,0"]
        found = forward(iter(lines), listener.getsockname(), "stdin", complain=said.append)
        assert found == {"job": "tracker bridge", "sent": 2, "left_out": 1}
        assert [read_pose(listener.recv(2048)).sequence for _ in range(2)] == [1, 3]
        assert "stdin:3" in said[0]
    with pytest.raises(FileFormatError, match="nothing came"):
        forward(iter([]), ("127.0.0.1", 9), "stdin")


def test_recorded_loads_are_read_in_any_order_of_columns(tmp_path: Path) -> None:
    file = tmp_path / "loads.csv"
    file.write_text("# N\nfx_n,time_s,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,0.0,2,3,4,5,6\n7,0.5,8,9,10,11,12\n")
    time_s, w = read_wrench_log(file)
    assert time_s.tolist() == [0.0, 0.5]
    assert w.tolist() == [[1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12]]
    for text, said in (
        ("time_s,fx_n\n1,2\n", "other columns"),
        ("time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,2,3,4,5,6,7\n", "fewer than two rows"),
        ("time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,2,3,4,5,6,7\n1,2,3,4,5,6,7\n", "time does not go on"),
        ("time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,2,x,4,5,6,7\n", "not a finite number"),
    ):
        file.write_text(text)
        with pytest.raises(FileFormatError, match=said):
            read_wrench_log(file)
