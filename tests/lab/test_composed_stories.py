"""Faults composed at random: kept stories hold, some new ones hold, and defects planted in the loop are caught."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.integrations.abb.link.guidance_link import EgmGuidanceLink
from counterflex.integrations.abb.link.path_link import EgmPathLink
from counterflex.integrations.kuka.link.link import RsiLink
from counterflex.protocols.processes.control_array import Life, Request
from counterflex.protocols.robot.port import RobotPort, Verdict
from counterflex.protocols.robot.session_counter import SessionCounter
from counterflex.protocols.session.publisher import RecordWriter
from counterflex.protocols.session.session import OnlineSession
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.state.supervisor import State
from counterflex.signals.limiter import MotionLimit
from counterflex_lab.composed import bench, campaign, cell
from counterflex_lab.composed.disk import DiskLog
from counterflex_lab.composed.invariants import Invariants
from counterflex_lab.composed.kinds import KINDS
from counterflex_lab.composed.play import shrunk, tell
from counterflex_lab.composed.story import Active, Fault, Story, as_text, draw, read_stories
from counterflex_lab.composed.world import World

KEPT = Path(__file__).parents[1] / "data" / "composed_stories.json"
NEW_SEEDS = (7, 21)
"""Few: each takes some seconds; `.ci/run` tells others with every change."""


@pytest.mark.by_turn
@pytest.mark.parametrize(("why", "kept"), read_stories(KEPT), ids=lambda value: str(value)[:60])
def test_a_story_that_once_broke_a_rule_holds(why: str, kept: Story) -> None:
    assert not tell(kept).broken, why


@pytest.mark.long
@pytest.mark.parametrize("seed", NEW_SEEDS)
def test_a_story_of_a_seed_holds(seed: int) -> None:
    told = tell(draw(seed))
    assert not told.broken
    assert told.compared > 500


def test_a_story_depends_on_its_seed_alone() -> None:
    """Bit for bit: every correction in force and every state, told twice."""

    def course(seed: int) -> list[tuple[float, ...]]:
        seen: list[tuple[float, ...]] = []
        World(
            Story(seed, "measured-plan", 4.0, (Fault("lost", 2.0, 0.2, 1.0), Fault("force-spikes", 2.5, 500.0, 1.0))),
            lambda world: seen.append((float(world.state), *world.correction_m.tolist())),
        ).run()
        return seen

    first = course(5)
    assert first == course(5)
    assert first != course(6)
    assert any(row[0] == State.ACTIVE and np.linalg.norm(row[1:]) > 1e-4 for row in first)


CELLS = {
    "rsi with 12 ms": Story(3, "measured", 3.5, period_ms=12),
    "egm path correction": Story(3, "measured-plan", 6.0, link="egm-path", period_ms=24),
    "egm guidance": Story(3, "measured", 1.5, link="egm-pose"),
    "spindle holder": Story(3, "measured", 1.5, sensor="holder"),
    "motor currents": Story(3, "fused", 1.5, currents=True),
}


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_without_a_fault_corrects_and_breaks_no_rule(name: str) -> None:
    """The force bends the tool by half a millimetre; what the drives make of the correction takes that back."""
    made: list[float] = []
    looks = Invariants(CELLS[name])

    def look(world: World) -> None:
        looks(world)
        made.append(float(np.linalg.norm(world.robot.made_m)))

    world = World(CELLS[name], look)
    world.run()
    looks.end(world)
    assert not looks.broken
    assert looks.states["ACTIVE"] > 80
    assert made[-1] > 0.4e-3


def test_the_plan_tells_the_link_of_egm_where_the_path_turns() -> None:
    """Feed directions about the place, as the program has them: the two of a straight, more of an arc, all of both."""
    seen: list[tuple[float, np.ndarray]] = []

    def look(world: World) -> None:
        link = None if world.session is None else world.session.link
        if isinstance(link, EgmPathLink) and link.feeds is not None and world.robot.speed > 0.02:
            seen.append((world.robot.place, link.feeds(2e-3)))

    World(Story(3, "measured", 8.5, **EGM_PATH), look).run()
    for place, feeds in seen[20::20]:
        here = bench.feeds()[int(place)]
        turned = np.arccos(np.clip(feeds @ here, -1.0, 1.0))
        assert turned.min() < 0.1
        assert turned.max() < 4e-3 / 15e-3
    assert any(np.ptp(feeds, axis=0).max() > 0.1 for _, feeds in seen)


@pytest.mark.parametrize("mode", ["measured", "measured-axes", "pilot-observer", "integrator", "fused"])
def test_a_loop_started_again_behind_a_killed_one_goes_on_from_what_stands(mode: str) -> None:
    """No answer further from the one before than one cycle of the limiter; the feed is held, the ramp ends at zero."""
    told = Story(107, mode, 5.2, (Fault("loop-killed", 2.6, 1.0),))
    looks, course = Invariants(told), list[tuple[int, float, np.ndarray, bool]]()

    def look(world: World) -> None:
        looks(world)
        course.append((world.runs, float(world.state), np.array(world.correction_m), world.side.held))

    World(told, look).run()
    assert not looks.broken
    again = [row for row in course if row[0] == 2]
    taken_over = [row for row in again if row[1] in (State.HOLD, State.RAMP_OUT)]
    assert np.linalg.norm(again[0][2]) > 0.4e-3
    assert all(held for *_, held in taken_over[1:-1])
    steps = [np.linalg.norm(one[2] - other[2]) for one, other in pairwise(again)]
    assert max(steps) < 20e-3 * 4e-3 + 20e-6
    assert np.linalg.norm(again[-1][2]) < 20e-6


def test_half_of_the_stories_have_the_cell_that_all_had_once() -> None:
    usual = [one for one in map(draw, range(400)) if (one.link, one.period_ms, one.sensor) == ("rsi", 4, "netft")]
    assert 170 < len(usual) < 230
    assert not any(one.currents for one in usual)


def test_stories_are_kept_as_text_and_read_again(tmp_path: Path) -> None:
    stories = [("a reason", draw(seed)) for seed in range(40)]
    file = tmp_path / "stories.json"
    file.write_text(as_text(stories), encoding="utf-8")
    assert read_stories(file) == stories


def test_a_fault_that_comes_into_a_longer_one_of_its_kind_ends_alone() -> None:
    active = Active(_told("measured", Fault("lost", 1.0, 0.1, 3.0), Fault("lost", 2.0, 0.2, 0.5)))
    seen = []
    for time_s in (0.5, 1.5, 2.2, 3.0, 4.5):
        active.advance(time_s)
        seen.append(active.size("lost"))
    assert seen == [0.0, 0.1, 0.2, 0.1, 0.0]
    assert active.begun == {"lost": 3.0}


def test_every_kind_of_fault_is_drawn() -> None:
    drawn = {fault.kind for seed in range(1500) for fault in draw(seed).faults}
    assert drawn == set(KINDS)


def _no_limits(of: Callable[[Story], OnlineSettings]) -> Callable[[Story], OnlineSettings]:
    def made(one: Story) -> OnlineSettings:
        settings = of(one)
        object.__setattr__(settings, "translation", MotionLimit(2e-3, 0.2, 125.0))
        return settings

    return made


def _limiter(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(cell, "settings_of", _no_limits(cell.settings_of))


def _answers(
    change: Callable[[np.ndarray, dict[str, Any]], np.ndarray], link: Any = RsiLink
) -> Callable[[pytest.MonkeyPatch], None]:
    """The answer says something else than the loop computed."""
    right = link.answer

    def answer(self: Any, correction: Any, axes: Any = None, **said: Any) -> bool:
        return bool(right(self, change(np.array(correction), said), axes, **said))

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(link, "answer", answer)

    return plant


def _sign(correction: np.ndarray, _said: dict[str, Any]) -> np.ndarray:
    return -correction


def _drifts_in_hold(correction: np.ndarray, said: dict[str, Any]) -> np.ndarray:
    if said.get("state") == State.HOLD:
        correction[1] += 1e-3 * np.sin(_drifts_in_hold.count)  # type: ignore[attr-defined]
        _drifts_in_hold.count += 0.01  # type: ignore[attr-defined]
    return correction


_drifts_in_hold.count = 0.0  # type: ignore[attr-defined]


def _keeps_correction(correction: np.ndarray, said: dict[str, Any]) -> np.ndarray:
    if said.get("state") in (State.IDLE, State.READY):
        correction[1] = 0.2e-3
    return correction


def _says_no_hold(correction: np.ndarray, said: dict[str, Any]) -> np.ndarray:
    said["feed_hold"] = said["stop"] = False
    return correction


def _all_are_new(patch: pytest.MonkeyPatch) -> None:
    def judge(self: SessionCounter, counter: int) -> Verdict:
        self.newest = counter
        return Verdict.NEW

    patch.setattr(SessionCounter, "judge", judge)


def _any_sender(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(RobotPort, "_may_speak", lambda _self, _sender: True)


def _answers_the_first(patch: pytest.MonkeyPatch) -> None:
    _any_sender(patch)
    right = RobotPort._take

    def take(self: RobotPort, row: int, read: Any) -> bool:
        first, peer, new = self._sender, self.peer, right(self, row, read)
        if first >= 0:
            self._sender, self.peer = first, peer
        return new

    patch.setattr(RobotPort, "_take", take)


def _session_goes_on(patch: pytest.MonkeyPatch) -> None:
    right = SessionCounter.advance
    patch.setattr(SessionCounter, "advance", lambda self: (right(self)[0], False))


def _decided(patch: pytest.MonkeyPatch, spoil: Callable[[OnlineSession], None]) -> None:
    """Let every decision be made on other inputs; control and log are given back behind it."""
    right = OnlineSession._decide

    def decide(self: OnlineSession, *words: Any) -> bool:
        control, ring = self.control.copy(), self.ring
        spoil(self)
        try:
            return right(self, *words)
        finally:
            self.ring = ring
            for word in (Life.GONE, Request.STOP):
                self.control[word] = control[word]

    patch.setattr(OnlineSession, "_decide", decide)


def _log_does_not_matter(patch: pytest.MonkeyPatch) -> None:
    _decided(patch, lambda session: setattr(session, "ring", None))


def _run_does_not_matter(patch: pytest.MonkeyPatch) -> None:
    def spoil(session: OnlineSession) -> None:
        session._now.run_silent_ns, session.control[Life.GONE] = -1, 0

    _decided(patch, spoil)


def _never_stops(patch: pytest.MonkeyPatch) -> None:
    _decided(patch, lambda session: session.control.__setitem__(Request.STOP, 0))


def _enable_stays(patch: pytest.MonkeyPatch) -> None:
    def spoil(session: OnlineSession) -> None:
        session.link.enable |= session._result.state == State.ACTIVE

    _decided(patch, spoil)


def _nobody_looks(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(RsiLink, "fill_reported", lambda _self, _out: False)


def _nobody_looks_at_a_guided_one(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(EgmGuidanceLink, "fill_reported", lambda _self, _out: False)


def _any_motion_turns_the_path(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(EgmPathLink, "_believed", lambda *_: True)


def _records_another_number(patch: pytest.MonkeyPatch) -> None:
    right = RecordWriter.write

    def write(self: RecordWriter, received: int, sent: int) -> None:
        loop = self._loop
        kept = float(loop.given.wrench[1])
        loop.given.wrench[1] = kept + 1e-9 * (loop.cycle % 500 == 0)
        right(self, received, sent)
        loop.given.wrench[1] = kept

    patch.setattr(RecordWriter, "write", write)


def _silence_is_patience(patch: pytest.MonkeyPatch) -> None:
    right = OnlineSession.handle_cycle

    def handle(self: OnlineSession, received: bool) -> bool:
        return right(self, received) if received or self._result.state < State.ACTIVE else False

    patch.setattr(OnlineSession, "handle_cycle", handle)


def _told(mode: str, *faults: Fault, **chosen: Any) -> Story:
    return Story(3, mode, chosen.pop("length_s", 5.0), faults, **chosen)


EGM_PATH: dict[str, Any] = {"link": "egm-path", "period_ms": 24}
OWN_FORCE: dict[str, Any] = {"sensor": "egm", "frame": "base", "without_log": "hold", "force_offset": "plan"}
_DISOBEYS = (Fault("harder", 0.5, 2.5, 2.6), Fault("robot-share", 0.5, 0.05, 2.6))


DEFECTS: dict[str, tuple[Callable[[pytest.MonkeyPatch], None], Story, str]] = {
    "the limiter lets everything pass": (
        _limiter,
        _told("measured", Fault("force-offset", 2.0, 2000.0, 1.0), force_offset="tell"),
        "no step",
    ),
    "the sign of the answer": (_answers(_sign), _told("measured"), "the true cause"),
    "the correction moves in hold": (
        _answers(_drifts_in_hold),
        _told("measured", Fault("force-silent", 2.2, 1.0, 0.3)),
        "at rest in hold",
    ),
    "a correction before anything is armed": (_answers(_keeps_correction), _told("measured"), "zero unless it acts"),
    "feed hold and stop are not said": (
        _answers(_says_no_hold),
        _told("measured", Fault("operator-stop", 2.0, 1.0), length_s=8.0),
        "the true cause",
    ),
    "old telegrams are taken for new ones": (
        _all_are_new,
        _told("measured", Fault("replayed", 1.5, 0.5, 2.0)),
        "the true cause",
    ),
    "strangers are listened to": (_any_sender, _told("measured", Fault("stranger", 2.0, 2.0, 1.0)), "one sender"),
    "answers go on to the port of an earlier session": (
        _answers_the_first,
        Story(4, "measured", 1.4, (Fault("controller-restart", 1.0, 0.1),)),
        "one sender",
    ),
    "another session goes unnoticed": (
        _session_goes_on,
        _told("measured", Fault("controller-restart", 2.3, 0.05), length_s=6.0),
        "no step",
    ),
    "a full disk does not matter": (
        _log_does_not_matter,
        _told("measured", Fault("disk-full", 1.5, 1.0, 3.0), without_log="hold"),
        "reacts to a lost log",
    ),
    "a run that stands still does not matter": (
        _run_does_not_matter,
        _told("measured", Fault("run-stopped", 1.5, 1.0, 1.0)),
        "reacts to a silent run",
    ),
    "a stop is not heard": (_never_stops, _told("measured", Fault("operator-stop", 2.0, 1.0)), "reacts to a stop"),
    "Enable is taken to stay": (
        _enable_stays,
        _told("measured", Fault("enable-flickers", 2.0, 1.0, 2.0)),
        "reacts to no Enable",
    ),
    "nobody looks whether the robot obeys": (
        _nobody_looks,
        _told("measured", Fault("robot-negates", 0.1, 1.0, 9.0), length_s=9.0),
        "obedience is checked",
    ),
    "nobody looks whether a guided robot obeys": (
        _nobody_looks_at_a_guided_one,
        _told("measured", *_DISOBEYS, link="egm-pose", length_s=3.2),
        "obedience is checked",
    ),
    "any pose turns the path frame of EGM": (
        _any_motion_turns_the_path,
        Story(
            41719, "pilot-observer", 5.4, (Fault("message-damaged", 4.9748, 0.7197, 0.0329),), **EGM_PATH, **OWN_FORCE
        ),
        "no step",
    ),
    "the correction moves in hold on the path of EGM": (
        _answers(_drifts_in_hold, EgmPathLink),
        _told("measured", Fault("force-silent", 4.4, 1.0, 0.5), length_s=5.6, **EGM_PATH),
        "at rest in hold",
    ),
    "the log holds another number": (_records_another_number, _told("measured"), "replays bit for bit"),
    "a line that is silent is waited for": (
        _silence_is_patience,
        _told("measured", Fault("controller-pauses", 2.0, 1.0, 1.0)),
        "reacts to no telegrams",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", DEFECTS)
def test_a_defect_in_the_loop_is_caught(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the rule that it breaks; the same story holds without the defect, but for being too short to correct again."""
    plant, told, rule = DEFECTS[name]
    assert {one.rule for one in tell(told).broken} <= {"corrects again"}
    plant(monkeypatch)
    assert rule in {one.rule for one in tell(told).broken}


