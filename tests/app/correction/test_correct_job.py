"""Correct the next part: a simulated part, its scan, the next program, the next part; wrong inputs in one line."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from counterflex.app.compensation import compensate
from counterflex.app.correction import correct
from counterflex.app.correction.scans import PartScan
from counterflex.app.inputs import read_job
from counterflex.app.proof import evaluate, simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ModelError, OutputError
from counterflex.core.units import UM
from counterflex.files.cell.cell import read_cell
from counterflex.files.part_deviations import MeasuredPart, write_part_deviations
from counterflex.files.plan_file import CLASS_ASSUMED, read_plan
from counterflex.files.summary_file import read_summary
from counterflex.twin.truth.family import WIDE

GROOVE = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60\nM5\nM2\n"
CELL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"


@dataclass(frozen=True)
class Shop:
    """A program, its first plan, the part that it made, the next program and its part."""

    program: Path
    plan: Path
    part: Path
    next_plan: Path
    next_part: Path


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Shop:
    """A cell of which one part tells a constant; of most cells it tells none, and ``--apply`` is refused."""
    folder = tmp_path_factory.mktemp("shop")
    program = folder / "part.ngc"
    program.write_text(GROOVE, encoding="ascii", newline="")
    made = Shop(program, *(folder / name for name in ("plan", "part", "next-plan", "next-part")))
    make_truth(read_cell(CELL), 3, folder / "truth.toml", WIDE)
    compensate.run(program, CELL, made.plan, report=False, predict=False)
    for plan, part in ((made.plan, made.part), (made.next_plan, made.next_part)):
        if plan == made.next_plan:
            correct.run(program, CELL, made.plan, [made.part], made.next_plan)
        simulate.run(plan / "part.ngc", CELL, folder / "truth.toml", part, original=program)
    return made


@pytest.mark.long
def test_the_next_program_stands_on_the_class_of_the_robot_as_the_plan_does(tmp_path: Path) -> None:
    text = CELL.read_text(encoding="utf-8")
    cell, program, truth = (tmp_path / name for name in ("cell.toml", "part.ngc", "truth.toml"))
    cell.write_text(text.replace("kuka_kr300_r2500_ultra", "kuka_kr270_r2700_ultra"), encoding="utf-8")
    program.write_text(GROOVE, encoding="ascii", newline="")
    make_truth(read_cell(cell, assume_class=True), 3, truth, WIDE)
    compensate.run(program, cell, tmp_path / "plan", assume_class=True, report=False, predict=False)
    simulate.run(tmp_path / "plan" / "part.ngc", cell, truth, tmp_path / "part", original=program)
    summary = correct.run(program, cell, tmp_path / "plan", [tmp_path / "part"], tmp_path / "next", report=False)
    assert summary["assumed"]["stiffness"]["axes"] == [1, 2, 3, 4, 5, 6]
    assert read_plan(tmp_path / "next" / "plan.parquet")[1][CLASS_ASSUMED]  # and so does the part after it


def surface_mm(shop: Shop, part: Path) -> float:
    seed = evaluate.run([part], None)["seeds"][0]
    return float(seed["variants"]["nominal"]["surface"]["p997_mm"])


@pytest.mark.long
def test_second_part_is_better_and_as_expected(shop: Shop) -> None:
    first, second = (surface_mm(shop, part) for part in (shop.part, shop.next_part))
    assert second < 0.5 * first
    found = read_summary(shop.next_plan / "summary.json")["correct"]
    assert found["expected"]["now_p997_um"] == pytest.approx(1e3 * first, rel=0.15)
    assert found["parts"][0]["noise_um"] == pytest.approx(20.0, rel=0.15)
    assert found["changed"]
    assert "measured_y_um" in pl.read_parquet_schema(shop.next_plan / "plan.parquet")
    assert (shop.next_plan / "report.html").is_file()


def test_the_next_plan_goes_on_from_the_history(shop: Shop, tmp_path: Path) -> None:
    summary = correct.run(shop.program, CELL, shop.next_plan, [shop.next_part], tmp_path / "third", report=False)
    parts = summary["correct"]["parts"]
    assert [row["part"] for row in parts] == [1, 2]
    assert parts[1]["surface_p997_um"] < 0.6 * parts[0]["surface_p997_um"]
    assert sorted(path.name for path in (tmp_path / "third" / "parts").iterdir()) == ["001", "002"]
    second, third = (read_plan(folder / "plan.parquet")[0] for folder in (shop.next_plan, tmp_path / "third"))
    assert second.measured_part is not None
    assert third.measured_part is not None
    assert np.max(np.abs(third.measured_part - second.measured_part)) < np.max(np.abs(second.measured_part))


@pytest.mark.long
def test_constants_go_into_a_new_cell_file_with_which_a_new_plan_is_better(shop: Shop, tmp_path: Path) -> None:
    new = tmp_path / "cell.toml"
    summary = correct.run(shop.program, CELL, shop.plan, [shop.part], tmp_path / "out", apply=new, report=False)
    best, before, cell = summary["correct"]["explanations"][0], read_cell(CELL), read_cell(new)
    entry = cell.tables.identified[-1]
    assert summary["applied"] == {"explanation": best["explanation"], "cell": "cell.toml"}
    assert (entry.recipe, entry.data) == ("correct", (shop.part.name,))
    assert entry.data_sha256 == (hashlib.sha256((shop.part / simulate.SURFACE).read_bytes()).hexdigest(),)
    assert [one.name for one in entry.values] == [factor["name"] for factor in best["factors"]]
    assert len(cell.tables.identified) == len(before.tables.identified) + 1
    compensate.run(shop.program, new, tmp_path / "plan", report=False, predict=False)
    truth = shop.part.parent / "truth.toml"
    simulate.run(tmp_path / "plan" / "part.ngc", CELL, truth, tmp_path / "part", original=shop.program)
    assert surface_mm(shop, tmp_path / "part") < 0.7 * surface_mm(shop, shop.part)
    text = new.read_bytes()
    for target, match in ((new, "already there"), (CELL, "itself is not overwritten")):
        with pytest.raises(InputError, match=match):
            correct.run(shop.program, CELL, shop.plan, [shop.part], tmp_path / "again", apply=target, report=False)
    assert new.read_bytes() == text
    assert not (tmp_path / "again").exists()


def test_a_cell_file_and_its_folder_are_written_both_or_neither(
    shop: Shop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full when the last file of the folder is written: no new cell file is left behind."""

    def full(path: Path, *_: object) -> None:
        raise OutputError("cannot write: No space left on device", where=str(path))

    monkeypatch.setattr(correct, "write_folder_summary", full)
    new = tmp_path / "made" / "cell.toml"
    with pytest.raises(OutputError, match="No space left"):
        correct.run(shop.program, CELL, shop.plan, [shop.part], tmp_path / "out", apply=new, report=False)
    assert list(tmp_path.iterdir()) == []


