"""The campaign on a short groove and one recipe: over files, kept steps, figures that follow from the records."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.campaign import campaign, laboratory
from counterflex.app.campaign.axes import Grid
from counterflex.app.campaign.report import headline_rows, remaining, rows_of, verdict
from counterflex.app.campaign.step import ORDER, campaign_of
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset

SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z36\nG1 X20 F1500\nG0 Z42\nM5\nM2\n"
RECIPE = "tracker-frame"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, small: Path) -> tuple[Path, Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("campaign")
    program = folder / "groove.ngc"
    program.write_text(SHORT, encoding="ascii")
    out = folder / "out"
    found = campaign.run(small, out, grid=Grid([program]), seeds=[1], recipes=[RECIPE], with_exact=True, workers=1)
    return program, out, found


@pytest.mark.long
def test_files_of_every_step_are_there(done: tuple[Path, Path, dict[str, Any]]) -> None:
    _, out, _ = done
    names = {str(file.relative_to(out).as_posix()) for file in out.rglob("*") if file.is_file()}
    step = f"seed-1/1-{RECIPE}"
    assert {
        "cell.toml", "original/groove.ngc", "compensated/groove.ngc", "summary.json", "report.html",
        "seed-1/truth.toml",
        f"{step}/data-proposal/proposal.toml", f"{step}/data/{RECIPE}.toml", f"{step}/data/{RECIPE}.csv",
        f"{step}/holdout/{RECIPE}.csv", f"{step}/result/result.json", f"{step}/cell.toml", "seed-1/cell.toml",
        "seed-1/compensated/groove.ngc", "seed-1/machined-nominal/run.parquet",
        "seed-1/machined-identified/run.parquet",
    } <= names  # fmt: skip
    assert not [name for name in names if ".part" in name]


def test_the_summary_names_its_levels(done: tuple[Path, Path, dict[str, Any]]) -> None:
    _, out, found = done
    stored = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert stored["job"] == "campaign"
    assert {entry["truth_level"] for entry in stored["seeds"]} == {"identified", "catalogue", "exact"}
    assert stored["seeds"] == json.loads(json.dumps(found["seeds"]))
    first = stored["campaigns"][0]["recipes"][0]
    assert first["recipe"] == RECIPE
    assert first["accepted"]
    assert first["rows"]["data"] > first["rows"]["holdout"] > 3
    assert {row["group"] for row in stored["campaigns"][0]["parameter_errors"]} >= {"use", "stiffness", "cutting"}


def test_the_table_is_what_the_summary_says(done: tuple[Path, Path, dict[str, Any]]) -> None:
    _, _, found = done
    (row,) = rows_of(found)
    by = {entry["truth_level"]: entry["variants"] for entry in found["seeds"]}
    before = by["catalogue"]["nominal"]["path"]["p997_mm"]
    assert row[0] == "1"
    assert float(row[1]) == pytest.approx(before, abs=5e-4)
    assert float(row[2]) == pytest.approx(by["catalogue"]["compensated"]["path"]["p997_mm"], abs=5e-4)
    assert float(row[3].rstrip(" %")) == pytest.approx(100.0 * remaining(found, "catalogue")[0], abs=0.05)
    assert float(row[7].rstrip(" %")) == pytest.approx(100.0 * remaining(found, "exact")[0], abs=0.05)
    assert f"{100.0 * remaining(found, 'identified')[0]:.1f} %" in verdict(found)
    assert headline_rows(found)[0][:2] == ["1", RECIPE]
    # where the tracker stands changes nothing that a plan uses
    assert remaining(found, "identified") == pytest.approx(remaining(found, "catalogue"), rel=1e-6)


def test_what_is_done_is_not_done_again(
    done: tuple[Path, Path, dict[str, Any]], small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, out, found = done

    def fail(*_: Any, **__: Any) -> None:
        raise AssertionError("done again")

    monkeypatch.setattr(simulate, "machine", fail)
    monkeypatch.setattr(laboratory, "measure", fail)
    again = campaign.run(small, out, grid=Grid([program]), seeds=[1], recipes=[RECIPE], with_exact=True, workers=1)
    assert again["seeds"] == found["seeds"]
    assert again["campaigns"] == found["campaigns"]


@pytest.mark.long
def test_an_interrupted_campaign_goes_on(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = tmp_path / "truth.toml"
    make_truth(read_cell(small), 2, truth)
    measured: list[str] = []
    measure = laboratory.measure

    def interrupted(*args: Any, **options: Any) -> dict[str, Any]:
        measured.append(options["session"])
        if len(measured) == 2:
            raise KeyboardInterrupt
        return measure(*args, **options)

    monkeypatch.setattr(laboratory, "measure", interrupted)
    with pytest.raises(KeyboardInterrupt):
        campaign.run(small, tmp_path / "out", truth_file=truth, recipes=[RECIPE], workers=1)
    assert not (tmp_path / "out" / "summary.json").exists()
    found = campaign.run(small, tmp_path / "out", truth_file=truth, recipes=[RECIPE], workers=1)
    assert found["campaigns"][0]["seed"] == 2
    assert "seeds" not in found
    assert len(measured) == 4


def test_validation_stands_elsewhere_and_has_noise_of_its_own(done: tuple[Path, Path, dict[str, Any]]) -> None:
    _, out, _ = done
    fit, holdout = (read_dataset(out / f"seed-1/1-{RECIPE}/{name}/{RECIPE}.toml") for name in ("data", "holdout"))
    assert not {tuple(row) for row in fit.values("q").round(6)} & {tuple(row) for row in holdout.values("q").round(6)}


def test_data_hold_readings_and_nothing_else_of_the_truth(done: tuple[Path, Path, dict[str, Any]], small: Path) -> None:
    """Two sessions on one truth differ by noise alone; the files know no seed, no truth and no noise-free value."""
    _, out, _ = done
    proposal = out / f"seed-1/1-{RECIPE}/data-proposal/proposal.toml"
    truth = out / "seed-1/truth.toml"
    readings = []
    for session in ("one", "two"):
        laboratory.measure(proposal, small, truth, out / session, seed=1, session=session)
        readings.append(read_dataset(out / session / f"{RECIPE}.toml"))
        text = (out / session / f"{RECIPE}.toml").read_text(encoding="utf-8")
        assert "truth" not in text
        assert "seed" not in text
    p = [data.values("p_tracker_target") for data in readings]
    sigma = readings[0].channel("p_tracker_target").need_sigma()
    spread = (p[1] - p[0]) / sigma
    assert 0.8 < float((spread**2).mean()) ** 0.5 / 2.0**0.5 < 1.25


def test_a_truth_of_another_cell_is_refused(
    done: tuple[Path, Path, dict[str, Any]], small: Path, tmp_path: Path
) -> None:
    _, out, _ = done
    text = small.read_text(encoding="utf-8").replace("z_mm = 80", "z_mm = 180")
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    proposal = out / f"seed-1/1-{RECIPE}/data-proposal/proposal.toml"
    with pytest.raises(FileFormatError, match="another cell"):
        laboratory.measure(proposal, tmp_path / "cell.toml", out / "seed-1/truth.toml", tmp_path / "data")


def test_what_a_campaign_consists_of(small: Path) -> None:
    cell = read_cell(small)
    names = [item.recipe for item in campaign_of(cell)]
    assert "holder" not in names
    assert names == [item.recipe for item in ORDER if item.recipe in names]
    assert [item.recipe for item in campaign_of(cell, ["cutting", "kinematics"])] == ["kinematics", "cutting"]
    with pytest.raises(InputError, match="no such recipe"):
        campaign_of(cell, ["weather"])


def test_either_seeds_or_a_truth(small: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="either"):
        campaign.run(small, tmp_path / "out")
    with pytest.raises(InputError, match="seeds"):
        campaign.run(small, tmp_path / "out", seeds=[])
