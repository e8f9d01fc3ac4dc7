"""The correction that stands at a robot whose loop was killed: found from counter and pose, and begun with."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.protocols.processes.instance_lock import InstanceLock
from counterflex.protocols.processes.last_answer import Answered, LastAnswer
from counterflex.protocols.processes.shared_words import kept_at
from counterflex.protocols.session.standing import Standing

SENT = np.array([0.3e-3, -0.4e-3, 0.1e-3, 0.0, 0.0, 0.0])
AXES = np.linspace(0.0, 5e-4, 6)
MS = 1_000_000
LAST = Answered(4_294_967_000, 50_000 * MS, SENT, AXES)
"""Its counter begins again at 0 a moment later."""


def shown(
    before: Answered | None,
    *,
    after_ms: int,
    made: np.ndarray | None,
    counted_ms: int | None = None,
    feed_m_s: float = 0.025,
) -> Standing:
    """Three telegrams of a robot that moves along y and trails its program by 60 ms."""
    found = Standing(before)
    for k in range(3):
        nominal = np.zeros(12)
        nominal[9:] = 1.2, -0.4 + feed_m_s * 4e-3 * k, 0.8
        reported = None if made is None else nominal + np.r_[np.zeros(9), made[:3]] - np.eye(12)[10] * 60e-3 * feed_m_s
        counter = (LAST.counter + (after_ms if counted_ms is None else counted_ms) + 4 * k) % 2**32
        found.see(counter, LAST.clock_ns + (after_ms + 4 * k) * MS, nominal, reported, restarted=False)
    return found


@given(st.integers(4, 600_000), st.floats(0.0, 0.1), st.sampled_from([None, SENT]))
def test_a_session_that_goes_on_has_the_last_answer_in_force(
    after_ms: int, feed: float, made: np.ndarray | None
) -> None:
    """However long nobody answered, while its counter wraps, and however far the robot trails along its way."""
    found = shown(LAST, after_ms=after_ms, made=made, feed_m_s=feed)
    assert found.known
    assert np.array_equal(found.correction, SENT)
    assert np.array_equal(found.axes, AXES)


@given(st.integers(4, 600_000), st.integers(0, 2**32 - 1))
def test_another_session_has_nothing_in_force(after_ms: int, counted_ms: int) -> None:
    """By the pose whatever its counter; without a pose, by a counter that did not go on with the clock."""
    found = shown(LAST, after_ms=after_ms, made=np.zeros(3), counted_ms=counted_ms)
    assert found.known
    assert not found.correction.any()
    other = 600 + 0.11 * after_ms < (counted_ms - after_ms) % 2**32 < 2**32 - 600 - 0.11 * after_ms
    unseen = shown(LAST, after_ms=after_ms, made=None, counted_ms=counted_ms)
    assert unseen.known
    assert not (other and unseen.correction.any())


def test_a_counter_that_jumped_does_not_hide_what_the_pose_shows() -> None:
    found = shown(LAST, after_ms=3000, made=SENT, counted_ms=900_000)
    assert np.array_equal(found.correction, SENT)


@pytest.mark.parametrize("made", [0.5 * SENT, -SENT, SENT + 2e-3])
def test_a_pose_that_contradicts_itself_leaves_it_unknown_until_the_session_ends(made: np.ndarray) -> None:
    found = shown(LAST, after_ms=3000, made=made)
    assert not found.known
    for _ in range(200):
        found.silent(4e-3)
    assert not found.known
    for _ in range(52):
        found.silent(4e-3)
    assert found.known
    assert not found.correction.any()


def test_a_lost_answer_is_unknown_until_another_session_comes() -> None:
    found = shown(None, after_ms=3000, made=np.zeros(3))
    assert not found.known
    found.see(5, 0, np.zeros(12), None, restarted=True)
    assert found.known


def test_nothing_stands_where_nothing_was_answered_or_zero() -> None:
    nothing = LastAnswer(np.zeros((2, 16))).before
    found = Standing(nothing)
    found.see(1, 2, np.zeros(12), None, restarted=False)
    assert found.known
    assert not found.correction.any()


@given(st.integers(1, 9))
def test_the_newest_whole_answer_counts(count: int) -> None:
    """One that was being written when the process was killed leaves the one before it."""
    memory = np.zeros((2, 16))
    last = LastAnswer(memory)
    for k in range(1, count + 1):
        last.put(k, 10 * k, k * SENT, k * AXES)
    before = LastAnswer(memory.copy()).before
    assert before is not None
    assert (before.counter, before.clock_ns) == (count, 10 * count)
    assert np.array_equal(before.correction, count * SENT)
    assert np.array_equal(before.axes, count * AXES)
    memory[count % 2, 0] = 0.0  # half written
    former = LastAnswer(memory).before
    assert former is not None
    assert former.counter == count - 1


KILLED = """
import os, pathlib, signal, sys
import numpy as np
from counterflex.protocols.processes.instance_lock import InstanceLock
lock = InstanceLock(pathlib.Path(sys.argv[1]), 49152, run="log")
lock.last.put(7, 8, np.arange(6.0), np.arange(6.0))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_last_answer_of_a_killed_process_is_found_once(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False, timeout=120)
    kept = kept_at(tmp_path / "robot-49152.lock")
    assert kept.stat().st_mode & 0o777 == 0o600
    unseen = InstanceLock(tmp_path, 49152, run="log 2")
    assert unseen.last.before is not None
    assert np.array_equal(unseen.last.before.correction, np.arange(6.0))
    unseen.close(acknowledged=False)
    seen = InstanceLock(tmp_path, 49152, run="log 3")
    assert seen.last.before is not None
    seen.close()
    assert not kept.exists()
    with InstanceLock(tmp_path, 49152) as fresh:
        assert fresh.last.before is not None
        assert not fresh.last.before.correction.any()


def test_memory_that_is_not_there_or_not_ours_is_lost(tmp_path: Path) -> None:
    InstanceLock(tmp_path, 49152, run="log").close(ended=False)
    kept = kept_at(tmp_path / "robot-49152.lock")
    kept.unlink()
    with InstanceLock(tmp_path, 49152) as lock:
        assert lock.not_closed == "log"
        assert lock.last.before is None
        lock.close(ended=False)
    kept.unlink()
    other = tmp_path / "other"
    other.write_bytes(bytes(256))
    kept.symlink_to(other)
    with InstanceLock(tmp_path, 49152) as lock:
        assert lock.last.before is None
    assert other.read_bytes() == bytes(256)
