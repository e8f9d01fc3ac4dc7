"""Receiver of the neutral tracker datagrams: drains to the newest good pose."""

from __future__ import annotations

import socket

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError, ProtocolError
from counterflex.wire.tracker_pose import BEAM_BROKEN, INACCURATE, read_pose


class TrackerLink:
    """Poses of a tracker's target.

    Args:
        host: Address to listen on; loopback unless told otherwise.
        port: UDP port; 0 takes a free one.
        peers: Addresses that are listened to; None takes the first that sends.

    Attributes:
        address: Where datagrams are expected.
        T_tracker_target: (4, 4) newest good pose.
        time_ns: When it was measured, clock of the source.
        sigma_m: Standard deviation that the source states; 0 where it does not.
        status: Its status bits, or those of a broken beam that came after it.
        lost: Datagrams lost, in all.
        malformed: Datagrams that are none, in all.
        foreign: From another address.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0, peers: tuple[str, ...] | None = None) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the port cannot be opened: {fault.strerror or fault}",
                where=f"{host}:{port}",
                hint="Is another program listening there?",
            ) from fault
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._peers, self._peer = peers, ""
        self.T_tracker_target: Float = np.eye(4)
        self.time_ns, self.sigma_m = 0, 0.0
        self.status = BEAM_BROKEN
        self._sequence = -1
        self.lost = self.malformed = self.foreign = 0

    def drain(self) -> bool:
        """Take every datagram that is there; returns whether a new good pose is among them."""
        fresh = False
        newest = b""
        while True:
            try:
                data, peer = self._socket.recvfrom(2048)
            except BlockingIOError:
                break
            except ConnectionError:
                continue
            if not self._known(peer[0]):
                self.foreign += 1
                continue
            newest = data
            fresh |= self._take(data)
        return fresh and newest != b"" and not self.status & (BEAM_BROKEN | INACCURATE)

    def _known(self, host: str) -> bool:
        if self._peers is not None:
            return host in self._peers
        if not self._peer:
            self._peer = host
        return host == self._peer

    def _take(self, data: bytes) -> bool:
        try:
            measured = read_pose(data)
        except ProtocolError:
            self.malformed += 1
            return False
        step = (measured.sequence - self._sequence) & 0xFFFFFFFF if self._sequence >= 0 else 1
        if step == 0 or step > 0x80000000:
            return False
        self.lost += step - 1
        self._sequence = measured.sequence
        self.status = measured.status
        if measured.status & (BEAM_BROKEN | INACCURATE):
            return False
        self.T_tracker_target = measured.T_tracker_target
        self.time_ns, self.sigma_m = measured.time_ns, measured.sigma_m
        return True

    def close(self) -> None:
        """Free the port."""
        self._socket.close()
