"""The grooves of Haehn2020: geometry of the two edges, and the figures over truths."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.core.arrays import Float
from counterflex.core.atomic import write_text
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_MIN
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.schema import write_toml
from counterflex.plan.inputs import solve_joints
from counterflex_lab.reproduce import haehn_case
from counterflex_lab.reproduce.haehn import PLANNED, over_seeds, run


@pytest.fixture(scope="module", params=list(haehn_case.EDGES))
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Cell, Job]:
    edge = str(request.param)
    folder = tmp_path_factory.mktemp(edge)
    angle = haehn_case.EDGES[edge]
    write_toml(folder / "cell.toml", haehn_case.cell_table(haehn_case.demonstration_cell(), angle))
    write_text(folder / "groove.ngc", haehn_case.program(angle))
    cell = read_cell(folder / "cell.toml")
    return edge, cell, read_job(folder / "groove.ngc", cell)


def cutting(job: Job) -> Float:
    """Points at full depth, part frame."""
    p = job.path.p_part_tcp
    return p[np.isclose(p[:, 2], (40.0 - haehn_case.DEPTH_MM) * MM)]


def test_the_feed_is_the_same_in_the_base_and_the_edge_is_turned(case: tuple[str, Cell, Job]) -> None:
    edge, cell, job = case
    p = cutting(job)
    direction = (p[-1] - p[0]) / np.linalg.norm(p[-1] - p[0])
    normal = np.array([1.0, 0.0, 0.0])  # of the edge x = 100 mm
    assert np.arccos(direction @ normal) == pytest.approx(haehn_case.EDGES[edge] * DEG, abs=1e-6)
    assert np.allclose(cell.T_base_part[:3, :3] @ direction, [1.0, 0.0, 0.0], atol=1e-6)
    middle = cell.T_base_part @ np.append(0.5 * (p[0] + p[-1]), 1.0)
    assert np.allclose(middle[:2] / MM, [1400.0, -60.0], atol=1e-3)
    assert np.all(job.path.feed_m_s[np.isclose(job.path.p_part_tcp[:, 2], p[0, 2])][1:] == 1500.0 * MM_PER_MIN)


def test_the_groove_passes_both_edges_within_the_blank(case: tuple[str, Cell, Job]) -> None:
    """Both walls of the groove leave through the edges x = 0 and x = 100 mm, not through a corner."""
    edge, _, job = case
    p = cutting(job)
    angle = haehn_case.EDGES[edge] * DEG
    half = 8.0 * MM / np.cos(angle)
    for x in (0.0, 100.0 * MM):
        y = np.interp(x, p[:, 0], p[:, 1])
        assert half < y < 130.0 * MM - half
    assert p[0, 0] < -8.0 * MM
    assert p[-1, 0] > 108.0 * MM


def test_the_robot_stands_in_the_same_posture(tmp_path: Path) -> None:
    """Middle of the groove: the same joint angles under both edges, so that only the edge differs."""
    straight, oblique = (_middle(tmp_path, angle) for angle in haehn_case.EDGES.values())
    assert np.allclose(straight, oblique, atol=2e-4)


def _middle(folder: Path, angle: float) -> Float:
    """(6,) rad where the tool is in the middle of the groove."""
    write_toml(folder / "cell.toml", haehn_case.cell_table(haehn_case.demonstration_cell(), angle))
    write_text(folder / "groove.ngc", haehn_case.program(angle))
    cell = read_cell(folder / "cell.toml")
    job = read_job(folder / "groove.ngc", cell)
    q = solve_joints(job.path, job.line_of_motion[job.path.motion], setting_of(cell)).q
    base = job.path.p_part_tcp @ cell.T_base_part[:3, :3].T + cell.T_base_part[:3, 3]
    deep = np.flatnonzero(np.isclose(job.path.p_part_tcp[:, 2], (40.0 - haehn_case.DEPTH_MM) * MM))
    at = deep[np.argsort(base[deep, 0])]
    return np.array([np.interp(1.4, base[at, 0], q[at, k]) for k in range(6)])


def test_variants_and_their_cells(tmp_path: Path) -> None:
    haehn_case.write_cells(haehn_case.demonstration_cell(), tmp_path, "oblique")
    for kind, item in haehn_case.KINDS.items():
        for output in item.outputs:
            cell = read_cell(tmp_path / haehn_case.cell_name(kind, output))
            table = cell.tables.online
            assert table is not None
            assert table.output == output
            assert table.force == item.online["force"]
    assert set(haehn_case.names()) >= {"uncompensated", "force", "force_pilot", "hybrid", "hybrid_axes"}
    assert haehn_case.KINDS["force_pilot_40ms"].online["lead_ms"] == 40.0
    assert "lead_ms" not in haehn_case.KINDS["force_pilot"].online


def test_figures_over_truths() -> None:
    """A loop that refused to act says nothing of the correction: it is counted apart."""

    def figures(value: float, *, active: bool = True) -> dict[str, Any]:
        named: dict[str, Any] = {name: {"max_mm": value} for name in ("path", "entry", "plateau", "exit")}
        return {**named, "loop": {"states": {"active": 9} if active else {"idle": 9}}}

    rows = [{"seed": s, "edge": "straight", "variants": {"force": figures(0.1 * s)}} for s in (1, 2, 3)]
    rows += [{"seed": 4, "edge": "straight", "variants": {"force": figures(9.0, active=False)}}]
    found = over_seeds(rows)["force"]
    assert found["path"] == pytest.approx({"max_mm": 0.3, "median_max_mm": 0.2})
    assert (found["runs"], found["refused"]) == (3, 1)
    watching = [{"seed": 1, "edge": "straight", "variants": {"uncompensated": figures(1.5, active=False)}}]
    assert over_seeds(watching)["uncompensated"]["runs"] == 1


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="truth seeds"):
        run(tmp_path, seeds=[])
    with pytest.raises(InputError, match="truth level"):
        run(tmp_path, level="guessed")


def test_every_variant_and_the_plan_have_folders_of_their_own() -> None:
    """In one folder each would take the other's mark for that of a changed one, and all would be made again."""
    assert len({PLANNED, *haehn_case.names()}) == 1 + len(haehn_case.names())
