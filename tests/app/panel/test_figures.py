"""What a panel shows: units, directions, signs against hand-made snapshots; a run that comes, goes and is lost."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from counterflex.app.panel import watched_run
from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.panel.figures import FeedFrame, Figures, Trail, cause_words, deviations
from counterflex.app.panel.page import report_html
from counterflex.app.panel.watched_run import Seen, WatchedRun
from counterflex.core.errors import OutputError
from counterflex.core.records import Records
from counterflex.geometry import pose
from counterflex.integrations.kuka.simulated import RsiContext
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.control_array import CONTROL, Life, Panel, Request
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.processes.snapshot import SnapshotMemory
from counterflex.protocols.processes.snapshot_layout import SNAPSHOT
from counterflex.robot.elasticity.chain import forward
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.state.states import Cause, State
from counterflex_lab.faults.rig import Rig

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
ABOUT: dict[str, Any] = {
    "limits": {"correction_m": 2e-3, "correction_rad": 5e-3},
    "sources": {"force": True, "tracker": True},
    "planned": True,
    "period_s": 0.004,
    "wall_minus_monotonic_ns": 0,
}


def moving(count: int, feed: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Records:
    """Snapshots of a tool that points down and moves at 25 mm/s, in a cut."""
    shots = np.zeros(count, SNAPSHOT)
    down = np.diag([1.0, -1.0, -1.0])
    shots["nominal"][:, :9] = down.reshape(-1)
    shots["nominal"][:, 9:] = 1e-4 * np.arange(count)[:, None] * np.array(feed)
    shots["received_ns"] = 4_000_000 * (1 + np.arange(count))
    shots["cuts"] = 1
    return shots.view(np.dtype((np.record, SNAPSHOT)))


@pytest.mark.parametrize(("feed", "left"), [((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0))])
def test_across_is_to_the_left_of_the_feed_seen_from_the_spindle(
    feed: tuple[float, float, float], left: tuple[float, float, float]
) -> None:
    rows = FeedFrame().rows(moving(20, feed))[-1]
    assert np.allclose(rows, [feed, left, (0.0, 0.0, -1.0)])


def test_a_tool_that_stands_keeps_its_last_direction() -> None:
    frame, shots = FeedFrame(), moving(20, (0.0, 1.0, 0.0))
    frame.rows(shots)
    still = moving(300, (0.0, 0.0, 0.0))
    still["nominal"][:, 9:] = shots["nominal"][-1, 9:]
    still["received_ns"] += shots["received_ns"][-1]
    assert np.allclose(frame.rows(still)[-1, 0], [0.0, 1.0, 0.0])


def test_what_remains_is_what_the_force_bends_less_what_is_corrected() -> None:
    """docs/conventions.md: a correction opposes the deflection; remaining is their sum, across the feed, in um.

    The program takes back 100 um that the plan predicted; the loop computes by what that is missed.
    """
    shots = moving(12)
    shots["deflection"][:, 1] = 200e-6
    shots["contained"][:, 1] = -100e-6
    shots["in_effect"][:, 1] = -150e-6
    shots["in_effect"][:, 2] = -20e-6
    shots["deviation"][5, 1] = 60e-6
    shots["correction"][:, :3] = [0.0, -3e-4, 4e-4]
    shots["force"], shots["expected"] = (100.0, 200.0, -30.0), (90.0, 210.0, -20.0)
    shots["share"], shots["speed"] = 0.25, 1.0
    made = Figures(ABOUT)
    seen = made.of(shots, 0, 0)
    assert (seen["predicted_um"], seen["corrected_um"]) == ([300.0, 0.0], [-250.0, 20.0])
    assert (seen["remaining_um"], seen["measured_um"]) == ([50.0, 20.0], [60.0, 0.0])
    assert (seen["correction_um"], seen["limit_um"], seen["share"]) == (500.0, 2000.0, 25.0)
    assert (seen["force_n"], seen["planned_n"]) == ([100.0, 200.0, -30.0], [90.0, 210.0, -20.0])
    assert seen["rate_hz"] == 250.0
    assert np.allclose(deviations(shots)["remaining"][0], [0.0, 50e-6, -20e-6])
    json.dumps(seen, allow_nan=False)


def test_what_is_not_known_is_nothing_and_never_a_number_that_no_browser_reads() -> None:
    shots = moving(1)
    shots["force_ns"] = shots["tracker_ns"] = shots["peer"] = -1
    shots["share"], shots["force"], shots["cause"] = -1.0, np.nan, 999
    seen = Figures({**ABOUT, "planned": False, "sources": {"tracker": False}}).of(shots, 10, 0)
    assert (seen["share"], seen["force_n"], seen["planned_n"], seen["measured_um"]) == (None, None, None, None)
    assert (seen["peer"], seen["ages_ms"], seen["cause"]) == ("", {"robot": None}, "cause 999")
    json.dumps(seen, allow_nan=False)
    assert cause_words(Cause.FORCE_STALE) == "force stale"


def test_events_are_shares_of_their_limits() -> None:
    shots = moving(1)
    shots["value"][:, Event.OVERLOAD], shots["limit"][:, Event.OVERLOAD] = 900.0, 600.0
    shots["events"] = 1 << Event.OVERLOAD
    events = {one["event"]: one for one in Figures(ABOUT).of(shots, 0, 0)["events"]}
    assert events["overload"] == {"event": "overload", "on": True, "watched": True, "share": 1.5}
    assert events["chatter"] == {"event": "chatter", "on": False, "watched": False, "share": None}


def test_the_trail_is_what_was_cut_and_never_grows_without_end() -> None:
    shots = moving(2000)
    shots["deflection"][:, 1] = 80e-6
    shots["cuts"][1000:1100] = 0
    frames = FeedFrame().rows(shots)
    trail = Trail()
    trail.add(shots, frames, planned=True)
    points = trail.after(0)
    steps = np.linalg.norm(np.diff(np.array(points)[:, :3], axis=0), axis=1)
    assert len(points) == len(trail)
    assert np.all(np.delete(steps, np.argmax(steps)) < 0.61)
    assert np.all(steps > 0.49)
    assert [point[4] for point in points].count(1.0) == 2  # two cuts
    assert {point[3] for point in points[5:]} == {80.0}
    assert points[0][5:] == [0.0, 0.0, -1.0]
    assert trail.after(len(trail)) == []
    short = Trail(most=100)
    short.add(shots, frames, planned=True)
    assert len(short) <= 200
    assert short.generation == 1


def test_frames_of_the_cell_are_those_of_its_kinematics() -> None:
    scene = CellScene(EXAMPLE)
    q = np.radians([10.0, -80.0, 100.0, 5.0, 40.0, -20.0])
    frames = scene.frames(q)
    tcp = frames["tcp"]
    T = pose.make(np.array(tcp[:9]).reshape(3, 3), np.array(tcp[9:]))
    assert np.allclose(T, forward(scene._chain, q), atol=2e-5)
    names = {body["name"] for body in scene.bodies}
    assert {"foot", "forearm", "spindle", "tool T1", "stock", "table"} <= names
    assert {body["frame"] for body in scene.bodies} <= set(frames)


class Live:
    """A loop on the virtual clock whose run lies in a folder as that of ``run`` does."""

    def __init__(self, folder: Path) -> None:
        self.words = SharedWords(CONTROL)
        control = np.frombuffer(self.words.words, dtype=np.int64)
        self.rig = Rig(force=lambda _: np.array([0.0, 450.0, 0.0]), context=RsiContext(), control=control)
        self.rig.control = control
        self.memory = SnapshotMemory(self.words.path)
        self.actions = Actions(actions_path(self.words.path), make=True)
        control[Life.MAY_ARM] = 1
        about = {**ABOUT, "planned": False, "sources": {"force": True, "tracker": False}, "files": {}}
        self.publisher = self.rig.session.publish(self.memory.path, about)
        self.file = OperatorFile(folder, self.words.path)
        self.panel = WatchedRun(folder, self.clock_ns)

    def clock_ns(self) -> int:
        return self.rig.clock_ns() + 10**12

    def close(self) -> None:
        self.panel.close()
        self.file.close()
        self.rig.close()
        self.memory.close()
        self.actions.close()
        self.words.remove()


@pytest.fixture
def live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Live]:
    monkeypatch.setenv("COUNTERFLEX_CACHE", str(tmp_path / "none"))
    made = Live(tmp_path)
    made.rig.clock_offset_s = 1000.0
    made.panel._clock_ns = made.rig.clock_ns
    yield made
    made.close()


def test_a_panel_sees_a_run_from_its_beginning_to_its_end(live: Live) -> None:
    rig, panel = live.rig, live.panel
    assert panel.poll() is False
    assert panel.seen.value == "running"
    rig.activate().run(100)
    assert panel.poll(clients=3) is True
    assert panel.figures["state"] == State.ACTIVE.name
    assert (rig.control[Panel.NS], rig.control[Panel.CLIENTS]) == (rig.clock_ns(), 3)
    assert panel.figures["panel"] == "there"
    live.publisher.end()
    panel.poll()
    assert (panel.seen, rig.control[Panel.NS]) == (Seen.ENDED, 0)
    rig.run(1000)
    assert panel.poll() is False  # the same run is not begun again
    assert panel.seen == Seen.ENDED


def test_a_loop_that_stands_still_is_told(live: Live) -> None:
    live.panel.poll()
    live.rig.activate()
    live.panel.poll()
    live.rig.frozen = True
    live.rig.run(200)
    assert "counterflex_cycles_total" in live.panel.open_metrics()
    live.panel.poll()
    assert live.panel.seen.value == "silent"
    text = live.panel.open_metrics()
    assert 'counterflex_run{counterflex_run="silent"} 1\n' in text
    assert "counterflex_cycles_total" not in text  # an old value would look like a live one
    live.rig.frozen = False
    live.rig.run(2)
    live.panel.poll()
    assert live.panel.seen == Seen.RUNNING


def test_an_operator_ramps_out_and_it_is_noted_who_did(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, panel = live.rig, live.panel
    panel.poll()
    rig.activate().run(50)
    monkeypatch.setattr("counterflex.app.panel.watched_run.Clock", lambda now: _Waits(now, rig))
    rig.control[Life.LOOP_NS] = rig.clock_ns()
    answer = panel.request("stop", "anna", "10.0.0.7")
    assert (answer["done"], answer["state"]) == (True, "hold")
    assert rig.control[Request.STOP] == 1
    (opened, stopped) = live.actions.take()
    assert opened["action"] == "panel opened"
    assert {k: stopped[k] for k in ("who", "from", "action", "done")} == {
        "who": "anna", "from": "10.0.0.7", "action": "stop", "done": True
    }  # fmt: skip
    rig.run(400)
    answer = panel.request("arm", "ben", "10.0.0.8")
    assert not answer["done"]
    (refused,) = live.actions.take()
    assert (refused["who"], refused["done"]) == ("ben", False)
    assert refused["refused"]


class _Waits:
    def __init__(self, now: Any, rig: Rig) -> None:
        self.now_ns, self._rig = now, rig

    def wait(self, _: float) -> None:
        self._rig.cycle()


def test_a_second_panel_is_refused(live: Live, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    live.panel.poll()
    other = WatchedRun(tmp_path, live.rig.clock_ns)
    monkeypatch.setattr(watched_run, "os", SimpleNamespace(getpid=lambda: -7))  # of this module alone
    other.poll()
    assert (other.seen, other.runs) == (Seen.WAITING, 0)
    assert "another panel watches this run" in other.why
    with pytest.raises(OutputError, match="another panel"):
        other.require_free()


def test_the_report_says_how_it_ended_and_trusts_no_text(tmp_path: Path) -> None:
    assert report_html(tmp_path) == ""
    run = {
        "job": "run",
        "ended": {"said": "as planned"},
        "cell": "<script>alert(1)</script>",
        "operator_actions": [{"who": "anna", "action": "stop", "done": True, "from": "10.0.0.7"}],
        "incidents": [{"number": 1, "state": "hold", "cause": "force_stale", "time_s": 3.2}],
    }
    (tmp_path / "summary.json").write_text(json.dumps(run))
    html = report_html(tmp_path)
    assert "as planned" in html
    assert "anna" in html
    assert "force stale" in html
    assert "<script>" not in html
