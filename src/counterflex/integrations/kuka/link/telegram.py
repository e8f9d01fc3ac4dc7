"""Telegrams of one RSI configuration: reading what the controller sends, writing the answer; and the other way round.

Both directions share one layout class, so that a controller can be played with the same file that drives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError, ProtocolError
from counterflex.integrations.kuka.link.config import ConfigValue, RsiConfig
from counterflex.integrations.kuka.link.kernel import NUMBER, TEXT, compose, scan
from counterflex.protocols.decimal_kernel import Bytes

LARGEST_DATAGRAM = 65_507


class Reader:
    """Reads telegrams of a fixed set of values into one array, without allocation.

    Args:
        root: ``Rob`` or ``Sen``.
        values: What the telegrams hold.
    """

    def __init__(self, root: str, values: Sequence[ConfigValue]) -> None:
        self.names = tuple(value.name for value in values)  # Of the values, in order
        text, entries = bytearray(), []
        for value in values:
            b = len(text)
            text += value.element.encode("ascii")
            e = len(text)
            text += value.attribute.encode("ascii")
            entries.append((b, e, e, len(text), TEXT if value.kind == "STRING" else NUMBER))
        self._root: Bytes = np.frombuffer(root.encode("ascii"), dtype=np.uint8).copy()
        self._names: Bytes = np.frombuffer(bytes(text) or b"\0", dtype=np.uint8).copy()
        self._entries: Int = np.array(entries, dtype=np.int64).reshape(-1, 5)
        self.values: Float = np.zeros(len(self.names))  # (m,) last numbers read, in the units of the wire
        self.seen: Bool = np.zeros(len(self.names), dtype=np.bool_)  # (m,) which of them the last telegram held
        self.counter = -1  # Its IPOC
        self.stopped_at = 0  # Byte at which the last scan ended, for messages

    def read(self, data: Bytes, length: int) -> int:
        """Read a telegram of ``length`` bytes from the buffer; returns the status (0: all is well)."""
        status, self.counter, self.stopped_at = scan(
            data, length, self._root, self._names, self._entries, self.values, self.seen
        )
        return int(status)

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Arguments of :func:`.kernel.scan`, for a kernel that calls it."""
        own = self._root, self._names, self._entries, self.values, self.seen
        return dict(zip(("root", "names", "entries", "values", "seen"), own, strict=True))

    def read_bytes(self, data: bytes) -> int:
        """Read a telegram given as bytes; allocates, so not for the loop."""
        return self.read(np.frombuffer(data, dtype=np.uint8).copy() if data else np.zeros(1, np.uint8), len(data))

    def place(self, *names: str) -> Int:
        """Places of values in :attr:`values`. Raises InputError: the configuration has no such value."""
        for name in names:
            if name not in self.names:
                raise InputError("the RSI configuration has no such value", value=name, limit=", ".join(self.names))
        return np.array([self.names.index(name) for name in names], dtype=np.int64)


