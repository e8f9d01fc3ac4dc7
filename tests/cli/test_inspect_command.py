"""``inspect``: a part of known shape gives its size back; bad inputs give one clear line or a right result."""

from __future__ import annotations

import functools
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import trimesh

from counterflex.core.arrays import Float
from counterflex.files.cell.cell import read_cell
from counterflex.files.part_deviations import read_part_deviations
from counterflex.geometry import rotation

PROGRAM = """G17 G54 G40 G49 G80 G90 G21
M6 T1
M3 S13000
G0 Z40
G0 X-12 Y11
G0 Z22
G1 Z17 F3000
G1 X22 F1500
G0 Z40
M2
"""
WIDTH, LEFT, RIGHT, DEPTH = 16.10, 8.25, 7.85, 3.12
"""Of the groove as made, mm: 0.1 too wide, 0.2 to the left, 0.12 too deep."""
R_TILT = rotation.exp(np.radians(15.0) * np.array([1.0, 2.0, 2.0]) / 3.0)
COMMAND = ("inspect", "groove.ngc", "--cell", "cell.toml", "--out", "out/deep")


@functools.cache
def part_mesh(size: tuple[float, float, float] = (40.0, 30.0, 20.0)) -> Any:
    """The part as made, mm: block less groove with a round end, by a library of solids."""
    block = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], size])
    middle = 11.0 + 0.5 * (LEFT - RIGHT)
    low, high = middle - 0.5 * WIDTH, middle + 0.5 * WIDTH
    slot = trimesh.creation.box(bounds=[[-1.0, low, 20.0 - DEPTH], [22.0, high, 30.0]])
    end = trimesh.creation.cylinder(0.5 * WIDTH, 20.0, sections=256)
    end.apply_translation([22.0, middle, 20.0 - DEPTH + 10.0])
    made = trimesh.boolean.difference([block, slot, end])
    assert made.is_volume
    return made


@functools.cache
def measured(count: int = 40_000, seed: int = 1, noise_mm: float = 0.01) -> Float:
    """Points all over the part but its bottom, part frame, mm, with noise and holes."""
    rng = np.random.default_rng(seed)
    points, _ = trimesh.sample.sample_surface(part_mesh(), count, seed=seed)
    kept = points[:, 2] > 0.3
    for _ in range(6):
        kept &= np.linalg.norm(points - points[rng.integers(len(points))], axis=1) > 1.5
    out: Float = points[kept] + rng.normal(scale=noise_mm, size=(int(kept.sum()), 3))
    return out


def tilted(points: Float) -> Float:
    """Points 15 deg and 30 mm off."""
    out: Float = points @ R_TILT.T + np.array([20.0, -20.0, 10.0])
    return out


def write(path: Path, points: Float) -> None:
    """Points as binary PLY or as text, by the name."""
    if path.suffix == ".ply":
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        head += "property float x\nproperty float y\nproperty float z\nend_header\n"
        path.write_bytes(head.encode() + points.astype("<f4").tobytes())
    else:
        pl.DataFrame(points).write_csv(path, include_header=False, separator=" ", float_precision=5)


def row(summary: dict[str, Any], quantity: str, name: str = "part") -> dict[str, Any]:
    """A measured quantity of the groove."""
    entry: dict[str, Any] = next(r for r in summary["features"] if r["quantity"] == quantity)[name]
    return entry


@pytest.fixture
def work(folder: Path) -> Path:
    """A folder with the program beside the cell."""
    (folder / "groove.ngc").write_text(PROGRAM)
    return folder


def expect_groove(summary: dict[str, Any], name: str = "part", tolerance_mm: float = 0.01) -> None:
    """The groove as made."""
    for quantity, value in (("width", WIDTH), ("wall left", LEFT), ("wall right", RIGHT), ("depth", DEPTH)):
        entry = row(summary, quantity, name)
        assert abs(entry["mean_mm"] - value) < min(0.005, tolerance_mm), (quantity, entry)
        assert abs(entry["worst_mm"] - value) < tolerance_mm, (quantity, entry)


