"""The proof on a short groove: machined before and after on one simulated cell, figures recomputed from the record."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import read_job
from counterflex.app.proof import prove
from counterflex.app.proof.judge import judge, reference_of
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import read_cell
from counterflex.files.summary_file import read_run
from counterflex.path.toolpath import FEED

SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z36\nG1 X52 F1500\nG0 Z42\nM5\nM2\n"


REPORTED: list[tuple[float, str]] = []
"""What the proof of the fixture told of its progress."""


def note(fraction: float, what: str = "") -> None:
    REPORTED.append((fraction, what))


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory, small: Path) -> tuple[Path, Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("prove")
    program = folder / "groove.ngc"
    program.write_text(SHORT, encoding="ascii")
    summary = prove.run(program, small, folder / "out", seeds=[1], exact=False, workers=1, progress=note)
    return program, folder / "out", summary


def test_compensation_leaves_what_it_left_before_and_no_more(proof: tuple[Path, Path, dict[str, Any]]) -> None:
    """30 % of the largest and 17 % of the mean error of a short groove; a tenth of each is the margin."""
    _, _, summary = proof
    before, after = (summary["variants"][name]["path"] for name in ("nominal", "compensated"))
    assert before["p997_mm"] > 0.55
    assert after["p997_mm"] < 0.33 * before["p997_mm"]
    assert after["rms_mm"] < 0.19 * before["rms_mm"]


def test_predicted_and_machined_error_agree(proof: tuple[Path, Path, dict[str, Any]]) -> None:
    """The twin is off from the cell file by ten per cent here and there; the prediction is of its kind."""
    _, _, summary = proof
    predicted = summary["prediction"]["predicted_nominal"]["rms_mm"]
    assert summary["variants"]["nominal"]["path"]["rms_mm"] == pytest.approx(predicted, rel=0.5)


def test_all_files_are_there(proof: tuple[Path, Path, dict[str, Any]]) -> None:
    _, out, summary = proof
    names = {str(file.relative_to(out).as_posix()) for file in out.rglob("*") if file.is_file()}
    assert names == {
        "original/groove.ngc", "compensated/groove.ngc", "cell.toml", "plan.parquet", "truth-1.toml",
        "nominal.parquet", "nominal-surface.npz", "compensated.parquet", "compensated-surface.npz",
        "summary.json", "report.html",
    }  # fmt: skip
    stored = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert stored["variants"] == json.loads(json.dumps(summary["variants"]))
    assert stored["job"] == "prove"


@pytest.mark.parametrize("variant", ["nominal", "compensated"])
def test_the_figures_follow_from_the_record(proof: tuple[Path, Path, dict[str, Any]], variant: str) -> None:
    program, out, summary = proof
    cell = read_cell(out / "cell.toml")
    reference = reference_of(read_job(program, cell), cell)
    run, about = read_run(out / f"{variant}.parquet")
    assert about["variant"] == variant
    judged = judge(reference, run, HeightMap.load(out / f"{variant}-surface.npz"))
    stored = summary["variants"][variant]
    found = judged.variant
    assert found.path.path.max_m / MM == pytest.approx(stored["path"]["max_mm"], abs=2e-4)
    assert found.path.path.p997_m / MM == pytest.approx(stored["path"]["p997_mm"], abs=2e-4)
    assert found.path.path.rms_m / MM == pytest.approx(stored["path"]["rms_mm"], abs=2e-4)
    assert found.path.exit.max_m / MM == pytest.approx(stored["exit"]["max_mm"], abs=2e-4)


def test_the_uncompensated_error_is_what_the_record_shows(proof: tuple[Path, Path, dict[str, Any]]) -> None:
    """One straight groove along x: the error across is what y and z are off, no evaluation needed."""
    _, out, summary = proof
    run, _ = read_run(out / "nominal.parquet")
    cutting = (run.kind == FEED) & (run.depth_m > 0.0)
    across = np.hypot(run.p_part_tcp[cutting, 1] - 15 * MM, run.p_part_tcp[cutting, 2] - 36 * MM) / MM
    assert across.max() == pytest.approx(summary["variants"]["nominal"]["path"]["max_mm"], rel=0.03)


def test_a_proof_needs_a_seed(small: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seeds"):
        prove.run("part.ngc", small, tmp_path / "out", seeds=[])
    assert not (tmp_path / "out").exists()


def test_the_bar_moves_within_each_run_and_by_what_parts_cost(proof: tuple[Path, Path, dict[str, Any]]) -> None:
    """A bar that moves when a run has ended stands still for most of the time of a long program."""
    assert proof
    fractions = [fraction for fraction, _ in REPORTED]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    for name in ("machining, seed 1, nominal", "machining, seed 1, compensated"):
        assert len({fraction for fraction, what in REPORTED if what == name}) >= 3
    for time_s, workers, tasks in ((4.0, 2, 3), (100.0, 1, 2), (1000.0, 4, 15)):
        work = prove._work(time_s, range(tasks // 3 or 1), tasks, workers, exact=tasks % 3 == 0)
        assert (prove.STARTING in work) == (workers > 1)  # processes that start take longer than a short program
        assert work[prove.MACHINING] >= 0.2 * time_s * tasks / workers
