"""A tool that turns while it cuts, the whole way: planned in columns, written in rotary words, machined, judged."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from counterflex.app.compensation import compensate
from counterflex.app.inputs import in_working_plane, read_job
from counterflex.app.proof import mesh, prove, simulate
from counterflex.app.proof.cut_logs import log_of_run, top_of
from counterflex.app.proof.truth import make_truth
from counterflex.app.run.session import RunSettings, open_session
from counterflex.core.errors import FileFormatError, InputError, ProgramError
from counterflex.cutting.tridexel.column_file import load_columns
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.surface import surface
from counterflex.files.cell.cell import read_cell
from counterflex.files.summary_file import read_run
from counterflex.path.toolpath import FEED
from counterflex.plan.cut import cut

ROOT = Path(__file__).resolve().parents[3]
LINES = (ROOT / "examples" / "programs" / "twisted_channel.ngc").read_text(encoding="ascii").splitlines()
SHORT = "\n".join([*LINES[:24], "G0 Z64", "M5", "M30", ""])
"""The channel up to y = 25 mm."""
OFF_M = 5e-6
"""The simulated cell places the tool every 0.02 mm, which leaves a saw of a quarter of that times the slope."""


@pytest.fixture(scope="module")
def cell_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example cell with a blank as long as that, in coarse columns."""
    text = (ROOT / "examples" / "cells" / "kr300_bc_table.toml").read_text(encoding="utf-8")
    text = text.replace("box_min_mm = [0, 0, 0]", "box_min_mm = [8, 0, 20]")
    text = text.replace("box_max_mm = [60, 60, 40]", "box_max_mm = [40, 20, 40]")
    file = tmp_path_factory.mktemp("turning") / "cell.toml"
    file.write_text(text.replace("cell_mm = 0.2", "cell_mm = 0.4"), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def program(cell_file: Path) -> Path:
    file = cell_file.parent / "channel.ngc"
    file.write_text(SHORT, encoding="ascii")
    return file


@pytest.fixture(scope="module")
def proof(cell_file: Path, program: Path) -> tuple[Path, dict[str, Any]]:
    out = cell_file.parent / "out"
    return out, prove.run(program, cell_file, out, seeds=[1], workers=1)


@pytest.mark.long
def test_little_error_remains_where_the_constants_are_known(proof: tuple[Path, dict[str, Any]]) -> None:
    shares = {seed["truth_level"]: seed["reduction"]["path"]["p997_mm"] for seed in proof[1]["seeds"]}
    assert proof[1]["variants"]["nominal"]["path"]["p997_mm"] > 0.3
    assert 1.0 - shares["exact"] < 0.3


def test_position_and_direction_are_corrected(
    proof: tuple[Path, dict[str, Any]], cell_file: Path, program: Path
) -> None:
    """Read back, the tool leans away from the programmed direction by the tilt of the deflection, and turns on."""
    cell = in_working_plane(program, read_cell(cell_file))
    assert cell.tool_turns
    before, after = (read_job(file, cell).path for file in (program, proof[0] / "compensated" / program.name))
    cuts = (after.kind == FEED) & (after.p_part_tcp[:, 1] > 2e-3) & (after.p_part_tcp[:, 1] < 18e-3)
    fed = before.kind == FEED
    place = before.p_part_tcp[fed, 1]
    programmed = np.stack([np.interp(after.p_part_tcp[cuts, 1], place, c) for c in before.axis_part[fed].T], axis=1)
    lean = np.linalg.norm(np.cross(after.axis_part[cuts], programmed), axis=1)
    assert 1e-4 < np.median(lean) < 5e-3
    assert np.ptp(after.axis_part[cuts, 0]) > 0.05
    text = (proof[0] / "compensated" / program.name).read_text(encoding="ascii")
    assert len(set(re.findall(r" B([0-9.]+)", text))) > 10
    assert proof[1]["written"]["largest_dropped_rotation_deg"] < 0.5


def test_the_report_and_the_files_say_so(proof: tuple[Path, dict[str, Any]]) -> None:
    stored = json.loads((proof[0] / "summary.json").read_text(encoding="utf-8"))
    assert stored["tool_turns"] is True
    judged = stored["variants"]["nominal"]["surface"]
    assert 0.2 < judged["p997_mm"] < stored["variants"]["nominal"]["path"]["max_mm"]
    assert judged["wall_lost_mm2"] == 0.0
    assert "surface" in stored["over_seeds"]["exact"]
    assert "path" in stored["over_seeds"]["exact"]
    columns = load_columns(proof[0] / "nominal-columns.npz")
    assert 1.5e-6 < 32e-3 * 20e-3 * 20e-3 - columns.volume_m3 < 4e-6
    assert (proof[0] / "report.html").stat().st_size > 10_000


def test_what_cannot_take_it_says_so(
    proof: tuple[Path, dict[str, Any]], cell_file: Path, program: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="turns while it cuts cannot be run with online correction"):
        open_session(RunSettings(cell=cell_file, plan=proof[0] / "plan.parquet"))
    with pytest.raises(ProgramError, match=r"channel\.ngc:\d+.*the tool is tilted, and this command takes"):
        read_job(program, read_cell(cell_file))


@pytest.mark.long
def test_simulated_and_evaluated_from_files(cell_file: Path, program: Path, tmp_path: Path) -> None:
    make_truth(read_cell(cell_file), None, tmp_path / "truth.toml")
    summary = simulate.run(program, cell_file, tmp_path / "truth.toml", tmp_path / "run")
    assert summary["machining"]["peak_force_n"] > 200.0
    assert (tmp_path / "run" / simulate.COLUMNS).is_file()
    assert not (tmp_path / "run" / simulate.SURFACE).exists()
    from counterflex.app.proof.judge import ProgramComparison

    judged = ProgramComparison.of([tmp_path / "run"]).judged["nominal"]
    assert judged.surface is None
    assert judged.columns is not None
    assert judged.turned is not None
    assert judged.variant.path.path.p997_m > 0.2e-3
    figures = mesh.run(tmp_path / "run", tmp_path / "mesh", range_m=5e-4)
    volume = {}
    for name in ("nominal.stl", "machined.ply"):
        part = trimesh.load_mesh(tmp_path / "mesh" / name)
        assert part.is_watertight
        assert part.is_winding_consistent
        np.testing.assert_allclose(part.extents, [32.0, 20.0, 20.0], atol=1e-2)
        volume[name] = part.volume
    # a facet cuts off what stands out of it: the edges of 0.4 mm cells
    assert volume["machined.ply"] == pytest.approx(judged.columns.volume_m3 * 1e9, rel=2e-3)
    # the undisturbed part judged along the normal of the machined one, and the other way round
    for kind, judged_there in (("walls", judged.turned.wall), ("floors", judged.turned.floor)):
        assert judged_there.max_m * 1e6 == pytest.approx(figures[kind]["max_um"], rel=0.15)
    _columns_end_where_the_tool_was(tmp_path / "run", judged.columns)
    (tmp_path / "run" / simulate.COLUMNS).write_bytes(b"PK")
    with pytest.raises(FileFormatError, match="do not belong together"):
        ProgramComparison.of([tmp_path / "run"])


def _columns_end_where_the_tool_was(folder: Path, columns: ColumnStock) -> None:
    """The columns that the simulated cell has left end on what the recorded poses of the tool sweep."""
    cell = simulate.read_cell_of(folder)
    swept = log_of_run(
        read_run(folder / simulate.RUN)[0], simulate.read_original(folder, cell).path, cell, top_of(cell)
    )
    left = surface(columns, swept)
    off = np.abs(swept.distance(left.points[left.cut & (left.along == 2)]))
    assert np.nanpercentile(off, 99.0) < OFF_M


def test_several_tilted_directions_in_one_program(cell_file: Path) -> None:
    """A groove with the tool upright and one with it tilted by 15 deg: the force of each is that of its own program."""
    head, upright = (
        "G17 G54 G21 G90\nM6 T1\nM3 S13000\nG0 B0 C0\nG43.4 H1\n",
        "G0 X14 Y-10 Z60\nG0 Z37\nG1 Y30 F1500\nG0 Z60\n",
    )
    tilted = "G0 B15 C0\nG0 X34 Y-10 Z60\nG0 Z36\nG1 Y30 F1500\nG0 Z60\n"
    cell, mean = read_cell(cell_file), {}
    for name, body in (("upright", upright), ("tilted", tilted), ("both", upright + tilted)):
        file = cell_file.parent / f"{name}.ngc"
        file.write_text(f"{head}{body}M5\nM2\n", encoding="ascii")
        seen = in_working_plane(file, cell)
        path = read_job(file, seen).path
        force = cut(path, path.p_part_tcp, seen.stock(), seen.cutter, seen.force_law).w_tcp_part[:, :3]
        R_part_plane = np.eye(3) if seen.R_part_plane is None else seen.R_part_plane
        p, force = path.p_part_tcp @ R_part_plane.T, force @ R_part_plane.T
        steady = (path.kind == FEED) & (p[:, 1] > 8e-3) & (p[:, 1] < 18e-3)
        for groove, side in (("first", p[:, 0] < 24e-3), ("second", p[:, 0] >= 24e-3)):
            mean[name, groove] = force[steady & side].mean(axis=0) if np.any(steady & side) else np.zeros(3)
        assert seen.tool_turns == (name == "both")
    for name, groove in (("upright", "first"), ("tilted", "second")):
        size = float(np.linalg.norm(mean[name, groove]))
        assert size > 50.0
        np.testing.assert_allclose(mean["both", groove], mean[name, groove], atol=0.02 * size)


def test_robot_programs_have_the_orientation_of_each_point(cell_file: Path, program: Path) -> None:
    """KRL: the z of the tool frame turns along the cut as the program's axis does."""
    text = "".join(compensate.compensate(program, read_cell(cell_file), language="krl", predict=False).files.values())
    poses = np.array(
        re.findall(r"X ([-\d.]+),Y ([-\d.]+),Z ([-\d.]+),A ([-\d.]+),B ([-\d.]+),C ([-\d.]+)", text), dtype=float
    )
    cut = poses[(poses[:, 1] > 2.0) & (poses[:, 1] < 18.0)]
    a, b, c = np.deg2rad(cut[:, 3:].T)
    z = np.stack([np.cos(a) * np.sin(b) * np.cos(c) + np.sin(a) * np.sin(c), np.cos(b) * np.cos(c)], axis=1)
    job = read_job(program, in_working_plane(program, read_cell(cell_file)))
    rows = job.path.kind == FEED
    for k, axis in enumerate((0, 2)):
        expected = np.interp(cut[:, 1] * 1e-3, job.path.p_part_tcp[rows, 1], job.path.axis_part[rows, axis])
        np.testing.assert_allclose(-z[:, k], expected, atol=5e-3)
