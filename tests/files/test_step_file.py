"""STEP files that Open CASCADE wrote give their solid back: size in every unit, names and tolerances of faces."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import step_parts
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.mesh_shape import CadSolid
from counterflex.files import step_file
from counterflex.files.step_file import read_step

BORE = "bore H9"


def block() -> Any:
    """60 x 60 x 40 mm with a groove 16 wide and 6 deep, and a pocket of 20 mm, 10 deep."""
    whole = step_parts.box((0, 0, 0), (60, 60, 40))
    return step_parts.less(
        whole, step_parts.box((-1, 7, 34), (61, 23, 41)), step_parts.cylinder((30, 42, 30), 10.0, 20.0)
    )


def named(face: Any) -> str:
    centre = step_parts.centre(face)
    places = {(30, 15, 34): "groove floor", (30, 42, 35): BORE, (30, 23, 37): "wall"}
    return places.get((round(centre[0]), round(centre[1]), round(centre[2])), "")


def read(path: Path) -> CadSolid:
    return read_step(path, lambda solids: solids[0], 5.0 * MM)


@pytest.mark.parametrize("unit", ["MM", "INCH", "M"])
def test_size_names_and_kinds_do_not_depend_on_the_unit(tmp_path: Path, unit: str) -> None:
    step_parts.write_step(tmp_path / "a.step", [block()], named, unit=unit)
    solid = read(tmp_path / "a.step")
    faces = {face.name: face for face in solid.faces}
    np.testing.assert_allclose(np.ptp(solid.vertices, axis=0) / MM, [60.0, 60.0, 40.0], atol=1e-6)
    assert faces["groove floor"].kind == "plane"
    np.testing.assert_allclose(faces["groove floor"].axis, [0.0, 0.0, 1.0], atol=1e-9)
    assert faces["groove floor"].axis @ faces["groove floor"].point / MM == pytest.approx(34.0)
    np.testing.assert_allclose(faces["wall"].axis, [0.0, -1.0, 0.0], atol=1e-9)
    assert faces[BORE].radius_m / MM == pytest.approx(10.0)
    assert "face 1 (plane)" in faces
    corners = solid.vertices[solid.triangles] / MM
    volume = np.einsum("tk,tk->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert volume == pytest.approx(60 * 60 * 40 - 60 * 16 * 6 - np.pi * 100 * 10, rel=1e-5)


def test_triangles_are_within_a_micrometre_and_know_their_face(tmp_path: Path) -> None:
    step_parts.write_step(tmp_path / "a.step", [block()], named)
    solid = read(tmp_path / "a.step")
    angle = np.linspace(0.0, 2.0 * np.pi, 1000)
    on = np.column_stack([30.0 + 10.0 * np.cos(angle), 42.0 + 10.0 * np.sin(angle), np.full(1000, 34.0)]) * MM
    away = np.column_stack([-np.cos(angle), -np.sin(angle), np.zeros(1000)])
    assert np.abs(solid.distance(on)).max() <= 1.0 * UM
    assert {solid.faces[k].name for k in solid.face_of(on, away)} == {BORE}
    assert (solid.face_of(on, np.tile([0.0, 0.0, 1.0], (1000, 1))) == -1).all()  # of no face that looks up


@pytest.mark.parametrize("free_form", [False, True])
def test_curved_faces_are_within_a_micrometre(tmp_path: Path, free_form: bool) -> None:
    ball = step_parts.occ("BRepPrimAPI_MakeSphere")(1.5).Shape()
    ball = step_parts.occ("BRepBuilderAPI_NurbsConvert")(ball).Shape() if free_form else ball
    step_parts.write_step(tmp_path / "a.step", [ball])
    solid = read(tmp_path / "a.step")
    assert [face.kind for face in solid.faces] == ["free form" if free_form else "sphere"]
    middle = solid.vertices[solid.triangles].mean(axis=1)
    assert np.abs(np.linalg.norm(middle, axis=1) - 1.5 * MM).max() <= 1.0 * UM


def test_tolerances_come_back_and_others_are_named(tmp_path: Path) -> None:
    step_parts.write_step(
        tmp_path / "a.step",
        [block()],
        named,
        zones=[
            ("groove floor", "Flatness", 0.02),
            ("groove floor", "Parallelism", 0.03),
            ("wall", "ProfileOfSurface", 0.1),
            ("wall", "Straightness", 0.01),
            (BORE, "Position", 0.06),
            (BORE, "CircularityOrRoundness", 0.04),
        ],
        diameters=[(BORE, 20.0, 0.03, 0.01)],
    )
    part = read(tmp_path / "a.step")
    limits = {face.name: face.limits for face in part.faces if face.limits}
    um = {
        (name, quantity): (None if value is None else round(value / UM, 3), round(tolerance / UM, 3))
        for name, one in limits.items()
        for quantity, (value, tolerance) in one.items()
    }
    assert um == {
        ("groove floor", "flatness"): (None, 20.0),
        ("groove floor", "orientation"): (None, 30.0),
        ("wall", "profile"): (None, 50.0),
        (BORE, "centre"): (None, 30.0),
        (BORE, "roundness"): (None, 40.0),
        (BORE, "diameter"): (20_010.0, 20.0),
    }
    assert part.not_measured == ("Straightness 0.01 mm of wall",)


def test_limits_on_one_side_of_the_nominal_size_are_not_taken_for_limits_about_it(tmp_path: Path) -> None:
    """+0.03 +0.01: Open CASCADE reads 0.01 without its sign."""
    step_parts.write_step(tmp_path / "a.step", [block()], named, diameters=[(BORE, 20.0, 0.03, -0.01)])
    part = read(tmp_path / "a.step")
    assert not any(face.limits for face in part.faces)
    assert part.not_measured == (f"Size Diameter 20 mm with both limits on one side of {BORE}",)


def test_faces_of_one_name_are_numbered(tmp_path: Path) -> None:
    step_parts.write_step(
        tmp_path / "a.step", [block()], lambda face: "side" if step_parts.centre(face)[2] < 30 else ""
    )
    names = [face.name for face in read(tmp_path / "a.step").faces]
    assert len(set(names)) == len(names)
    assert any(name.startswith("side (face ") for name in names)


def surface_only(path: Path) -> None:
    step_parts.write_step(path, step_parts.faces(block())[:1])


def open_solid(path: Path) -> None:
    step_parts.write_step(path, [block()])
    path.write_text(re.sub(r"(CLOSED_SHELL\('',\()#\d+,", r"\1", path.read_text()))


def damaged(path: Path) -> None:
    step_parts.write_step(path, [block()])
    path.write_bytes(path.read_bytes()[:3000])


BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "no STEP": (lambda path: path.write_text("solid a\nendsolid"), "not a STEP file"),
    "surface": (surface_only, "holds no closed solid"),
    "open": (open_solid, "holds no closed solid"),
    "cut off": (damaged, "STEP file"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    make, words = BAD[name]
    make(tmp_path / "bad.step")
    with pytest.raises(FileFormatError, match=words) as fault:
        read(tmp_path / "bad.step")
    assert "\n" not in str(fault.value)


def test_sizes_beyond_the_limits_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    step_parts.write_step(tmp_path / "a.step", [block()])
    monkeypatch.setattr(step_file, "MOST_TRIANGLES", 200)
    with pytest.raises(FileFormatError, match="too many curved faces"):
        read(tmp_path / "a.step")
    monkeypatch.setattr(step_file, "LARGEST_BYTES", 1000)
    with pytest.raises(FileFormatError, match="too large"):
        read(tmp_path / "a.step")


def test_without_the_extra_its_name_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(step_file, "import_module", missing)
    with pytest.raises(FileFormatError, match=r"counterflex\[step\]"):
        read(tmp_path / "a.step")
    assert importlib.import_module("OCP")