def test_a_tilted_scan_in_inches_gives_the_part_as_made(work: Path, counterflex: Callable[..., Any]) -> None:
    write(work / "scan.ply", tilted(measured()) / 25.4)
    ended = counterflex(*COMMAND, "--scan", "scan.ply", "--json")
    assert ended.status == 0, ended.err
    summary = json.loads(ended.out)
    expect_groove(summary)
    entry = summary["parts"]["part"]
    assert entry["scan"]["unit"] == "inch"
    assert 8.0 < entry["scan"]["noise_um"] < 13.0
    assert entry["registration"]["datum_faces"] == ["x-", "x+", "y-", "y+", "top"]
    T = np.array(entry["registration"]["T_part_scan_mm"])
    np.testing.assert_allclose(T[:3, :3], R_TILT.T, atol=2e-4)
    # deviations: walls and floor as they were made, the faces that were left alone at zero
    rows, part = read_part_deviations(Path("out/deep/deviations.parquet"))
    assert (part.unit, part.program) == ("inch", "groove.ngc")
    floor = rows.deviation_m[rows.face == 0]
    assert abs(np.median(floor) + 120e-6) < 3e-6
    left = (rows.face == 1) & (rows.normals[:, 1] < -0.99)
    assert abs(np.median(rows.deviation_m[left]) + 250e-6) < 4e-6
    right = (rows.face == 1) & (rows.normals[:, 1] > 0.99)
    assert abs(np.median(rows.deviation_m[right]) - 150e-6) < 4e-6
    free = rows.face == 2
    assert abs(np.median(rows.deviation_m[free])) < 1e-6
    spread = float(np.std(rows.deviation_m[free] / rows.standard_deviation_m[free]))
    assert 0.8 < spread < 1.25  # deviations scatter as their standard deviations say


def test_two_parts_are_compared(work: Path, counterflex: Callable[..., Any]) -> None:
    write(work / "scan.xyz", measured())
    write(work / "first.xyz", tilted(measured(seed=2)))
    ended = counterflex(*COMMAND, "--scan", "scan.xyz", "--before", "first.xyz", "--unit", "mm")
    assert ended.status == 0, ended.err
    assert "wall right" in ended.out
    summary = json.loads(Path("out/deep/summary.json").read_text())
    for name in ("before", "after"):
        expect_groove(summary, name)
    page = Path("out/deep/report.html").read_text()
    assert "Sections across grooves" in page
    assert page.count("the scan and where it was laid") == 2


def test_a_cad_mesh_as_nominal_part_takes_the_deviation_away(work: Path, counterflex: Callable[..., Any]) -> None:
    part_mesh().export(work / "cad.stl")
    write(work / "scan.ply", tilted(measured()))
    ended = counterflex(*COMMAND, "--scan", "scan.ply", "--nominal", "cad.stl", "--json")
    assert ended.status == 0, ended.err
    rows, _ = read_part_deviations(Path("out/deep/deviations.parquet"))
    for face in (0, 1):
        assert abs(np.median(rows.deviation_m[rows.face == face])) < 3e-6
    assert json.loads(ended.out)["nominal"] == "cad.stl"


def test_datum_faces_decide_where_the_part_lies(work: Path, counterflex: Callable[..., Any]) -> None:
    """A blank sawn 0.4 mm too long in x: laid on x- its far end is off by that, by both ends half of it each."""
    points = measured()
    points = np.where(points[:, :1] > 35.0, points + np.array([0.4, 0.0, 0.0]), points)
    write(work / "scan.ply", tilted(points))
    offset = {}
    for faces in ("x-,y-,top", "x-,x+,y-,y+,top"):
        ended = counterflex(*COMMAND, "--scan", "scan.ply", "--datum", faces, "--json")
        assert ended.status == 0, ended.err
        rows, _ = read_part_deviations(Path("out/deep/deviations.parquet"))
        offset[faces] = float(np.median(rows.deviation_m[rows.normals[:, 0] > 0.99]))
    assert abs(offset["x-,y-,top"] - 400e-6) < 5e-6
    assert abs(offset["x-,x+,y-,y+,top"] - 200e-6) < 20e-6


def binary_stl(triangles: int, stated: int) -> bytes:
    """A binary STL that states another number of triangles than it holds."""
    return b"\0" * 80 + struct.pack("<I", stated) + b"\0" * (50 * triangles)


