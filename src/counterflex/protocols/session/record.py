"""One cycle of a session as a row of the record ring, and now and then the loop's whole state beside it."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session.pair import PairSource
from counterflex.runtime import record_ring as record
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import RecordRing


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
