"""What `run` says of how it ended, in words and by its exit status."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import counterflex
from counterflex.app import doctor
from counterflex.app.run import run as online
from counterflex.app.run.end import End, RunEnd, ended_how
from counterflex.app.run.status import Status
from counterflex.cli.main import whole
from counterflex.core.arrays import Float
from counterflex.runtime.record_ring import WIDTH, column
from counterflex.runtime.state.supervisor import Cause, State

DEMO = Path(counterflex.__file__).parent / "app" / "demo"


def summary(ended: str, by: str = "never", cause: str = "none", lost: int = 0) -> dict[str, Any]:
    return {
        "cycles": 10,
        "seconds": 0.1,
        "largest_correction_um": 0.0,
        "compute_us": {"p50": 1.0, "p99": 2.0},
        "records_lost": lost,
        "states": {"idle": 10},
        "causes": [],
        "events": [],
        "wear": None,
        "slowed_share": 0.0,
        "loop_ended": ended,
        "correction_ended": {"by": by, "cause": cause},
        "log_trouble": "",
        "recorder_died": False,
        "compared": {"frame_offset_mm": None, "missing_most_mm": None},
        "another_port": False,
    }


ENDS = [
    ("as asked", "program", "program", 0, End.PLANNED, ""),
    ("as asked", "never", "none", 0, End.NEVER_ARMED, "never armed"),
    ("as asked", "armed", "none", 0, End.NEVER_ARMED, "never switched the correction on"),
    ("as asked", "fault", "telegrams_stopped", 0, End.FAULT, "a fault ended the correction: telegrams stopped"),
    ("as asked", "hold", "force_stale", 3, End.FAULT, "ended, not by the program: force stale"),
    ("as asked", "acting", "none", 0, End.FAULT, "the robot fell silent"),
    ("as asked", "program", "program", 7, End.LOG_LOST, "7 records are missing"),
    ("as asked", "operator", "operator", 0, End.STOPPED, "before the program ended it"),
    ("died (1)", "acting", "none", 0, End.DIED, "the loop died (1)"),
]


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize(("ended", "by", "cause", "lost", "end", "words"), ENDS)
def test_the_exit_status_tells_how_it_ended(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ended: str,
    by: str,
    cause: str,
    lost: int,
    end: End,
    words: str,
    as_json: bool,
) -> None:
    found = summary(ended, by, cause, lost)
    found["ended"] = ended_how(found, arm=True)
    monkeypatch.setattr(online, "run", lambda *_, **__: found)
    monkeypatch.setattr(doctor, "require_fit", lambda: None)
    line = ["run", "--arm", "--cell", DEMO / "cell.toml", "--rsi", DEMO / "rsi.xml", "--out", tmp_path / "log"]
    result = CliRunner().invoke(whole(), [str(word) for word in [*line, *(["--json"] if as_json else [])]])
    assert result.exit_code == end, result.output
    assert words in result.output


def test_a_loop_that_only_watches_is_never_armed_on_purpose() -> None:
    assert ended_how(summary("as asked"), arm=False)["status"] == 0


def rows(*states: tuple[State, Cause]) -> Float:
    out = np.zeros((len(states), WIDTH))
    for row, (state, cause) in zip(out, states, strict=True):
        row[column("out_state")], row[column("out_cause")] = state, cause
    return out


@pytest.mark.parametrize("asked", [Cause.OPERATOR, Cause.FORCE_STALE])
@pytest.mark.parametrize("holds_feed", [False, True])
def test_a_stop_that_cannot_hold_the_feed_is_the_operators_end(asked: Cause, holds_feed: bool) -> None:
    """A link that has no feed hold (EGM path correction) stops a robot that goes on: no fault, if asked for."""
    end = RunEnd()
    end.add(rows((State.ARMED, Cause.NONE), (State.ACTIVE, Cause.NONE), (State.HOLD, asked)))
    end.add(rows((State.HOLD, asked), (State.FAULT, Cause.HELD_TOO_LONG), (State.FAULT, Cause.HELD_TOO_LONG)))
    found = summary("as asked") | {"correction_ended": end.shown(), "holds_feed": holds_feed}
    told = ended_how(found, arm=True)
    stopped = asked == Cause.OPERATOR and not holds_feed
    assert told["status"] == (End.STOPPED if stopped else End.FAULT)
    assert told["wrong"] is not stopped
    assert ("was stopped" if stopped else f"held too long, for {asked.name.lower().replace('_', ' ')}") in told["said"]


def test_telegrams_that_cannot_be_read_are_not_none() -> None:
    """It said that no telegram came, of a robot that sent hundreds."""
    nothing = summary("as asked") | {"cycles": 0}
    assert "no telegram came" in ended_how(nothing, arm=True)["said"]
    told = ended_how(nothing | {"malformed": 82}, arm=True)
    assert (told["status"], "none of 82 telegrams could be read" in told["said"]) == (End.NEVER_ARMED, True)


def test_what_ended_the_correction_last_counts() -> None:
    end = RunEnd()
    end.add(rows((State.READY, Cause.NONE), (State.ARMED, Cause.NONE), (State.ACTIVE, Cause.NONE)))
    assert end.shown()["by"] == "acting"
    end.add(rows((State.HOLD, Cause.CLOCK), (State.ACTIVE, Cause.NONE), (State.FAULT, Cause.WRONG_FRAME)))
    assert end.shown() == {"by": "fault", "cause": "wrong_frame"}
    end.add(rows((State.IDLE, Cause.NONE), (State.READY, Cause.NONE), (State.ARMED, Cause.NONE)))
    end.add(rows((State.ACTIVE, Cause.NONE), (State.RAMP_OUT, Cause.PROGRAM), (State.READY, Cause.PROGRAM)))
    end.add(rows((State.FAULT, Cause.TELEGRAMS_STOPPED)))  # the robot has ended its session: after the program
    assert end.shown()["by"] == "program"
    end.add(rows((State.IDLE, Cause.NONE), (State.READY, Cause.NONE), (State.ARMED, Cause.NONE)))
    assert end.shown()["by"] == "armed"  # armed anew, and never switched on: not as planned
    end.add(rows((State.FAULT, Cause.WRONG_FRAME)))
    assert end.shown() == {"by": "fault", "cause": "wrong_frame"}


DANGERS: dict[str, tuple[dict[str, Any], str]] = {
    "feed": ({"feed_hold": True}, "feed held"),
    "log": (
        {"log_trouble": "No space left on device", "records_lost": 7},
        "LOGGING STOPPED: No space left on device, 7 rec",
    ),
    "lost": ({"records_lost": 7}, "LOGGING STOPPED: it goes on, 7 records lost"),
    "still": ({"still_s": 2.0}, "THE LOOP STANDS STILL: no sign of life for 2.0 s; stop the robot"),
    "tracker": ({"tracker_off": "3.4 mm off, limit 2 mm"}, "NOT READY: 3.4 mm off, limit 2 mm"),
    "zero": ({"tares": 2, "idle_n": 30.0}, "TARE FAILED: 30.0 N"),
    "trouble": ({"trouble": "a kernel"}, "INTERNAL: a kernel"),
    "foreign": ({"foreign": 9}, "UNKNOWN SENDER: 9"),
    "malformed": ({"malformed": 8}, "UNREADABLE TELEGRAMS: 8"),
    "rejected": ({"rejected": 4}, "4 tracker samples rejected"),
    "set back": ({"set_back": 3}, "tracker's clock set back, 3 times"),
    "force stepped": ({"degraded": Cause.FORCE_OFFSET}, "FORCE STEPPED: look for another zero of the sensor"),
    "force differs": ({"degraded": Cause.FORCE_DIFFERS}, "deeper stock or harder material; or the sensor's zero"),
}


@pytest.mark.by_turn
@pytest.mark.parametrize("name", DANGERS)
def test_the_status_line_says_every_danger(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """What nobody reads in the line nobody knows while it cuts; without it the line is silent."""
    shown, said = DANGERS[name]
    plain = Status(State.ACTIVE, Cause.NONE, 100, (0.0, 0.0, 0.0), 100.0, "")

    def lines(status: Status) -> str:
        def run(*_: Any, watch: Callable[[Status], None], **__: Any) -> dict[str, Any]:
            watch(status)
            return summary("as asked", "program") | {"ended": {"wrong": False, "status": 0, "said": ""}}

        monkeypatch.setattr(online, "run", run)
        words = ["run", "--cell", "cell.toml", "--egm", "6510", "--out", "log", "--json"]
        return CliRunner().invoke(whole(), words).output

    assert said in lines(replace(plain, **shown))
    assert said not in lines(plain)
