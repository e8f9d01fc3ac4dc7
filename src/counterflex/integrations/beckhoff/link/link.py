"""Client of a TwinCAT over Beckhoff ADS: numbers by symbol name, converted to SI; never in the loop's own process.

A reading takes about a millisecond on a network, now and then many: parameters, slow measurements, monitoring. The
package pyads carries Beckhoff's own library; it is an extra (``pip install 'counterflex[ads]'``).
"""

from __future__ import annotations

import contextlib
import importlib
import math
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Final

from counterflex.core.errors import InputError, OutputError, ProtocolError
from counterflex.core.units import MS
from counterflex.integrations.beckhoff.link import telegram as ads

_RUN: Final = 5
_LARGEST: Final = 500  # Symbols of one sum request that every TwinCAT answers


@dataclass(frozen=True)
class AdsSymbol:
    """A number in the PLC."""

    name: str  # What it is here
    symbol: str  # Its name in the PLC
    si: float = 1.0  # SI value of the PLC's unit
    writable: bool = False  # It may be written
    low: float = -math.inf  # Smallest value that may be written, SI
    high: float = math.inf  # Largest


@dataclass(frozen=True)
class AdsSettings:
    """Address of a TwinCAT."""

    net_id: str  # Its AMS net id
    host: str  # Its address
    port: int = ads.PLC_PORT  # AMS port of the PLC
    local_net_id: str = ""  # Of this computer, as the TwinCAT's route names it; empty: its address with ``.1.1``
    timeout_s: float = 1.0  # Longest time for an answer


@dataclass(frozen=True)
class DeviceSymbol:
    """A variable that a device has: name, type and comment."""

    name: str
    kind: str
    comment: str


