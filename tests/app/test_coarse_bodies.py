"""Coarse bodies of a cell and a program: what the cell file says of tools and bodies comes before what is assumed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from counterflex.app import preflight as job
from counterflex.app.coarse_bodies import coarse_bodies
from counterflex.app.inputs import read_job
from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation

SMALL = Path(__file__).resolve().parents[1] / "data" / "cells" / "small.toml"
GROOVE = "G21 G17 G90 G94\nT1 M6\nM3 S13000\nG0 X-12 Y15 Z60\nG0 Z42\nG1 Z37 F3000\nG1 X20 F1500\nG0 Z60\nM30\n"


def checked(folder: Path, text: str) -> dict[str, Any]:
    (folder / "cell.toml").write_text(text)
    (folder / "part.ngc").write_text(GROOVE)
    return job.check(folder / "part.ngc", read_cell(folder / "cell.toml")).summary


def distance_mm(summary: dict[str, Any]) -> float:
    row = next(row for row in summary["checks"] if row["check"] == "robot and spindle to surroundings")
    assert row["what"] == "spindle to stock"
    return float(row["value"])


def test_a_longer_tool_keeps_the_spindle_away(tmp_path: Path) -> None:
    """35 mm of flutes and one diameter are assumed; 80 mm out of the holder are 29 mm more."""
    text = SMALL.read_text(encoding="utf-8")
    assumed = distance_mm(checked(tmp_path, text))
    known = distance_mm(
        checked(tmp_path, text.replace("flute_length_mm = 35", "flute_length_mm = 35\noverhang_mm = 80"))
    )
    assert known - assumed == pytest.approx(80 - 35 - 16, abs=1.0)  # each is the smallest to 0.5 mm


def test_a_body_of_the_file_is_said_to_be_no_assumption(tmp_path: Path) -> None:
    text = SMALL.read_text(encoding="utf-8")
    text += '\n[[cell.body]]\nname = "forearm"\nframe = "joint4"\nshape = "capsule"\nradius_mm = 90\nlength_mm = 500\n'
    bodies = {body["name"]: body for body in checked(tmp_path, text)["bodies"]}
    assert (bodies["forearm"]["assumed"], bodies["elbow"]["assumed"]) == (False, True)
    assert len(bodies) == len(checked(tmp_path, SMALL.read_text(encoding="utf-8"))["bodies"])


def test_bodies_of_the_part_stand_where_they_are_whatever_the_tool_is_tilted(tmp_path: Path) -> None:
    """Seen along a tool tilted by 15 deg: blank, table and fixture have the same places in the base."""
    text = SMALL.read_text(encoding="utf-8")
    text += '\n[[cell.body]]\nname = "fixture"\nframe = "part"\nshape = "box"\nx_mm = 90\nsize_mm = [20, 30, 40]\n'
    (tmp_path / "cell.toml").write_text(text)
    (tmp_path / "part.ngc").write_text(GROOVE)
    cell = read_cell(tmp_path / "cell.toml")
    program = read_job(tmp_path / "part.ngc", cell)
    tilted = cell.in_plane(rotation.about_y(np.radians(15.0)))
    upright, seen = ({body.name: body for body in coarse_bodies(program, c, c.stock())} for c in (cell, tilted))
    assert set(seen) == set(upright)
    for name in ("stock", "table", "fixture"):
        before, after = upright[name], seen[name]
        assert after.size_m == pytest.approx(before.size_m)
        T_base_plane, T_plane_body = tilted.T_base_part, after.T_frame_body
        T_base_part, T_part_body = cell.T_base_part, before.T_frame_body
        assert T_base_plane @ T_plane_body == pytest.approx(T_base_part @ T_part_body)


def test_a_mesh_beside_the_part_is_hit_where_its_box_is(tmp_path: Path) -> None:
    """A pillar as an STL mesh and as a box of the same size and place; a file that is not there is refused."""
    trimesh.creation.box(extents=(20, 20, 400)).export(tmp_path / "pillar.stl")
    place = '\n[[cell.body]]\nname = "pillar"\nframe = "part"\nx_mm = 20\ny_mm = {y}\nshape = '
    text = SMALL.read_text(encoding="utf-8")
    row = {}
    for y in (60, 250):
        for shape in ('"mesh"\nstl = "pillar.stl"\n', '"box"\nsize_mm = [20, 20, 400]\n'):
            checks = checked(tmp_path, text + place.format(y=y) + shape)["checks"]
            row[y, shape[1:4]] = next(r for r in checks if r["check"] == "robot and spindle to surroundings")
    assert row[60, "mes"]["verdict"] == row[60, "box"]["verdict"] == "fail"
    assert row[250, "mes"]["value"] == pytest.approx(row[250, "box"]["value"], abs=0.05)
    with pytest.raises(FileFormatError, match="no such file"):
        checked(tmp_path, text + place.format(y=60) + '"mesh"\nstl = "absent.stl"\n')
