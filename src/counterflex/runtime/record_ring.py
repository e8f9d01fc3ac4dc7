"""From the loop to the recorder: a ring of records in shared memory. Writing never waits and never fails.

The loop writes whole rows and then their number; the reader takes what is new. A reader that is too slow loses the
oldest rows and is told how many; the loop notices nothing. Who uses a ring holds it (:mod:`counterflex.core.held`); one
that nobody holds was left by processes that were killed, and is cleared when the next one is made.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from multiprocessing import resource_tracker, shared_memory
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.held import clear_unheld, share
from counterflex.core.records import count_of, reals_and_words, records
from counterflex.runtime.monitoring import records as monitor
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.state.given import GIVEN as _GIVEN
from counterflex.runtime.state.result import RESULT as _RESULT
from counterflex.runtime.state_slots import BYTES as STATE_BYTES, StateSlots

ROWS: Final = 4096
"""16 s at 250 Hz."""
MOST: Final = ROWS - ROWS // 8
"""Rows that may wait for the reader: the oldest may be overwritten while they are copied."""
_HEAD: Final = 64  # bytes
_PLACE: Final = Path("/dev/shm")
"""Where the system shows shared memory as files; where it does not, nothing is held, and nothing cleared."""
_PREFIX: Final = "counterflex-ring-"
_WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
_TWIST: Final = ("x", "y", "z", "rx", "ry", "rz")
_POSE: Final = (*(f"R{i}{j}" for i in range(3) for j in range(3)), "x", "y", "z")
_EVENTS: Final = tuple(event.name.lower() for event in Event)
_GROUPS: Final[tuple[tuple[str, Iterable[str]], ...]] = (
    ("", ("counter_ms", "received_ns", "sent_ns", "elapsed", "w_good")),
    ("fast_", ("samples", "residual", "turn", "tooth", "ready", "separate", "slower", "change")),
    ("sensor_", _WRENCH),
    ("second_", ("fx", "fy", "fz", "sx", "sy", "sz")),
    ("pair_", ("used", "gap")),
    ("nominal_", _POSE),
    ("q", "123456"),
    ("wrench_", _WRENCH),
    ("actual_", _POSE),
    ("tracker_", ("late", "sigma")),
    ("torque_", "123456"),
    ("reported_", _POSE),
    ("flag_", ("elapsed", "force_age", "tracker_new", "tracker_age", "healthy", "arm", "enable", "stop", "reset")),
    ("flag_", ("soft", "hard", "sources", "current_age", "reported")),
    ("correction_", _TWIST),
    ("axis_", "123456"),
    ("used_", _WRENCH),
    ("predicted_", _WRENCH),
    ("filtered_", _WRENCH),
    ("deflection_", _TWIST),
    ("wanted_", _TWIST),
    ("deviation_", _TWIST),
    ("", ("path_distance", "sigma", "cutting")),
    ("factor_", ("feed", "across", "axial")),
    ("model_", ("feed", "across", "axial")),
    ("offset_", _TWIST),
    ("", ("uncertain",)),
    ("surprise_", ("force", "tracker", "currents")),
    ("out_", ("state", "cause", "feed_hold", "stop", "silent", "limits", "elastic", "soft", "hard", "sources")),
    ("out_", ("degraded", "doubt", "rejected")),
    ("force_", ("feed", "across", "tool")),
    ("expected_", ("feed", "across", "tool")),
    ("force_", ("size", "least", "most", "ratio")),
    ("value_", _EVENTS),
    ("limit_", _EVENTS),
    ("wear_", ("trend", "trend_sigma", "rise", "degrees")),
    ("", ("cut_m", "path_m", "speed_measured", "speed_asked")),
    ("event_", ("on", "new", "seen")),
    ("", ("slowed", "cycle")),
)
COLUMNS: Final = tuple(prefix + name for prefix, names in _GROUPS for name in names)
"""Names of a record's numbers: SI, part axes, angles in rad."""
_PLACES: Final = {name: place for place, name in enumerate(COLUMNS)}
_WHOLE: Final = ("counter_ms", "received_ns", "sent_ns", "elapsed", "w_good", "pair_used", "slowed", "cycle")


def column(name: str) -> int:
    """Place of a number in a record by its name, see :data:`COLUMNS`."""
    return _PLACES[name]


def is_whole(column: str) -> bool:
    """Return whether a column of :data:`COLUMNS` holds whole numbers only: counts, bits, states, times in ns."""
    return column in _WHOLE or column.startswith(("flag_", "out_", "event_"))


