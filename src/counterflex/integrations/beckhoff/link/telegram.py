"""Beckhoff ADS over TCP: frames, commands, index groups, elementary types and symbol entries (little-endian).

A frame is the AMS/TCP header of 6 bytes, the AMS header of 32, and the data of the command.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProtocolError

TCP_PORT: Final = 48898
PLC_PORT: Final = 851
"""AMS port of the first PLC of a TwinCAT 3."""
_FRAME: Final = struct.Struct("<HI6sH6sHHHIII")
LONGEST: Final = 1 << 20
"""Bytes of data that a frame may hold here."""
RESPONSE: Final = 0x0001
REQUEST: Final = 0x0004

READ_DEVICE_INFO, READ, WRITE, READ_STATE, READ_WRITE = 1, 2, 3, 4, 9
HANDLE_BY_NAME: Final = 0xF003
VALUE_BY_HANDLE: Final = 0xF005
RELEASE_HANDLE: Final = 0xF006
SYMBOL_VERSION: Final = 0xF008
"""Index group of one byte that changes with the program of the PLC."""
INFO_BY_NAME: Final = 0xF009
UPLOAD: Final = 0xF00B
UPLOAD_INFO: Final = 0xF00F
SUM_READ: Final = 0xF080
SUM_WRITE: Final = 0xF081
PLC_MEMORY: Final = 0x4040
"""Index group at which PLC variables lie."""

NO_TARGET_PORT: Final = 0x6
NOT_SUPPORTED: Final = 0x701
NO_GROUP: Final = 0x702
NO_OFFSET: Final = 0x703
WRONG_SIZE: Final = 0x705
WRONG_DATA: Final = 0x706
NO_SYMBOL: Final = 0x710

TYPES: Final[dict[str, tuple[int, str]]] = {
    "BOOL": (33, "?"),
    "SINT": (16, "b"),
    "USINT": (17, "B"),
    "BYTE": (17, "B"),
    "INT": (2, "h"),
    "UINT": (18, "H"),
    "WORD": (18, "H"),
    "DINT": (3, "i"),
    "UDINT": (19, "I"),
    "DWORD": (19, "I"),
    "LINT": (20, "q"),
    "ULINT": (21, "Q"),
    "REAL": (4, "f"),
    "LREAL": (5, "d"),
}
"""Number of the type and its struct code, by the name that the PLC gives it."""
_NET_ID: Final = re.compile(r"[0-9]{1,3}(\.[0-9]{1,3}){5}")


def net_id_bytes(net_id: str) -> bytes:
    """An AMS net id ``1.2.3.4.1.1`` as six bytes. Raises ProtocolError: it is none."""
    parts = [int(part) for part in net_id.split(".")] if _NET_ID.fullmatch(net_id) else []
    if len(parts) != 6 or max(parts) > 255:
        raise ProtocolError("not an AMS net id", value=repr(net_id), limit="six numbers up to 255: 192.168.1.20.1.1")
    return bytes(parts)


@dataclass(frozen=True)
class AmsFrame:
    """One request or response."""

    target: tuple[bytes, int]  # Net id (6 bytes) and port of the receiver
    source: tuple[bytes, int]  # Of the sender
    command: int  # Of the protocol
    flags: int  # :data:`REQUEST`, with :data:`RESPONSE` in answers
    error: int  # Of routing; 0 is none
    invoke: int  # Number that an answer repeats
    data: bytes  # Of the command

    def telegram(self) -> bytes:
        """A frame as bytes."""
        size = len(self.data)
        head = _FRAME.pack(
            0, size + HEADER - 6, *self.target, *self.source, self.command, self.flags, size, self.error, self.invoke
        )
        return head + self.data

    def answered(self, data: bytes, error: int = 0) -> AmsFrame:
        """The response to a request."""
        return AmsFrame(self.source, self.target, self.command, REQUEST | RESPONSE, error, self.invoke, data)


HEADER: Final = _FRAME.size
"""Bytes before the data: both headers."""


def read_header(head: bytes) -> int:
    """Bytes of data behind a header of :data:`HEADER` bytes.

    Raises:
        ProtocolError: Not a header, or more data than :data:`LONGEST`.
    """
    if len(head) != HEADER:
        raise ProtocolError("not a header of ADS", value=f"{len(head)} bytes", limit=f"{HEADER} bytes")
    reserved, length, *_, size, _, _ = _FRAME.unpack(head)
    if reserved != 0 or length != size + HEADER - 6 or size > LONGEST:
        raise ProtocolError("lengths of an ADS frame", value=(reserved, length, size), limit=f"at most {LONGEST} bytes")
    return int(size)


def read_frame(data: bytes) -> AmsFrame:
    """Read a whole frame. Raises ProtocolError: its lengths contradict each other."""
    size = read_header(data[:HEADER])
    if len(data) != HEADER + size:
        raise ProtocolError("an ADS frame was cut", value=f"{len(data)} bytes", limit=f"{HEADER + size} bytes")
    _, _, target, target_port, source, source_port, command, flags, _, error, invoke = _FRAME.unpack(data[:HEADER])
    return AmsFrame((target, target_port), (source, source_port), command, flags, error, invoke, data[HEADER:])


def symbol_entry(name: str, kind: str, group: int, offset: int, comment: str = "") -> bytes:
    """Return the entry of a symbol: place, size, type, names. Raises ProtocolError: an unknown type."""
    if kind not in TYPES:
        raise ProtocolError("unknown type of a PLC variable", value=kind, limit=", ".join(TYPES))
    code, form = TYPES[kind]
    texts = [text.encode("ascii", "replace") for text in (name, kind, comment)]
    tail = b"".join(text + b"\0" for text in texts)
    size = struct.calcsize("<" + form)
    head = struct.pack("<IIIIIIHHH", 30 + len(tail), group, offset, size, code, 0, *(len(text) for text in texts))
    return head + tail


def pack(kind: str, value: float) -> bytes:
    """A number as the PLC holds it. Raises ProtocolError: an unknown type, or it does not fit."""
    if kind not in TYPES:
        raise ProtocolError("unknown type of a PLC variable", value=kind, limit=", ".join(TYPES))
    form = TYPES[kind][1]
    try:
        return struct.pack("<" + form, value if form in "fd" else bool(value) if form == "?" else round(value))
    except (struct.error, OverflowError, ValueError) as fault:
        raise ProtocolError(f"a number does not fit into {kind}", value=value) from fault


def unpack(kind: str, data: bytes) -> float:
    """A number that the PLC holds. Raises ProtocolError: another size."""
    try:
        return float(struct.unpack("<" + TYPES[kind][1], data)[0])
    except (struct.error, KeyError) as fault:
        raise ProtocolError(f"not a number of the type {kind}", value=f"{len(data)} bytes") from fault