class AdsLink:
    """A connection that reads and writes a fixed list of symbols.

    Args:
        settings: Where.
        symbols: Which.

    Attributes:
        kinds: Type in the PLC of each symbol, by its name here.

    Raises:
        InputError: pyads is missing.
        ProtocolError: A net id is none.
        OutputError: The device cannot be reached, does not answer, does not run, or lacks a symbol.
    """

    def __init__(self, settings: AdsSettings, symbols: tuple[AdsSymbol, ...] = ()) -> None:
        self.settings, self.symbols = settings, symbols
        self._where = f"{settings.host} ({settings.net_id}:{settings.port})"
        ads.net_id_bytes(settings.net_id)
        if settings.local_net_id:
            ads.net_id_bytes(settings.local_net_id)
        self._pyads: Any = _pyads()
        self._by_name = {one.name: one for one in symbols}
        if len(self._by_name) != len(symbols):
            raise InputError("two symbols have one name", value=", ".join(sorted(one.name for one in symbols)))
        self._reach()
        self._connection: Any = None
        self.kinds: dict[str, str] = {}
        self._places: dict[str, tuple[int, int, int]] = {}
        try:
            self._connect()
            self._version = self._symbol_version()
            for one in symbols:
                self._find(one)
        except BaseException:
            self.close()
            raise

    def _reach(self) -> None:
        """Look whether anybody is there at all: Beckhoff's library waits for minutes."""
        try:
            socket.create_connection((self.settings.host, ads.TCP_PORT), self.settings.timeout_s).close()
        except OSError as fault:
            raise OutputError(
                f"the TwinCAT cannot be reached: {fault.strerror or fault}",
                where=f"{self.settings.host}:{ads.TCP_PORT}",
                hint="Check address, cable and firewall",
            ) from fault

    def _connect(self) -> None:
        pyads, settings = self._pyads, self.settings
        with self._explained("the TwinCAT does not take the connection"):
            pyads.open_port()
            if settings.local_net_id:
                pyads.set_local_address(settings.local_net_id)
            if sys.platform.startswith("linux"):
                pyads.add_route(settings.net_id, settings.host)
            self._connection = pyads.Connection(settings.net_id, settings.port, settings.host)
            self._connection.open()
            self._connection.set_timeout(max(1, round(settings.timeout_s / MS)))
            state = self._connection.read_state()
        if state is None or state[0] != _RUN:
            raise OutputError(
                "the PLC does not run", where=self._where, value=f"state {state[0] if state else None}", limit=_RUN
            )

    def _symbol_version(self) -> int | None:
        """Version of the device's symbols; None where it has none."""
        try:
            return int(self._connection.read(ads.SYMBOL_VERSION, 0, self._pyads.PLCTYPE_USINT))
        except (self._pyads.ADSError, RuntimeError):
            return None

    def _find(self, one: AdsSymbol) -> None:
        """Store type and place of a symbol."""
        with self._explained(
            f"the symbol '{one.symbol}' cannot be found", hint="counterflex ads list shows what is there"
        ):
            entry = self._connection.get_symbol(one.symbol)
            kind = str(entry.symbol_type).strip("\0 ")
        if kind not in ads.TYPES:
            raise OutputError(
                f"the symbol '{one.symbol}' is no number", where=self._where, value=kind, limit=", ".join(ads.TYPES)
            )
        self.kinds[one.name] = kind
        self._places[one.name] = entry.index_group, entry.index_offset, len(ads.pack(kind, 0.0))

    def device_symbols(self) -> list[DeviceSymbol]:
        """Everything that the device has. Raises OutputError: it does not tell."""
        with self._explained("the symbols cannot be listed"):
            symbols = self._connection.get_all_symbols()
        texts = [(str(one.name), str(one.symbol_type), str(one.comment or "")) for one in symbols]
        return [DeviceSymbol(*(text.strip("\0 ") for text in row)) for row in texts]

    def read(self) -> dict[str, float]:
        """All symbols in one exchange, SI, by their names here; NaN and infinity are handed on as they are.

        Raises:
            OutputError: No answer in time, or an error of the device.
        """
        out: dict[str, float] = {}
        for at in range(0, len(self.symbols), _LARGEST):
            out |= self._exchange(self.symbols[at : at + _LARGEST])
        return out

    def _exchange(self, symbols: tuple[AdsSymbol, ...]) -> dict[str, float]:
        # pyads' own list reading takes what a short answer lacks for zeros, and reads on in the old places behind a
        # change of the PLC's program: other variables may lie there.
        pyads, places = self._pyads, [self._places[one.name] for one in symbols]
        if self._version is not None:
            places.append((ads.SYMBOL_VERSION, 0, 1))
        requests = (pyads.structs.SAdsSumRequest * len(places))(*places)
        with self._explained("the symbols cannot be read"):
            answer = bytes(
                pyads.pyads_ex.adsSyncReadWriteReqEx2(
                    self._connection._port, self._connection._adr, ads.SUM_READ, len(places), None, requests, None, True
                )
            )
        at, parts = 4 * len(places), []
        for *_, size in places:
            parts.append(answer[at : at + size])
            at += size
        codes = [int.from_bytes(answer[4 * k : 4 * k + 4], "little") for k in range(len(places))]
        if self._version is not None and (codes[-1] or parts[-1][0] != self._version):
            raise OutputError(
                "the program of the PLC has changed since this connection began", where=self._where,
                value=f"version {parts[-1][0]} of its symbols", limit=self._version, hint="Start this command again",
            )  # fmt: skip
        for one, code in zip(symbols, codes, strict=False):
            if code:
                fault = pyads.errorcodes.ERROR_CODES.get(code, f"error {code}")
                raise OutputError(f"the symbol '{one.symbol}' cannot be read", where=self._where, value=fault)
        return {
            one.name: ads.unpack(self.kinds[one.name], part) * one.si for one, part in zip(symbols, parts, strict=False)
        }

    def write(self, name: str, value: float) -> float:
        """Write a number.

        Args:
            name: Of a symbol, here.

        Returns:
            The number in the type of the symbol, SI.

        Raises:
            InputError: No such symbol, not one to be written, a value outside its limits or that does not fit its type.
            OutputError: The device refuses it.
        """
        one = self._by_name.get(name)
        if one is None:
            raise InputError("no such symbol", value=name, limit=", ".join(self._by_name))
        if not one.writable:
            raise InputError(f"'{name}' may not be written", where=self._where, hint="write = true allows it")
        if not (math.isfinite(value) and one.low <= value <= one.high):
            limit = f"{one.low / one.si:g} .. {one.high / one.si:g}"
            raise InputError(f"'{name}' is out of range", where=self._where, value=f"{value / one.si:g}", limit=limit)
        kind = self.kinds[name]
        try:
            number = ads.unpack(kind, ads.pack(kind, value / one.si))
        except ProtocolError as fault:
            raise InputError(fault.what, where=f"{self._where}: {one.symbol}", value=value / one.si) from fault
        whole = ads.TYPES[kind][1] not in "fd"
        plain = bool(number) if kind == "BOOL" else int(number) if whole else number
        with self._explained(f"'{name}' cannot be written"):
            self._connection.write_by_name(one.symbol, plain, getattr(self._pyads, f"PLCTYPE_{kind}"))
        return number * one.si

    @contextlib.contextmanager
    def _explained(self, what: str, hint: str | None = None) -> Any:
        try:
            yield
        except self._pyads.ADSError as fault:
            text = " ".join(str(fault).split()).rstrip(".")
            known = {6: "The PLC does not run on this AMS port", 7: "The TwinCAT has no route to this computer"}
            code = getattr(fault, "err_code", None)
            raise OutputError(f"{what}: {text}", where=self._where, hint=hint or known.get(code or 0)) from fault
        except (RuntimeError, ValueError, KeyError, TypeError, IndexError) as fault:
            raise OutputError(f"{what}: {fault}", where=self._where, hint=hint) from fault

    def close(self) -> None:
        """Hang up."""
        if self._connection is not None:
            with contextlib.suppress(Exception):
                self._connection.close()
            self._connection = None
        if sys.platform.startswith("linux"):
            with contextlib.suppress(Exception):
                self._pyads.delete_route(self._pyads.AmsAddr(self.settings.net_id, self.settings.port))


