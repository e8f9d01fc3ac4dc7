"""A robot without stiffness passes for rigid nowhere: nothing is planned on it, unless its class is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app import examples
from counterflex.app.campaign import campaign
from counterflex.app.compensation.compensate import compensate, run
from counterflex.app.identification.cell_model import read_settings, starting_cell
from counterflex.app.inputs import setting_of
from counterflex.app.proof.prove import prove
from counterflex.app.proof.truth import truth_of
from counterflex.app.questions import check_cell, deflection
from counterflex.app.run.job_check import cell_of_run
from counterflex.app.run.session import RunSettings, open_session
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import CLASS_ASSUMED, read_plan
from counterflex.identify.geometry.compliances import springs
from counterflex.identify.recipe import Recipe
from counterflex.identify.recipes import RECIPES
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import axis_deflections, rigid_axes
from counterflex.robot.model.class_prior import arm_over_axis

EXAMPLES = Path(__file__).parents[2] / "examples"
GROOVE = EXAMPLES / "programs" / "groove.ngc"
SMALL = EXAMPLES / "cells" / "kr300_d16_small.toml"
KNOWN, UNKNOWN = "kuka_kr300_r2500_ultra", "kuka_kr270_r2700_ultra"
ALL = "A1, A2, A3, A4, A5, A6"


def cell_file(folder: Path, robot: str = UNKNOWN, more: str = "") -> Path:
    """The small cell with another robot."""
    text = SMALL.read_text(encoding="utf-8").replace(f'catalog = "{KNOWN}"', f'catalog = "{robot}"\n{more}')
    file = folder / "cell.toml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.fixture
def unknown(tmp_path: Path) -> Path:
    """The small cell with a robot of the same geometry family of which no stiffness is published."""
    return cell_file(tmp_path)


def test_every_axis_of_a_robot_with_published_stiffness_is_elastic() -> None:
    cell = read_cell(SMALL)
    assert rigid_axes(cell.chain) == ()
    assert read_cell(SMALL, assume_class=True).class_stiffness is None
    assert not any("no stiffness" in one for one in check_cell(str(SMALL))["warnings"])


def test_a_cell_that_is_named_after_another_robot_says_so(tmp_path: Path) -> None:
    def remarks(text: str) -> list[str]:
        file = tmp_path / "cell.toml"
        file.write_text(text, encoding="utf-8")
        return [one for one in check_cell(str(file))["warnings"] if one.startswith("name: ")]

    edited = examples.small().replace(KNOWN, UNKNOWN)  # as a person does who has another robot
    (found,) = remarks(edited)
    assert "named after KR 300 R2500 ultra, and its robot is KR 270 R2700 ultra" in found
    assert not remarks(edited.replace("KR 300 R2500 ultra", "KR 270 R2700 ultra"))
    assert not remarks(examples.small())
    assert not remarks(examples.with_robot(examples.small(), UNKNOWN))


def test_cell_check_says_what_is_missing_and_what_it_costs(unknown: Path) -> None:
    found = [one for one in check_cell(str(unknown))["warnings"] if f"no stiffness is known of {ALL}" in one]
    assert len(found) == 1
    assert "in nine of ten robots of this class) under 500 N at a corner" in found[0]
    assert "counterflex identify stiffness" in found[0]


def test_nothing_is_planned_and_nothing_is_written(unknown: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match=f"no stiffness is known of {ALL}") as refused:
        run(GROOVE, unknown, out)
    assert not out.exists()
    line = str(refused.value)
    assert "mm in nine of ten robots of this class) in groove.ngc" in line
    assert "identify stiffness --propose" in line
    assert "--assume-class" in line
    with pytest.raises(InputError, match="no stiffness is known"):
        prove(GROOVE, unknown, tmp_path)
    with pytest.raises(InputError, match="no stiffness is known"):
        open_session(RunSettings(cell=unknown, robot=("egm", None)))
    with pytest.raises(InputError, match="no stiffness is known"):
        campaign.run(unknown, out, seeds=[1])
    assert not out.exists()
    with pytest.raises(InputError, match="under 500 N"):
        setting_of(read_cell(unknown))


def test_on_the_class_a_plan_is_marked_everywhere(unknown: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    summary = run(GROOVE, unknown, out, assume_class=True, predict=False)
    assumed = summary["assumed"]["stiffness"]
    assert assumed["axes"] == [1, 2, 3, 4, 5, 6]
    assert summary["prediction"]["peak_deflection_um"]["value"] > 100.0
    assert any(f"{ALL} of {UNKNOWN} is assumed from its class" in one for one in summary["written"]["warnings"])
    assert f"stiffness of {ALL} assumed from the robot's class" in (out / "groove.ngc").read_text().splitlines()[1]
    assert "ASSUMED: median of the robot&#39;s class" in (out / "report.html").read_text(encoding="utf-8")
    assert read_plan(out / "plan.parquet")[1][CLASS_ASSUMED]
    assert cell_of_run(unknown, read_plan(out / "plan.parquet")).class_stiffness is not None
    with pytest.raises(FileFormatError, match=r"no table \[online\]"):  # no longer refused for its stiffness
        open_session(RunSettings(cell=unknown, robot=("egm", None), plan=out / "plan.parquet"))


def test_an_axis_that_the_file_states_keeps_what_it_states(tmp_path: Path) -> None:
    rows = "\n".join(
        f'[[robot.elastic]]\nsegment = "axis{axis}"\nrz_urad_per_knm = {value}' for axis, value in ((1, 250), (6, 0))
    )
    cell = read_cell(cell_file(tmp_path, more=rows), assume_class=True)
    assert cell.class_stiffness is not None
    assert cell.class_stiffness.axes == (1, 2, 3, 4)
    about = {name: cell.chain.compliance[i, 5] for i, name in enumerate(cell.chain.names)}
    assert about["axis1"] == pytest.approx(250e-9)
    assert about["axis6"] == 0.0
    assert about["axis2"] == pytest.approx(1.0 / cell.class_stiffness.prior.median_nm_per_rad[1])


def test_a_file_that_states_all_axes_is_planned_as_before(tmp_path: Path) -> None:
    rows = "\n".join(f'[[robot.elastic]]\nsegment = "axis{i}"\nrz_urad_per_knm = 500' for i in range(1, 7))
    cell = read_cell(cell_file(tmp_path, more=rows))
    summary = compensate(GROOVE, cell, predict=False).summary
    assert "assumed" not in summary
    assert not any("stiffness" in one for one in summary["written"]["warnings"])


@pytest.mark.parametrize(
    ("robot", "said"),
    [("abb_irb120", "payload 3 kg; expected 20 to 1000 kg"), ("staubli_tx2_90", "payload of the robot")],
)
def test_an_arm_without_class_is_refused_with_the_reason(tmp_path: Path, robot: str, said: str) -> None:
    file = cell_file(tmp_path, robot)
    with pytest.raises(InputError, match=said) as refused:
        setting_of(read_cell(file))
    assert "--assume-class" not in str(refused.value)
    with pytest.raises(ValueError, match=said):
        read_cell(file, assume_class=True)


def test_springs_about_the_axes_are_the_chain_with_these_springs(unknown: Path) -> None:
    """The law: J (J^T w) / k summed over the axes is the compliance of the chain that has these springs alone."""
    rigid, elastic = read_cell(unknown), read_cell(unknown, assume_class=True)
    assert elastic.class_stiffness is not None
    q = np.deg2rad([[10.0, -80.0, 110.0, 20.0, -40.0, 5.0]])
    w = np.array([[120.0, -300.0, 200.0, 5.0, -8.0, 3.0]])
    k = elastic.class_stiffness.prior.median_nm_per_rad
    added = np.einsum("nad,a->nd", axis_deflections(rigid.chain, q, w, tuple(range(6))), 1.0 / k)
    C = compliance.cartesian_compliance(elastic.chain, q) - compliance.cartesian_compliance(rigid.chain, q)
    np.testing.assert_allclose(added, np.einsum("nij,nj->ni", C, w)[:, :3], rtol=1e-6)


def test_truths_of_a_class_spread_as_far_as_the_class(unknown: Path) -> None:
    """A proof on the class meets robots of the class, not its median with ten per cent."""
    cell = read_cell(unknown, assume_class=True)
    assert cell.class_stiffness is not None
    axis2 = [truth_of(cell, seed).bodies[1].compliance[5] for seed in range(200)]
    spread = np.std(np.log(axis2))
    assert 0.7 < spread / cell.class_stiffness.prior.log_sigma[1] < 1.3


def test_pulls_at_such_a_robot_determine_its_axes(unknown: Path) -> None:
    """An axis that is rigid in the file would stay rigid: identification begins with the class, and widely."""
    recipe: Recipe = RECIPES["stiffness"]
    cell, chosen, remark = starting_cell(unknown, recipe, read_settings(recipe, {"wide": "sensor"}))
    found = springs(cell.chain, chosen).parameters
    sigma = {one.name: one.prior_sigma for one in found}
    assert [sigma[f"axis{axis}.rz"] for axis in range(1, 7)] == [1.0] * 6
    assert sigma["sensor.rx"] == 1.0
    assert sigma["spindle.rx"] == 0.3
    assert f"{ALL} begin with the median of the robot's class" in remark
    assert starting_cell(SMALL, recipe, read_settings(recipe, {}))[2] == ""


def test_friction_holds_a_twist_in_the_gear_alone(unknown: Path) -> None:
    """The springs of the class stand for the whole arm: tilting and bending beyond the gear follow the load."""
    cell = read_cell(unknown, assume_class=True)
    nominal, drawn = truth_of(cell, None), truth_of(cell, 1)
    share = arm_over_axis()
    assert np.all((share > 0.1) & (share < 0.7))
    for axis in range(6):
        ratio = sum(drawn.drives[axis].link_friction_nm) / sum(nominal.drives[axis].link_friction_nm)
        assert ratio == pytest.approx(share[axis], rel=0.9)
        assert ratio < 1.0


def test_a_question_about_such_a_robot_says_that_it_yields_nothing(unknown: Path) -> None:
    for cell, answer in (
        (unknown, [f"{ALL} of {UNKNOWN} yield nothing here: rigid, or of unknown stiffness"]),
        (SMALL, []),
    ):
        asked = deflection(read_cell(cell).chain, [0.0, -90.0, 90.0, 0.0, 30.0, 0.0], [0.0, 500.0, 0.0], [0.0] * 3)
        assert asked["warnings"] == answer
