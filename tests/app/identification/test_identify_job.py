"""The job around every recipe: what it checks, what it refuses, what it writes and keeps; all of it or nothing."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification import identify
from counterflex.app.identification.history import history
from counterflex.app.identification.identify import judged
from counterflex.app.identification.propose import propose
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ModelError
from counterflex.core.units import URAD_PER_KNM
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.proposal import read_proposal
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.writer import write_dataset
from counterflex.files.identification_file import covariance_shop, read_identification
from counterflex.identify.data.changes import Change, ElementCompliance
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Proposal, Recipe
from counterflex.identify.solver.holdout import Folds, cross_validate, score_separate
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve

CELL = Path(__file__).parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
TRUE = np.array([400.0, 900.0]) * URAD_PER_KNM
NOMINAL = np.array([500.0, 700.0]) * URAD_PER_KNM
SIGMA_M = 2e-6


@dataclass(frozen=True, eq=False)
class Turned:
    """A lever that two springs turn: ``d = f l^2 (c_1 + s c_2)`` with a different share s in every row."""

    force: Float
    share: Float
    d: Float
    sigma: Float
    group: Int
    name: str = "pulls"
    components: tuple[str, ...] = ("d m",)

    def evaluate(self, x: Float) -> Float:
        out: Float = (self.d - self._slope() @ x[:2])[:, None] / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        J = np.zeros((len(self.d), 1, len(x)))
        J[:, 0, :2] = -self._slope() / self.sigma
        return J

    def subset(self, rows: Bool) -> Turned:
        return replace(
            self,
            force=self.force[rows],
            share=self.share[rows],
            d=self.d[rows],
            sigma=self.sigma[rows],
            group=self.group[rows],
        )

    def _slope(self) -> Float:
        return self.force[:, None] * np.stack([np.ones_like(self.share), self.share], axis=1)


def block(data: Sequence[Dataset]) -> Turned:
    f, d = (np.concatenate([s.values(key)[:, 0] for s in data]) for key in ("f_tcp_base", "d_tcp_base"))
    share = np.concatenate([s.values("q")[:, 0] for s in data])
    sigma = np.concatenate([s.channel("d_tcp_base").need_sigma()[:, :1] for s in data])
    return Turned(f, share, d, sigma, np.concatenate([s.group for s in data]))


def identify_springs(given: Inputs) -> Identification:
    cell, data, holdout, settings, _ = given
    parameters = Parameters.of(
        Parameter(name, "rad/(N m)", value, 0.5, log=True, label=name)
        for name, value in zip(("spring 1", "spring 2"), NOMINAL, strict=True)
    ) + Parameters.of([Parameter("unused", "m", 0.0, 1e-3)])
    rows = block(data)
    fit = solve(parameters, [rows])
    if holdout:
        judged = score_separate(parameters, [rows], [block(holdout)])
    else:
        judged = cross_validate(parameters, [rows], folds=Folds(int(settings["folds"]), int(settings["seed"])))
    found, before = judged.mean()
    spindle = cell.end_effector.segments[1].compliance.copy()
    spindle[3:5] = fit.values[:2]
    changes: tuple[Change, ...] = (ElementCompliance("spindle", spindle),)
    if settings["broken"]:
        changes = (ElementCompliance("spindle", np.full(6, 1.0)),)
    worse = 1000.0 if settings["worse"] else 1.0
    return Identification(
        recipe="springs",
        fits={"springs": fit},
        headline=(
            Figure("holdout_mean_um", "mean error of pulls not used", worse * found * 1e6, before * 1e6 / worse),
        ),
        figures=(Figure("pulls_count", "pulls", float(len(rows.d))),),
        changes=changes,
        remarks=("Pulled by hand.",),
        pictures=(Picture("Pulls", "force, N", "moved, um", (Curve("pulls", rows.force, rows.d * 1e6),)),),
    )


def propose_springs(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    rng = np.random.default_rng(settings["seed"])
    return Proposal(
        recipe="springs",
        kind="pulls",
        columns={**{f"q{i + 1}_rad": rng.uniform(-1.0, 1.0, count) for i in range(6)}, "fx_n": np.full(count, 500.0)},
        expected={"spring 1": 3.0 * URAD_PER_KNM},
        remarks=("Pull slowly.",),
        settings={"payload_kg": 5.0},
        units={"spring 1": "rad/(N m)"},
    )


RECIPE = Recipe(
    "springs",
    "two springs from pulls",
    ("pulls",),
    {"folds": 5, "worse": False, "broken": False, "name": "a"},
    identify_springs,
    propose_springs,
)


@pytest.fixture(autouse=True)
def springs(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("counterflex.app.identification.identify", "counterflex.app.identification.propose"):
        monkeypatch.setattr(f"{module}.RECIPES", {"springs": RECIPE})


def pulls(folder: Path, name: str, seed: int, count: int = 40, kind: str = "pulls") -> Path:
    rng = np.random.default_rng(seed)
    force, share = rng.uniform(100.0, 800.0, count), rng.uniform(0.2, 1.5, count)
    d = force * (TRUE[0] + share * TRUE[1]) + SIGMA_M * rng.standard_normal(count)
    d[3] += 200.0 * SIGMA_M
    zero = np.zeros(count)
    return write_dataset(
        folder,
        name,
        kind,
        {
            "q": np.stack([share, *[zero] * 5], axis=1),
            "f_tcp_base": np.stack([force, zero, zero], axis=1),
            "d_tcp_base": np.stack([d, zero, zero], axis=1),
        },
        {"d_tcp_base": SIGMA_M},
    )


def test_results_on_files(tmp_path: Path) -> None:
    data = pulls(tmp_path, "data", 1)
    out = tmp_path / "out"
    result = identify.run("springs", [data], CELL, out, seed=4)
    assert sorted(p.name for p in out.iterdir()) == ["archive", "cell.toml", "report.html", "result.json"]
    on_disk = read_identification(out / "result.json")
    assert on_disk["headline"][0]["value"] == pytest.approx(result["headline"][0]["value"])
    assert on_disk["settings"] == {"folds": 5, "worse": False, "broken": False, "name": "a", "seed": 4}
    assert on_disk["data"][0]["sha256"] == read_dataset(data).fingerprint
    fit = on_disk["fits"]["springs"]
    rows = {row["name"]: row for row in fit["parameters"]}
    for name, value in zip(("spring 1", "spring 2"), (400.0, 900.0), strict=True):
        assert rows[name]["unit"] == "urad/kNm"
        # Five standard deviations of the fit itself.
        assert abs(rows[name]["value"] - value) < 5.0 * rows[name]["sigma"]
        assert rows[name]["low"] < rows[name]["value"] < rows[name]["high"]
        assert rows[name]["seen"] == "determined"
    assert rows["unused"]["seen"] == "prior"
    assert (rows["unused"]["value"], rows["unused"]["unit"]) == (0.0, "mm")
    assert rows["unused"]["sigma"] == pytest.approx(1.0, rel=1e-6)
    assert any("unused" in sentence for sentence in fit["hidden"])
    # The row that was put off is the fifth line of the file, and is named by it.
    assert fit["outliers"][0]["where"].endswith("data.csv:5")
    spread = np.sqrt(np.diag(np.array(fit["covariance"]["values"])))
    np.testing.assert_allclose(spread, [rows[n]["sigma"] for n in fit["covariance"]["names"]], rtol=1e-6)


def test_the_new_cell_file_holds_values_and_where_they_come_from(tmp_path: Path) -> None:
    data = pulls(tmp_path, "data", 1)
    identify.run("springs", [data], CELL, tmp_path / "out")
    cell = read_cell(tmp_path / "out" / "cell.toml")
    (entry,) = cell.tables.identified
    values = {v.name: v for v in entry.values}
    spindle = cell.end_effector.segments[1]
    np.testing.assert_allclose(
        spindle.compliance[3:5] / URAD_PER_KNM, [values["spring 1"].value, values["spring 2"].value], rtol=1e-7
    )
    assert entry.data == ("data.toml",)
    assert entry.data_sha256 == (read_dataset(data).fingerprint,)
    assert "before" in entry.holdout
    assert "folds of the data" in entry.holdout
    assert values["unused"].seen == "prior"
    # What was identified can be identified again, from the new cell on; the entry is replaced.
    identify.run("springs", [pulls(tmp_path, "more", 2)], tmp_path / "out" / "cell.toml", tmp_path / "again")
    again = read_cell(tmp_path / "again" / "cell.toml").tables.identified
    assert [e.data for e in again] == [("more.toml",)]


def test_the_report_is_one_page_that_loads_nothing(tmp_path: Path) -> None:
    data = pulls(tmp_path, "data", 1)
    result = identify.run("springs", [data], CELL, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    head = page.split("<script>")[0]
    for text in ("mean error of pulls not used", "Pulled by hand.", "spring 1", "data.csv:5", "unused", "Pulls"):
        assert text in head
    assert f"{result['headline'][0]['value']:.4g}" in head
    assert "src=" not in head
    assert "http" not in head
    figures = json.loads(page.split('<script type="application/json" id="figures">')[1].split("</script>")[0])
    assert set(figures) == {"intervals0", "residuals0", "correlation0", "picture0"}


def test_hold_out_is_folds_or_a_file_and_the_same_rows_are_not_used_twice(tmp_path: Path) -> None:
    data, unseen = pulls(tmp_path, "data", 1), pulls(tmp_path, "unseen", 2, 12)
    result = identify.run("springs", [data], CELL, tmp_path / "out", holdout=[unseen])
    assert result["holdout"] == "separate data"
    assert result["holdout_data"][0]["rows"] == 12
    with pytest.raises(InputError, match=r"data\.csv:2: two datasets hold the same rows"):
        identify.run("springs", [data], CELL, tmp_path / "no", holdout=[data])
    text = data.read_text()
    for name, rows in (("a", "last_line = 20"), ("b", "first_line = 21"), ("c", "first_line = 20")):
        (tmp_path / f"{name}.toml").write_text(f"{text}\n[rows]\n{rows}\n")
    parts = [tmp_path / "a.toml", tmp_path / "b.toml"]
    assert identify.run("springs", parts[:1], CELL, tmp_path / "out", holdout=parts[1:])["data"][0]["rows"] == 19
    with pytest.raises(InputError, match=r"data\.csv:20"):
        identify.run("springs", parts[:1], CELL, tmp_path / "no", holdout=[tmp_path / "c.toml"])
    assert not (tmp_path / "no").exists()


def test_what_is_worse_than_before_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    data = pulls(tmp_path, "data", 1)
    with pytest.raises(ModelError, match="worse than the cell file") as found:
        identify.run("springs", [data], CELL, tmp_path / "out", settings={"worse": "true"})
    assert "holdout_mean_um" in str(found.value)
    assert not (tmp_path / "out").exists()
    identify.run("springs", [data], CELL, tmp_path / "out")
    before = (tmp_path / "out" / "cell.toml").read_bytes()
    with pytest.raises(ModelError):
        identify.run("springs", [data], CELL, tmp_path / "out", settings={"worse": True})
    assert (tmp_path / "out" / "cell.toml").read_bytes() == before
    assert len(list((tmp_path / "out" / "archive").iterdir())) == 1


def test_an_impossible_cell_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    data = pulls(tmp_path, "data", 1)
    with pytest.raises(ModelError, match="no possible cell.*implausibly large"):
        identify.run("springs", [data], CELL, tmp_path / "out", settings={"broken": "true"})
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.rglob("*trial*"))


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ({"fold": "3"}, "Did you mean 'folds'"),
        ({"folds": "3.5"}, "a whole number"),
        ({"worse": "yes"}, "true or false"),
    ],
)
def test_settings_are_checked(given: dict[str, str], wanted: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=wanted):
        identify.run("springs", [pulls(tmp_path, "data", 1)], CELL, tmp_path / "out", settings=given)


def test_data_of_another_kind_and_data_without_standard_deviation_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"slots\.toml: kind: .*got slots; expected pulls"):
        identify.run("springs", [pulls(tmp_path, "slots", 1, kind="slots")], CELL, tmp_path / "out")
    path = pulls(tmp_path, "data", 1)
    path.write_text("".join(line for line in path.read_text().splitlines(True) if not line.startswith("sigma")))
    lines = path.read_text().split("sigma = [")
    path.write_text(lines[0] if len(lines) == 1 else lines[0] + lines[1].split("]", 1)[1])
    with pytest.raises(CounterflexError, match=r"\[channels\.d_tcp_base\]: sigma ="):
        identify.run("springs", [path], CELL, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_every_run_is_kept_with_its_inputs_and_can_be_done_again(tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    data = pulls(tmp_path / "lab", "data", 1)
    text = data.read_text().replace('"data.csv"', '"../raw/data.csv"')
    (tmp_path / "raw").mkdir()
    (tmp_path / "lab" / "data.csv").rename(tmp_path / "raw" / "data.csv")
    data.write_text(text)
    result = identify.run("springs", [data], CELL, tmp_path / "out", archive=tmp_path / "runs", seed=7)
    (folder,) = (tmp_path / "runs").iterdir()
    assert not (tmp_path / "out" / "archive").exists()
    kept = [folder / "inputs" / "1" / "data.toml"]
    again = identify.run(
        result["recipe"], kept, folder / "inputs" / "cell.toml", tmp_path / "again", settings=result["settings"]
    )
    assert again["headline"] == result["headline"]
    assert again["fits"]["springs"]["parameters"] == result["fits"]["springs"]["parameters"]


def test_history_lists_runs_once_and_marks_what_has_changed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for seed in (1, 2):
        identify.run("springs", [pulls(tmp_path, "data", seed)], CELL, out)
    stiffer = pulls(tmp_path, "data", 3)
    table = np.loadtxt(tmp_path / "data.csv", delimiter=",", skiprows=1)
    names = (tmp_path / "data.csv").read_text().splitlines()[0]
    column = names.split(",").index("d_tcp_base_x_mm")
    table[:, column] *= 0.9
    np.savetxt(tmp_path / "data.csv", table, delimiter=",", header=names, comments="", fmt="%.12g")
    identify.run("springs", [stiffer], CELL, out)
    found = history(tmp_path)
    assert [run["recipe"] for run in found["runs"]] == ["springs"] * 3
    rows = {row["parameter"]: row for row in found["compared"]["springs"]}
    assert [len(row["values"]) for row in rows.values()] == [3, 3, 3]
    assert rows["spring 2"]["significant"]
    assert rows["spring 2"]["change_in_sigma"] < -3.0
    assert rows["unused"]["change_in_sigma"] is None
    assert history(out) == {**found, "runs": [{**run, "folder": run["folder"][4:]} for run in found["runs"]]}
    with pytest.raises(FileFormatError, match="no such folder"):
        history(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="no identification is kept here"):
        history(tmp_path / "empty")


def test_a_proposal_is_written_and_read_back_with_a_form_to_fill(tmp_path: Path) -> None:
    path = propose("springs", 7, CELL, tmp_path / "p", settings={"seed": 3})
    asked = propose_springs(None, 7, {"seed": 3})  # type: ignore[arg-type]
    found = read_proposal(path)
    assert list(found.columns) == list(asked.columns)
    for name, values in asked.columns.items():
        np.testing.assert_allclose(found.columns[name], values, rtol=1e-11, atol=1e-15)
    assert (found.recipe, found.kind, found.remarks) == ("springs", "pulls", ("Pull slowly.",))
    assert found.settings == {"payload_kg": 5.0}
    assert found.expected == pytest.approx(dict(asked.expected))
    header = (tmp_path / "p" / "proposal.csv").read_text().splitlines()[0]
    assert header == "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_n"
    form = tmp_path / "p" / "springs.toml"
    assert tomllib.loads(form.read_text())["settings"] == {"payload_kg": 5.0}
    with pytest.raises(FileFormatError, match=r"springs\.csv:2: column 'f_tcp_base_fy_n'"):
        read_dataset(form)
    lines = (tmp_path / "p" / "springs.csv").read_text().splitlines()
    filled = [",".join(cell or "1" for cell in line.split(",")) for line in lines]
    (tmp_path / "p" / "springs.csv").write_text("\n".join(filled) + "\n")
    data = read_dataset(form)
    np.testing.assert_allclose(data.values("q")[:, 2], asked.columns["q3_rad"], rtol=1e-11)
    assert not data.channel("d_tcp_base").sigma


def test_covariance_is_in_the_units_of_the_table(tmp_path: Path) -> None:
    data = read_dataset(pulls(tmp_path, "data", 1))
    parameters = Parameters.of([Parameter("a", "rad/(N m)", 5e-7, np.inf, scale=1e-7), Parameter("b", "rad", 0.0, 1e3)])
    fit = solve(parameters, [block([data])])
    spread = np.sqrt(np.diag(covariance_shop(fit)))
    np.testing.assert_allclose(spread, [fit.sigma_of("a") / 1e-9, fit.sigma_of("b") / 1e-3], rtol=1e-9)


def test_a_worst_error_that_grows_is_warned_of() -> None:
    found = Identification(
        recipe="stiffness",
        fits={},
        headline=(
            Figure("holdout_median_mm", "median error", 0.10, 0.20),
            Figure("holdout_largest_mm", "largest", 0.71, 0.48),
        ),
        figures=(
            Figure("count", "rows", 9.0, 3.0),
            Figure("holdout_same_mm", "same", 0.1, 0.1),
            Figure("holdout_explained_percent", "better when larger", 80.0, 40.0),
            Figure("mass_kg", "an identified value, no error", 80.8, 75.0),
            Figure("mounting_deg", "another", 0.35, 0.0),
        ),
        changes=(),
    )
    assert judged(found, separate=False)[1] == "better"
    (warning,) = identify.grown(found)
    assert warning.startswith("Warning: largest grows from 0.48 to 0.71 mm")


def test_datasets_of_one_name_are_told_apart_by_their_manifests() -> None:
    a = replace(of_arrays("poses", "pulls", {"q": np.zeros((2, 6))}), where="day1/a.toml")
    b = replace(of_arrays("poses", "pulls", {"q": np.ones((2, 6))}), where="day2/b.toml")
    c = of_arrays("other", "pulls", {"q": np.ones((2, 6))})
    (first, third), (second,) = identify._with_unique_names((a, c), (b,))
    assert (first.name, second.name, third.name) == ("poses (a.toml)", "poses (b.toml)", "other")
