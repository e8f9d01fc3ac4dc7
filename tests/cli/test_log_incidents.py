"""Holds and faults of a run log as a user finds and exports them, across segments, runs and missing records."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.incidents import MOST_INCIDENTS, IncidentFinder
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segment import headings, unit_of
from counterflex.runtime import record_ring as record
from counterflex.runtime.record_ring import COLUMNS, WIDTH
from counterflex.runtime.state.supervisor import Cause, State

HOLD, FAULT = 700, 1100


def synthetic(n: int = 1500, seed: int = 1) -> Float:
    """Records of a run that holds at HOLD for 100 cycles, corrects again, and has a fault at FAULT."""
    rows = np.random.default_rng(seed).standard_normal((n, WIDTH)) * 1e-4
    k = np.arange(1, n + 1)
    for i, name in enumerate(COLUMNS):
        if record.is_whole(name):
            rows[:, i] = 0.0
    rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = 4 * k, 4e6 * k, 4e6 * k + 2e4, 1
    rows[:, record.CYCLE] = k
    rows[:, COLUMNS.index("path_distance")] = 1e-5 * k
    rows[FAULT - 1 : FAULT, 3] = 4
    state = np.full(n, float(State.ACTIVE))
    cause = np.zeros(n)
    state[HOLD - 1 : HOLD + 99], cause[HOLD - 1 : HOLD + 99] = State.HOLD, Cause.FORCE_SATURATED
    state[FAULT - 1 :], cause[FAULT - 1 :] = State.FAULT, Cause.LIMIT_HARD
    rows[:, record.column("out_state")], rows[:, record.column("out_cause")] = state, cause
    return rows


def write(folder: Path, rows: Float) -> None:
    log = RunLogWriter(folder, {})
    for k in range(0, len(rows), 25):
        log.add(rows[k : k + 25], 0.1 * (k + 1))
    log.close()


@pytest.fixture
def rotated(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Float:
    """A folder ``log`` whose segments end every few cycles, so that the window of an incident spans several."""
    rows = synthetic()
    with monkeypatch.context() as patch:
        patch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 200_000)
        write(folder / "log", rows)
    assert len(list((folder / "log").glob("run-*.mcap"))) > 5
    return rows


def test_show_lists_each_hold_and_fault(folder: Path, rotated: Float, counterflex: Any) -> None:
    run = json.loads(counterflex("log", "show", "log", "--json").out)["runs"][0]
    assert run["incidents_total"] == 2
    assert run["incidents"] == [
        {
            "number": 1,
            "cycle": HOLD,
            "time_s": pytest.approx((HOLD - 1) * 4e-3, abs=1e-3),
            "state": "hold",
            "cause": "force_saturated",
            "before": "active",
            "path_distance_mm": pytest.approx(1e-2 * HOLD),
            "cycles_since_telegram": 1,
        },
        {
            "number": 2,
            "cycle": FAULT,
            "time_s": pytest.approx((FAULT - 1) * 4e-3, abs=1e-3),
            "state": "fault",
            "cause": "limit_hard",
            "before": "active",
            "path_distance_mm": pytest.approx(1e-2 * FAULT),
            "cycles_since_telegram": 4,
        },
    ]
    said = counterflex("log", "show", "log").out
    for word in ("Incidents", "force saturated", "limit hard", str(HOLD), str(FAULT)):
        assert word in said


@pytest.mark.parametrize(("number", "first", "cause"), [(1, HOLD, "force_saturated"), (2, FAULT, "limit_hard")])
def test_an_incident_with_the_250_cycles_before_it_across_segments(
    folder: Path, rotated: Float, counterflex: Any, number: int, first: int, cause: str
) -> None:
    ended = counterflex("log", "export", "log", "--incident", str(number), "--csv", "one.csv")
    assert (ended.status, ended.err) == (0, "")
    assert f"501 cycles around the {'hold' if number == 1 else 'fault'} of cycle {first}" in ended.out
    table = polars.read_csv(folder / "one.csv", infer_schema_length=None)
    assert table.columns[4:] == headings()
    np.testing.assert_array_equal(table[:, 4:].cast(polars.Float64).to_numpy(), rotated[first - 1 - 250 : first + 250])
    begin = table.filter(polars.col("from_incident [cycles]") == 0)
    assert begin["cause"].to_list() == [cause]
    assert begin["from_incident [s]"].to_list() == [0.0]
    assert table["from_incident [s]"].min() == pytest.approx(-1.0)
    before = table.filter(polars.col("from_incident [cycles]") < 0)
    assert len(before) == 250
    assert before["state"].unique().to_list() == ["active"]


def test_fewer_cycles_and_those_at_the_end_of_the_run(folder: Path, counterflex: Any) -> None:
    write(folder / "log", synthetic(FAULT + 3))
    ended = counterflex("log", "export", "log", "--incident", "2", "--csv", "a.csv", "--before", "5")
    assert ended.status == 0
    table = polars.read_csv(folder / "a.csv", infer_schema_length=None)
    assert table["cycle"].to_list() == list(range(FAULT - 5, FAULT + 4))


def test_missing_records_are_said(folder: Path, counterflex: Any) -> None:
    write(folder / "log", np.delete(synthetic(), np.arange(HOLD - 41, HOLD + 19), axis=0))
    found = json.loads(counterflex("log", "show", "log", "--json").out)["runs"][0]["incidents"][0]
    assert found["cycle"] == HOLD + 20  # the first that there is a record of
    ended = counterflex("log", "export", "log", "--incident", "1", "--csv", "a.csv")
    assert "60 cycles in between have no record" in ended.out


def test_numbers_go_on_over_the_runs_of_a_folder(folder: Path, counterflex: Any) -> None:
    first, second = synthetic(), synthetic(seed=2)
    write(folder / "log", first)
    write(folder / "log", second)
    runs = json.loads(counterflex("log", "show", "log", "--json").out)["runs"]
    assert [[one["number"] for one in run["incidents"]] for run in runs] == [[1, 2], [3, 4]]
    assert counterflex("log", "export", "log", "--incident", "3", "--csv", "b.csv").status == 0
    table = polars.read_csv(folder / "b.csv", infer_schema_length=None)
    np.testing.assert_array_equal(table[:, 4:].cast(polars.Float64).to_numpy(), second[HOLD - 251 : HOLD + 250])


def test_no_such_incident_in_one_line(folder: Path, rotated: Float, refused: Any) -> None:
    said = refused("log", "export", "log", "--incident", "3", "--csv", "c.csv")
    assert "no incident of this number" in said
    assert "1 to 2" in said
    write(folder / "calm", synthetic(HOLD - 1))
    assert "no hold and no fault" in refused("log", "export", "calm", "--incident", "1", "--csv", "c.csv")
    assert not (folder / "c.csv").exists()


def test_the_same_incidents_however_the_records_come() -> None:
    rows = synthetic()
    whole, pieces = IncidentFinder(), IncidentFinder()
    whole.add(rows)
    for k in range(0, len(rows), 7):
        pieces.add(rows[k : k + 7])
    assert whole.incidents == pieces.incidents
    late = IncidentFinder()
    late.add(rows[HOLD + 10 :])
    assert [(one.cycle, one.before) for one in late.incidents] == [(HOLD + 11, None), (FAULT, State.ACTIVE)]


def test_a_loop_that_flutters_is_counted_to_the_end() -> None:
    rows = synthetic(100)
    rows[:, record.column("out_state")] = np.where(np.arange(100) % 2, State.HOLD, State.ACTIVE)
    finder = IncidentFinder()
    for _ in range(MOST_INCIDENTS // 50 + 1):
        finder.add(rows)
    assert (len(finder.incidents), finder.total) == (MOST_INCIDENTS, MOST_INCIDENTS + 50)


def test_records_that_are_none_are_refused() -> None:
    rows = synthetic(10)
    with pytest.raises(InputError, match="shape"):
        IncidentFinder().add(rows[:, :5])
    rows[4, record.column("out_state")] = 99.0
    with pytest.raises(InputError, match="state"):
        IncidentFinder().add(rows)
    rows[4, record.column("out_state")], rows[4, record.column("out_cause")] = State.FAULT, 99.0
    with pytest.raises(InputError, match="cause"):
        IncidentFinder().add(rows)


def test_every_length_force_and_angle_has_a_unit() -> None:
    without = {name for name in COLUMNS if not unit_of(name) and not record.is_whole(name)}
    ratios = ("fast_", "factor_", "model_", "value_", "limit_", "speed_", "surprise_")
    assert {name for name in without if "_R" not in name and not name.startswith(ratios)} == {
        "sigma",
        "cutting",
        "force_ratio",
        "wear_rise",
        "wear_degrees",
    }
    assert (unit_of("correction_x"), unit_of("correction_rx"), unit_of("sensor_mx")) == ("m", "rad", "N m")
