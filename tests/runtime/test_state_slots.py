"""Snapshots in shared memory: the newest that stands, never a torn one."""

from __future__ import annotations

from multiprocessing import resource_tracker

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError
from counterflex.runtime import record_ring
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.state_slots import BYTES, WORDS, LoopState, StateSlots


class _Interrupted(np.ndarray[tuple[int], np.dtype[np.int64]]):
    """Memory in which the writer goes on while the reader copies."""

    writer: StateSlots
    turns: int

    def copy(self, *_order: object) -> np.ndarray[tuple[int], np.dtype[np.int64]]:  # type: ignore[override]
        half = np.array(self[: self.size // 2])
        for _ in range(type(self).turns):
            type(self).writer.put(99, 990, {"numbers": np.full(self.size, 9.0)})
        return np.concatenate([half, np.array(self[self.size // 2 :])])


@pytest.mark.skipif(not record_ring._PLACE.is_dir(), reason="shared memory is no file here")
def test_a_ring_that_another_process_clears_while_it_is_made_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two campaigns at once: at their end Python warned of shared memory that had leaked."""
    tracked: list[str] = []
    hold, place = record_ring._hold, record_ring._PLACE
    register, unregister = resource_tracker.register, resource_tracker.unregister

    def count(name: str, kind: str) -> None:
        tracked.append(name)
        register(name, kind)

    def forget(name: str, kind: str) -> None:
        tracked.remove(name)
        unregister(name, kind)

    monkeypatch.setattr(resource_tracker, "register", count)
    monkeypatch.setattr(resource_tracker, "unregister", forget)
    made = 0

    def once(name: str) -> int | None:
        nonlocal made
        made += 1
        if made > 1:
            return hold(name)
        (place / name).unlink()
        return None

    monkeypatch.setattr(record_ring, "_hold", once)
    ring = RecordRing()
    assert (made, tracked) == (2, [f"/{ring.name}"])
    ring.close()
    assert not tracked


def test_states_come_back_bit_for_bit_and_once() -> None:
    ring = RecordRing()
    reader = RecordRing(ring.name)
    try:
        assert reader.states.take() is None
        numbers = np.array([[1.0, np.nan, -0.0], [np.inf, 5e-324, 3.0]])
        counts = np.array([2**62, -1])
        ring.states.put(7, 70, {"numbers": numbers, "counts": counts})
        ring.states.put(8, 80, {"numbers": numbers + 1.0, "counts": counts})
        found = reader.states.take()
        assert found is not None
        assert (found.cycle, found.time_ns) == (8, 80)
        assert found.words.tobytes() == (numbers + 1.0).tobytes() + counts.tobytes()
        assert reader.states.take() is None
        late = RecordRing(ring.name)
        assert late.states.take() is None
        late.rewind()
        assert isinstance(late.states.take(), LoopState)
        late.close()
    finally:
        reader.close()
        ring.close()


@given(st.integers(0, 4))
def test_what_is_written_over_while_it_is_copied_is_not_taken(left: int) -> None:
    memory = np.zeros(BYTES // 8, dtype=np.int64)
    writer, reader = StateSlots(memory), StateSlots(memory.view(_Interrupted))
    _Interrupted.writer, _Interrupted.turns = writer, left
    writer.put(1, 10, {"numbers": np.full(100, 1.0)})
    found = reader.take()
    if left < 2:  # the other slot
        assert found is not None
        assert found.cycle == 1
        assert set(found.words.view(np.float64).tolist()) == {1.0}
    else:
        assert found is None
    _Interrupted.turns = 0
    again = reader.take()
    assert (again is None) == (left == 0)
    if again is not None:
        assert set(again.words.view(np.float64).tolist()) == {9.0}


def test_what_does_not_fit_is_refused() -> None:
    slots = StateSlots(np.zeros(BYTES // 8, dtype=np.int64))
    with pytest.raises(InputError, match="does not fit"):
        slots.put(1, 1, {"numbers": np.zeros(WORDS + 1)})
    assert slots.take() is None
