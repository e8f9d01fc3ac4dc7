"""Thermal growth from touches: a filter that states its own error, against its own law and the simulated cell."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.proof.truth import truth_of
from counterflex.app.thermal import ThermalSettings
from counterflex.app.unknown_stiffness import corner_of_blank
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import UM
from counterflex.evaluate.thermal.growth import GrowthModel, Touches, follow
from counterflex.files.cell.cell import read_cell
from counterflex.files.touches_file import read_touches
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.family import OTHER

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
AXIS: Float = np.array([0.0, 0.0, -1.0])
U = GrowthModel().reference_rad_s
SIGMA = 4.0 * UM


def touched(
    rng: np.random.Generator, speeds: Float, end_m: float, tau_s: float, step_s: float = 300.0
) -> tuple[Touches, Float, Float]:
    """Touches of a spindle and an arm that do as the filter thinks, with true growth (n,) and drift (n, 3)."""
    usual, n = GrowthModel(), len(speeds)
    grown, arm = np.zeros(n), np.zeros((n, 3))
    for k in range(1, n):
        kept, root = np.exp(-step_s / tau_s), np.sqrt(step_s / 3600.0)
        target = end_m * speeds[k] / U
        grown[k] = kept * grown[k - 1] + (1.0 - kept) * target + usual.growth_walk_m * root * rng.standard_normal()
        arm[k] = arm[k - 1] + usual.arm_walk_m * root * rng.standard_normal(3)
    place = grown[:, None] * AXIS + arm + SIGMA * rng.standard_normal((n, 3))
    time_s: Float = step_s * np.arange(n, dtype=np.float64)
    return Touches(time_s, place - place[0], speeds, np.full(n, SIGMA), np.full(n, np.nan)), grown, arm


SPEEDS: Float = U * np.array([0.0, *[1.0] * 9, *[0.0] * 5, *[0.6] * 6])


def test_its_errors_are_as_large_as_it_states() -> None:
    """A of any machine, time constant between the ends of the grid, speed that changes: normalised errors about one."""
    rng = np.random.default_rng(5)
    growth, total, unforeseen = [], [], 0
    for _ in range(60):
        end_m, tau_s = 80.0 * UM * rng.standard_normal(), float(np.exp(rng.uniform(np.log(300.0), np.log(5000.0))))
        touches, grown, arm = touched(rng, SPEEDS, end_m, tau_s)
        course = follow(touches, AXIS)
        growth.append((course.growth_m[-1] - grown[-1]) / course.growth_sigma_m[-1])
        error = course.total_m[-1] - (grown[-1] * AXIS + arm[-1])
        total.append(error / course.total_sigma_m[-1])
        unforeseen += not course.holds.all()
    assert np.mean(np.square(growth)) == pytest.approx(1.0, abs=0.45)
    assert np.mean(np.square(total)) == pytest.approx(1.0, abs=0.35)
    assert unforeseen <= 3


def test_a_speed_that_changes_tells_growth_from_drift() -> None:
    rng = np.random.default_rng(2)
    changing = follow(touched(rng, SPEEDS, 60.0 * UM, 1200.0)[0], AXIS)
    still = follow(touched(rng, np.zeros(len(SPEEDS)), 60.0 * UM, 1200.0)[0], AXIS)
    assert changing.model.end_sigma_m < 0.5 * still.model.end_sigma_m
    assert changing.model.end_m == pytest.approx(60.0 * UM, abs=3.0 * changing.model.end_sigma_m)


def test_a_temperature_makes_it_surer() -> None:
    touches, grown, _ = touched(np.random.default_rng(4), SPEEDS, 60.0 * UM, 1200.0)
    model = GrowthModel(per_kelvin_m=3.0 * UM)
    warm = replace(touches, warmer_k=grown / (3.0 * UM))
    without, with_it = follow(touches, AXIS, model), follow(warm, AXIS, model)
    assert with_it.growth_sigma_m[-1] < 0.8 * without.growth_sigma_m[-1]
    assert abs(with_it.growth_m[-1] - grown[-1]) < 3.0 * with_it.growth_sigma_m[-1]


def test_a_place_that_was_moved_is_unforeseen() -> None:
    """The target of a tracker knocked by 0.1 mm between two touches: a jump, which the state follows at once."""
    touches = touched(np.random.default_rng(8), SPEEDS, 60.0 * UM, 1200.0)[0]
    moved = touches.deviation_m.copy()
    moved[-3:, 0] += 100.0 * UM
    assert follow(touches, AXIS).holds.all()
    course = follow(replace(touches, deviation_m=moved), AXIS)
    assert course.holds[:-3].all()
    assert not course.holds[-3]
    assert course.jump_m[-3] == pytest.approx(100.0 * UM, abs=3.0 * course.jump_sigma_m[-3])
    assert course.total_m[-1, 0] == pytest.approx(moved[-1, 0], abs=3.0 * course.total_sigma_m[-1, 0])


def warming(rng: np.random.Generator, step_m: float = 0.0, count: int = 16) -> Touches:
    """Spindle and arm that approach their ends by laws of their own, and a step of the place at some touch."""
    time_s: Float = 240.0 * np.arange(count, dtype=np.float64)
    direction, step = rng.standard_normal(3), rng.standard_normal(3)
    grown = rng.uniform(0.0, 60.0) * UM * (1.0 - np.exp(-time_s / rng.uniform(600.0, 3000.0)))
    arm = rng.uniform(0.0, 60.0) * UM * (1.0 - np.exp(-time_s / rng.uniform(1500.0, 7000.0)))
    place = np.outer(grown, AXIS) + np.outer(arm, direction / np.linalg.norm(direction))
    place = place + SIGMA * rng.standard_normal((count, 3))
    place[int(rng.integers(5, count - 2)) :] += step_m * step / np.linalg.norm(step)
    return Touches(
        time_s, place - place[0], np.where(time_s > 0.0, U, 0.0), np.full(count, SIGMA), np.full(count, np.nan)
    )


@pytest.mark.parametrize(("step_um", "least", "most"), [(0.0, 0, 2), (25.0, 24, 40), (40.0, 37, 40)])
def test_jumps_are_found_and_warm_up_is_none(step_um: float, least: int, most: int) -> None:
    """Touches of 4 um. A jump of 25 um is three standard deviations of an expectation, so not every one is seen."""
    rng = np.random.default_rng(3)
    found = sum(bool(np.any(follow(warming(rng, step_um * UM), AXIS).jump_m > 0.0)) for _ in range(40))
    assert least <= found <= most


@pytest.mark.parametrize("seed", [1002, 1003, 1004, 1006])
def test_the_simulated_cell_within_what_is_stated(seed: int) -> None:
    """Spindle and arm that warm up by a law that nothing here knows the constants of; the arm is no random walk."""
    cell = read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")
    truth, q = truth_of(cell, seed, OTHER), corner_of_blank(cell)
    assert truth.other.thermal is not None
    plant, p_base = Plant(truth), []
    time_s: Float = 240.0 * np.arange(16, dtype=np.float64)
    for t in time_s:
        plant.program_time(float(t), 1)
        plant.reset(q)
        p_base.append(plant.p_base_tcp.copy())
    true = (np.array(p_base) - p_base[0]) @ cell.T_base_part[:3, :3]
    assert np.linalg.norm(true[-1]) > 10.0 * UM
    rng = np.random.default_rng(seed)
    noisy = true + SIGMA * rng.standard_normal(true.shape)
    speeds = np.where(time_s > 0.0, U, 0.0)
    course = follow(Touches(time_s, noisy - noisy[0], speeds, np.full(16, SIGMA), np.full(16, np.nan)), AXIS)
    error = course.total_m[1:] - true[1:]
    common = error.mean(axis=0)  # what the first touch itself was off by, which no later one shows
    assert np.sqrt(np.mean((error - common) ** 2)) < SIGMA
    assert np.all(np.abs(common) < 3.0 * SIGMA)
    assert np.mean(np.abs(error) < 3.0 * course.total_sigma_m[1:]) > 0.95
    assert course.holds.all()


ROWS = "time_s,x_mm,y_mm,z_mm,spindle_rpm\n0,0,0,0,0\n600,0,0,-0.02,12000\n1200,0,0,{last},12000\n"


def test_alerts_and_a_model_that_comes_back(tmp_path: Path) -> None:
    file, learnt = tmp_path / "touches.csv", tmp_path / "growth.json"
    file.write_text(ROWS.format(last=-0.03), encoding="utf-8")
    assert ThermalSettings(file, limit_m=100.0 * UM).run(learnt)["alerts"] == []
    file.write_text(ROWS.format(last=-0.2), encoding="utf-8")
    later = ThermalSettings(file, limit_m=100.0 * UM, model=learnt).run()
    assert any("touch the part again" in alert for alert in later["alerts"])
    assert any("jumped before the touch at 20 min" in alert for alert in later["alerts"])
    older = json.loads(learnt.read_text(encoding="utf-8"))
    del older["walk_weights"]
    learnt.write_text(json.dumps({**older, "version": 1}), encoding="utf-8")
    from_older = ThermalSettings(file, limit_m=100.0 * UM, model=learnt).run()
    assert from_older["end_um"] == pytest.approx(later["end_um"], abs=1.0)
    assert [alert[:20] for alert in from_older["alerts"]] == [alert[:20] for alert in later["alerts"]]
    learnt.write_text("{}", encoding="utf-8")
    with pytest.raises(FileFormatError, match="not a model"):
        ThermalSettings(file, model=learnt).run()


@pytest.mark.parametrize("jump_um", [40.0, 68.0])
def test_a_jump_stays_an_alert_after_touches_that_hold(tmp_path: Path, jump_um: float) -> None:
    """The part slips at the sixth touch of the example; five touches later it is an alert still, with its size."""
    lines = (EXAMPLES / "touches.csv").read_text(encoding="utf-8").splitlines()
    head, rows = lines[0], [line.split(",") for line in lines[1:11]]
    for row in rows[5:]:
        row[1] = f"{float(row[1]) + 1e-3 * jump_um:.4f}"
    file = tmp_path / "touches.csv"
    file.write_text("\n".join([head, *(",".join(row) for row in rows)]) + "\n", encoding="utf-8")
    summary = ThermalSettings(file, limit_m=1000.0 * UM).run()
    (alert,) = summary["alerts"]
    assert "jumped before the touch at 20 min" in alert
    assert "begin a new file" in alert
    assert summary["touches"][5]["jump_um"] == pytest.approx(jump_um, abs=15.0)
    assert summary["touches"][-1]["holds"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "other columns"),
        ("time_s,x_mm\n0,0\n1,0\n", "other columns"),
        ("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n", ">= 2"),
        ("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0,0,0,0\n", "do not rise"),
        ("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n1,0,0\n", "another length"),
        ("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n1,0,0,high\n", "z_mm is no number"),
        ("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n1,0,nan,0\n", "y_mm is not finite"),
        ("time_s,x_mm,y_mm,z_mm,sigma_um\n0,0,0,0,1\n1,0,0,0,-1\n", "uncertainty"),
    ],
)
def test_bad_files_are_one_clear_line(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "touches.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises((FileFormatError, InputError), match=says):
        read_touches(file)