def test_wrong_inputs_are_named_in_one_line_and_nothing_is_written(shop: Shop, tmp_path: Path) -> None:
    other = tmp_path / "other.ngc"
    other.write_text(GROOVE.replace("Y15", "Y16"), encoding="ascii", newline="")
    job = read_job(shop.program, read_cell(CELL))
    scan = PartScan.read(shop.part, shop.program, job, read_cell(CELL), 0).deviations
    foreign = tmp_path / "deviations.parquet"
    write_part_deviations(foreign, scan, MeasuredPart("x.ngc", "ab" * 32, "x.ply", "mm", (), 1.0))
    elsewhere = tmp_path / "elsewhere.parquet"
    moved = type(scan)(
        scan.points + np.array([0.0, 3e-3, 5e-3]), scan.normals, scan.deviation_m, scan.standard_deviation_m, scan.face
    )
    write_part_deviations(elsewhere, moved, MeasuredPart("part.ngc", "", "x.ply", "mm", (), 1.0))
    empty = tmp_path / "empty"
    empty.mkdir()
    raw = tmp_path / "scan.ply"
    raw.write_bytes(b"ply\nformat ascii 1.0\n")
    plan, part = shop.plan, shop.part
    cases: list[tuple[tuple[Path, Path, list[Path]], dict[str, Any], type[CounterflexError], str]] = [
        ((shop.program, plan, []), {}, InputError, "no measured part"),
        ((shop.program, empty, [part]), {}, FileFormatError, "no plan in this folder"),
        ((shop.program, plan, [empty]), {}, FileFormatError, "no measured part in this folder"),
        ((other, plan, [part]), {}, InputError, "the plan is of another program"),
        ((shop.program, plan, [foreign]), {}, InputError, "another program's part"),
        ((shop.program, plan, [raw]), {}, FileFormatError, "not a file of part deviations.*counterflex inspect"),
        ((shop.program, plan, [elsewhere]), {}, InputError, "too few places that this program made"),
        ((shop.program, plan, [part]), {"limit_m": 20 * UM}, ModelError, "more than is allowed at a time|change the"),
    ]
    for (program, folder, scans), options, kind, match in cases:
        with pytest.raises(kind, match=match) as fault:
            correct.run(program, CELL, folder, scans, tmp_path / "out", report=False, **options)
        assert "\n" not in str(fault.value)
        assert not (tmp_path / "out").exists()
    broken = tmp_path / "broken"
    shutil.copytree(shop.next_plan, broken)
    (broken / "path-error.parquet").unlink()
    with pytest.raises(FileFormatError, match=r"path-error\.parquet: no such file"):
        correct.run(shop.program, CELL, broken, [part], tmp_path / "out", report=False)