TEXT = "0 0 0\n10 0 0\n0 10 0\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
FILES: dict[str, tuple[str, bytes, list[str]]] = {
    "empty": ("s.xyz", b"", ["s.xyz", "empty"]),
    "blank lines": ("s.xyz", b"\n \n", ["s.xyz", "empty"]),
    "words": ("s.txt", b"a letter to a friend\nwith two lines\n", ["s.txt", "no line holds three numbers", "PLY"]),
    "two columns": ("s.xyz", b"1 2\n3 4\n", ["s.xyz", "no line holds three numbers"]),
    "text for a number": ("s.xyz", (TEXT + "1 two 3\n").encode(), ["s.xyz:4", "'two' is no number"]),
    "line too short": ("s.xyz", (TEXT + "1 2\n").encode(), ["s.xyz:4", "columns", "got 2", "expected 3"]),
    "only not a number": ("s.xyz", b"nan nan nan\nnan nan nan\n", ["s.xyz", "no valid point", "2 points"]),
    "unknown binary": ("s.bin", bytes(range(256)) * 8, ["s.bin", "binary", "PLY, STL, OBJ"]),
    "workbook": ("s.csv", b"PK\x03\x04rest", ["s.csv", "spreadsheet"]),
    "pts with a wrong count": ("s.pts", ("5\n" + TEXT).encode(), ["s.pts", "first line", "got 3", "expected 5"]),
    "header without z": ("s.csv", b"x,y,w\n1,2,3\n", ["s.csv", "no columns of measured z", "x, y, w"]),
    "two columns of x": ("s.csv", b"x,x,y,z\n1,2,3,4\n", ["s.csv", "several columns of measured x"]),
    "ply that is none": ("s.ply", b"solid\n", ["s.ply", "no PLY file"]),
    "ply without end of header": ("s.ply", b"ply\nformat ascii 1.0\n", ["s.ply", "does not end"]),
    "ply without coordinates": ("s.ply", PLY.replace("float x", "float q").encode(), ["s.ply", "no vertices with x"]),
    "ply of unknown format": ("s.ply", PLY.replace("ascii", "ebcdic").encode(), ["s.ply:2", "ebcdic"]),
    "ply with a negative count": ("s.ply", PLY.replace("vertex 3", "vertex -3").encode(), ["s.ply:3", "vertex -3"]),
    "ply text cut off": ("s.ply", (PLY + "0 0 0\n1 1 1\n").encode(), ["s.ply", "too early", "2 vertices"]),
    "ply binary cut off": (
        "s.ply",
        PLY.replace("ascii", "binary_little_endian").encode() + b"\0" * 30,
        ["s.ply", "too early", "2 vertices", "expected 3"],
    ),
    "ply with a word": ("s.ply", (PLY + "0 0 0\n1 x 1\n2 2 2\n").encode(), ["s.ply:9", "'x' is no number"]),
    "stl cut off": ("s.stl", binary_stl(2, 9), ["s.stl", "too early", "2 triangles", "expected 9"]),
    "stl without triangles": ("s.stl", b"solid a\nendsolid a\n", ["s.stl"]),
    "obj without faces": ("s.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", ["s.obj"]),
    "xml that is no QIF": ("s.qif", b"<a><b/></a>", ["s.qif", "no QIF document"]),
    "damaged xml": ("s.qif", b"<QIFDocument><a>", ["s.qif", "XML"]),
    "xml with entities": (
        "s.qif",
        b'<!DOCTYPE a [<!ENTITY b "c">]><QIFDocument>&b;</QIFDocument>',
        ["s.qif", "not read here"],
    ),
    "QIF without points": ("s.qif", b"<QIFDocument/>", ["s.qif", "no measured points"]),
    "DMIS program": ("s.dmi", b"UNITS/MM\nF(A)=FEAT/POINT,CART,1,2,3,0,0,1\n", ["s.dmi", "1 nominal", "output"]),
    "DMIS polar": ("s.dmi", b"UNITS/MM\nFA(A)=FEAT/POINT,POL,1,2,3,0,0,1\n", ["s.dmi:2", "POL", "CART"]),
    "DMIS with a word": ("s.dmi", b"FA(A)=FEAT/POINT,CART,1,b,3,0,0,1\n", ["s.dmi:1", "three numbers"]),
    "DMIS of unknown unit": ("s.dmi", b"UNITS/FURLONG\n", ["s.dmi:1", "FURLONG"]),
    "one place": ("s.xyz", b"1 2 3\n" * 50, ["s.xyz"]),
    "three points": ("s.xyz", TEXT.encode(), ["s.xyz"]),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_bad_file_is_named(work: Path, refused: Callable[..., str], name: str) -> None:
    file, content, words = FILES[name]
    (work / file).write_bytes(content)
    line = refused(*COMMAND, "--scan", file)
    for word in words:
        assert word in line, line


def other_part(_: Float) -> Float:
    """Another part of the same blank: three bores where the program mills a groove."""
    bores = []
    for x, y in ((10.0, 22.0), (22.0, 20.0), (33.0, 8.0)):
        bore = trimesh.creation.cylinder(4.5, 24.0)
        bore.apply_translation([x, y, 13.0])
        bores.append(bore)
    solid = trimesh.boolean.difference([trimesh.creation.box(bounds=[[0, 0, 0], [40, 30, 20]]), *bores])
    points: Float = trimesh.sample.sample_surface(solid, 40_000, seed=1)[0]
    return points[points[:, 2] > 0.3]


def of_scale(factor: float) -> Callable[[Float], Float]:
    """Points larger by a factor."""
    return lambda points: points * factor


POSES: dict[str, tuple[Callable[[Float], Float], tuple[str, ...], list[str]]] = {
    "mirrored": (lambda p: p * [1.0, -1.0, 1.0], (), ["mirrored", "right-handed"]),
    "another part": (other_part, (), ["another part", "on no surface of the part"]),
    "metres for mm": (lambda p: p, ("--unit", "m"), ["another size", "unit is m", "--unit mm"]),
    "inches for mm": (lambda p: p, ("--unit", "inch"), ["another size", "unit is inch", "--unit mm"]),
    "a part of another size": (of_scale(1.7), (), ["in any unit", "diagonal of the blank"]),
    "scale": (of_scale(1.004), (), ["scale", "times the size", "2 directions"]),
    "only the top": (lambda p: p[p[:, 2] > 19.95], (), ["one direction only", "three of six freedoms"]),
    "one datum face": (lambda p: p, ("--datum", "top"), ["freedoms", "top", "shift along x", "turn about z"]),
    "a face that is no face": (lambda p: p, ("--datum", "lid"), ["unknown datum face", "lid", "x-, x+"]),
    "aligned with datum": (lambda p: p, ("--aligned", "--datum", "top"), ["--aligned"]),
    "aligned, but not": (lambda p: p, ("--aligned",), ["another part"]),
    "half of the volume is outliers": (
        lambda p: np.random.default_rng(0).uniform(-20.0, 60.0, p.shape),
        ("--unit", "mm"),
        ["another size"],
    ),
}


@pytest.mark.by_turn
@pytest.mark.parametrize("name", POSES)
def test_a_scan_that_does_not_fit_is_told_why(work: Path, refused: Callable[..., str], name: str) -> None:
    change, options, words = POSES[name]
    write(work / "s.ply", tilted(change(measured())))
    line = refused(*COMMAND, "--scan", "s.ply", *options)
    for word in words:
        assert word in line, line


def with_outliers(points: Float) -> Float:
    """As many outliers as points, in a box twice as large as the part."""
    rng = np.random.default_rng(1)
    out: Float = np.concatenate([points, rng.uniform([-20.0, -15.0, -10.0], [60.0, 45.0, 30.0], points.shape)])
    return rng.permutation(out)


RIGHT_RESULTS: dict[str, Callable[[Float], Float]] = {
    "outliers, as many as points": with_outliers,
    "not a number in a third of the rows": lambda p: np.concatenate([p, np.full((len(p) // 2, 3), np.nan)]),
    "half a part": lambda p: p[p[:, 0] < 24.0],
    "upside down": lambda p: p * [1.0, -1.0, -1.0],
    "a few far away": lambda p: np.concatenate([p, [[1e7, 0.0, 0.0], [0.0, -1e9, 3.0]]]),
}


@pytest.mark.by_turn
@pytest.mark.parametrize("name", RIGHT_RESULTS)
def test_a_poor_scan_still_gives_the_part_as_made(work: Path, counterflex: Callable[..., Any], name: str) -> None:
    write(work / "s.ply", tilted(RIGHT_RESULTS[name](measured())))
    ended = counterflex(*COMMAND, "--scan", "s.ply", "--json", "--unit", "mm")
    assert ended.status == 0, ended.err
    expect_groove(json.loads(ended.out), tolerance_mm=0.012)


def test_datum_points_give_the_pose_where_the_part_is_alike_from_two_sides(
    work: Path, refused: Callable[..., str], counterflex: Callable[..., Any]
) -> None:
    """A groove through the middle of the blank: turned by half a turn it looks the same."""
    program = PROGRAM.replace("Y11", "Y15").replace("X22", "X52")
    (work / "groove.ngc").write_text(program)
    block = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [40.0, 30.0, 20.0]])
    slot = trimesh.creation.box(bounds=[[-1.0, 7.0, 17.0], [41.0, 23.0, 30.0]])
    points = trimesh.sample.sample_surface(trimesh.boolean.difference([block, slot]), 40_000, seed=1)[0]
    write(work / "s.ply", tilted(points[points[:, 2] > 0.3]))
    line = refused(*COMMAND, "--scan", "s.ply")
    assert "two poses" in line
    assert "--datum-points" in line
    corners = np.array([[0.0, 0.0, 20.0], [40.0, 0.0, 20.0], [0.0, 30.0, 20.0]])
    table = np.hstack([tilted(corners), corners])
    np.savetxt(work / "points.csv", table, delimiter=",")
    ended = counterflex(*COMMAND, "--scan", "s.ply", "--datum-points", "points.csv", "--json")
    assert ended.status == 0, ended.err
    assert abs(row(json.loads(ended.out), "width")["mean_mm"] - 16.0) < 0.005
    np.savetxt(work / "points.csv", table[:, :5], delimiter=",")
    assert "3 lines of 5 numbers" in refused(*COMMAND[:-1], "o2", "--scan", "s.ply", "--datum-points", "points.csv")


def test_a_few_probed_points_in_the_part_frame_are_judged(work: Path, counterflex: Callable[..., Any]) -> None:
    """A table of a coordinate measuring machine: names, nominal and measured values, decimals with a comma."""
    points = measured(noise_mm=0.001)[::150]
    lines = ["Name;Nom X;Nom Y;Nom Z;Meas X [mm];Meas Y [mm];Meas Z [mm]"]
    lines += [";".join([f"P{k}", "0", "0", "0", *(f"{v:.4f}" for v in p)]) for k, p in enumerate(points)]
    (work / "cmm.csv").write_text("\n".join(lines).replace(".", ","))
    ended = counterflex(
        *COMMAND, "--scan", "cmm.csv", "--aligned", "--json", "--export", "out/deep/map.ply", "--export-frame", "base"
    )
    assert ended.status == 0, ended.err
    rows, part = read_part_deviations(Path("out/deep/deviations.parquet"))
    assert part.datum_faces == ()
    assert 100 < len(rows) < 400
    floor = (rows.face == 0) & (rows.points[:, 0] > 1e-3)
    assert abs(np.median(rows.deviation_m[floor]) + 120e-6) < 2e-6
    np.testing.assert_allclose(rows.deviation_m[rows.face == 2], 0.0, atol=5e-6)
    with Path("out/deep/map.ply").open("rb") as stream:
        map_of = trimesh.load(stream, file_type="ply", process=False)
    data = map_of.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(np.ravel(data["deviation_mm"]), 1e3 * rows.deviation_m, rtol=1e-6)
    p_base_part = read_cell(Path(COMMAND[3])).T_base_part[:3, 3]  # the part is not turned
    np.testing.assert_allclose(map_of.vertices, 1e3 * (rows.points + p_base_part), atol=1e-6)


@pytest.mark.parametrize(("option", "words"), [("map.vtk", ".ply or .vtp"), ("s.ply", "replace s.ply")])
def test_a_map_that_cannot_be_written_is_refused_first(
    work: Path, refused: Callable[..., str], option: str, words: str
) -> None:
    write(work / "s.ply", measured()[::150])
    assert words in refused(*COMMAND, "--scan", "s.ply", "--aligned", "--export", option)
