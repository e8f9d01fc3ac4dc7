"""Snapshots of a loop in shared memory: layout and version, torn copies, what they say of a run; no browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.records import count_of
from counterflex.integrations.kuka.simulated import RsiContext
from counterflex.protocols.processes import snapshot_layout as layout
from counterflex.protocols.processes.control_array import Panel, Request
from counterflex.protocols.processes.snapshot import SnapshotMemory, SnapshotReader, SnapshotSlots, check_of
from counterflex.protocols.session.session import SessionChecks
from counterflex.protocols.session.snapshot_kernel import LOST, NO_PANEL, THERE, lengths_of, share_of
from counterflex.runtime.state.states import Cause, State
from counterflex_lab.faults.rig import Rig


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SnapshotMemory]:
    memory = SnapshotMemory(tmp_path_factory.mktemp("shared") / "words")
    yield memory
    memory.close()


def write(slots: SnapshotSlots, value: int) -> None:
    """A snapshot whose numbers are all the same."""
    place = slots.begin()
    numbers = slots.slots[place : place + 1].view(np.int64).reshape(-1)
    numbers[1:-1] = value
    whole = numbers.copy()
    whole[0] = slots.number + 1
    numbers[-1] = check_of(whole)
    slots.commit()


def test_layout_is_that_of_the_version() -> None:
    """Whoever changes names, kinds or order raises the version, and writes the new number here."""
    assert (layout.VERSION, layout.NUMBERS) == (1, 138)
    assert count_of(layout.SNAPSHOT) == layout.NUMBERS
    assert layout.layout_number() == 7750824593036440180


def test_what_is_written_is_read_in_order_and_once(made: SnapshotMemory) -> None:
    slots = SnapshotSlots(made.path, {"cell": "a"})
    reader = SnapshotReader(made.path)
    for value in range(5):
        write(slots, value)
    taken = reader.take()
    assert (reader.about, list(taken["number"]), list(taken["state"])) == (
        {"cell": "a"},
        [1, 2, 3, 4, 5],
        [0, 1, 2, 3, 4],
    )
    assert len(reader.take()) == 0
    assert list(reader.latest()["number"]) == [5]
    reader.close()


def test_a_reader_that_is_late_is_told_how_much_it_missed(made: SnapshotMemory) -> None:
    slots = SnapshotSlots(made.path, {})
    reader = SnapshotReader(made.path)
    for value in range(1000):
        write(slots, value)
    taken = reader.take()
    assert (len(taken), reader.missed) == (layout.MOST, 1000 - layout.MOST)
    assert list(taken["number"]) == list(range(1001 - layout.MOST, 1001))
    reader.close()


@settings(max_examples=200, deadline=None)
@given(
    old=st.integers(-(2**63), 2**63 - 1),
    new=st.integers(-(2**63), 2**63 - 1),
    copied=st.integers(0, layout.NUMBERS),
    backwards=st.booleans(),
)
def test_a_torn_copy_is_never_taken(made: SnapshotMemory, old: int, new: int, copied: int, backwards: bool) -> None:
    """A slot of which any part is of another snapshot, in whichever order memory becomes visible."""
    slots = SnapshotSlots(made.path, {})
    reader = SnapshotReader(made.path)
    for _ in range(layout.SLOTS):
        write(slots, old)
    reader.take()
    before = (
        slots.numbers[layout.HEAD + layout.TEXT :].reshape(layout.SLOTS, -1)[(slots.number + 1) % layout.SLOTS].copy()
    )
    place = (slots.number + 1) % layout.SLOTS
    write(slots, new)
    slot = slots.numbers[layout.HEAD + layout.TEXT :].reshape(layout.SLOTS, -1)[place]
    stale = slice(copied, None) if not backwards else slice(0, layout.NUMBERS - copied)
    whole = slot.copy()
    slot[stale] = before[stale]
    taken = reader.take()
    assert len(taken) == int(np.array_equal(slot, whole))
    reader.close()


def test_a_slot_that_is_being_written_is_not_taken(made: SnapshotMemory) -> None:
    slots = SnapshotSlots(made.path, {})
    reader = SnapshotReader(made.path)
    for value in range(layout.SLOTS + 1):
        write(slots, value)
    slots.begin()
    assert list(reader.latest()["number"]) == [layout.SLOTS + 1]
    assert len(reader.take()) == layout.MOST
    reader.close()


def test_readers_cannot_write(made: SnapshotMemory) -> None:
    SnapshotSlots(made.path, {})
    reader = SnapshotReader(made.path)
    with pytest.raises(ValueError, match="read-only"):
        reader._numbers[0] = 1
    with pytest.raises(TypeError):
        reader._memory[0] = 1
    reader.close()


@pytest.mark.parametrize("place", [layout.VERSION_AT, layout.LAYOUT_AT, layout.NUMBERS_AT, layout.SLOTS_AT])
def test_another_version_is_refused_by_name(made: SnapshotMemory, place: int) -> None:
    slots = SnapshotSlots(made.path, {})
    slots.numbers[place] += 1
    with pytest.raises(FileFormatError, match="of another version"):
        SnapshotReader(made.path)


def test_what_is_no_memory_of_ours_is_refused(made: SnapshotMemory, tmp_path: Path) -> None:
    slots = SnapshotSlots(made.path, {})
    slots.numbers[layout.MAGIC_AT] = 0
    with pytest.raises(FileFormatError, match="still being prepared"):
        SnapshotReader(made.path)
    with pytest.raises(FileFormatError, match="shows no snapshots"):
        SnapshotReader(tmp_path / "none")
    (tmp_path / "short").write_bytes(bytes(8))
    with pytest.raises(FileFormatError, match="shows no snapshots"):
        SnapshotReader(tmp_path / "short")
    with pytest.raises(InputError, match="does not fit"):
        SnapshotSlots(made.path, {"text": "x" * 8 * layout.TEXT})
    assert made.path.stat().st_mode & 0o777 == 0o600


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=layout.NUMBERS, max_size=layout.NUMBERS))
@settings(max_examples=20, deadline=None)
def test_check_sum_is_that_of_the_definition(numbers: list[int]) -> None:
    expected = sum((2 * k + 1) * value for k, value in enumerate(numbers[:-1])) % 2**64
    assert int(check_of(np.array(numbers))) % 2**64 == expected


def test_share_of_the_path_is_by_length() -> None:
    lengths = lengths_of(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 0.0, 1.0]]))
    assert [share_of(lengths, 0.0, 0.5), share_of(lengths, 1.0, 0.0), share_of(lengths, 1.0, 1.0)] == [0.375, 0.75, 1.0]
    assert share_of(lengths, -1.0, 0.0) == share_of(lengths_of(np.zeros((0, 3))), 0.0, 0.0) == -1.0
    assert len(lengths_of(np.zeros((4, 3)))) == 0


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig(force=lambda _: np.array([0.0, 450.0, 0.0]), context=RsiContext()) as made:
        yield made


def test_a_snapshot_says_what_the_loop_does(rig: Rig, made: SnapshotMemory) -> None:
    rig.session.publish(made.path, {})
    reader = SnapshotReader(made.path)
    rig.activate().run(200)
    (now,) = reader.take()[-1:]
    loop, robot = rig.loop, rig.robot_socket.getsockname()
    assert (now.state, now.cause, now.cycle, now.telegrams) == (State.ACTIVE, 0, loop.cycle, rig.session.cycles)
    assert np.array_equal(now.correction, loop.correction)
    assert np.array_equal(now.measured, loop.result.measured)
    assert np.array_equal(now.deflection, loop.result.deflection)
    assert np.array_equal(now.in_effect, loop.in_effect)
    assert (now.peer >> 16, now.peer & 0xFFFF) == (0x7F000001, robot[1])
    assert (now.tracker_ns, now.share, now.panel, now.incident_cause) == (-1, -1.0, NO_PANEL, 0)
    assert 0.0 < np.linalg.norm(now.measured[:3]) < 500.0
    reader.close()


def test_the_first_cause_of_an_incident_stays_until_it_is_acknowledged(rig: Rig, made: SnapshotMemory) -> None:
    rig.session.publish(made.path, {})
    reader = SnapshotReader(made.path)
    rig.activate().run(100)
    rig.sense = False
    rig.run(60)
    (now,) = reader.latest()
    assert (now.state, now.incident_cause, now.incident_state) == (State.HOLD, Cause.FORCE_STALE, State.HOLD)
    assert now.incident_end_ns == 0 < now.incident_ns
    rig.run(600)
    (later,) = reader.latest()
    assert (later.incident_cause, later.incidents) == (Cause.FORCE_STALE, 1)
    assert later.incident_state > State.HOLD
    assert later.incident_end_ns > later.incident_ns == now.incident_ns
    rig.sense = True
    rig.restart_robot(rig.robot.counter + 60_000)
    rig.enable = rig.feed = False
    rig.run(60)
    rig.control[Request.RESET] = 1
    rig.run(2)
    rig.control[Request.RESET] = 1
    rig.run(2)
    (clear,) = reader.latest()
    assert (clear.incident_cause, clear.incident_ns) == (0, 0)
    reader.close()


def beat(rig: Rig, cycles: int) -> None:
    for _ in range(cycles):
        rig.control[Panel.NS] = rig.clock_ns()
        rig.cycle()


def test_a_panel_that_dies_is_told_and_nothing_else(rig: Rig, made: SnapshotMemory) -> None:
    rig.session.publish(made.path, {})
    reader = SnapshotReader(made.path)
    rig.activate()
    beat(rig, 100)
    assert reader.latest()[0].panel == THERE
    rig.run(260)
    (now,) = reader.latest()
    assert (now.panel, now.state) == (LOST, State.ACTIVE)
    rig.control[Panel.NS] = 0
    rig.run(2)
    assert reader.latest()[0].panel == NO_PANEL
    reader.close()


def test_a_cell_that_asks_for_a_panel_holds_when_it_dies_and_goes_on_when_it_is_back() -> None:
    checks = SessionChecks(hold_without_panel=True)
    with Rig(force=lambda _: np.array([0.0, 450.0, 0.0]), context=RsiContext(), checks=checks) as rig:
        rig.control[Request.ARM] = 1
        rig.run(200)
        assert (rig.state, rig.loop.result.soft) == (State.IDLE, Cause.PANEL_LOST)  # none has come: not armed
        beat(rig, 100)
        assert rig.state.name == "ARMED"
        rig.enable = rig.feed = True
        beat(rig, 200)
        assert rig.state == State.ACTIVE
        cycles = 0
        while rig.state == State.ACTIVE:
            rig.cycle()
            cycles += 1
        assert rig.loop.cause == Cause.PANEL_LOST
        assert 1.0 <= 0.004 * cycles <= 1.02
        assert rig.robot.feed_hold
        beat(rig, 60)
        assert rig.state == State.ACTIVE
        rig.control[Panel.NS] = 0  # it has left: likewise
        rig.run(2)
        assert (rig.state, rig.loop.cause) == (State.HOLD, Cause.PANEL_LOST)
