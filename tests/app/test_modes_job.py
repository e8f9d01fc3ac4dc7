"""Command modes: figures of a shipped cell, files that are written, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from counterflex.app import cell_modes as job, cell_modes as tap_test
from counterflex.app.cell_modes import PostureModes
from counterflex.app.lowest_mode import estimate
from counterflex.cli.main import whole
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.plan.tap_fit import fit_masses
from counterflex.robot.elasticity.compliance import cartesian_compliance

ROOT = Path(__file__).resolve().parents[2]
SMALL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
JOINTS = [0.0, -90.0, 110.0, 0.0, 40.0, 0.0]


def test_tip_motions_add_up_to_the_compliance() -> None:
    """``sum_k a_k a_k'`` of all modes is the static compliance, and every frequency lies in its interval."""
    cell = read_cell(SMALL)
    done = PostureModes.of(cell, np.array(JOINTS) * DEG)
    np.testing.assert_allclose(done.tip @ done.tip.T, cartesian_compliance(cell.chain, done.q), rtol=1e-6, atol=1e-12)
    for row in done.summary["modes"]:
        low, high = row["of_90_percent_hz"]
        assert low < row["hz"] < high
        towards = np.array(row["tip_direction"])
        assert towards[np.argmax(np.abs(towards))] > 0.0  # a mode swings both ways: one sign for all
        assert np.linalg.norm(towards) == pytest.approx(1.0, abs=2e-3)
    assert done.summary["modes"][0]["hz"] == pytest.approx(estimate(cell, done.q).mode.hz, abs=1e-3)


def test_the_command_prints_and_writes(tmp_path: Path) -> None:
    words = [
        "modes",
        str(SMALL),
        "--joints",
        "0,-90,110,0,40,0",
        "--count",
        "3",
        "--out",
        str(tmp_path / "out"),
        "--json",
    ]
    result = CliRunner().invoke(whole(), words)
    assert result.exit_code == 0, result.output
    printed = json.loads(result.stdout)
    assert len(printed["modes"]) == 3
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["modes"] == printed["modes"]
    assert "Hz" in CliRunner().invoke(whole(), ["modes", str(SMALL)]).output


def test_a_robot_without_stiffness_is_refused_or_taken_by_its_class() -> None:
    file = ROOT / "examples" / "cells" / "irb6640_d16.toml"
    with pytest.raises(InputError, match="no stiffness is known"):
        job.run(file)
    assert job.run(file, assume_class=True)["masses"] == "from stiffness and assumed masses"


def test_a_tap_test_finds_the_masses_that_are_off() -> None:
    """``examples/tap_test.csv``: spindle 20 %, axis 3 15 % and arm 25 % heavier, all compliances 10 % larger."""
    before = job.run(SMALL, joints_deg=JOINTS)
    found = job.run(SMALL, joints_deg=JOINTS, tap_test=ROOT / "examples" / "tap_test.csv")["tap_test"]
    masses = {row["body"]: row for row in found["masses"]}
    assert masses["spindle"]["fitted_kg"] == pytest.approx(1.2 * masses["spindle"]["stated_kg"], rel=0.05)
    assert masses["axis3"]["fitted_kg"] == pytest.approx(1.15 * masses["axis3"]["stated_kg"], rel=0.05)
    assert found["stiffness_factor"] == pytest.approx(1.0 / 1.1, rel=0.02)
    assert not masses["axis1"]["seen"]
    assert found["frac_after"] > 0.99 > found["frac_before"]
    assert found["modes_after"][0]["hz"] < 0.93 * before["modes"][0]["hz"]
    assert found["modes_after"][0]["damping_ratio"] == pytest.approx(
        2e-3 * np.pi * found["modes_after"][0]["hz"], rel=0.05
    )


def test_modes_behind_a_tap_test_are_damped_as_it_was_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """``zeta = beta omega / 2`` by the damping of the fit, before it by that of the cell."""
    monkeypatch.setattr(tap_test, "fit_masses", lambda *given: replace(fit_masses(*given), damping_s=3e-3))
    done = job.run(SMALL, joints_deg=JOINTS, tap_test=ROOT / "examples" / "tap_test.csv")
    for one in done["tap_test"]["modes_after"]:
        assert one["damping_ratio"] == pytest.approx(np.pi * one["hz"] * 3e-3, abs=6e-5)
    assert done["tap_test"]["modes_before"][0]["damping_ratio"] == done["modes"][0]["damping_ratio"]


def test_a_tap_test_above_what_counts_is_refused() -> None:
    with pytest.raises(InputError, match="low enough"):
        job.run(SMALL, joints_deg=JOINTS, tap_test=ROOT / "examples" / "tap_test.csv", up_to_hz=1.0)
