"""The mesh of a machined part against what ``evaluate`` measures of the same part on its own way."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import trimesh

from counterflex.app.proof import mesh, simulate
from counterflex.app.proof.judge import ProgramComparison
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import InputError
from counterflex.cutting.tridexel.surface import Surface
from counterflex.files.cell.cell import read_cell

SLOT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z36\nG1 X72 F1500\nG0 Z42\nM5\nM2\n"


def test_walls_and_floors_are_off_by_what_evaluate_finds(small: Path, tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(SLOT, encoding="ascii")
    make_truth(read_cell(small), 201, tmp_path / "truth.toml")
    simulate.run(tmp_path / "part.ngc", small, tmp_path / "truth.toml", tmp_path / "run")
    summary = mesh.run(tmp_path / "run", tmp_path / "mesh", range_m=1e-4)
    comparison = ProgramComparison.of([tmp_path / "run"])
    judged, surface = comparison.judged["nominal"].surface, comparison.reference.surface
    assert judged is not None
    assert surface is not None
    walls = np.abs(judged.wall_m) * 1e6
    at_x = surface.wall_point[:, 0] * 1e3
    points = pl.read_parquet(tmp_path / "mesh" / "points.parquet")
    middle = points.filter(pl.col("x_mm").is_between(8.0, 32.0))
    wall = middle.filter(pl.col("line") == 1)["deviation_um"].abs()
    assert wall.median() == pytest.approx(np.nanmedian(walls[(at_x > 8.0) & (at_x < 32.0)]), abs=1.0)
    assert summary["walls"]["p997_um"] == pytest.approx(np.nanpercentile(walls, 99.7), abs=15.0)
    # one wall was gouged by as much as was left on the other
    sides = middle.filter(pl.col("line") == 1).group_by(pl.col("y_mm") > 15.0).agg(pl.col("deviation_um").mean())
    assert np.prod(sides["deviation_um"].to_numpy()) < 0.0
    for name in ("nominal.stl", "machined.ply"):
        part = trimesh.load_mesh(tmp_path / "mesh" / name)
        np.testing.assert_allclose(part.extents[:2], [40.0, 30.0], atol=1e-2)
    assert part.volume == pytest.approx(40.0 * 30.0 * 40.0 - 40.0 * 16.0 * 4.0, rel=5e-3)


def test_a_folder_without_a_part_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no machined program"):
        mesh.run(tmp_path, tmp_path / "mesh", range_m=1e-4)


def test_the_deviation_stands_in_the_mesh_as_a_scalar(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.04, 0.03, 0.02))
    none = np.empty(0, np.int64)
    part = Surface(np.empty((0, 3)), none, none.astype(np.bool_), box.vertices, box.faces, none)
    deviation = np.append(np.linspace(-80e-6, 60e-6, len(box.vertices) - 1), np.nan)
    part.save(tmp_path / "part.ply", deviation)
    head, _, rows = (tmp_path / "part.ply").read_bytes().partition(b"end_header\n")
    sizes = {"float": "<f4", "uchar": "u1"}
    vertex = head.decode().partition("element face")[0]
    row = np.dtype([(name, sizes[kind]) for kind, name in re.findall(r"property (\w+) (\w+)", vertex)])
    read = np.frombuffer(rows, row, len(deviation))
    np.testing.assert_allclose(read["deviation_um"], deviation / 1e-6, rtol=1e-6)
    left = deviation > 0.0
    assert np.all((read["red"] > read["blue"])[left])
    assert np.all((read["red"] < read["blue"])[deviation < 0.0])
