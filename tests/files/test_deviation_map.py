"""A map of deviations says to other readers what was measured: PLY to trimesh, VTP by the rules of its XML."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest
import trimesh
from defusedxml import ElementTree

from counterflex.core.errors import InputError
from counterflex.evaluate.inspection.part_deviations import FLOOR, FREE, WALL, PartDeviations
from counterflex.files.deviation_map import about, write_deviation_map

COUNT = 7


@pytest.fixture
def measured() -> PartDeviations:
    """Places with material left and gouges."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(COUNT, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    deviation = np.array([1e-4, -2e-4, 0.0, 3e-6, -4e-6, 5e-5, 1e-3])
    return PartDeviations(
        rng.normal(scale=0.1, size=(COUNT, 3)), normals, deviation, np.full(COUNT, 2e-6),
        np.array([FLOOR, WALL, FREE, FLOOR, WALL, FREE, FREE]),
    )  # fmt: skip


def test_a_ply_is_read_by_another_library(tmp_path: Path, measured: PartDeviations) -> None:
    file = tmp_path / "map.PLY"
    write_deviation_map(file, measured)
    read = trimesh.load(file, file_type="ply", process=False)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(read.vertices, measured.points * 1e3, rtol=1e-15)
    np.testing.assert_allclose(np.ravel(data["deviation_mm"]), measured.deviation_m * 1e3, rtol=1e-6)
    np.testing.assert_allclose(np.ravel(data["standard_deviation_mm"]), 2e-3, rtol=1e-6)
    np.testing.assert_array_equal(np.ravel(data["face"]), measured.face)
    np.testing.assert_allclose(np.stack([np.ravel(data[f"n{a}"]) for a in "xyz"], axis=1), measured.normals, atol=1e-7)
    head = file.read_bytes().partition(b"end_header\n")[0].decode("ascii").splitlines()
    assert f"comment {about('part')[0]}" in head
    assert "positive = material left" in about("part")[0]


def test_a_vtp_holds_what_the_rules_of_its_xml_ask_for(tmp_path: Path, measured: PartDeviations) -> None:
    """VTK XML formats, serial PolyData: base 64 of a number of bytes (header_type) and the bytes."""
    file = tmp_path / "map.vtp"
    write_deviation_map(file, measured)
    root = ElementTree.parse(file).getroot()
    assert root.attrib == {
        "type": "PolyData", "version": "1.0", "byte_order": "LittleEndian", "header_type": "UInt64"
    }  # fmt: skip
    (piece,) = root.findall("./PolyData/Piece")
    assert {name: int(number) for name, number in piece.attrib.items() if number != "0"} == {
        "NumberOfPoints": COUNT, "NumberOfVerts": COUNT
    }  # fmt: skip
    kinds = {"Float32": "<f4", "Float64": "<f8", "UInt8": "u1", "Int64": "<i8"}
    arrays = {}
    for one in piece.iter("DataArray"):
        raw = base64.b64decode(one.text or "", validate=True)
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        values = np.frombuffer(raw[8:], kinds[one.attrib["type"]])
        arrays[one.attrib["Name"]] = values.reshape(-1, int(one.attrib.get("NumberOfComponents", 1)))
    np.testing.assert_allclose(arrays["points"], measured.points * 1e3, rtol=1e-15)
    np.testing.assert_allclose(arrays["normal"], measured.normals, atol=1e-7)
    np.testing.assert_allclose(arrays["deviation_mm"][:, 0], measured.deviation_m * 1e3, rtol=1e-6)
    np.testing.assert_array_equal(arrays["face"][:, 0], measured.face)
    np.testing.assert_array_equal(arrays["connectivity"][:, 0], range(COUNT))
    np.testing.assert_array_equal(arrays["offsets"][:, 0], range(1, COUNT + 1))
    (data,) = piece.findall("PointData")
    assert data.attrib == {"Scalars": "deviation_mm", "Normals": "normal"}
    (said,) = root.findall("./PolyData/FieldData/Array")
    assert bytes(int(code) for code in (said.text or "").split()).decode("ascii") == "; ".join(about("part")) + "\0"


def test_a_map_in_the_base_of_the_robot_says_so(tmp_path: Path, measured: PartDeviations) -> None:
    """A part turned by 90 degrees about z: its x axis is the y axis of the base."""
    T_base_part = np.array([[0.0, -1.0, 0.0, 1.5], [1.0, 0.0, 0.0, -0.2], [0.0, 0.0, 1.0, 0.9], [0.0, 0.0, 0.0, 1.0]])
    write_deviation_map(tmp_path / "map.ply", measured, T_base_part, "base")
    read = trimesh.load(tmp_path / "map.ply", file_type="ply", process=False)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    x, y, z = measured.points.T
    np.testing.assert_allclose(read.vertices, 1e3 * np.stack([1.5 - y, x - 0.2, z + 0.9], axis=1), atol=1e-9)
    nx, ny, nz = measured.normals.T
    np.testing.assert_allclose(np.ravel(data["nx"]), -ny, atol=1e-7)
    np.testing.assert_allclose(np.ravel(data["ny"]), nx, atol=1e-7)
    np.testing.assert_allclose(np.ravel(data["nz"]), nz, atol=1e-7)
    assert b"base of the robot, mm" in (tmp_path / "map.ply").read_bytes()


def test_another_ending_is_refused(tmp_path: Path, measured: PartDeviations) -> None:
    with pytest.raises(InputError, match=r"\.ply or \.vtp"):
        write_deviation_map(tmp_path / "map.vtk", measured)
    assert list(tmp_path.iterdir()) == []