def test_a_story_is_shortened_to_the_fault_that_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    _never_stops(monkeypatch)
    told = _told(
        "measured",
        Fault("repeated", 1.0, 0.5, 1.0),
        Fault("operator-stop", 2.0, 1.0),
        Fault("force-spikes", 1.5, 60.0, 0.1),
    )
    shortest = shrunk(told, "reacts to a stop", most=6)
    assert [fault.kind for fault in shortest.faults] == ["operator-stop"]


def test_the_campaign_writes_what_broke_and_can_be_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = _told("measured", Fault("operator-stop", 1.0, 1.0), length_s=1.6)
    monkeypatch.setattr(campaign, "draw", lambda seed: Story(seed, short.mode, 1.6, short.faults))
    monkeypatch.setattr(campaign, "shrunk", lambda one, _rule: one)
    _never_stops(monkeypatch)
    out = campaign.run(tmp_path / "out", minutes=0.05, seed=9)
    assert out.stories == 2
    assert {rule for _, rule, _ in out.broken} >= {"reacts to a stop"}
    kept = read_stories(tmp_path / "out" / campaign.STORIES)
    assert {one.seed for _, one in kept} == {9, 10}
    summary = json.loads((tmp_path / "out" / campaign.SUMMARY).read_text(encoding="utf-8"))
    assert not summary["passed"]
    assert summary["stories"] == 2

    def interrupts(fraction: float, what: str = "") -> None:
        raise KeyboardInterrupt

    assert campaign.run(tmp_path / "two", minutes=1.0, progress=interrupts).interrupted


