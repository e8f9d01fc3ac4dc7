"""A prediction is sealed before the truth is opened, and what came later is held against it, misses too."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from counterflex.app import ledger as room
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.proof import evaluate, prove, simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset

SHORT: Final = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z36\nG1 X12 F1500\nG0 Z42\nM5\nM2\n"
EXAMPLES: Final = Path(__file__).parents[2] / "examples"
PULLS: Final = EXAMPLES / "data" / "fanuc_r2000ic_stiffness" / "last_14.toml"
FANUC: Final = EXAMPLES / "cells" / "fanuc_r2000ic.toml"
Edit = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, small: Path) -> Path:
    """A plan, its prediction, and a proof and an evaluated part that came afterwards."""
    folder = tmp_path_factory.mktemp("ledger")
    program, cell = folder / "groove.ngc", folder / "cell.toml"
    program.write_text(SHORT, encoding="ascii")
    shutil.copy(small, cell)
    compensate(program, cell, folder / "plan", report=False)
    room.predict(folder / "plan", None, folder / "groove.json")
    prove.run(program, cell, folder / "proof", seeds=[3, 1], exact=True, workers=1)
    make_truth(read_cell(cell), 1, folder / "truth.toml")
    for name, machined in (("before", program), ("after", folder / "plan" / "groove.ngc")):
        simulate.run(machined, cell, folder / "truth.toml", folder / name, original=program)
    evaluate.run([folder / "before", folder / "after"], folder / "evaluated")
    return folder


def edited(made: Path, target: Path, edit: Edit, name: str = "proof") -> Path:
    """The folder of a measurement with a summary that says something else."""
    shutil.copytree(made / name, target)
    file = target / "summary.json"
    summary = json.loads(file.read_text(encoding="utf-8"))
    edit(summary)
    file.write_text(json.dumps(summary), encoding="utf-8")
    return target


@pytest.mark.long
def test_a_prediction_holds_what_the_plan_says_first(made: Path) -> None:
    summary = json.loads((made / "plan" / "summary.json").read_text(encoding="utf-8"))
    said = json.loads((made / "groove.json").read_text(encoding="utf-8"))
    for name in ("before", "after"):
        one = said["figures"][f"{name}.p997_mm"]
        assert [one["predicted"], one["low"], one["high"]] == summary["prediction"]["headline"][f"{name}_mm"]
    assert said["program"] == "groove.ngc"
    assert said["inputs"]["program_sha256"] == summary["inputs"]["program_sha256"]


def test_every_truth_is_held_against_the_plan_that_was_predicted(made: Path) -> None:
    """The program planned with the exact constants is another plan, and no result of this one."""
    summary = json.loads((made / "proof" / "summary.json").read_text(encoding="utf-8"))
    pair = room.reveal(made / "groove.json", made / "proof", None)
    came = {(row["truth"], row["figure"]): row["came"] for row in pair["figures"]}
    for seed in summary["seeds"]:
        for name, variant in (("before", "nominal"), ("after", "compensated")):
            value = seed["variants"][variant]["path"]["p997_mm"]
            key = (f"seed {seed['seed']}", f"{name}.p997_mm")
            assert (came[key] == value) == (seed["truth_level"] == "catalogue" or variant == "nominal")
    assert len(pair["figures"]) == 6
    assert pair["not_looked_at"] == []


def test_an_evaluated_part_gives_what_the_proof_of_its_truth_gives(made: Path) -> None:
    proof = room.reveal(made / "groove.json", made / "proof", None)["figures"]
    part = room.reveal(made / "groove.json", made / "evaluated", None)["figures"]
    ours = [row["came"] for row in proof if row["truth"] == "seed 1"]
    assert [row["came"] for row in part] == pytest.approx(ours, rel=1e-6)


@pytest.mark.parametrize("change", ["predicted", "low", "high"])
def test_a_changed_prediction_is_refused(made: Path, tmp_path: Path, change: str) -> None:
    said = json.loads((made / "groove.json").read_text(encoding="utf-8"))
    said["figures"]["after.p997_mm"][change] += 0.1
    (tmp_path / "groove.json").write_text(json.dumps(said), encoding="utf-8")
    with pytest.raises(FileFormatError, match="changed after it was written"):
        room.reveal(tmp_path / "groove.json", made / "proof", None)
    with pytest.raises(FileFormatError, match="changed after it was written"):
        room.ledger(tmp_path)


@pytest.mark.parametrize(
    ("key", "said"),
    [("program_sha256", "another program"), ("cell_sha256", "another cell"), ("machined_sha256", "another machined")],
)
@pytest.mark.parametrize("name", ["proof", "evaluated"])
def test_a_measurement_of_something_else_is_refused(made: Path, tmp_path: Path, name: str, key: str, said: str) -> None:
    other = edited(made, tmp_path / "other", lambda summary: summary["inputs"].update({key: "0" * 64}), name)
    with pytest.raises(InputError, match=said):
        room.reveal(made / "groove.json", other, None)


def test_a_measurement_that_does_not_say_of_what_it_is_is_refused(made: Path, tmp_path: Path) -> None:
    for k, edit in enumerate((lambda summary: summary.pop("inputs"), lambda summary: summary["inputs"].clear())):
        with pytest.raises(InputError, match="another program"):
            room.reveal(made / "groove.json", edited(made, tmp_path / str(k), edit), None)


def test_a_measurement_from_before_the_prediction_is_refused(made: Path, tmp_path: Path) -> None:
    room.predict(made / "plan", None, tmp_path / "late.json")
    for name in ("proof", "evaluated"):
        with pytest.raises(InputError, match="older than the prediction"):
            room.reveal(tmp_path / "late.json", made / name, None)


def test_one_old_run_makes_an_evaluation_old(made: Path, tmp_path: Path) -> None:
    """Also where the other run came after the prediction."""
    begun = "2000-01-01T00:00:00.000+00:00"
    old = edited(made, tmp_path / "before", lambda summary: summary["inputs"].update(begun=begun), "before")
    assert evaluate.run([old, made / "after"], None)["inputs"]["begun"] == begun


def test_a_scan_that_does_not_say_when_is_named_so(made: Path, tmp_path: Path) -> None:
    def as_scan(summary: dict[str, Any]) -> None:
        del summary["inputs"]["machined_sha256"]
        path = {"path": {"path": {"p997_mm": 9.0}}, "surface": {"p997_mm": 1.0}}
        summary.update(job="inspect", parts={"before": {"surface": {"p997_mm": 5.0}}, "after": path})

    pair = room.reveal(made / "groove.json", edited(made, tmp_path / "scan", as_scan), None)
    (row,) = pair["figures"]
    assert (row["figure"], row["came"], row["inside"]) == ("after.p997_mm", 9.0, False)
    assert pair["not_looked_at"] == [
        "which program made the part", "when it was measured, which the measurement does not say",
    ]  # fmt: skip


def test_the_next_part_of_correct_is_held_against_its_surface(made: Path, tmp_path: Path) -> None:
    expected = {"next_p997_um": 120.0, "next_5_percent_um": 80.0, "next_95_percent_um": 200.0}
    correct: dict[str, Any] = {"expected": expected, "parts": [{"surface_p997_um": 500.0}]}
    plan = edited(made, tmp_path / "plan-2", lambda summary: summary.update(job="correct", correct=correct), "plan")
    said = room.predict(plan, None, tmp_path / "next.json")
    assert said["figures"] == {"surface.p997_mm": {"predicted": 0.12, "low": 0.08, "high": 0.2}}
    came = {**correct, "parts": [{"surface_p997_um": 500.0}, {"surface_p997_um": 90.0}]}
    measured = edited(made, tmp_path / "plan-3", lambda summary: summary.update(job="correct", correct=came), "plan")
    pair = room.reveal(tmp_path / "next.json", measured, None)
    (row,) = pair["figures"]
    assert (row["came"], row["inside"], pair["against"]) == (0.09, True, "measured parts")
    came["parts"][-1]["simulated"] = True
    scan = edited(made, tmp_path / "scan", lambda summary: summary.update(job="correct", correct=came), "plan")
    assert room.reveal(tmp_path / "next.json", scan, None)["against"] == "scans of simulated parts"


def test_each_pull_is_held_against_its_measured_displacement(tmp_path: Path) -> None:
    said = room.predict(PULLS, FANUC, tmp_path / "pulls.json")
    pair = room.reveal(tmp_path / "pulls.json", PULLS, tmp_path / "pulls-pair.json")
    lengths = 1e3 * np.linalg.norm(read_dataset(PULLS).values("d_tcp_base"), axis=1)
    assert [row["came"] for row in pair["figures"]] == pytest.approx(lengths, abs=1e-4)
    assert all(one["low"] < one["predicted"] < one["high"] for one in said["figures"].values())
    with pytest.raises(InputError, match="another program"):
        room.reveal(tmp_path / "pulls.json", PULLS.with_name("first_29.toml"), None)


def test_the_force_of_a_pull_was_measured_and_widens_nothing(tmp_path: Path) -> None:
    """Cutting constants known by a handbook would give an upper end at least 1.3 times as high."""
    said = room.predict(PULLS, FANUC, tmp_path / "pulls.json")["figures"]
    wide = FANUC.read_text(encoding="utf-8") + '\n[[identified]]\nrecipe = "cutting"\ndate = ""\ndata = []\n'
    wide += 'data_sha256 = []\ncounterflex = ""\nholdout = ""\nvalues = []\n'
    (tmp_path / "cell.toml").write_text(wide, encoding="utf-8")
    assert room.predict(PULLS, tmp_path / "cell.toml", tmp_path / "known.json")["figures"] == said


def test_a_ledger_lists_misses_and_what_nobody_revealed(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "all" / "below"
    folder.mkdir(parents=True)
    shutil.copy(made / "groove.json", folder)
    (folder / "another.json").write_text("{}", encoding="utf-8")

    def missed(summary: dict[str, Any]) -> None:
        summary["seeds"][0]["variants"]["compensated"]["path"]["p997_mm"] = 50.0

    room.reveal(folder / "groove.json", edited(made, tmp_path / "miss", missed), folder / "pair.json")
    room.predict(made / "plan", None, folder / "open.json")
    found = room.ledger(tmp_path / "all")
    assert found["not_revealed"] == ["open.json"]
    row = next(row for row in found["rows"] if row["came"] == 50.0)
    assert (row["figure"], row["inside"]) == ("after.p997_mm", False)
    after = next(one for one in found["credibility"] if one["figure"] == "after.p997_mm")
    assert after["above"] >= 1
    assert after["inside"] < after["of"] == 2
    assert len(found["rows"]) == 6


def test_nothing_that_was_committed_is_replaced(made: Path) -> None:
    before = (made / "groove.json").read_bytes()
    with pytest.raises(InputError, match="never replaced"):
        room.predict(made / "plan", None, made / "groove.json")
    with pytest.raises(InputError, match="never replaced"):
        room.reveal(made / "groove.json", made / "proof", made / "groove.json")
    assert (made / "groove.json").read_bytes() == before


def test_a_plan_without_an_interval_predicts_nothing(made: Path, tmp_path: Path) -> None:
    bare = edited(made, tmp_path / "bare", lambda summary: summary["prediction"].pop("headline"), "plan")
    with pytest.raises(InputError, match="no interval"):
        room.predict(bare, None, tmp_path / "x.json")
    older = edited(made, tmp_path / "older", lambda summary: summary.pop("inputs"), "plan")
    with pytest.raises(FileFormatError, match="does not say of which program"):
        room.predict(older, None, tmp_path / "x.json")
    assert not (tmp_path / "x.json").exists()
