"""Runs that have ended: figures from their logs, trends over runs of a program, two runs on one page."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import stats

from counterflex.app.panel.figures import FeedFrame
from counterflex.app.run_history.history import history, log_folders
from counterflex.app.run_history.logged_run import RunOfHistory, _share, read_runs
from counterflex.app.run_history.pages import compare, page
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.records import records
from counterflex.evaluate.run_curves import LEAST_RUNS, curves_of, needed_of, trend
from counterflex.protocols.processes.snapshot_layout import SNAPSHOT
from counterflex.runtime.record_ring import column
from straight_cut_log import rows_of, write


def test_figures_count_across_the_feed_and_along_the_tool_only(tmp_path: Path) -> None:
    (one,) = read_runs(write(tmp_path / "log", rows_of()))
    row = one.row
    assert (row["predicted_um"], row["corrected_um"], row["remaining_um"]) == (100.0, 80.0, 20.0)
    assert (row["measured_um"], row["share_percent"]) == (None, None)
    assert (row["force_peak_n"], row["force_ratio"], row["incidents"]) == (200.0, 1.0, 1)
    assert row["mean_correction_um"] == [-80.0, 0.0]
    assert row["begun"] == "2027-01-15T08:00:01+00:00"
    assert row["reply_us"] == {"p50": 100.0, "p99": 100.0, "p99.9": 100.0, "max": 100.0}
    assert one.actions[0]["time_s"] == 0.5


def test_of_a_compensated_program_without_its_plan_only_what_is_missed_is_known(tmp_path: Path) -> None:
    (one,) = read_runs(write(tmp_path / "log", rows_of(), plan=True))
    assert (one.row["predicted_um"], one.row["corrected_um"], one.row["remaining_um"]) == (None, None, 20.0)


def test_directions_are_those_of_the_panel_on_a_circle() -> None:
    """The panel follows the feed cycle by cycle; here all cycles at once."""
    angle = np.linspace(0.0, 2.0 * np.pi, 1000)
    rows = rows_of().repeat(2, axis=0)[:1000]
    rows[:, column("received_ns")] = 4e6 * np.arange(1000)
    rows[:, column("nominal_x")], rows[:, column("nominal_y")] = 0.05 * np.cos(angle), 0.05 * np.sin(angle)
    shots = records(SNAPSHOT, 1000)
    shots["received_ns"] = rows[:, column("received_ns")]
    first = column("nominal_R00")
    shots["nominal"] = rows[:, first : first + 12]
    theirs = FeedFrame().rows(shots)[:, 1:]
    ours = curves_of([needed_of(rows)], planned=False).sides
    inside = slice(20, -20)  # at the ends the direction is taken from one side
    assert np.allclose(ours[inside], theirs[inside], atol=0.01)  # they look back one cycle: 3 mrad
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert np.allclose(ours[inside, 0, :2], -outward[inside], atol=1e-6)  # left of a way against the clock: inwards


@given(st.lists(st.floats(0.0, 2.0), min_size=1), st.floats(2.0, 9.0))
def test_the_share_of_a_path_is_what_was_reached_wherever_the_run_ended(places: list[float], length: float) -> None:
    """A tool that goes back, or a loop that follows nothing any more, takes nothing away."""
    curves: Any = SimpleNamespace(length_m=np.array(places))
    most = max(places)
    assert _share(curves, length) == (pytest.approx(100.0 * most / length, abs=0.0051) if most > 0.0 else None)


def test_a_trend_is_the_line_and_the_interval_of_scipy() -> None:
    values = [3.0, 3.4, 3.1, 3.9, 4.0, 4.6]
    line = stats.linregress(range(6), values)
    one = trend(values)
    assert one is not None
    assert one.slope == pytest.approx(line.slope, rel=1e-12)
    assert one.half_width == pytest.approx(line.stderr * stats.t.ppf(0.975, 4), rel=1e-9)
    assert one.clear == (line.pvalue < 0.05)
    assert trend([1.0, None, 2.0, float("nan")] + [3.0] * (LEAST_RUNS - 3)) is None


def test_history_finds_runs_below_a_folder_and_tells_wear_from_scatter(tmp_path: Path) -> None:
    scatter = np.random.default_rng(1).normal(0.0, 1e-6, 6)
    for k in range(6):
        rows = rows_of(ratio=1.0 + 0.03 * k + 0.002 * (k % 2), sent_m=-8e-5 + scatter[k])
        write(tmp_path / "logs" / f"run{5 - k}", rows, begun_s=600.0 * k)
    write(tmp_path / "logs" / "other", rows_of(), begun_s=1e4, program="b" * 64)
    (tmp_path / "logs" / "broken").mkdir()
    (tmp_path / "logs" / "broken" / "run-000.mcap").write_bytes(b"nothing")
    summary = history(tmp_path / "logs", tmp_path / "out")
    assert [Path(row["folder"]).name for row in summary["runs"][:2]] == ["run5", "run4"]
    assert [len(one["runs"]) for one in summary["programs"]] == [6, 1]
    trends = {one["figure"]: one for one in summary["programs"][0]["trends"]}
    assert trends["force_ratio"]["clear"]
    assert trends["force_ratio"]["slope_per_run"] == pytest.approx(0.03, abs=0.001)
    assert not trends["correction_across"]["clear"]
    assert [Path(one["folder"]).name for one in summary["unreadable"]] == ["broken"]
    assert summary["incomplete"]
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "groove.ngc: 6 runs" in text
    assert "https://" not in text.replace("https://plotly", "").split("<script>")[0]
    with pytest.raises(FileFormatError, match="no run log"):
        log_folders(tmp_path / "out")


def test_two_runs_beside_each_other_and_one_again(tmp_path: Path) -> None:
    first = write(tmp_path / "first", rows_of())
    second = write(tmp_path / "second", rows_of(bend_m=2e-4, force_n=300.0))
    summary = compare(first, second, tmp_path / "out")
    assert summary["same_program"]
    assert summary["figures"]["remaining_um"] == {"first": 20.0, "second": 120.0, "difference": 100.0}
    assert summary["figures"]["force_peak_n"]["difference"] == 100.0
    assert summary["figures"]["measured_um"]["difference"] is None
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert '"name":"second run 0: remaining (model)"' in text
    again = page(first, tmp_path / "again", 0)
    assert json.loads((tmp_path / "again" / "summary.json").read_text(encoding="utf-8"))["remaining_um"] == 20.0
    assert (again["incidents_by_number"][0]["cause"], again["operator_actions"][0]["who"]) == ("operator", "anna")
    text = (tmp_path / "again" / "report.html").read_text(encoding="utf-8")
    assert "<h1>groove.ngc</h1>" in text
    assert "um remain by the model" in text
    curves = json.loads(text.split('id="figures">')[1].split("</script>")[0])["curves"]["data"]
    colour_of = {one["name"]: one["line"]["color"] for one in curves}
    assert len(set(colour_of.values())) == len(colour_of) > 3
    with pytest.raises(InputError, match="the same run"):
        compare(first, first, tmp_path / "no")
    with pytest.raises(InputError, match="no run of this number"):
        RunOfHistory.of(first, 7)
    assert not (tmp_path / "no").exists()


def test_runs_of_one_folder_are_told_apart(tmp_path: Path) -> None:
    folder = write(write(tmp_path / "log", rows_of()), rows_of(bend_m=2e-4), begun_s=60.0)
    assert [one.row["run"] for one in read_runs(folder)] == [0, 1]
    summary = compare(folder, folder, tmp_path / "out", (0, 1))
    assert summary["figures"]["predicted_um"]["difference"] == 100.0
