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
        try:
            self._connect()
            self.kinds = {one.name: self._kind(one) for one in symbols}
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

    def _kind(self, one: AdsSymbol) -> str:
        with self._explained(
            f"the symbol '{one.symbol}' cannot be found", hint="counterflex ads list shows what is there"
        ):
            kind = str(self._connection.get_symbol(one.symbol).symbol_type).strip("\0 ")
        if kind not in ads.TYPES:
            raise OutputError(
                f"the symbol '{one.symbol}' is no number", where=self._where, value=kind, limit=", ".join(ads.TYPES)
            )
        return kind

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
        names = [one.symbol for one in self.symbols]
        if not names:
            return {}
        with self._explained("the symbols cannot be read"):
            values = self._connection.read_list_by_name(names, ads_sub_commands=_LARGEST)
        out = {}
        for one in self.symbols:
            value = values[one.symbol]
            if isinstance(value, str) or not isinstance(value, int | float):
                raise OutputError(f"the symbol '{one.symbol}' cannot be read", where=self._where, value=value)
            out[one.name] = float(value) * one.si
        return out

    def write(self, name: str, value: float) -> None:
        """Write a number.

        Args:
            name: Of a symbol, here.

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

    @contextlib.contextmanager
    def _explained(self, what: str, hint: str | None = None) -> Any:
        try:
            yield
        except self._pyads.ADSError as fault:
            text = " ".join(str(fault).split())
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