class Writer:
    """Writes telegrams of a fixed set of values, without allocation.

    Args:
        root: ``Sen`` or ``Rob``.
        kind: Text of the root's Type attribute.
        values: What the telegrams hold; texts (STRING) are written as given in ``texts``.
        decimals: Places of DOUBLE values.
        texts: By value name; missing ones are empty.
    """

    def __init__(
        self,
        root: str,
        kind: str,
        values: Sequence[ConfigValue],
        *,
        decimals: int = 6,
        texts: dict[str, str] | None = None,
    ) -> None:
        if not 0 <= decimals <= 9:
            raise InputError("decimal places of telegrams", value=decimals, limit="0 .. 9")
        self.names = tuple(value.name for value in values)  # Of the values, in order
        # (m,) numbers to write, in the units of the wire; those of texts are ignored
        self.values: Float = np.zeros(len(self.names))
        self.buffer: Bytes = np.zeros(LARGEST_DATAGRAM, dtype=np.uint8)  # Where telegrams are written
        pieces, pending = bytearray(), f'<{root} Type="{kind}">'
        parts: list[tuple[int, int, int, int]] = []
        for element, group in _elements(values):
            attributes = [(k, v) for k, v in group if v.attribute]
            pending += f"<{element}"
            for k, value in attributes:
                pending += f' {value.attribute}="'
                pending = _value(pieces, parts, pending, k, value, decimals, texts)
                pending += '"'
            if len(attributes) == len(group):
                pending += "/>"
                continue
            pending += ">"
            for k, value in group:
                if not value.attribute:
                    pending = _value(pieces, parts, pending, k, value, decimals, texts)
            pending += f"</{element}>"
        _piece(pieces, parts, pending + "<IPOC>", -2, 0)
        _piece(pieces, parts, f"</IPOC></{root}>", -1, 0)
        self._pieces: Bytes = np.frombuffer(bytes(pieces), dtype=np.uint8).copy()
        self._parts: Int = np.array(parts, dtype=np.int64)

    @property
    def fixed(self) -> tuple[Bytes, Int]:
        """Fixed text and parts of :func:`.kernel.compose`, for a kernel that writes itself."""
        return self._pieces, self._parts

    def write(self, counter: int) -> int:
        """Write :attr:`values` with a counter into :attr:`buffer`.

        Returns:
            Its length; 0 where a value is not finite or too large, and then nothing may be sent.
        """
        return int(compose(self.buffer, self._pieces, self._parts, self.values, counter))

    def telegram(self, counter: int) -> bytes:
        """The telegram as bytes; allocates, so not for the loop.

        Raises:
            ProtocolError: A value is not finite or too large.
        """
        length = self.write(counter)
        if length == 0:
            bad = [name for name, v in zip(self.names, self.values, strict=True) if not abs(v) <= 1e6]
            raise ProtocolError("a value cannot be written into a telegram", value=", ".join(bad) or "counter")
        return self.buffer[:length].tobytes()

    def place(self, *names: str) -> Int:
        """Places of values in :attr:`values`. Raises as :meth:`Reader.place`."""
        for name in names:
            if name not in self.names:
                raise InputError("the RSI configuration has no such value", value=name, limit=", ".join(self.names))
        return np.array([self.names.index(name) for name in names], dtype=np.int64)


def robot_reader(config: RsiConfig) -> Reader:
    """Reads what the controller sends."""
    return Reader("Rob", config.sent())


def answer_writer(config: RsiConfig, *, decimals: int = 6, texts: dict[str, str] | None = None) -> Writer:
    """Writes the answer to it."""
    return Writer("Sen", config.sentype, config.received(), decimals=decimals, texts=texts)


def answer_reader(config: RsiConfig) -> Reader:
    """Reads answers: the controller's side."""
    return Reader("Sen", config.received())


def robot_writer(config: RsiConfig, *, decimals: int = 4) -> Writer:
    """Writes what a controller sends: the controller's side; ``decimals`` is its parameter Precision."""
    return Writer("Rob", "KUKA", config.sent(), decimals=decimals)


def _elements(values: Sequence[ConfigValue]) -> list[tuple[str, list[tuple[int, ConfigValue]]]]:
    groups: list[tuple[str, list[tuple[int, ConfigValue]]]] = []
    for k, value in enumerate(values):
        if groups and groups[-1][0] == value.element:
            groups[-1][1].append((k, value))
        else:
            groups.append((value.element, [(k, value)]))
    return groups


def _piece(pieces: bytearray, parts: list[tuple[int, int, int, int]], text: str, which: int, places: int) -> None:
    begin = len(pieces)
    pieces += text.encode("ascii")
    parts.append((begin, len(pieces), which, places))


def _value(
    pieces: bytearray,
    parts: list[tuple[int, int, int, int]],
    pending: str,
    k: int,
    value: ConfigValue,
    decimals: int,
    texts: dict[str, str] | None,
) -> str:
    if value.kind == "STRING":
        text = (texts or {}).get(value.name, "")
        if not text.isascii() or set(text) & set("<>&\"'"):
            raise InputError("a text cannot be written into a telegram", where=value.name, value=repr(text))
        return pending + text
    _piece(pieces, parts, pending, k, decimals if value.kind == "DOUBLE" else 0)
    return ""
