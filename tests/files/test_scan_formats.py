"""Scans of other formats, written by their own libraries, give their points; damaged or unread ones are named."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pye57
import pypcd4
import pytest
import trimesh

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan import by_library
from counterflex.files.scan.read import read_scan
from counterflex.files.scan.scan import Scan

rng = np.random.default_rng(1)
POINTS = rng.uniform(-0.2, 0.3, (500, 3)).round(6)
R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
T = np.array([0.5, -0.25, 0.125])


def points_of(scan: Scan) -> Float:
    """All points in file units."""
    out: Float = np.concatenate(scan.chunks).astype(np.float64) + scan.origin
    return out


def e57(path: Path) -> None:
    """Two scans, the second in a scanner frame of its own."""
    with pye57.E57(str(path), mode="w") as file:
        for some, pose in ((POINTS[:200], False), (POINTS[200:], True)):
            local = (some - T) @ R if pose else some
            raw = {f"cartesian{axis}": local[:, k].copy() for k, axis in enumerate("XYZ")}
            turn = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]) if pose else np.array([1.0, 0.0, 0.0, 0.0])
            file.write_scan_raw(raw, rotation=turn, translation=T if pose else np.zeros(3))


def las(path: Path) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales, header.offsets = np.full(3, 1e-6), np.zeros(3)
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.write(path)


def pcd(encoding: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        cloud = pypcd4.PointCloud.from_xyz_points(np.vstack([POINTS, np.full((1, 3), np.nan)]).astype(np.float32))
        cloud.save(path, encoding=getattr(pypcd4.Encoding, encoding))

    return write


def ptx(path: Path) -> None:
    """Two scans on grids with missing returns, the second turned and moved."""
    lines = []
    for some, turn, shift in ((POINTS[:200], np.eye(3), np.zeros(3)), (POINTS[200:], R, T)):
        lines += ["25" if len(some) == 225 else str(len(some) // 10 + 1), "10"]
        lines += [" ".join(f"{v:.6f}" for v in row) for row in (shift, *turn.T)]
        M = np.eye(4)
        M[:3, :3], M[3, :3] = turn.T, shift
        lines += [" ".join(f"{v:.6f}" for v in row) for row in M]
        local = (some - shift) @ turn
        lines += [" ".join(f"{v:.6f}" for v in row) + " 0.5" for row in local]
        lines += ["0 0 0 0.5"] * 10
    path.write_text("\n".join(lines) + "\n")


def ply_behind(text: bool) -> Callable[[Path], None]:
    """Vertices behind an element with a list."""

    def write(path: Path) -> None:
        head = f"ply\nformat {'ascii' if text else 'binary_little_endian'} 1.0\nelement camera 1\n"
        head += "property float view_x\nproperty list uchar int ids\n"
        head += f"element vertex {len(POINTS)}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        if text:
            body = "1.5 2 7 8\n" + "".join(" ".join(f"{v:.6f}" for v in row) + "\n" for row in POINTS)
            path.write_text(head + body)
        else:
            body_bytes = struct.pack("<fB2i", 1.5, 2, 7, 8) + POINTS.astype("<f4").tobytes()
            path.write_bytes(head.encode() + body_bytes)

    return write


FORMATS: dict[str, tuple[str, Callable[[Path], None], float | None, int]] = {
    "E57": ("s.e57", e57, 1.0, 0),
    "LAS": ("s.las", las, None, 0),
    "LAZ": ("s.laz", las, None, 0),
    "PCD text": ("s.pcd", pcd("ASCII"), None, 1),
    "PCD binary": ("s.pcd", pcd("BINARY"), None, 1),
    "PCD compressed": ("s.pcd", pcd("BINARY_COMPRESSED"), None, 1),
    "PTX": ("s.ptx", ptx, None, 20),
    "PLY, other elements first, text": ("s.ply", ply_behind(True), None, 0),
    "PLY, other elements first, binary": ("s.ply", ply_behind(False), None, 0),
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_points_come_back(tmp_path: Path, name: str) -> None:
    file, write, unit, dropped = FORMATS[name]
    write(tmp_path / file)
    scan = read_scan(tmp_path / file)
    np.testing.assert_allclose(points_of(scan), POINTS, atol=2e-6)
    assert scan.unit_m == unit
    assert scan.dropped == dropped


@pytest.mark.parametrize("name", [name for name in FORMATS if "text" not in name])
def test_a_damaged_file_is_named(tmp_path: Path, name: str) -> None:
    file, write, _, _ = FORMATS[name]
    write(tmp_path / file)
    data = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(data[: len(data) // 2])
    with pytest.raises(FileFormatError) as error:
        read_scan(tmp_path / file)
    assert file in str(error.value)


@pytest.mark.parametrize("line", [b"POINTS", b"WIDTH", b"HEIGHT"])
def test_a_cloud_that_says_to_have_too_many_points_is_refused_before(tmp_path: Path, line: bytes) -> None:
    file, write, _, _ = FORMATS["PCD compressed"]
    write(tmp_path / file)
    head = re.sub(
        rb"^(" + line + rb") \d+$", rb"\1 999999999999", (tmp_path / file).read_bytes(), count=1, flags=re.MULTILINE
    )
    (tmp_path / file).write_bytes(head)
    with pytest.raises(FileFormatError, match="too many points"):
        read_scan(tmp_path / file)


@pytest.mark.parametrize("name", ["E57", "LAS", "PCD binary"])
def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    file, write, _, _ = FORMATS[name]
    write(tmp_path / file)

    def missing(module: str) -> Any:
        raise ImportError(module)

    monkeypatch.setattr(by_library, "import_module", missing)
    with pytest.raises(FileFormatError, match=r"counterflex\[formats\]"):
        read_scan(tmp_path / file)


@pytest.mark.parametrize(
    ("first", "word"), [(b"ISO-10303-21;\nHEADER;", "STEP"), (b"glTF\x02", "glTF"), (b"%PDF-1.7", "PDF")]
)
def test_other_formats_are_named(tmp_path: Path, first: bytes, word: str) -> None:
    (tmp_path / "s.dat").write_bytes(first + b"\n" * 40)
    with pytest.raises(FileFormatError, match=word):
        read_scan(tmp_path / "s.dat")


def test_text_and_binary_stl_are_the_same_mesh(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(3, 25.0)
    mesh.export(tmp_path / "b.stl")
    mesh.export(tmp_path / "t.stl", file_type="stl_ascii")
    a, b = (points_of(read_scan(tmp_path / name)) for name in ("b.stl", "t.stl"))
    np.testing.assert_allclose(np.sort(a[:, 0])[::5000], np.sort(b[:, 0])[::5000], atol=0.01)
