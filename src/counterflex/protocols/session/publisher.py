"""Shows every cycle of a session as a snapshot, after the answer has gone out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.processes.control_array import Panel
from counterflex.protocols.processes.snapshot import SnapshotSlots
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session import snapshot_kernel as own
from counterflex.protocols.session.pair import PairSource
from counterflex.runtime import record_ring as record
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import RecordRing

_PANEL = int(Panel.NS)


class RecordWriter:
    """Writes what a cycle was given and what it gave into the ring.

    Args:
        loop: Its arrays stay where they are.
        force: Force sensor, or None.
    """

    def __init__(self, ring: RecordRing, link: RobotLink, loop: Loop, force: ForceSource | None) -> None:
        self._ring, self._link, self._loop, self._force = ring, link, loop, force
        self._pair = force if isinstance(force, PairSource) else None
        self._head: Float = np.zeros(record.FAST)
        self._sensor: Float = np.zeros(record.SECOND - record.SENSOR)
        self._second: Float = np.zeros(record.GIVEN - record.SECOND)
        fast, tests, events = loop.monitor.columns
        # In the order of a row: one call copies them all.
        self._parts: list[Float | Int] = [self._head, fast, self._sensor, self._second]
        self._parts += [*loop.inputs, *loop.answers, tests, events, loop.cycles]

    def write(self, received: int, sent: int) -> None:
        """Write a cycle, as the loop left it.

        Args:
            received: When the telegram had come, ns, monotonic.
            sent: When the answer was out.
        """
        ring, link, loop, force, second = self._ring, self._link, self._loop, self._force, self._second
        good = 0.0
        if force is not None:
            self._sensor[:], good = force.w_sensor, force.good
        if self._pair is not None:
            second[:6], second[-2], second[-1] = self._pair.record
        self._head[:] = link.counter, received, sent, link.elapsed, good
        np.concatenate(self._parts, out=ring.row(), casting="unsafe")
        ring.commit()
        cycle = loop.cycle
        if cycle % loop.state_cycles == 0:
            ring.states.put(cycle, received, loop.memory)


class Publisher:
    """Writes the snapshots of a session.

    Args:
        about: What the run is, for whoever reads them.
        loop: As each cycle leaves it.
        counters: Of the robot's link.
        control: Shared, see :mod:`counterflex.protocols.processes.control_array`.

    Raises:
        InputError: No such memory.
    """

    def __init__(self, path: Path, about: Mapping[str, Any], loop: Loop, counters: Counters, control: Int) -> None:
        self._slots = SnapshotSlots(path, about)
        self._counters, self._control = counters, control
        (self._records, plan), self._monitor = loop.records, loop.monitor.records[2]
        commanded: Float = plan["point"]
        points = commanded - plan["contained"][:, :3]
        self._lengths: Float = own.lengths_of(points if loop.planned else points[:0])
        self._own: Int = np.zeros(own.OWN, dtype=np.int64)
        self._incident: Int = np.zeros(own.LATCHED, dtype=np.int64)
        self._numbers = self._slots.numbers

    def show(self, now_ns: int, received_ns: int, compute_ns: int, *, cycles: int, elapsed: int, trouble: bool) -> None:
        """Write the snapshot of a cycle.

        Args:
            now_ns: Monotonic.
            received_ns: When its telegram came.
            compute_ns: From then to the answer.
            cycles: Telegrams so far.
            elapsed: Cycles of the controller since the telegram before.
            trouble: The loop's own program failed.
        """
        slots, control = self._slots, self._control
        place = slots.begin()
        self._own[:] = (
            slots.number + 1,
            now_ns,
            received_ns,
            compute_ns,
            cycles,
            elapsed,
            self._counters.sender,
            trouble,
            own.panel_state(int(control[_PANEL]), now_ns),
        )
        own.fill(
            self._records,
            self._monitor,
            self._lengths,
            control,
            self._own,
            self._incident,
            slots.slots,
            self._numbers,
            place,
        )
        slots.commit()

    def end(self) -> None:
        """The loop has ended by itself."""
        self._slots.end()
