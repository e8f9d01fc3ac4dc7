"""The tracker in the loop over sockets, on a small circle: worse without, better with; and the figures themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.lowest_mode import lowest_mode
from counterflex.core.arrays import Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex_lab.reproduce import closed_loop, mandiola as reproduce_mandiola, mandiola_report, tracking
from counterflex_lab.reproduce.mandiola_case import write_case


def contour_error(p: Float, corners: Float, near: Int) -> Float:
    """Distance (n,) m of each point from a polyline: from its :func:`tracking.nearest_on_polyline`, same arguments."""
    out: Float = np.linalg.norm(p - tracking.nearest_on_polyline(p, corners, near), axis=1)
    return out


def circle_error(p: Float, radius_m: float) -> Float:
    """Distance (n,) m of points (n, 3) m from a circle about the origin in the plane z = 0."""
    points, radius = as_float("p", p, (None, 3)), as_positive("radius_m", radius_m)
    out: Float = np.hypot(np.hypot(points[:, 0], points[:, 1]) - radius, points[:, 2])
    return out


def test_the_designed_controller_against_the_published_gain_pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Same truth, same path; each runs over sockets. Then the same again is not run again."""
    case = write_case(tmp_path / "case", 1, scale=0.03)
    tasks = [reproduce_mandiola.task_of(case, "square", name) for name in ("published", "designed")]
    results = run_tasks([reproduce_mandiola.plan_of(case, "square"), *tasks], 1, silent)
    found = {task.name.rpartition(" ")[2]: results[task.name] for task in tasks}
    for item in found.values():
        assert item["loop"]["states"]["active"] > 1500
        assert "fault" not in item["loop"]["states"]
        assert "hold" not in item["loop"]["states"]
    published, designed = (found[name]["figures"] for name in ("published", "designed"))
    assert published["corners"]["total"]["max_um"] > 1000.0
    assert designed["corners"]["total"]["max_um"] < 0.45 * published["corners"]["total"]["max_um"]
    assert designed["corners"]["contour"]["rms_um"] < 0.4 * published["corners"]["contour"]["rms_um"]
    monkeypatch.delattr(closed_loop, "run")
    again = run_tasks([reproduce_mandiola.plan_of(case, "square"), *tasks], 1, silent)
    assert again == results


def test_margins_are_those_of_the_published_loop(tmp_path: Path) -> None:
    case = write_case(tmp_path, 0, scale=0.05)
    published, designed, observer = mandiola_report.margin_table(mandiola_report.open_loops(case.cell("designed")))
    assert published["phase_margin_deg"] == pytest.approx(75.0, abs=3.0)
    assert 22.0 <= published["gain_margin_db"] <= 27.0
    assert designed["phase_margin_deg"] >= 50.0
    assert designed["gain_margin_db"] >= 10.0
    assert designed["sensitivity"] <= 1.6
    assert designed["crossover_hz"] > 3.0 * published["crossover_hz"]
    assert observer["controller"] == "observer"
    cell = read_cell(case.cell("designed"))
    assert cell.tables.dynamics.mode is None
    assert designed["mode_hz"] == pytest.approx(lowest_mode(cell).hz, abs=1e-3)


def test_no_seeds_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="seeds"):
        reproduce_mandiola.Paths(tmp_path, seeds=())


def test_contour_and_total_error_of_a_known_path() -> None:
    """A tool 0.1 mm beside its path and 1 mm late: contour is the one, total is both."""
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0]])
    s = np.linspace(0.0, 0.2, 2001)
    command = np.stack([np.minimum(s, 0.1), np.maximum(s - 0.1, 0.0), np.zeros_like(s)], axis=1)
    late = np.maximum(s - 1e-3, 0.0)
    actual = np.stack([np.minimum(late, 0.1), np.maximum(late - 0.1, 0.0), np.full_like(s, 1e-4)], axis=1)
    run = tracking.Tracked(s / 0.0117, command, actual, np.zeros_like(command), np.zeros((len(s), 6)))
    near = tracking.segment_of(command, corners)
    contour = contour_error(actual, corners, near)
    np.testing.assert_allclose(contour, 1e-4, rtol=1e-9)
    straight, corner = tracking.corner_zones(run, corners, 0.01)
    found = tracking.spread(run.total, straight)
    assert found.largest == pytest.approx(np.hypot(1e-3, 1e-4), rel=1e-9)
    assert found.rms == pytest.approx(found.largest, rel=1e-9)
    assert not np.any(straight & corner)
    assert np.sum(corner) == pytest.approx(200, abs=2)


def test_circle_error_and_its_turn() -> None:
    angle = np.linspace(0.0, 2.2 * np.pi, 5000)
    command = 0.15 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    actual = command * (1.0 + 1e-3)
    run = tracking.Tracked(angle, command, actual, np.zeros_like(command), np.sin(angle)[:, None] * np.ones(6))
    turn = tracking.turn_zone(run, 0.1 * np.pi)
    gone = angle[turn]
    assert gone[-1] - gone[0] == pytest.approx(2.0 * np.pi, abs=0.01)
    np.testing.assert_allclose(circle_error(actual, 0.15), 1.5e-4, rtol=1e-9)
    after = tracking.reversal_zone(run, turn, 0.2)
    np.testing.assert_allclose(np.unique(np.round(angle[after] / np.pi - 0.5)), [0.0, 1.0])


def test_spread_is_of_values_that_were_met() -> None:
    found = tracking.spread(np.array([3.0, -4.0]), np.array([True, True]))
    assert found.rms == pytest.approx(np.sqrt(12.5))
    assert (found.p997, found.largest) == (4.0, 4.0)
    with pytest.raises(InputError, match="no sample"):
        tracking.spread(np.zeros(2), np.zeros(2, dtype=bool))
