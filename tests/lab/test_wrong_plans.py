"""Wrong plans: what is changed on the simulated cell is what a row says, and the table counts what is brought back."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import rotation
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.live.live_cell import LiveCell
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.family import WIDE
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex.twin.truth.truth import Truth
from counterflex_lab.reproduce import online, online_case, online_report
from counterflex_lab.reproduce.wrong_plans import DRIFT_BASE_M, LONGER_M, WRONG

SEED = 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of all rows, as if the catalogue were what was identified."""
    out = tmp_path_factory.mktemp("online")
    catalogue = online_case.catalogue_cell(out)
    write_truth(out / "truth.toml", truth_of(read_cell(catalogue), SEED, WIDE))
    for row in ("as planned", "drift", "longer tool"):
        online_case.write_case(out / row, row, catalogue, out / "truth.toml", catalogue, SEED)
    return out


@pytest.fixture(scope="module")
def cell(folder: Path) -> Cell:
    return read_cell(folder / online_case.CATALOGUE)


@pytest.fixture(scope="module")
def truth(folder: Path) -> Truth:
    return read_truth(folder / "truth.toml")


def chip_force(truth: Truth, h_m: float) -> Float:
    """(3,) N/m per edge by chip thickness: cutting, radial, axial."""
    c = truth.cutting
    shear = np.array(c.k_pa) * c.h_ref_m ** np.array(c.exponent) * h_m ** (1.0 - np.array(c.exponent))
    out: Float = shear + np.array(c.edge_n_m)
    return out


def test_each_row_changes_what_it_says(cell: Cell, truth: Truth) -> None:
    now = {name: wrong.truth(cell, truth) for name, wrong in WRONG.items()}
    sharp = chip_force(truth, 20.0 * UM)
    assert now["as planned"] is truth
    assert chip_force(now["worn tool"], 20.0 * UM) == pytest.approx(1.3 * sharp)
    softer = chip_force(now["other alloy"], 20.0 * UM)
    assert 0.5 < softer[0] / sharp[0] < 0.9
    assert softer[2] > sharp[2]  # another direction too, not one factor
    assert now["higher stock"].stock_top_offset_m - truth.stock_top_offset_m == pytest.approx(0.5 * MM)
    for soft, planned in zip(now["soft robot"].bodies, truth.bodies, strict=True):
        assert np.allclose(soft.compliance * 0.8, planned.compliance)
    q = np.array([0.1, -1.2, 1.4, 0.2, 0.6, -0.3])
    moved = now["drift"].rigid_tcp(q) - truth.rigid_tcp(q)
    assert np.allclose(moved[:3, 3], DRIFT_BASE_M, atol=1e-9)
    assert np.linalg.norm(DRIFT_BASE_M[1:]) == pytest.approx(0.1 * MM)
    tip = truth.rigid_tcp(q)
    assert np.allclose(now["longer tool"].rigid_tcp(q)[:3, 3], tip[:3, 3] + LONGER_M * tip[:3, 2])


def test_the_controller_knows_the_longer_tool_and_the_plan_does_not(folder: Path, cell: Cell) -> None:
    run = read_cell(folder / "longer tool" / online_case.cell_name("hybrid"))
    planned, told = (simulate.controller(c).T_flange_tcp for c in (cell, run))
    assert np.allclose(told[:3, 3], planned[:3, 3] + LONGER_M * planned[:3, 2], atol=1e-9)
    assert np.allclose(simulate.controller(read_cell(folder / "as planned" / "cell.toml")).T_flange_tcp, planned)


def test_a_drift_after_touching_shows_and_one_before_does_not(folder: Path, cell: Cell) -> None:
    """Pair: a part touched by the arm as it now is lies where the arm takes it to be; else the drift is left."""
    place, job = folder / "drift", read_job(folder / online_case.PROGRAM, cell)
    drifted, before = read_truth(place / online_case.TRUTH), read_truth(place / online_case.TOUCHED)

    def part(now: Truth, touched: Truth | None) -> Float:
        live = LiveCell(
            job.machined,
            truth=now,
            controller=simulate.controller(cell),
            stock=cell.stock(),
            cutter=cell.cutter(1),
            datum_points_part=cell.datum_points_part,
            touched=touched,
        )
        return np.asarray(live.T_base_part[:3, 3])

    right = part(before, None)
    assert part(drifted, before) == pytest.approx(right, abs=1e-9)
    assert part(drifted, None) == pytest.approx(right + DRIFT_BASE_M, abs=1e-6)


