"""A plan of another robot, another place of the part or another tool is not taken for one of this cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import examples
from counterflex.app.compensation import compensate as job
from counterflex.app.correction.correct import correct
from counterflex.app.plan_of_cell import APART_M, require_of_cell, require_same_cell
from counterflex.app.run.job_check import cell_of_run
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import read_plan


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``cell.toml``, ``groove.ngc`` and its plan in ``out``."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "cell.toml").write_text(examples.small(), encoding="utf-8")
    (folder / "groove.ngc").write_text(examples.text("groove.ngc"), encoding="utf-8")
    job.run(folder / "groove.ngc", folder / "cell.toml", folder / "out", predict=False, report=False)
    return folder


def _other(planned: Path, old: str, new: str) -> Path:
    text = (planned / "cell.toml").read_text(encoding="utf-8")
    assert old in text
    file = planned / "other.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("x_mm = 1350", "x_mm = 1150", "200 mm away from its point"),
        ("z_mm = 1000", "z_mm = 700", "300 mm away from its point"),
        ('catalog = "kuka_kr300_r2500_ultra"', 'catalog = "kuka_kr270_r2700_ultra"', "the plan is of another cell"),
        ("x_mm = 240", "x_mm = 140", "100 mm away from its point"),
    ],
)
def test_a_plan_of_another_cell_is_refused(planned: Path, old: str, new: str, says: str) -> None:
    plan, about = read_plan(planned / "out" / "plan.parquet")
    other = read_cell(_other(planned, old, new))
    with pytest.raises(InputError, match=r"plan\.parquet.*another cell") as caught:
        require_of_cell(plan, about, other, planned / "out" / "plan.parquet")
    assert says in str(caught.value)
    with pytest.raises(InputError, match="another cell"):
        cell_of_run(other.path, (plan, about), "plan.parquet")
    if "catalog" in old:  # of no known stiffness: nothing is planned for it at all
        return
    with pytest.raises(InputError, match="another cell"):
        correct(planned / "groove.ngc", other, planned / "out", [planned / "none.npz"])


@pytest.mark.parametrize("shift_mm", [0.0, 3.0, APART_M / MM - 1.0, APART_M / MM + 1.0])
def test_a_part_that_is_measured_again_keeps_its_plan(planned: Path, shift_mm: float) -> None:
    plan, about = read_plan(planned / "out" / "plan.parquet")
    cell = read_cell(_other(planned, "x_mm = 1350", f"x_mm = {1350 + shift_mm}"))
    if shift_mm * MM <= APART_M:
        require_of_cell(plan, about, cell, "plan.parquet")
        return
    with pytest.raises(InputError, match="another cell"):
        require_of_cell(plan, about, cell, "plan.parquet")


def test_the_check_is_forward_kinematics(planned: Path) -> None:
    """The distance that is named is the one by which the part was moved."""
    plan, about = read_plan(planned / "out" / "plan.parquet")
    rng = np.random.default_rng(5)
    for shift in rng.uniform(60.0, 400.0, 3):
        with pytest.raises(InputError) as caught:
            require_of_cell(plan, about, read_cell(_other(planned, "y_mm = -30", f"y_mm = {shift - 30.0}")), "p")
        value: Any = caught.value.value
        assert float(value.split()[0]) == pytest.approx(shift, abs=1.0)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('catalog = "kuka_kr300_r2500_ultra"', 'catalog = "kuka_kr500_r2830"', "another robot"),
        ("diameter_mm = 16", "diameter_mm = 12", "another tool T"),
        ("x_mm = 1350", "x_mm = 1150", "the part lies elsewhere"),
    ],
)
def test_a_part_of_another_cell_is_refused(planned: Path, old: str, new: str, says: str) -> None:
    """A simulated part is taken by its folder; the cell file in it must be of the same robot, tools and place."""
    cell = read_cell(planned / "cell.toml")
    require_same_cell(read_cell(planned / "cell.toml"), cell, "part")
    with pytest.raises(InputError, match=f"part: the part was machined in another cell: {says}"):
        require_same_cell(read_cell(_other(planned, old, new)), cell, "part")
