"""Constants and wear from run logs: known constants and growth recovered, history, the new cell file, bad input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.compensation import compensate
from counterflex.app.production.production import run
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ModelError
from counterflex.files.cell.cell import read_cell
from counterflex.identify.production.alignment import PlannedCut
from counterflex.runtime.record_ring import column
from counterflex.runtime.state.states import Cause
from production_log import cut_of, rows_of, write_rows

CELL = Path(__file__).resolve().parents[2] / "data" / "cells" / "rigid.toml"
PROGRAM = (
    "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-20 Y8\nG1 Z37 F3000\nG1 X62 F1500\nG0 Z60\n"
    "G0 X-20 Y26\nG1 Z36 F3000\nG1 X62 F900\nG0 Z60\nG0 X-20 Y20\nG1 Z36 F3000\nG1 X62 F2400\nG0 Z60\nM5\nM2\n"
)
"""A slot, half of the tool beside it, and the rib between the two."""
TRUE = (1.15, 0.85, 1.25)
"""Specific forces c, r, a over those of the cell file."""


@dataclass(frozen=True)
class Shop:
    """A plan, its maps, the true law, and a run of it."""

    plan: Path
    cut: PlannedCut
    terms: Float
    run: Path


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Shop:
    folder = tmp_path_factory.mktemp("production")
    program = folder / "part.ngc"
    program.write_text(PROGRAM, encoding="ascii", newline="")
    compensate.run(program, CELL, folder / "plan", report=False, predict=False)
    plan = folder / "plan" / "plan.parquet"
    cut = cut_of(CELL, plan)
    terms = read_cell(CELL).force_law.terms()
    terms[:, 1:] *= np.array(TRUE)
    return Shop(plan, cut, terms, write_rows(folder / "run", rows_of(plan, cut, terms), plan, CELL))


def life(shop: Shop, folder: Path, factors: list[float], first: int = 1) -> list[Path]:
    """Runs of a tool whose force grows."""
    return [
        write_rows(
            folder / f"run-{i}", rows_of(shop.plan, shop.cut, shop.terms, factor=f, seed=i), shop.plan, CELL
        )
        for i, f in enumerate(factors, first)
    ]  # fmt: skip


def test_wrong_constants_are_found_within_their_interval(shop: Shop, tmp_path: Path) -> None:
    result = run([shop.run], CELL, [shop.plan], tmp_path / "out", apply=tmp_path / "new.toml")
    assert result["proposed"]
    h_ref = next(f["value"] for f in result["figures"] if f["name"] == "h_ref_um") * 1e-6
    stated = read_cell(CELL).force_law.terms()[0]
    for i, name in enumerate(("kc", "kr", "ka")):
        row = next(p for p in result["fits"]["production"]["parameters"] if p["name"] == name)
        true = TRUE[i] * stated[1 + i] * h_ref**-0.25 * 1e-6
        assert abs(row["value"] - true) < 2.0 * row["sigma"]
        assert row["sigma"] < 0.12 * row["value"]
    mean = result["headline"][0]
    assert mean["value"] < 0.25 * mean["nominal"]
    new = read_cell(tmp_path / "new.toml")
    entry = next(e for e in new.tables.identified if e.recipe == "production")
    assert entry.data == ("run",)
    assert entry.data_sha256[0] == result["runs"][0]["sha256"]
    assert {"kc", "kr", "ka"} <= {v.name for v in entry.values}
    assert new.force_law.terms()[0, 1] > 1.1 * stated[1]
    assert (tmp_path / "out" / "report.html").is_file()


def test_growth_and_a_new_edge_and_a_history(shop: Shop, tmp_path: Path) -> None:
    """Four runs of one edge, then an edge that nobody stated; given in two calls."""
    runs = life(shop, tmp_path, [1.0, 1.04, 1.08, 1.12, 1.0, 1.04])
    out = tmp_path / "out"
    first = run(runs[:4], CELL, [shop.plan], out, settings={"wear_limit": 0.1})
    slope = {f["name"]: f["value"] for f in first["figures"]}
    length = first["runs"][0]["cut_mm"] * 1e-3
    assert slope["wear_low_percent_per_m"] < 4.0 / length < slope["wear_high_percent_per_m"]
    assert first["drift"]["significant"]
    assert first["wear"] in ("at", "beyond")
    again = run(runs, CELL, [shop.plan], out)
    assert [row["new_edge"] for row in again["runs"]] == ["", "", "", "", "seen", ""]
    assert [row["edge"] for row in again["runs"]] == [1, 1, 1, 1, 2, 2]
    assert sum("in the history already" in remark for remark in again["remarks"]) == 4
    assert sorted(p.name for p in (out / "runs").iterdir()) == [f"{n:03d}" for n in range(1, 7)]
    assert again["wear"] == "within"


def test_a_jump_of_the_force_is_named_with_its_size(shop: Shop, tmp_path: Path) -> None:
    """Eight runs, 35 % more force from the fifth on: no new edge, and the growth is that of the force."""
    runs = life(shop, tmp_path, [1.0] * 4 + [1.35] * 4)
    result = run(runs, CELL, [shop.plan], tmp_path / "out")
    assert all(row["new_edge"] == "" for row in result["runs"])
    (event,) = result["drift"]["events"]
    assert event["run"] == "run-5"
    assert event["size_percent"] == pytest.approx(35.0, abs=3.0)
    figures = {f["name"]: f["value"] for f in result["figures"]}
    assert figures["grown_percent"] == pytest.approx(35.0, abs=3.0)
    assert result["wear"] in ("at", "beyond")
    assert any("rises by" in remark and "run-5" in remark for remark in result["remarks"])


def test_without_wear_none_is_seen_and_stated_constants_stand(shop: Shop, tmp_path: Path) -> None:
    stated = read_cell(CELL).force_law.terms()
    runs = [
        write_rows(tmp_path / f"run-{i}", rows_of(shop.plan, shop.cut, stated, seed=i), shop.plan, CELL)
        for i in range(1, 5)
    ]
    result = run(runs, CELL, [shop.plan], tmp_path / "out")
    assert not result["proposed"]
    assert not result["drift"]["significant"]
    assert all(row["new_edge"] == "" for row in result["runs"])
    with pytest.raises(ModelError, match="no reason to change the constants"):
        run(runs, CELL, [shop.plan], tmp_path / "out", apply=tmp_path / "new.toml")
    assert not (tmp_path / "new.toml").exists()


def damaged(shop: Shop, folder: Path, change: Callable[[Float], Float]) -> Path:
    rows = change(rows_of(shop.plan, shop.cut, shop.terms, seed=9))
    return write_rows(folder / "bad", rows, shop.plan, CELL)


def in_cut(rows: Float) -> Int:
    """Cycles about the middle of the slot."""
    x, y = rows[:, column("nominal_x")], rows[:, column("nominal_y")]
    return np.array(np.flatnonzero((np.abs(x - 0.02) < 0.005) & (np.abs(y - 0.008) < 1e-3)), dtype=np.int64)


def saturated(rows: Float) -> Float:
    rows[in_cut(rows)[:5], column("flag_soft")] = float(Cause.FORCE_SATURATED)
    return rows


def gap(rows: Float) -> Float:
    return np.delete(rows, in_cut(rows)[:40], axis=0)


def silent(rows: Float) -> Float:
    rows[:, column("wrench_fx") : column("wrench_fx") + 6] = 0.0
    return rows


def stale(rows: Float) -> Float:
    rows[in_cut(rows), column("flag_force_age")] = 3.0
    return rows


def elsewhere(rows: Float) -> Float:
    rows[:, column("nominal_y")] += 0.02
    return rows


def noise(rows: Float) -> Float:
    rows[:, column("wrench_fx") : column("wrench_fx") + 3] = np.random.default_rng(1).normal(0.0, 50.0, (len(rows), 3))
    return rows


def backwards(rows: Float) -> Float:
    rows[500:, column("counter_ms")] -= 1500.0
    return rows


def no_air(rows: Float) -> Float:
    return rows[in_cut(rows)[0] - 260 : in_cut(rows)[-1] + 60]


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (saturated, "the force sensor was saturated in the cut"),
        (gap, "stretches of the run log are missing"),
        (silent, "made without a force sensor"),
        (stale, "the force is missing in a part of the cut"),
        (elsewhere, "not on the path of the plan"),
        (noise, "does not follow the force that the plan predicts"),
        (backwards, "clock runs backwards"),
        (lambda rows: rows[:100], "the run is too short"),
    ],
)
def test_runs_that_say_nothing_are_refused(
    shop: Shop, tmp_path: Path, change: Callable[[Float], Float], wanted: str
) -> None:
    with pytest.raises(CounterflexError, match=wanted) as raised:
        run([damaged(shop, tmp_path, change)], CELL, [shop.plan], tmp_path / "out")
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "out").exists()


def test_files_that_do_not_belong_together_are_refused(shop: Shop, tmp_path: Path) -> None:
    def refused(wanted: str, kind: type[CounterflexError] = InputError, **options: Any) -> None:
        given: dict[str, Any] = {"folders": [shop.run], "cell_file": CELL, "plans": [shop.plan]}
        given |= {"out": tmp_path / "out"} | options
        with pytest.raises(kind, match=wanted):
            run(**given)

    rows = rows_of(shop.plan, shop.cut, shop.terms)[:2000]
    other = write_rows(tmp_path / "other", rows, CELL, CELL)
    refused("made with another plan", folders=[other])
    planless = write_rows(tmp_path / "planless", rows, shop.plan, CELL, lambda about: about["sha256"].pop("plan"))
    refused("made without a plan", folders=[planless])
    refused("there is no run log", FileFormatError, folders=[tmp_path])
    refused("does not cut with this tool", settings={"tool": 2})
    refused("cannot tell .* apart", settings={"constants": "all"})
    refused("no such set of constants", settings={"constants": "some"})
    refused("out of range", settings={"wear_limit": 9.0})
    refused("has no such setting", settings={"wear": 0.1})
    there = tmp_path / "there.toml"
    there.write_text("mine", encoding="utf-8")
    refused("already there", apply=there)
    assert there.read_text(encoding="utf-8") == "mine"
    refused("cell file itself is not overwritten", apply=CELL)
    text = CELL.read_text(encoding="utf-8").replace("box_max_mm = [40, 30, 40]", "box_max_mm = [40, 30, 30]")
    lower = tmp_path / "lower.toml"
    lower.write_text(text, encoding="utf-8")
    refused("not of this cell's blank and tools", cell_file=lower)
