"""A simulated TwinCAT on a real socket: ADS over TCP, symbols read and written by name, handle or place."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import OutputError, ProtocolError
from counterflex.integrations.beckhoff.link import telegram as ads
from counterflex.twin.network.faults import FaultSchedule

FAULTS: Final = ("silent", "dying", "frozen", "nan")
"""Faults of the device itself that it can show; of the way it shows lost, late and garbage answers."""
_RUN: Final = 5
_TICK_S: Final = 0.05


@dataclass
class PlcVariable:
    """A variable of the simulated PLC."""

    kind: str = "LREAL"  # Type, as :data:`counterflex.integrations.beckhoff.link.telegram.TYPES` names it
    value: float = 0.0  # What it holds, in the PLC's own unit; used until somebody writes it
    # What it holds at a time, s since the start; takes the place of ``value``
    source: Callable[[float], float] | None = None
    comment: str = ""  # Of the PLC program


class _AdsFault(Exception):
    """A request that is answered by an error code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(hex(code))


class AdsServer:
    """The device's side. Every connection has a thread of its own.

    Args:
        variables: By name; upper and lower case count as the same, as in a PLC.
        host: Address to bind.
        port: TCP port; clients that follow Beckhoff's own library expect 48898.
        ams_port: Of the PLC.
        faults: Scripted, by the time since the start and the numbers of requests.

    Raises:
        OutputError: The port cannot be opened.
        ProtocolError: A variable of an unknown type, or one whose value does not fit.
    """

    def __init__(
        self,
        variables: dict[str, PlcVariable],
        *,
        host: str = "127.0.0.1",
        port: int = ads.TCP_PORT,
        ams_port: int = ads.PLC_PORT,
        faults: FaultSchedule | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._faults = faults if faults is not None else FaultSchedule()
        self._faults.require(FAULTS, "a TwinCAT")
        self._names = list(variables)
        self._place = {name.upper(): k for k, name in enumerate(self._names)}
        self._variables = list(variables.values())
        self._memory = [ads.pack(one.kind, one.value) for one in self._variables]
        self._ams_port, self._clock, self._start = ams_port, clock, clock()
        self._lock = threading.Lock()
        self.requests = 0  # Taken so far
        self.version = 1  # Of its symbols
        self.dead = False  # It never answers again
        self._ending = False
        self._threads: list[threading.Thread] = []
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind((host, port))
            self._listener.listen()
        except OSError as fault:
            self._listener.close()
            raise OutputError(
                f"the port cannot be opened: {fault.strerror or fault}",
                where=f"{host}:{port}",
                hint="Is another program there, or a real TwinCAT on this computer?",
            ) from fault
        self.address: tuple[str, int] = self._listener.getsockname()  # Where it listens
        self._listener.settimeout(_TICK_S)
        self._begin(self._accept)

    def value(self, name: str) -> float:
        """Value of a variable now, in its type."""
        place = self._place[name.upper()]
        with self._lock:
            return ads.unpack(self._variables[place].kind, self._content(place, frozen=False))

    def _begin(self, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while not self._ending:
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            self._begin(lambda taken=connection: self._serve(taken))  # type: ignore[misc]

    def _serve(self, connection: socket.socket) -> None:
        connection.settimeout(_TICK_S)
        with connection, contextlib.suppress(ConnectionError, ProtocolError):
            while not self._ending:
                head = self._receive(connection, ads.HEADER)
                data = self._receive(connection, ads.read_header(head))
                index, time_s = self.requests, self._clock() - self._start
                self.requests += 1
                condition = self._faults.condition(index, time_s)
                if condition.dead:
                    self.dead = True
                    return
                if condition.silent:
                    continue
                frame = ads.read_frame(head + data)
                reply = self._answer(frame, condition.frozen, condition.not_a_number).telegram()
                for delivery in self._faults.deliveries(reply, index, time_s):
                    if delivery.late_s:
                        time.sleep(delivery.late_s)  # a stream: what follows waits behind it
                    connection.sendall(delivery.data)

    def _receive(self, connection: socket.socket, size: int) -> bytes:
        data = b""
        while len(data) < size:
            if self._ending:
                raise ConnectionError
            try:
                part = connection.recv(size - len(data))
            except TimeoutError:
                continue
            if not part:
                raise ConnectionError
            data += part
        return data

    def _answer(self, request: ads.AmsFrame, frozen: bool, not_a_number: bool) -> ads.AmsFrame:
        if request.target[1] != self._ams_port:
            return request.answered(b"", ads.NO_TARGET_PORT)
        with self._lock:
            try:
                data = self._execute(request.command, request.data, frozen, not_a_number)
            except _AdsFault as fault:
                filler = b"\0\0\0\0" if request.command in (ads.READ, ads.READ_WRITE) else b""
                return request.answered(struct.pack("<I", fault.code) + filler)
            except struct.error:
                return request.answered(struct.pack("<II", ads.WRONG_DATA, 0))
        return request.answered(struct.pack("<I", 0) + data)

    def _execute(self, command: int, data: bytes, frozen: bool, not_a_number: bool) -> bytes:
        if command == ads.READ_DEVICE_INFO:
            return struct.pack("<BBH16s", 3, 1, 4024, b"counterflex twin")
        if command == ads.READ_STATE:
            return struct.pack("<HH", _RUN, 0)
        if command == ads.READ:
            group, offset, length = struct.unpack("<III", data)
            content = self._read(group, offset, length, frozen, not_a_number)
            return struct.pack("<I", len(content)) + content
        if command == ads.WRITE:
            group, offset, length = struct.unpack_from("<III", data)
            if len(data) != 12 + length:
                raise _AdsFault(ads.WRONG_SIZE)
            self._write(group, offset, data[12:])
            return b""
        if command == ads.READ_WRITE:
            group, offset, longest, length = struct.unpack_from("<IIII", data)
            if len(data) != 16 + length:
                raise _AdsFault(ads.WRONG_SIZE)
            content = self._read_write(group, offset, data[16:], frozen, not_a_number)
            return struct.pack("<I", len(content[:longest])) + content[:longest]
        raise _AdsFault(ads.NOT_SUPPORTED)

    def _content(self, place: int, *, frozen: bool, not_a_number: bool = False) -> bytes:
        variable = self._variables[place]
        if not_a_number and ads.TYPES[variable.kind][1] in "fd":
            return ads.pack(variable.kind, math.nan)
        if variable.source is not None and not frozen:
            self._memory[place] = ads.pack(variable.kind, variable.source(self._clock() - self._start))
        return self._memory[place]

    def _at(self, group: int, offset: int) -> int:
        """Place of a variable by handle or by index group and offset."""
        if group == ads.VALUE_BY_HANDLE:
            place = offset - 1
        elif group == ads.PLC_MEMORY:
            place, rest = divmod(offset, 8)
            place = place if rest == 0 else -1
        else:
            raise _AdsFault(ads.NO_GROUP)
        if not 0 <= place < len(self._variables):
            raise _AdsFault(ads.NO_SYMBOL if group == ads.VALUE_BY_HANDLE else ads.NO_OFFSET)
        return place

    def _read(self, group: int, offset: int, length: int, frozen: bool, not_a_number: bool) -> bytes:
        if group == ads.UPLOAD_INFO:
            entries = self._entries()
            return struct.pack("<IIIIII", len(entries), sum(map(len, entries)), 0, 0, 0, 0)[:length]
        if group == ads.UPLOAD:
            return b"".join(self._entries())[:length]
        if group == ads.SYMBOL_VERSION:
            return bytes([self.version])
        content = self._content(self._at(group, offset), frozen=frozen, not_a_number=not_a_number)
        if length < len(content):
            raise _AdsFault(ads.WRONG_SIZE)
        return content

    def _write(self, group: int, offset: int, data: bytes) -> None:
        if group == ads.RELEASE_HANDLE:
            return
        place = self._at(group, offset)
        if len(data) != len(self._memory[place]):
            raise _AdsFault(ads.WRONG_SIZE)
        self._memory[place] = data
        self._variables[place].source = None

    def _read_write(self, group: int, offset: int, data: bytes, frozen: bool, not_a_number: bool) -> bytes:
        if group in (ads.HANDLE_BY_NAME, ads.INFO_BY_NAME):
            name = data.rstrip(b"\0").decode("ascii", "replace").upper()
            if name not in self._place:
                raise _AdsFault(ads.NO_SYMBOL)
            place = self._place[name]
            return struct.pack("<I", place + 1) if group == ads.HANDLE_BY_NAME else self._entry(place)
        if group == ads.SUM_READ:
            codes, contents = [], []
            requests = [struct.unpack_from("<III", data, 12 * k) for k in range(offset)]
            if 4 * offset + sum(length for _, _, length in requests) > ads.LONGEST // 2:
                raise _AdsFault(ads.WRONG_SIZE)
            for its_group, its_offset, length in requests:
                try:
                    content, code = self._read(its_group, its_offset, length, frozen, not_a_number), 0
                except _AdsFault as fault:
                    content, code = b"", fault.code
                codes.append(struct.pack("<I", code))
                contents.append(content[:length].ljust(length, b"\0"))
            return b"".join((*codes, *contents))
        if group == ads.SUM_WRITE:
            places = [struct.unpack_from("<III", data, 12 * k) for k in range(offset)]
            at, codes = 12 * offset, []
            for place_group, place_offset, length in places:
                try:
                    self._write(place_group, place_offset, data[at : at + length])
                    codes.append(struct.pack("<I", 0))
                except _AdsFault as fault:
                    codes.append(struct.pack("<I", fault.code))
                at += length
            return b"".join(codes)
        raise _AdsFault(ads.NO_GROUP)

    def _entry(self, place: int) -> bytes:
        variable = self._variables[place]
        return ads.symbol_entry(self._names[place], variable.kind, ads.PLC_MEMORY, 8 * place, variable.comment)

    def _entries(self) -> list[bytes]:
        return [self._entry(place) for place in range(len(self._variables))]

    def close(self) -> None:
        """Hang up and free the port."""
        self._ending = True
        self._listener.close()
        for thread in self._threads:
            thread.join(5.0)
