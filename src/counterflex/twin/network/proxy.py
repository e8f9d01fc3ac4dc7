"""A bad network on real sockets: carries datagrams both ways, loses, delays, copies and damages them, and logs it.

Whoever begins (a controller, or the client of a sensor) sends to the proxy's address; the proxy hands on to the other
side from a port of its own and carries what comes back. What it did is logged, datagram by datagram, so that a run can
be repeated from the log with no seed and no settings.
"""

from __future__ import annotations

import contextlib
import csv
import heapq
import itertools
import select
import socket
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, Protocol, TextIO

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError, OutputError
from counterflex.twin.network.impairment import Delivery

THERE: Final = 0
"""Way from the side that began to the other."""
BACK: Final = 1
WAYS: Final = ("there", "back")
COLUMNS: Final = ("time_s", "way", "number", "bytes", "copies", "delay_s", "flip", "keep", "garbage")
_LARGEST: Final = 65536
_LONGEST_WAIT_S: Final = 0.2


class Decider(Protocol):
    """Decider on the fate of datagrams of one way."""

    def decide(self, n: int) -> tuple[Delivery, ...]:
        """Deliveries of datagram n."""


class Recorded:
    """The decisions of a log, once more; datagrams beyond its end are left alone.

    Args:
        deliveries: What arrived of each datagram, by its number.
    """

    def __init__(self, deliveries: dict[int, tuple[Delivery, ...]]) -> None:
        self._deliveries = deliveries

    def decide(self, n: int) -> tuple[Delivery, ...]:
        """Deliveries of datagram n, as they were."""
        return self._deliveries.get(n, (Delivery(),))


class DecisionLog:
    """Writes decisions, a row per copy that arrives and one for a datagram of which none does.

    Args:
        stream: Text file to write to.
    """

    def __init__(self, stream: TextIO) -> None:
        self._writer = csv.writer(stream, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def add(self, time_s: float, way: int, number: int, length: int, copies: tuple[Delivery, ...]) -> None:
        """One datagram: when it came, which way, its number and length, and what is made of it."""
        head = [f"{time_s:.6f}", WAYS[way], number, length, len(copies)]
        if not copies:
            self._writer.writerow([*head, "", "", "", ""])
        for copy in copies:
            flip, garbage = "" if copy.flip is None else repr(copy.flip), "" if copy.garbage is None else copy.garbage
            self._writer.writerow([*head, repr(copy.delay_s), flip, repr(copy.keep), garbage])


def read_decisions(path: Path) -> tuple[Recorded, Recorded]:
    """Decisions of a log, there and back. Raises FileFormatError: it is none."""
    decisions: tuple[dict[int, tuple[Delivery, ...]], dict[int, tuple[Delivery, ...]]] = ({}, {})
    hint = f"twin proxy --log writes one, with columns {', '.join(COLUMNS)}"
    text = file_content.text(path, hint)
    with file_content.readable(path, "a log of the proxy", hint):
        rows = csv.DictReader(text.splitlines())
        if tuple(rows.fieldnames or ()) != COLUMNS:
            raise FileFormatError("not a log of the proxy", where=str(path), hint=hint)
        for row in rows:
            if None in row or None in row.values():
                raise FileFormatError(
                    "a row of another length", where=f"{path}:{rows.line_num}", limit=f"{len(COLUMNS)} cells", hint=hint
                )
            way, number = decisions[WAYS.index(row["way"])], int(row["number"])
            copies = way.get(number, ())
            way[number] = (*copies, *_delivery(row))
    return Recorded(decisions[THERE]), Recorded(decisions[BACK])


def _delivery(row: dict[str, str]) -> tuple[Delivery, ...]:
    if int(row["copies"]) == 0:
        return ()
    flip = float(row["flip"]) if row["flip"] else None
    garbage = int(row["garbage"]) if row["garbage"] else None
    return (Delivery(float(row["delay_s"]), flip, float(row["keep"]), garbage),)


class UdpProxy:
    """Carries datagrams between the sender and another address.

    Args:
        listen: Address to send to.
        target: Where they go.
        there: Decides on what goes to ``target``.
        back: Decides on what comes from it.
        clock: Seconds, monotonic.

    Attributes:
        address: Where it listens.
        carried: Datagrams that came, there and back.
        lost: Of them, those of which nothing arrived.

    Raises:
        OutputError: The address cannot be bound.
    """

    def __init__(
        self,
        listen: tuple[str, int],
        target: tuple[str, int],
        there: Decider,
        back: Decider,
        *,
        log: DecisionLog | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._rear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._front.bind(listen)
            self._rear.connect(target)
        except OSError as fault:
            self.close()
            raise OutputError(
                f"the proxy cannot stand between these: {fault.strerror or fault}",
                where=f"{listen[0]}:{listen[1]} to {target[0]}:{target[1]}",
            ) from fault
        self._front.setblocking(False)
        self._rear.setblocking(False)
        self.address: tuple[str, int] = self._front.getsockname()
        self._deciders, self._log, self._clock = (there, back), log, clock
        self._begin = clock()
        self._peer: tuple[str, int] | None = None
        self._queue: list[tuple[float, int, int, bytes]] = []
        self._tie = itertools.count()
        self.carried = [0, 0]
        self.lost = [0, 0]

    def step(self, wait_s: float = 0.0) -> None:
        """Take what has come and hand on what is due.

        Args:
            wait_s: Longest wait for something to do.
        """
        now = self._clock() - self._begin
        due = self._queue[0][0] - now if self._queue else wait_s
        ready, _, _ = select.select([self._front, self._rear], [], [], max(0.0, min(wait_s, due)))
        now = self._clock() - self._begin
        for own in ready:
            for data in self._take(own):
                self._decide(THERE if own is self._front else BACK, data, now)
        while self._queue and self._queue[0][0] <= self._clock() - self._begin:
            _, _, way, data = heapq.heappop(self._queue)
            self._hand_on(way, data)

    def run(self, seconds: float | None = None, *, ended: Callable[[], bool] = lambda: False) -> None:
        """Carry until the time is over, or for ever.

        Args:
            ended: Asked now and then whether to stop.
        """
        end = None if seconds is None else self._clock() + seconds
        while not ended() and (end is None or self._clock() < end):
            self.step(_LONGEST_WAIT_S if end is None else min(_LONGEST_WAIT_S, max(0.0, end - self._clock())))

    def _take(self, own: socket.socket) -> Iterable[bytes]:
        while True:
            try:
                data, peer = own.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except ConnectionError:  # nobody listens there yet
                continue
            if own is self._front:
                self._peer = peer
            yield data

    def _decide(self, way: int, data: bytes, now: float) -> None:
        number = self.carried[way]
        self.carried[way] += 1
        copies = self._deciders[way].decide(number)
        self.lost[way] += int(not copies)
        if self._log is not None:
            self._log.add(now, way, number, len(data), copies)
        for copy in copies:
            heapq.heappush(self._queue, (now + copy.delay_s, next(self._tie), way, copy.of(data)))

    def _hand_on(self, way: int, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionError):
            if way == THERE:
                self._rear.send(data)
            elif self._peer is not None:
                self._front.sendto(data, self._peer)

    def close(self) -> None:
        """Free the sockets."""
        self._front.close()
        self._rear.close()
