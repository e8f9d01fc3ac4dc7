"""A line that carries datagrams as a fault schedule says: some never, some late, some twice, some as something else."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

from counterflex.twin.network.faults import Direction, FaultSchedule, FaultyDelivery


class FaultyLine:
    """One direction of a connection. It has no clock of its own: every call says what time it is.

    Args:
        direction: Which of them are its.

    Attributes:
        offered: Datagrams put in so far.
        carried: Datagrams that came out so far.
    """

    def __init__(self, schedule: FaultSchedule, direction: Direction = "out") -> None:
        self._schedule, self._direction, self._spared = schedule, direction, schedule.spares(direction)
        self._late: list[tuple[float, int, bytes]] = []
        self._delayed: list[tuple[int, FaultyDelivery]] = []
        self._order = 0
        self.offered = self.carried = 0

    def put(self, data: bytes, time_s: float, deliver: Callable[[bytes], None]) -> None:
        """Put a datagram in; what is due comes out, the late ones of before first.

        Args:
            time_s: Now, s since the start; never less than in the call before.
            deliver: Told every datagram that comes out.
        """
        if self._spared:
            deliver(data)
            self.offered += 1
            self.carried += 1
            return
        self.release(time_s, deliver)
        waiting, self._delayed = self._delayed, []
        for delivery in self._schedule.deliveries(data, self.offered, time_s, self._direction):
            if delivery.overtaken_by:
                self._delayed.append((self.offered + delivery.overtaken_by, delivery))
            else:
                self._carry(delivery, time_s, deliver)
        for after, delivery in waiting:
            if after <= self.offered:
                self._carry(delivery, time_s, deliver)
            else:
                self._delayed.append((after, delivery))
        self.offered += 1

    def release(self, time_s: float, deliver: Callable[[bytes], None]) -> None:
        """Let out the late datagrams whose time has come, in the order of their times."""
        while self._late and self._late[0][0] <= time_s:
            deliver(heapq.heappop(self._late)[2])
            self.carried += 1

    def due_s(self) -> float:
        """Time at which the next late datagram comes out, s since the start; infinite where none is waiting."""
        return self._late[0][0] if self._late else math.inf

    def _carry(self, delivery: FaultyDelivery, time_s: float, deliver: Callable[[bytes], None]) -> None:
        if delivery.late_s > 0.0:
            self._order += 1
            heapq.heappush(self._late, (time_s + delivery.late_s, self._order, delivery.data))
        else:
            deliver(delivery.data)
            self.carried += 1