def test_a_story_that_is_ended_early_leaves_neither_memory_nor_files() -> None:
    left: list[tuple[str, Path]] = []

    def ends(world: World) -> None:
        if world.now_s > 0.8:
            assert world.ring is not None
            assert isinstance(world.log, DiskLog)
            left.append((world.ring.name, world.log._disk.folder))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        World(_told("measured", log="disk"), ends).run()
    ((name, folder),) = left
    assert not folder.parent.exists()
    with pytest.raises(InputError):
        RecordRing(name)


_INTERRUPTED = """
import os, signal, sys, threading
from counterflex_lab.composed import campaign
from counterflex_lab.composed.story import Story

def begin(*_):
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()

if __name__ == "__main__":
    campaign.draw = lambda seed: Story(seed, "measured", 1.2 if seed == 9 else 40.0)
    print(campaign.run(sys.argv[1], minutes=2.0, seed=9, workers=2, progress=begin).interrupted)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_workers_that_are_interrupted_free_their_shared_memory(tmp_path: Path) -> None:
    """They were killed where they stood: Python warned of leaked memory, and Ctrl-C waited for the next story."""
    script = tmp_path / "interrupted.py"
    script.write_text(_INTERRUPTED, encoding="utf-8")
    command = [sys.executable, str(script), str(tmp_path / "out")]
    ended = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert (ended.stdout, ended.stderr) == ("True\n", "")


def _summary(out: Path) -> dict[str, Any]:
    table: dict[str, Any] = json.loads((out / campaign.SUMMARY).read_text(encoding="utf-8"))
    return {name: value for name, value in table.items() if name != "simulated_by_processor_time"}


def test_an_interrupted_campaign_goes_on_behind_its_last_story(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = _told("measured", Fault("operator-stop", 1.0, 1.0), length_s=1.6)
    seeds: list[int] = []

    def draws(seed: int) -> Story:
        seeds.append(seed)
        return Story(seed, short.mode, 1.6, short.faults)

    def interrupts(fraction: float, what: str = "") -> None:
        if len(seeds) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(campaign, "draw", draws)
    _never_stops(monkeypatch)
    monkeypatch.setattr(campaign, "shrunk", lambda one, _rule: one)
    campaign.run(tmp_path / "whole", minutes=0.1, seed=9)
    assert seeds == [9, 10, 11, 12]
    seeds.clear()
    cut = tmp_path / "cut"
    assert campaign.run(cut, minutes=0.1, seed=9, progress=interrupts).stories == 2
    with (cut / campaign.TOLD).open("a", encoding="utf-8") as file:
        file.write('{"story": {"se')  # as of a process that was killed while it wrote
    campaign.run(cut, minutes=0.1, seed=9)
    assert seeds == [9, 10, 11, 12]
    assert _summary(cut) == _summary(tmp_path / "whole")
    assert (cut / campaign.STORIES).read_bytes() == (tmp_path / "whole" / campaign.STORIES).read_bytes()
    seeds.clear()
    campaign.run(cut, minutes=0.05, seed=10)  # others: the file begins anew
    assert seeds == [10, 11]


@pytest.mark.long
def test_several_processes_tell_what_one_tells(tmp_path: Path) -> None:
    for workers in (1, 2):
        campaign.run(tmp_path / f"{workers}", minutes=1.1, seed=6000, workers=workers)
    assert _summary(tmp_path / "1") == _summary(tmp_path / "2")