@dataclass(frozen=True)
class AdsReading:
    """All symbols at one time."""

    values: Mapping[str, float]  # SI, by name
    time_ns: int  # Monotonic clock, when the answer had come
    took_s: float  # From asking to the answer
    number: int  # From 1


class AdsReader(threading.Thread):
    """Reads a connection again and again in a thread of its own.

    Args:
        link: The connection; it belongs to the thread until :meth:`end`.
        period_s: From one reading to the next; where readings take longer there is no pause.
        take: Told every reading, in the thread.
    """

    def __init__(self, link: AdsLink, period_s: float, take: Callable[[AdsReading], None] = lambda _: None) -> None:
        super().__init__(daemon=True, name="ads")
        if not period_s > 0.0:
            raise InputError("period of readings", value=period_s, limit="> 0 s")
        self._link, self._period_s, self._take = link, period_s, take
        self._ending = threading.Event()
        self.newest: AdsReading | None = None  # Last reading, or None
        self.trouble = ""  # Why the last reading failed, or empty
        self.failed = 0  # Readings that failed

    def run(self) -> None:
        """Read until :meth:`end`."""
        number = 0
        due = time.monotonic()
        while not self._ending.is_set():
            begin = time.monotonic()
            try:
                values = self._link.read()
            except OutputError as fault:
                self.trouble = str(fault)
                self.failed += 1
            else:
                number += 1
                now = time.monotonic_ns()
                self.newest = AdsReading(values, now, time.monotonic() - begin, number)
                self.trouble = ""
                self._take(self.newest)
            due = max(due + self._period_s, time.monotonic())
            self._ending.wait(max(0.0, due - time.monotonic()))

    def end(self) -> None:
        """Stop reading; the connection stays open."""
        self._ending.set()
        if self.is_alive():
            self.join()


def _pyads() -> ModuleType:
    try:
        return importlib.import_module("pyads")
    except (ImportError, OSError) as fault:
        raise InputError(
            "the library for Beckhoff ADS is missing",
            value=str(fault),
            hint="pip install 'counterflex[ads]'; on Windows it needs a TwinCAT installation",
        ) from fault
