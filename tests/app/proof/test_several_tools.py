"""Two tools in one program: the second cuts what the first left; walls are judged with the tool that made them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.inputs import Job, read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import features, judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.evaluate.swept_section import swept_section
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.path.toolpath import FEED
from counterflex.twin.plant.simulate import mounted_tools

ROOT = Path(__file__).resolve().parents[3]
TEXT = (ROOT / "examples" / "programs" / "two_tools.ngc").read_text(encoding="ascii")
SHORT = TEXT.replace("X72", "X6")


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(ROOT / "examples" / "cells" / "kr300_d16_small.toml")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, cell: Cell) -> Job:
    file = tmp_path_factory.mktemp("tools") / "two.ngc"
    file.write_text(SHORT, encoding="ascii")
    return read_job(file, cell)


def test_each_row_is_cut_with_the_tool_in_the_spindle(job: Job) -> None:
    mounted, feed = mounted_tools(job.path), job.path.kind == FEED
    np.testing.assert_array_equal(mounted[feed], job.path.tool[feed])
    assert simulate.tools_of(job.path) == [1, 2]
    assert mounted[0] == 1
    assert np.count_nonzero(np.diff(mounted)) == 1


def test_the_undisturbed_part_has_both_grooves(cell: Cell, job: Job) -> None:
    """16 mm wide to z = 36 mm, 10 mm wide to z = 33 mm, each to half a tool beyond x = 6 mm."""
    stock = simulate.undisturbed(job, cell)
    y = stock.y0_m + np.arange(stock.z.shape[0]) * stock.cell_m - 30e-3
    across = stock.z[:, round((3e-3 - stock.x0_m) / stock.cell_m)]
    np.testing.assert_allclose(across[np.abs(y) < 4.7e-3], 33e-3, atol=1e-8)
    np.testing.assert_allclose(across[(np.abs(y) > 5.3e-3) & (np.abs(y) < 7.7e-3)], 36e-3, atol=1e-8)
    np.testing.assert_allclose(across[np.abs(y) > 8.3e-3], 40e-3, atol=1e-8)


def test_the_simulated_cell_carries_the_stock_over(cell: Cell, job: Job) -> None:
    """The second tool is 3 mm deep in the floor of the first; in a fresh blank it would be 7 mm deep."""
    record = simulate.machine(job, cell, truth_of(cell, None))
    tool = job.path.tool[np.searchsorted(job.path.motion, record.motion)]
    depth = [float(np.median(record.depth_m[(tool == n) & record.engaged & (record.kind == FEED)])) for n in (1, 2)]
    np.testing.assert_allclose(depth, [4e-3, 3e-3], atol=0.4e-3)
    shelf = record.stock.z[round((36.5e-3 - record.stock.y0_m) / record.stock.cell_m)]
    assert shelf[round((3e-3 - record.stock.x0_m) / record.stock.cell_m)] > 35e-3  # beside the narrower tool
    reference = reference_of(job, cell)
    judged = judge(reference, record, record.stock)
    assert 0.05e-3 < judged.variant.path.path.p997_m < 1.2e-3
    assert judged.surface is not None
    wall = judged.surface.wall_m[np.isfinite(judged.surface.wall_m)]
    assert len(wall) > 0.95 * len(judged.surface.wall_m)
    assert np.abs(wall).max() < 1.2e-3  # judged with the other's radius, every wall would be 3 mm off
    assert features(reference, {"nominal": judged}) == ()


def test_walls_of_the_undisturbed_path_are_where_each_tool_left_them(cell: Cell, job: Job) -> None:
    surface = reference_of(job, cell).surface
    assert surface is not None
    side = surface.wall_point[:, 0] < 5e-3
    off = np.abs(surface.wall_point[side, 1] - 30e-3)
    high = surface.wall_point[side, 2] > 36e-3
    np.testing.assert_allclose(off[high], 8e-3, atol=1e-9)
    np.testing.assert_allclose(off[~high], 5e-3, atol=1e-9)
    assert high.any()
    assert not high.all()


def test_a_section_through_moves_of_two_radii() -> None:
    """Closed form: the furthest of both tools where they overlap, each alone elsewhere."""
    p = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.04, 0.0, 0.0]])
    outline = np.array([[1.0, 0.0], [8e-3, 0.0], [10e-3, 0.0]])
    section = swept_section(p, outline, 3e-3)
    point, up = np.array([[0.02, 8e-3, 0.0], [0.06, 8e-3, 0.0]]), np.tile([0.0, 1.0], (2, 1))
    np.testing.assert_allclose(section.wall_exit(point, up, 1e-3)[0], [0.0, 2e-3], atol=1e-12)
    cutter = Cutter(diameter_m=16e-3, corner_radius_m=0.0, flutes=2, flute_length_m=20e-3)
    np.testing.assert_allclose(swept_section(p, cutter, 3e-3).wall_exit(point, up, 1e-3)[0], 0.0, atol=1e-12)


def test_online_correction_has_one_tool(job: Job) -> None:
    with pytest.raises(InputError, match=r"a run with online correction has one tool; got T1, T2"):
        simulate.tool_of(job.path)
