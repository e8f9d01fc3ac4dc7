"""Frames that the cell file describes: datagrams of whole frames, and a stream that arrives in pieces of any length."""

from __future__ import annotations

import binascii
import math
import struct
from collections.abc import Callable, Sequence

import numpy as np

from counterflex.core.arrays import Float
from counterflex.files.cell.sensing import FrameTable
from counterflex.files.schema import parse
from counterflex.protocols.force.frame_format import COMPONENTS
from counterflex.protocols.frame.link import FrameLink
from fuzz_target import Count, Finding, Target

_DATAGRAM = {
    "byte_order": "big", "fields": ["uint32 sequence", "uint32 status", *(f"int32 {c}" for c in COMPONENTS)],
    "counts_per_n": 10000, "counts_per_nm": 100000, "saturated_bits": 2, "invalid_bits": 1,
}  # fmt: skip
_STREAM = {
    "header": "aa55", "footer": "0d", "byte_order": "little", "crc_from": 2,
    "fields": ["uint16 status", "uint16 sequence", *(f"float32 {c}" for c in COMPONENTS), "uint16 crc16_x25"],
    "saturated_bits": 2, "invalid_bits": 5,
}  # fmt: skip
_REFLECTED = bytes(int(f"{k:08b}"[::-1], 2) for k in range(256))
Sample = tuple[int, int, tuple[float, ...]]
"""Number, status and the six values of a frame."""


def frame_datagram(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Datagrams of one or several frames; one of another length is refused whole."""
    link = _link(_DATAGRAM)
    size, wrench = link._frame.size, np.array([1.0, -2.0, 3.0, 4.0, -5.0, 6.0])
    seeds = [
        b"".join(link._frame.write(k * wrench, first + k, status) for k in range(4))
        for first, status in ((7, 0), (2**32 - 2, 2), (5, 1), (9, 4))
    ]

    def stream(data: bytes) -> FrameLink:
        return _taken(link, data if len(data) % size == 0 else b"", 32)

    def check(data: bytes) -> bool:
        samples: list[Sample] = []
        for at in range(0, len(data), size) if len(data) % size == 0 else ():
            number, status, *counts = struct.unpack_from(">II6i", data, at)
            samples.append(
                (number, status, tuple(c / scale for c, scale in zip(counts, [1e4] * 3 + [1e5] * 3, strict=True)))
            )
        return _same(stream(data), samples, 32, invalid=1, saturated=2)

    return Target(seeds, False, check, stream)


def frame_stream(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """A TCP stream of frames: found by header, footer and checksum, in whatever pieces it arrives."""
    link = _link(_STREAM)
    size, wrench = link._frame.size, np.array([1.5, -2.0, 3.0, 0.25, -0.5, 0.75])
    whole = [link._frame.write(k * wrench, 2**16 - 2 + k, k) for k in range(4)]
    seeds = [b"".join(whole), b"\xaa" + whole[0] + b"\xaa\x55" + whole[1], whole[2][:9] + whole[3] + whole[0][:20]]

    def stream(data: bytes, step: int) -> FrameLink:
        frames, link._rest = b"", b""
        for at in range(0, len(data), step):
            link._rest += data[at : at + step]
            frames += link._cut()
            if len(link._rest) >= size and link._rest.startswith(b"\xaa\x55"):
                raise Finding("a whole frame is held back")
        return _taken(link, frames, 16)

    def check(data: bytes) -> bool:
        samples, at = [], data.find(b"\xaa\x55")
        while 0 <= at <= len(data) - size:
            status, number, *w, crc, footer = struct.unpack_from("<HH6fHB", data, at + 2)
            good = footer == 0x0D and crc == _crc(data[at + 2 : at + size - 3])
            if good:
                samples.append((number, status, tuple(w)))
            at = data.find(b"\xaa\x55", at + (size if good else 1))
        accepted = [
            _same(stream(data, step), samples, 16, invalid=5, saturated=2) for step in (1 << 16, 7 + len(data) // 40)
        ]
        return accepted[0]

    return Target(seeds, False, check, lambda data: stream(data, 1 << 16))


def _link(data: dict[str, object]) -> FrameLink:
    """A receiver whose socket is closed: it is given its bytes."""
    link = FrameLink("127.0.0.1", 0, parse(FrameTable, data, where="[sensor.frame]").source())
    link.close()
    return link


def _taken(link: FrameLink, frames: bytes, bits: int) -> FrameLink:
    """Read frames with a new stream of samples."""
    super(FrameLink, link).__init__(bits=bits)
    link.begin()
    link._take_frames(frames)
    link.end()
    return link


def _crc(data: bytes) -> int:
    """CRC-16/X-25 by the standard library's CRC of the same polynomial, which takes the bits the other way round."""
    crc = binascii.crc_hqx(data.translate(_REFLECTED), 0xFFFF)
    return int(f"{crc:016b}"[::-1], 2) ^ 0xFFFF


def _same(found: FrameLink, samples: Sequence[Sample], bits: int, *, invalid: int, saturated: int) -> bool:
    """Return whether there are good samples; raises where the judge counts others."""
    good, lost, bad, total = _judge(samples, bits, invalid, saturated)
    if (found.good, found.lost, found.bad) != (good, lost, bad):
        raise Finding(f"counted {found.good, found.lost, found.bad}, the judge {good, lost, bad}")
    if good and not np.allclose(found.w_sensor * good, total, rtol=1e-12, atol=1e-6):
        raise Finding(f"mean {found.w_sensor}, sum of the judge {total}")
    return good > 0


def _judge(samples: Sequence[Sample], bits: int, invalid: int, saturated: int) -> tuple[int, int, int, Float]:
    """Good, lost and invalid samples, and the sum of the good ones."""
    count = Count(bits)
    good, lost, bad, total = 0, 0, 0, np.zeros(6)
    for number, status, w in samples:
        step = count.steps(number)
        if step == 0:
            continue
        lost += step - 1
        if status & invalid or not all(map(math.isfinite, w)):
            bad += 1
        elif not status & saturated:
            good, total = good + 1, total + w
    return good, lost, bad, total


FRAMES: dict[str, Callable[..., Target]] = {"frame": frame_datagram, "frame-stream": frame_stream}
