"""A campaign over programs, placements and postures: a row for each, faults beside results, what is done is kept."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import polars
import pytest

from counterflex.app.campaign import campaign
from counterflex.app.campaign.axes import Grid, Placement, branch_and_rotation, read_placements
from counterflex.app.proof import simulate
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell

SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z36\nG1 X20 F1500\nG0 Z42\nM5\nM2\n"
PLACES = (Placement("near", {"x_mm": 1300.0}), Placement("nowhere", {"x_mm": 9000.0}))
HELD = "front up noflip 160"


def done(small: Path, program: Path, out: Path) -> dict[str, Any]:
    grid = Grid([program], PLACES, ["present", HELD])
    return campaign.run(small, out, grid=grid, seeds=[1, 2], recipes=[], workers=1)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, small: Path) -> tuple[Path, Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("grid")
    program = folder / "groove.ngc"
    program.write_text(SHORT, encoding="ascii")
    return program, folder / "out", done(small, program, folder / "out")


@pytest.mark.long
def test_a_row_for_each(made: tuple[Path, Path, dict[str, Any]]) -> None:
    _, out, summary = made
    rows = polars.read_parquet(out / "results.parquet")
    assert len(rows) == 2 * 2 * 2
    assert rows.select("placement", "posture", "seed").is_unique().all()
    reached, beyond = (rows.filter(polars.col("placement") == place.name) for place in PLACES)
    assert reached["fault"].is_null().all()
    assert (reached["compensated_p997_mm"] < reached["nominal_p997_mm"]).all()
    assert reached["nominal_p997_mm"].n_unique() == 4  # place and posture count, and the simulated cell
    assert reached.filter(polars.col("posture") == HELD)["rotation_about_tool_deg"].to_list() == [160.0, 160.0]
    assert beyond["compensated_p997_mm"].is_null().all()
    assert beyond["fault"].str.contains("reach").all()
    entry = summary["setups"][0]
    assert (entry["placement"], entry["cells"], entry["failed"]) == ("near", 2, 0)
    assert entry["remains_percent"]["worst"] == pytest.approx(
        reached.filter(polars.col("posture") == "present")["remains_percent"].max(), abs=1e-4
    )
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["setups"] == summary["setups"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert HELD in page
    assert "nowhere" in page


def test_part_and_posture_are_where_they_should_be(made: tuple[Path, Path, dict[str, Any]], small: Path) -> None:
    _, out, _ = made
    before, cell = read_cell(small), read_cell(out / "setups" / f"near_{HELD.replace(' ', '-')}" / "cell.toml")
    assert cell.T_base_part[0, 3] == pytest.approx(1.3)
    assert cell.T_base_part[1:3, 3] == pytest.approx(before.T_base_part[1:3, 3])
    assert cell.tables.posture.branch == "front up noflip"


def test_what_is_done_is_not_done_again(
    made: tuple[Path, Path, dict[str, Any]], small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What could not be done is tried again; nothing else is."""
    program, out, summary = made
    machine, places_m = simulate.machine, []

    def noted(job: Any, cell: Any, truth: Any, **options: Any) -> Any:
        places_m.append(cell.T_base_part[0, 3])
        return machine(job, cell, truth, **options)

    monkeypatch.setattr(simulate, "machine", noted)
    assert done(small, program, out)["setups"] == summary["setups"]
    assert set(places_m) == {9.0}


def test_where_nothing_can_be_run(made: tuple[Path, Path, dict[str, Any]], small: Path, tmp_path: Path) -> None:
    program, _, _ = made
    grid = Grid([program], [Placement(name, {"x_mm": 9000.0}) for name in ("a", "b")])
    with pytest.raises(InputError, match="none of the set-ups could be run.*reach"):
        campaign.run(small, tmp_path / "out", grid=grid, seeds=[1], recipes=[], workers=1)
    assert not (tmp_path / "out" / "results.parquet").exists()


def placements(folder: Path, text: str) -> Path:
    file = folder / "places.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_placements_are_read(tmp_path: Path) -> None:
    places = read_placements(placements(tmp_path, "\ufeffname,x_mm,c_deg\na,1,2.5\nb-2,-3e2,0\n"))
    assert places == (Placement("a", {"x_mm": 1.0, "c_deg": 2.5}), Placement("b-2", {"x_mm": -300.0, "c_deg": 0.0}))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no placement"),
        ("name,x_mm\n", "no placement"),
        ("x_mm\n1\n", "columns"),
        ("name,x\na,1\n", "columns"),
        ("name,x_mm\n../a,1\n", "no name for a folder"),
        ("name,x_mm\n,1\n", "no name for a folder"),
        ("name,x_mm\na,1\nA,2\n", "same name"),
        ("name,x_mm\na,nan\n", "places.csv:2: x_mm is no number"),
        ("name,x_mm\na\n", "x_mm is no number"),
        ("name,x_mm\na,1,2\n", "more cells than the header"),
        ("name,x_mm\na,1\nb,2,3\n", "more cells than the header"),
        ("name,x_mm,x_mm\na,1,2\n", "columns"),
    ],
)
def test_what_are_no_placements(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message):
        read_placements(placements(tmp_path, text))


def test_set_ups_are_named_by_what_differs() -> None:
    assert [item.name for item in Grid(["a.ngc"]).setups()] == [""]
    assert [item.name for item in Grid(["a.ngc", "x/b.ngc"], PLACES).setups()] == [
        "a_near", "a_nowhere", "b_near", "b_nowhere",
    ]  # fmt: skip
    assert [item.name for item in Grid(["a.ngc"], (), ["present", "chosen"]).setups()] == ["present", "chosen"]
    assert branch_and_rotation("back down flip -90") == ("back down flip", -90.0)
    assert Grid().setups() == ()


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (Grid((), PLACES), "those of a program"),
        (Grid(["a.ngc", "x/a.nc"]), "same name"),
        (Grid(["a.ngc"], (), ["chosen", "chosen"]), "twice"),
        (Grid(["a.ngc"], (), ["front up 90"]), "no posture"),
        (Grid(["a.ngc"], (), ["front up noflip 400"]), "no posture"),
        (Grid(["a.ngc"], (), [""]), "no posture"),
    ],
)
def test_what_is_no_grid(grid: Grid, message: str) -> None:
    with pytest.raises(InputError, match=message):
        grid.setups()
