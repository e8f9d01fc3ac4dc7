"""Receiver of the neutral tracker datagrams: drains to the newest good pose, or to the mean of a cycle's poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import Record, attributes, records
from counterflex.core.units import MM
from counterflex.protocols.system.datagrams import DatagramLink, Inbox, batches, listening
from counterflex.protocols.tracker import kernel as reading
from counterflex.protocols.tracker.drain_kernel import ARRAYS, drain_poses
from counterflex.protocols.tracker.telegram import BEAM_BROKEN


class TrackerLink(DatagramLink):
    """Poses of a tracker's target.

    Args:
        host: Address to listen on; loopback unless told otherwise.
        port: UDP port; 0 takes a free one.
        peers: Addresses that are listened to; None takes the first that sends a good datagram.
        mean_of: Largest number of good poses of one :meth:`drain` of which the mean is taken, time stamp included: a
            tracker of 1 kHz then has half the noise at 4 ms. Where more have piled up, or with 1, the newest counts.
        inbox: Where the datagrams come in; None opens the port.

    Attributes:
        address: Where datagrams are expected.
        T_tracker_target: (4, 4) newest good pose, or mean.

    Raises:
        InputError: ``mean_of`` is below 1.
        OutputError: The port cannot be opened.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        peers: tuple[str, ...] | None = None,
        *,
        mean_of: int = 1,
        inbox: Inbox | None = None,
    ) -> None:
        if mean_of < 1:
            raise InputError("number of poses of which the mean is taken", value=mean_of, limit=">= 1")
        self.address = host, port
        if inbox is None:
            inbox, self.address = listening(host, port)
        super().__init__(inbox, records(reading.RECEIVED), peers)
        r: Record = self._received[0]
        r.status, r.most = BEAM_BROKEN, float(mean_of)
        self._now: Any = attributes(self._received)
        self._spare: Float = np.zeros((4, 4))
        self.T_tracker_target: Float = np.eye(4)
        self._table = ArrayTable(
            ARRAYS,
            **self._inbox.arrays(),
            allowed=self._allowed,
            pose=self.T_tracker_target,
            spare=self._spare,
            received=self._received,
        )

    def drain(self) -> bool:
        """Take every datagram that is there; returns whether a new good pose is among them."""
        inbox = self._inbox
        return drain_poses(inbox.fd, not inbox.many and self._one_by_one(), self._table.rows)

    def _one_by_one(self) -> bool:
        inbox, received, fresh = self._inbox, self._received, False
        for name in ("poses", "count", "first_ns", "later_ns"):
            received[name] = 0.0
        for count in batches(inbox):
            fresh |= reading.take_poses(
                inbox.data, inbox.lengths, inbox.hosts, count, self._allowed,
                self.T_tracker_target, self._spare, received,
            )  # fmt: skip
        return bool(fresh)

    def compiled(self) -> tuple[int, ArrayTable]:
        """Socket and table of :func:`.drain_poses`; -1 where datagrams are taken one by one."""
        return self._inbox.fd if self._inbox.many else -1, self._table

    @property
    def time_ns(self) -> int:
        """Time of the newest good pose, or mean time of the mean, by the clock of the source."""
        return int(self._now.pose_ns)

    @property
    def sigma_m(self) -> float:
        """Standard deviation that the source states for it; 0 where it does not."""
        return float(self._now.values[7]) * MM

    @property
    def status(self) -> int:
        """Its status bits, or those of a broken beam that came after it."""
        return int(self._now.status)
