"""Frames of a fixed length as a force sensor's manual describes them: header, fields in order, checksum. Pure bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.core.errors import InputError

TYPES: Final = {
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
COMPONENTS: Final = ("fx", "fy", "fz", "mx", "my", "mz")
CHANNELS: Final = ("ch1", "ch2", "ch3", "ch4", "ch5", "ch6")
WORDS: Final = ("status", "sequence", "crc16_x25", "-")
"""Other fields: status bits, number of the sample, checksum, and bytes that mean nothing here."""
_UNSIGNED: Final = dict.fromkeys(("status", "sequence"), ("uint8", "uint16", "uint32", "uint64")) | {
    "crc16_x25": ("uint16",)
}
"""Types that a word may have."""
LONGEST: Final = 512


@dataclass(frozen=True)
class FrameField:
    """One field."""

    kind: str  # of TYPES
    name: str  # of COMPONENTS, CHANNELS or WORDS


@dataclass(frozen=True, eq=False)
class FrameFormat:
    """A frame.

    Raises:
        InputError: Fields that are unknown, repeated or missing, a frame that is too long, a matrix that is singular.
    """

    fields: tuple[FrameField, ...]  # between header and footer, in order, packed
    matrix: Float  # (6, 6) N, N m per unit of a channel: ``w = matrix c``; c in the order fx .. mz or ch1 .. ch6
    header: bytes = b""  # first bytes
    footer: bytes = b""  # last bytes
    little: bool = True  # least significant byte first
    crc_from: int = 0  # first byte that the checksum covers; it covers all up to itself
    saturated_bits: int = 0  # bits of the status that mean a reading beyond the range
    invalid_bits: int = 0  # bits with which the reading means nothing

    def __post_init__(self) -> None:
        """Check that it is a frame of six components."""
        for one in self.fields:
            if one.kind not in TYPES or one.name not in (*COMPONENTS, *CHANNELS, *WORDS):
                known = f"TYPE NAME with {', '.join(TYPES)} and fx..mz or ch1..ch6, {', '.join(WORDS)}"
                raise InputError("unknown field of a frame", value=f"{one.kind} {one.name}", limit=known)
        names = [one.name for one in self.fields if one.name != "-"]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InputError("a field of a frame is there twice", value=twice)
        if self.channels is None:
            raise InputError(
                "a frame needs six components", value=" ".join(names), limit=f"{', '.join(COMPONENTS)} or ch1 .. ch6"
            )
        kinds = {one.name: one.kind for one in self.fields}
        for name, allowed in _UNSIGNED.items():
            if kinds.get(name, "uint16") not in allowed:
                limit = "an unsigned integer; uint16 for a CRC-16"
                raise InputError(f"type of the field {name}", value=kinds[name], limit=limit)
        if not self.size <= LONGEST:
            raise InputError("a frame is too long", value=self.size, limit=f"{LONGEST} bytes")
        self._check_numbers("status" in names)

    def _check_numbers(self, has_status: bool) -> None:
        if (self.saturated_bits or self.invalid_bits) and not has_status:
            raise InputError("bits of a status are named, but the frame has no field status")
        if not 0 <= self.crc_from < self.size:
            raise InputError("first byte of the checksum", value=self.crc_from, limit=f"0 .. {self.size - 1}")
        A = as_float("matrix of the force sensor", self.matrix, (6, 6))
        if np.linalg.matrix_rank(A) < 6:
            raise InputError("the calibration matrix is singular: a component cannot be told from the others")

    @property
    def channels(self) -> tuple[str, ...] | None:
        """Names of the six values, or None where they are not all there, or of both kinds."""
        names = {one.name for one in self.fields}
        for expected, other in ((COMPONENTS, CHANNELS), (CHANNELS, COMPONENTS)):
            if names.issuperset(expected) and not names.intersection(other):
                return expected
        return None

    @property
    def dtype(self) -> np.dtype[Any]:
        """The frame as a row of an array."""
        order = "<" if self.little else ">"
        parts: list[Any] = [("header", "u1", (len(self.header),))]
        for k, one in enumerate(self.fields):
            parts.append((one.name if one.name != "-" else f"unused{k}", order + TYPES[one.kind]))
        return np.dtype([*parts, ("footer", "u1", (len(self.footer),))])

    @property
    def size(self) -> int:
        """Bytes of a frame."""
        return self.dtype.itemsize

    @property
    def sequence_bits(self) -> int:
        """Bits of the number of a sample; 32 where a frame has none."""
        kind = next((one.kind for one in self.fields if one.name == "sequence"), "uint32")
        return min(int(kind.removeprefix("uint")), 32)

    def has(self, name: str) -> bool:
        """Return whether there is a field of this name."""
        return any(one.name == name for one in self.fields)

    def rows(self, data: bytes) -> tuple[NDArray[Any], Bool]:
        """Frames one behind the other.

        Args:
            data: A multiple of :attr:`size` bytes.

        Returns:
            (k,) rows of :attr:`dtype`, and which of them have header, footer and checksum right.
        """
        rows = np.frombuffer(data, dtype=self.dtype)
        good: Bool = np.ones(len(rows), dtype=np.bool_)
        for name, expected in (("header", self.header), ("footer", self.footer)):
            if expected:
                good &= np.asarray(np.all(rows[name] == np.frombuffer(expected, dtype=np.uint8), axis=1))
        if self.has("crc16_x25"):
            end = int(self.dtype.fields["crc16_x25"][1]) if self.dtype.fields is not None else 0
            for k in np.flatnonzero(good):
                covered = data[k * self.size + self.crc_from : k * self.size + end]
                good[k] = crc16_x25(covered) == int(rows["crc16_x25"][k])
        return rows, good

    def wrench(self, rows: NDArray[Any]) -> Float:
        """(k, 6) N, N m of rows."""
        values = np.stack([rows[name].astype(np.float64) for name in self.channels or ()], axis=1)
        out: Float = values @ self.matrix.T
        return out

    def write(self, w_sensor: Float, sequence: int, status: int = 0) -> bytes:
        """The frame that shows a wrench: the sensor's side, for a simulated one.

        Args:
            w_sensor: (6,) N, N m; what does not fit an integer field stands at its end, what is no number is 0.
            status: Status bits.
        """
        row = np.zeros(1, dtype=self.dtype)
        row["header"], row["footer"] = list(self.header), list(self.footer)
        for name, value in zip(self.channels or (), np.linalg.solve(self.matrix, w_sensor), strict=True):
            kind = row[name].dtype
            if kind.kind in "iu":
                ends = np.iinfo(kind)
                value = min(max(round(float(value)), int(ends.min)), int(ends.max)) if np.isfinite(value) else 0
            row[name] = value
        for name, number in (("sequence", sequence), ("status", status)):
            if self.has(name):
                row[name] = number & int(np.iinfo(row[name].dtype).max)
        if self.has("crc16_x25") and self.dtype.fields is not None:
            end = int(self.dtype.fields["crc16_x25"][1])
            row["crc16_x25"] = crc16_x25(row.tobytes()[self.crc_from : end])
        return row.tobytes()


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25: polynomial 0x1021 reflected, begins with 0xFFFF, inverted at the end; of ``123456789`` 0x906E."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc ^ 0xFFFF
