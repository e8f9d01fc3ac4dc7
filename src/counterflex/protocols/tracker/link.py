"""Receiver of the neutral tracker datagrams: drains to the newest good pose, or to the mean of a cycle's poses."""

from __future__ import annotations

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.records import Record, records
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
        self._most = float(mean_of)
        self.address = host, port
        if inbox is None:
            inbox, self.address = listening(host, port)
        super().__init__(inbox, records(reading.RECEIVED), peers)
        r: Record = self._received[0]
        r.status = BEAM_BROKEN
        self._status: Int = self._received["status"]
        self._time: Int = self._received["time_ns"]
        self._values: Float = r.values
        self._spare: Float = np.zeros((4, 4))
        self._mean_ns = -1
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
        if self._most > 1.0:
            for name in ("poses", "count", "first_ns", "later_ns"):
                self._received[name] = 0.0
        fresh = drain_poses(inbox.fd, self._table.rows) if inbox.many else self._drain_singly()
        if fresh and self._most > 1.0:
            after = reading.mean_pose(self._received, self._most, self.T_tracker_target)
            self._mean_ns = -1 if after < 0.0 else int(self._received["first_ns"][0] + after)
        return fresh

    def _drain_singly(self) -> bool:
        inbox, fresh = self._inbox, False
        for count in batches(inbox):
            fresh |= reading.take_poses(
                inbox.data, inbox.lengths, inbox.hosts, count, self._allowed,
                self.T_tracker_target, self._spare, self._received,
            )  # fmt: skip
        return bool(fresh and not self.status & reading.UNUSABLE)

    @property
    def time_ns(self) -> int:
        """Time of the newest good pose, or mean time of the mean, by the clock of the source."""
        return int(self._time[0]) if self._mean_ns < 0 else self._mean_ns

    @property
    def sigma_m(self) -> float:
        """Standard deviation that the source states for it; 0 where it does not."""
        return float(self._values[7]) * MM

    @property
    def status(self) -> int:
        """Its status bits, or those of a broken beam that came after it."""
        return int(self._status[0])