FAST: Final = 5
"""Place of what the force sensor's own samples said: given."""
SENSOR: Final = FAST + count_of(monitor.FAST)
SECOND: Final = SENSOR + 6
"""Place of what a second force sensor shows: six numbers, bits of those used, and by how much both differ in N."""
GIVEN: Final = SECOND + 8
FLAGS: Final = GIVEN + reals_and_words(records(_GIVEN))[0].size
RESULTS: Final = GIVEN + count_of(_GIVEN)
OUTCOME: Final = RESULTS + reals_and_words(records(_RESULT))[0].size
MONITOR: Final = RESULTS + count_of(_RESULT)
MONITOR_OUTCOME: Final = MONITOR + count_of(monitor.RESULTS)
CYCLE: Final = MONITOR_OUTCOME + count_of(monitor.OUTCOME)
"""Place of the loop's own count of cycles: 1 in its first, one more in each; a step says that records are lost."""
WIDTH: Final = CYCLE + 1
RING_BYTES: Final = _HEAD + ROWS * WIDTH * 8 + STATE_BYTES
"""Shared memory that a ring takes."""


class RecordRing:
    """The ring; made by one process, joined by the other by name.

    Args:
        name: None makes a new one; the name of an existing one joins it.

    Attributes:
        name: To join it.
        dropped: Reader: rows lost because it was too slow.
        states: Snapshots of the loop's state, beside the records.

    Raises:
        InputError: There is no ring of that name.
    """

    def __init__(self, name: str | None = None) -> None:
        try:
            self._memory, self._handle = _made() if name is None else _joined(name)
        except FileNotFoundError as fault:
            raise InputError("there is no such ring of records", value=name) from fault
        self._owner = name is None
        self.name = self._memory.name
        self._count: Int = np.ndarray((1,), dtype=np.int64, buffer=self._memory.buf)
        self._rows: Float = np.ndarray((ROWS, WIDTH), dtype=np.float64, buffer=self._memory.buf, offset=_HEAD)
        states: Int = np.ndarray(
            (STATE_BYTES // 8,), dtype=np.int64, buffer=self._memory.buf, offset=RING_BYTES - STATE_BYTES
        )
        self.states = StateSlots(states)
        if self._owner:
            self._count[0] = 0
        else:
            self.states.skip()
        self._read = int(self._count[0]) if not self._owner else 0
        self.dropped = 0

    def row(self) -> Float:
        """(WIDTH,) the row to be written next; then call :meth:`commit`."""
        out: Float = self._rows[int(self._count[0]) % ROWS]
        return out

    def commit(self) -> None:
        """Hand the row over."""
        self._count[0] += 1

    @property
    def count(self) -> int:
        """Rows handed over since the ring was made."""
        return int(self._count[0])

    @property
    def taken(self) -> int:
        """Reader: rows taken, or lost because it was too slow."""
        return self._read

    def take(self) -> Float:
        """(n, WIDTH) copies of the rows that are new since the last call."""
        count = int(self._count[0])
        first = max(self._read, count - MOST)
        self.dropped += first - self._read
        places = np.arange(first, count) % ROWS
        out: Float = self._rows[places].copy()
        self._read = count
        return out

    def rewind(self, skipped: int = 0) -> None:
        """Reader: take also what was written before it joined.

        Args:
            skipped: Rows at the beginning that are not taken.
        """
        self._read = skipped
        self.states.rewind()

    def close(self) -> None:
        """Leave the ring; the maker removes it, also where a row is still in use."""
        del self._count, self._rows, self.states
        try:
            self._memory.close()
        finally:
            if self._owner:
                _unlink(self._memory)
            if self._handle is not None:
                os.close(self._handle)


def _made() -> tuple[shared_memory.SharedMemory, int | None]:
    """A ring of a new name, held; another process may clear one between its making and its holding."""
    clear_unheld(_PLACE, _PREFIX)
    while True:
        name = _PREFIX + secrets.token_hex(4)
        try:
            memory = shared_memory.SharedMemory(name=name, create=True, size=RING_BYTES)
        except FileExistsError:
            continue
        handle = _hold(name)
        if handle is not None or (_PLACE / name).exists() or not _PLACE.is_dir():
            return memory, handle
        memory.close()
        _unlink(memory)


def _unlink(memory: shared_memory.SharedMemory) -> None:
    """Remove a ring; where another process has cleared it, Python's tracker still has it, and would warn of it."""
    try:
        memory.unlink()
    except FileNotFoundError:
        resource_tracker.unregister(f"/{memory.name}", "shared_memory")


def _joined(name: str) -> tuple[shared_memory.SharedMemory, int | None]:
    memory = shared_memory.SharedMemory(name=name)
    return memory, _hold(name)


def _hold(name: str) -> int | None:
    """A handle that holds the ring; None where there is none to hold."""
    try:
        handle = os.open(_PLACE / name, os.O_RDWR)
    except OSError:
        return None
    if share(handle):
        return handle
    os.close(handle)
    return None