def test_the_sag_of_the_spindle_is_in_the_calibrated_target(folder: Path, cell: Cell, truth: Truth) -> None:
    """A tilt of more than 0.2 deg between tracker and controller would keep the loop from arming on soft robots."""
    controller = simulate.controller(cell)
    q = controller.joints(cell.datum_points_part[:1], np.array([[0.0, 0.0, 1.0]]))[0]
    tilted = Plant(truth).equilibrium(q)
    rigid = forward(cell.controller_chain, q)
    lab = laboratory(SEED)
    table = tomllib.loads((folder / "as planned" / online_case.cell_name("all")).read_text(encoding="utf-8"))["tracker"]

    def angles(prefix: str) -> Float:
        R: Float = rotation.from_zyx(np.deg2rad([table[f"{prefix}{k}_deg"] for k in "abc"]))
        return R

    seen = angles("") @ (lab.T_base_tracker[:3, :3].T @ tilted[:3, :3] @ lab.T_tcp_target[:3, :3])
    shown = seen @ angles("target_").T
    assert np.degrees(np.linalg.norm(rotation.log(rigid[:3, :3].T @ tilted[:3, :3]))) > 0.1
    assert np.degrees(np.linalg.norm(rotation.log(rigid[:3, :3].T @ shown))) < 0.02


def test_every_way_has_a_cell_that_a_run_can_use(folder: Path) -> None:
    for name, way in online_case.WAYS.items():
        found = read_cell(folder / "as planned" / online_case.cell_name(name))
        assert found.tables.online is not None
        assert found.tables.online.force == way.online["force"]
        assert found.tables.tracker is not None


def figures(left: float, *, active: bool = True) -> dict[str, Any]:
    return {
        "path": {"p997_mm": left, "max_mm": 1.1 * left},
        "loop": {"states": {"active" if active else "idle": 9}, "causes": []},
    }


def table(hybrid: float, *, active: bool = True) -> list[dict[str, Any]]:
    """Two truths; a worn tool costs 0.2 mm."""
    out = []
    for seed in (1, 2):
        for row, lost in (("as planned", 0.0), ("worn tool", 0.2)):
            left = dict.fromkeys(online_case.WAYS, 0.1 + lost)
            if row == "worn tool" and seed == 2:
                left["hybrid"] = hybrid
            acts = active or seed == 1
            variants = {way: figures(value, active=acts or way != "hybrid") for way, value in left.items()}
            out.append({"seed": seed, "row": row, "truth_level": "identified", "variants": variants})
    return out


def test_what_is_brought_back_is_counted_from_the_right_plan() -> None:
    total = online_report.over_seeds(table(0.15))
    worn = total["worn tool"]["hybrid"]
    assert worn["restored"] == pytest.approx(0.0)
    assert worn["median_restored"] == pytest.approx(0.375)
    assert worn["p997_mm"] == pytest.approx(0.3)
    assert "restored" not in total["as planned"]["hybrid"]  # nothing was lost
    assert online_report.restored(0.35, 0.3, 0.1) == pytest.approx(-0.25)


def test_goals_count_the_worst_and_no_refused_run() -> None:
    worse = online_report.goals(online_report.over_seeds(table(0.32)))["hybrid_not_worse_mm"]
    assert worse == {"limit": 0.01, "worst": pytest.approx(0.02), "met": False}
    kept = online_report.goals(online_report.over_seeds(table(0.305)))["hybrid_not_worse_mm"]
    assert kept["met"]
    refused = online_report.goals(online_report.over_seeds(table(0.305, active=False)))["hybrid_not_worse_mm"]
    assert not refused["met"]


def test_page_and_table_show_the_same_figures() -> None:
    rows = table(0.15)
    total = online_report.over_seeds(rows)
    summary = {"family": "wide", "truth_level": "identified", "seeds": rows, "rows": total}
    summary["goals"] = online_report.goals(total)
    page = online_report.page(summary)
    worn = online_report.table_rows(summary)[1]
    assert worn[0] == WRONG["worn tool"].title
    assert worn[1 + list(online_case.WAYS).index("hybrid")] == "0.225 / 0.300"
    assert "0.225 / 0.300" in page
    assert "37 / 0" in page or "38 / 0" in page
    assert "restores" in online_report.verdict(summary)


def test_the_job_puts_every_run_into_table_summary_and_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With runs that are made up: a worn tool costs 0.2 mm, and the hybrid brings three quarters of it back."""

    def milled(_: str, seed: int, row: str, way: str, *, progress: Progress) -> dict[str, Any]:
        progress(1.0)
        lost = {"plan": 0.2, "hybrid": 0.05}.get(way, 0.2) if row == "worn tool" else 0.0
        return figures(0.1 * seed + lost)

    monkeypatch.setattr("counterflex.app.campaign.campaign.run", lambda *_, **__: {})
    monkeypatch.setattr(online, "prepare", lambda *_: None)
    monkeypatch.setattr(online, "one", milled)
    summary = online.run(tmp_path, seeds=(1, 2), rows=("worn tool",), workers=1)
    assert list(summary["rows"]) == ["as planned", "worn tool"]
    assert summary["rows"]["worn tool"]["hybrid"]["restored"] == pytest.approx(0.75)
    assert summary["goals"]["hybrid_restores"] == {"limit": 0.7, "worst": pytest.approx(0.75), "met": True}
    written = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert written["rows"] == summary["rows"]
    assert "worn tool: force x1.3" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="truth seeds"):
        online.run(tmp_path, seeds=())
    with pytest.raises(InputError, match="no such row"):
        online.run(tmp_path, rows=("rain",))
