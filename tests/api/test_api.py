"""The ten functions for scripts: they say what the commands say, and load nothing before they are used."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import counterflex as cf
from counterflex import api
from counterflex.app import examples
from counterflex.app.proof import evaluate, prove, simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.family import family_of

GROOVE = Path(__file__).parents[2] / "examples" / "programs" / "groove.ngc"
SHORT = "G21 G17 G90 G94\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z38\nG1 X6 F1500\nG0 Z60\nM30\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("api")
    (place / "cell.toml").write_text(examples.small(), encoding="utf-8")
    (place / "part.ngc").write_text(SHORT, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def plan(folder: Path) -> Any:
    return cf.compensate(folder / "part.ngc", folder / "cell.toml")


def test_ten_names_and_no_package_of_one_of_them() -> None:
    assert len(cf.__all__) == 10
    assert tuple(cf.__all__) == tuple(api.__all__)
    for name in cf.__all__:
        assert getattr(cf, name) is getattr(api, name)
        assert not (Path(cf.__file__).parent / name).exists()


def test_importing_the_package_loads_nothing() -> None:
    program = "import sys, counterflex; print(*[n for n in ('numpy', 'numba', 'polars', 'plotly') if n in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == []


def test_unknown_names_are_said() -> None:
    name = "milling"
    with pytest.raises(AttributeError, match="no attribute 'milling'"):
        getattr(cf, name)


def test_a_compensation_has_the_table_of_its_plan_file(plan: Any, folder: Path) -> None:
    from counterflex.files.plan_file import write_plan

    write_plan(folder / "plan.parquet", plan.plan, {})
    assert plan.table.equals(pl.read_parquet(folder / "plan.parquet"))
    row = plan.table.sort("deflection_y_um").row(0, named=True)
    assert plan.table["correction_y_um"].max() > 0.5 * abs(row["deflection_y_um"])


@pytest.mark.parametrize("kind", ["along", "map", "remaining", "cell"])
def test_pictures_of_a_plan(plan: Any, kind: str) -> None:
    picture = plan.plot(kind)
    assert len(picture.data) >= 1
    assert json.loads(picture.to_json())["data"]


def test_a_picture_that_does_not_exist(plan: Any) -> None:
    with pytest.raises(InputError, match="no such picture.*along, map, remaining, cell"):
        plan.plot("pie")


def test_simulated_and_compared_as_by_the_commands(plan: Any, folder: Path) -> None:
    before = cf.simulate(folder / "part.ngc", folder / "cell.toml", seed=3, family="wide")
    after = cf.simulate(plan, folder / "cell.toml", seed=3, family="wide")
    found = cf.compare(before, after)

    (program,) = plan.save_program(folder / "out")
    make_truth(read_cell(folder / "cell.toml"), 3, folder / "truth.toml", family_of("wide"))
    for name, file in (("before", folder / "part.ngc"), ("after", program)):
        original = folder / "part.ngc"
        simulate.run(file, folder / "cell.toml", folder / "truth.toml", folder / name, original=original)
    expected = evaluate.run([folder / "before", folder / "after"], None)
    assert found.summary["variants"] == expected["variants"]
    figures = dict(found.table.select("figure", "nominal").iter_rows())
    assert figures["path.p997_mm"] == expected["variants"]["nominal"]["path"]["p997_mm"]
    assert found.table["compensated"].item(0) < found.table["nominal"].item(0)
    assert len(found.plot("map").data) > 0
    off = after.table.select((pl.col("y_mm") - pl.col("command_y_mm")).abs().max()).item()
    assert 0.0 < off < 5.0
    with pytest.raises(InputError, match="different simulated cells"):
        cf.compare(before, cf.simulate(plan, folder / "cell.toml", seed=None))


def test_proof_is_that_of_the_command(folder: Path, tmp_path: Path) -> None:
    proof = cf.prove(folder / "part.ngc", folder / "cell.toml", seeds=[5], family="wide")
    expected = prove.prove(
        folder / "part.ngc",
        folder / "cell.toml",
        tmp_path,
        seeds=[5],
        family=family_of("wide"),
        exact=False,
        workers=1,
    )
    variants = expected.summary["seeds"][0]["variants"]
    row = proof.seeds.row(0, named=True)
    assert row["after_p997_mm"] == variants["compensated"]["path"]["p997_mm"]
    assert row["remains_percent"] == pytest.approx(
        100.0 * variants["compensated"]["path"]["p997_mm"] / variants["nominal"]["path"]["p997_mm"]
    )


def test_deflection_is_linear_and_along_the_force(folder: Path) -> None:
    one = cf.deflection(folder / "cell.toml", [20.0, 15.0, 38.0], [0.0, 100.0, 0.0])
    two = cf.deflection(folder / "cell.toml", [[20.0, 15.0, 38.0]] * 2, [[0.0, 100.0, 0.0], [0.0, 200.0, 0.0]])
    assert len(one) == 1
    assert one["deflection_y_um"][0] > 0.0
    assert two["deflection_y_um"][1] == pytest.approx(2.0 * one["deflection_y_um"][0], rel=1e-2)
    assert np.isfinite(one.to_numpy()).all()
    with pytest.raises(InputError, match="force_n"):
        cf.deflection(folder / "cell.toml", [[0.0, 0.0, 0.0]] * 3, [[1.0, 0.0, 0.0]] * 2)


def test_preflight_and_posture(folder: Path) -> None:
    checks = cf.preflight(folder / "part.ngc", folder / "cell.toml")
    assert len(checks) > 5
    chosen = cf.choose_posture(folder / "part.ngc", folder / "cell.toml", rotations=12)
    assert chosen.summary["chosen"]["deflection_um"] <= chosen.summary["present"]["deflection_um"]
