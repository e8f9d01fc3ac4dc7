"""Targets of fuzzing, and the independent reader that judges each: an XML library, struct, a protobuf decoder."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

import counterflex
from counterflex.core.errors import CounterflexError, ProtocolError
from counterflex.core.records import as_words, records
from counterflex.integrations.abb.link import telegram as egm
from counterflex.integrations.ati.link import kernel as netft_kernel, telegram as netft
from counterflex.integrations.kuka.link import kernel as rsi_kernel
from counterflex.integrations.kuka.link.config import RsiConfig, parse_config
from counterflex.integrations.kuka.link.telegram import Reader, answer_reader, answer_writer, robot_reader, robot_writer
from counterflex.protocols import decimal_kernel
from counterflex.protocols.tracker import kernel as tracker_pose_kernel, telegram as tracker_pose
from fuzz_coverage import instrument
from fuzz_other_targets import OTHERS
from fuzz_target import Count, Finding, Target


def config() -> RsiConfig:
    """The set-up of the demonstration cell, with a text and a tag of its own in the telegrams."""
    demo = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
    text = demo.read_text(encoding="utf-8")
    own = '<ELEMENT TAG="Note" TYPE="STRING" INDX="3"/></ELEMENTS></SEND>'
    return parse_config("".join(text.split("\n")).replace("    </ELEMENTS>  </SEND>", own).encode(), "demo")


def _rsi(reader: Reader, seeds: list[bytes], expect: RsiConfig, root: str, *, compiled: bool) -> Target:
    values = expect.sent() if root == "Rob" else expect.received()
    own = instrument(rsi_kernel, "scan", decimal_kernel, compiled=compiled)
    buffer = np.zeros(70_000, dtype=np.uint8)

    def check(data: bytes) -> bool:
        status = reader.read_bytes(data)
        if status not in (rsi_kernel.OK, rsi_kernel.MISSING):
            return False
        try:
            tree = _tree(data.rstrip(b"\0 \t\r\n"))
        except expat.ExpatError as fault:
            raise Finding(f"accepted, but an XML library says {fault}") from fault
        if tree.tag != root or [e.text and int(e.text) for e in tree.findall("IPOC") if e.text] != [reader.counter]:
            raise Finding(f"root {tree.tag}, counter {reader.counter}")
        for value, number, seen in zip(values, reader.values.tolist(), reader.seen.tolist(), strict=True):
            texts = [e.get(value.attribute) if value.attribute else e.text for e in tree.findall(value.element)]
            there = [t for t in texts if t is not None and (value.attribute or t.strip())]
            empty = value.kind == "STRING" and not value.attribute and len(texts) > 0  # a text may be empty
            if len(there) != int(seen) and not (seen and not there and empty):
                raise Finding(f"{value.name} seen {seen}, but {len(there)} times there")
            if seen and value.kind != "STRING" and not _same(float(there[0]), number):
                raise Finding(f"{value.name} is {number!r}, but the text says {there[0]!r}")
        return status == rsi_kernel.OK

    def run(data: bytes) -> object:
        buffer[: len(data)] = np.frombuffer(data, dtype=np.uint8)
        return own.run(
            buffer, len(data), reader._root, reader._names, reader._entries, reader.values, reader.seen, own.counts
        )

    return Target(seeds, True, check, reader.read_bytes, run, own)


def _tree(data: bytes) -> ElementTree.Element:
    """Elements of a document under their names as written: an attribute ``xmlns`` renames nothing here."""
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(data, True)
    return builder.close()


def _same(a: float, b: float) -> bool:
    """Equal to two units in the last place: more than 15 digits are not rounded to the nearest double."""
    return a == b or abs(a - b) <= 2.0 * math.ulp(max(abs(a), abs(b)))


def rsi(*, compiled: bool = True) -> Target:
    """Telegrams of a KUKA controller."""
    expect = config()
    writer = robot_writer(expect)
    seeds = []
    for k in range(4):
        writer.values[:] = np.linspace(-1.0, 1.0, len(writer.values)) * 10.0 ** (3 * k - 3)
        seeds.append(writer.telegram(4208163000 + 4 * k))
    seeds.append(seeds[0].replace(b"/>", b"></RIst>", 1).replace(b"><", b">\r\n <"))
    seeds.append(b'<Rob Type="KUKA"><IPOC>12</IPOC></Rob>\0')
    return _rsi(robot_reader(expect), seeds, expect, "Rob", compiled=compiled)


def answer(*, compiled: bool = True) -> Target:
    """Answers to a KUKA controller."""
    expect = config()
    writer = answer_writer(expect, texts={"EStr": "counterflex"})
    writer.values[:] = 0.123456
    return _rsi(answer_reader(expect), [writer.telegram(4), writer.telegram(10**17)], expect, "Sen", compiled=compiled)


def tracker(*, compiled: bool = True) -> Target:
    """Pose datagrams."""
    own = instrument(tracker_pose_kernel, "read_datagram", compiled=compiled)
    rows, T, values = np.zeros((1, 88), dtype=np.uint8), np.eye(4), np.zeros(8)
    pose = np.eye(4)
    pose[:3, 3] = 1.0, -2.0, 3.0
    seeds = [
        tracker_pose.TrackerPose(k, 10**k, status, k, pose, 1e-5).telegram() for k, status in enumerate((0, 1, 2, 4, 7))
    ]

    def check(data: bytes) -> bool:
        good = _tracker_judge(data)
        try:
            found = tracker_pose.read_pose(data)
        except ProtocolError:
            if good is not None:
                raise Finding("refused, but it is good") from None
            return False
        if good is None:
            raise Finding("accepted, but it is not good")
        sequence, time_ns, status, frame, R, p, sigma = good
        if (found.sequence, found.time_ns, found.status, found.frame_id) != (sequence, time_ns, status, frame):
            raise Finding("whole numbers differ")
        if not np.allclose(found.T_tracker_target[:3, :3], R, rtol=0.0, atol=1e-14):
            raise Finding("the rotation differs")
        if not np.allclose(found.T_tracker_target[:3, 3], p, rtol=1e-15, atol=0.0) or not _same(found.sigma_m, sigma):
            raise Finding("the position differs")
        return True

    def run(data: bytes) -> object:
        rows[0, : min(len(data), 88)] = np.frombuffer(data[:88], dtype=np.uint8)
        return own.run(rows, 0, len(data), T, values, own.counts)

    return Target(seeds, False, check, _refusing(tracker_pose.read_pose), run, own)


def _tracker_judge(data: bytes) -> tuple[int, int, int, int, Any, Any, float] | None:
    if len(data) != 88 or data[:4] != b"CFP1":
        return None
    sequence, time_ns, status, frame, *numbers = struct.unpack("<IQII8d", data[4:])
    if status > 7 or any(not math.isfinite(v) or (k < 3 and abs(v) > 200_000.0) for k, v in enumerate(numbers)):
        return None
    if numbers[7] < 0.0:
        return None
    w, x, y, z = numbers[3:7] if not status & 2 else (1.0, 0.0, 0.0, 0.0)
    if not abs(math.sqrt(w * w + x * x + y * y + z * z) - 1.0) <= 1e-6:
        return None
    n = math.hypot(w, x, y, z)
    u, s = np.array([x, y, z]) / n, w / n
    R = (s * s - u @ u) * np.eye(3) + 2.0 * np.outer(u, u) + 2.0 * s * np.cross(np.eye(3), u)
    return sequence, time_ns, status, frame, R, np.array(numbers[:3]) * 1e-3, numbers[7] * 1e-3


def force(*, compiled: bool = True) -> Target:
    """Records of a Net F/T, several one behind the other: gaps, status, sums. An input is cut into rows of 36 bytes."""
    own = instrument(netft_kernel, "take_records", compiled=compiled)
    counts = (1, 2, 3, -4, 5, -(2**31))
    seeds = [
        b"".join(netft.NetftRecord((first + k) % 2**32, k, status, counts).written() for k in range(4))
        for first, status in ((7, 0), (2**32 - 2, 0x80010000), (5, 0x80000002))
    ]
    rows, lengths = np.zeros((64, 2048), dtype=np.uint8), np.zeros(64, dtype=np.int64)
    received, samples = records(netft_kernel.RECEIVED), np.zeros((512, 6))

    def fill(data: bytes) -> int:
        count = 0
        for k in range(0, min(len(data), 64 * 36), 36):
            piece = data[k : k + 36]
            rows[count, : len(piece)] = np.frombuffer(piece, dtype=np.uint8)
            lengths[count] = len(piece)
            count += 1
        as_words(received)[:] = 0
        received["scale"], received["limit"], received["order"]["newest"] = 1e-6, 950.0, -1
        return count

    def check(data: bytes) -> bool:
        count = fill(data)
        netft_kernel.take_records(rows, lengths, count, samples, received)
        good, lost, bad, malformed, saturated, sums = _force_judge(data, 1e-6, 950.0)
        r = received[0]
        found = [int(r.good), int(r.lost), int(r.bad), int(r.malformed)]
        if found != [good, lost, bad, malformed]:
            raise Finding(f"counted {found}, the judge {good, lost, bad, malformed}")
        if bool(r.saturated) != saturated:
            raise Finding("saturation differs")
        if not np.allclose(r.total, sums, rtol=1e-12, atol=1e-9):
            raise Finding(f"sum {r.total}, the judge {sums}")
        return good > 0

    def run(data: bytes) -> object:
        count = fill(data)
        return own.run(rows, lengths, count, samples, received, own.counts)

    def read(data: bytes) -> object:
        count = fill(data)
        return netft_kernel.take_records(rows, lengths, count, samples, received)

    return Target(seeds, False, check, read, run, own)


def _force_judge(data: bytes, scale: float, limit: float) -> tuple[int, int, int, int, bool, Any]:
    count = Count(32)
    good = lost = bad = malformed = 0
    saturated = False
    sums = np.zeros(6)
    for k in range(0, min(len(data), 64 * 36), 36):
        piece = data[k : k + 36]
        if len(piece) != 36:
            malformed += 1
            continue
        sequence, _, status, *counts = struct.unpack(">III6i", piece)
        ahead = count.steps(sequence)
        if ahead == 0:
            continue
        lost += ahead - 1
        if status not in (0, 0x80010000):
            bad, saturated = bad + 1, True
            continue
        good += 1
        readings = np.array(counts, dtype=np.float64) * scale
        saturated |= bool(np.any(np.abs(readings) > limit))
        sums += readings
    return good, lost, bad, malformed, saturated, sums


def egm_robot(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Messages of an ABB controller; the reader is protobuf with checks, the judge decodes the wire types by itself."""
    T = np.eye(4)
    q = np.linspace(-1.0, 1.0, 6)
    state = egm.RobotState(7, 1000, q, T, T, True, True, True, 0.5, np.arange(6.0))
    seeds = [state.telegram(robotware=r) for r in (6, 7)]

    def check(data: bytes) -> bool:
        try:
            found = egm.read_robot(data)
        except ProtocolError:
            return False
        header = _joined(data, 1)
        if (found.sequence, found.time_ms) != (_last_varint(header, 1) % 2**32, _last_varint(header, 2) % 2**32):
            raise Finding("sequence or time differ")
        if found.q is not None:
            doubles = _doubles(_joined(_joined(data, 2), 1), 1)
            if not np.allclose(np.degrees(found.q), doubles, rtol=1e-14, atol=1e-300):
                raise Finding("joints differ")
        for T_any in (found.T_frame_tcp, found.T_frame_tcp_planned):
            if T_any is not None and not (
                np.all(np.isfinite(T_any)) and abs(np.linalg.det(T_any[:3, :3]) - 1.0) < 1e-9
            ):
                raise Finding("a pose is none")
        if found.force is not None and not np.all(np.isfinite(found.force)):
            raise Finding("a force is not finite")
        return True

    return Target(seeds, False, check, _refusing(egm.read_robot))


def egm_sensor(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Messages to an ABB controller: guidance and path correction, as the simulated controllers read them."""
    seeds = [egm.write_guidance(3, np.eye(4)), egm.write_path_correction(4, 1e-3, -1e-3, 0.01)]

    def check(data: bytes) -> bool:
        accepted = False
        for read in (egm.read_guidance, egm.read_path_correction):
            try:
                sequence, number, *_ = read(data)
            except ProtocolError:
                continue
            accepted = True
            if sequence != _last_varint(_joined(data, 1), 1) % 2**32 or not np.all(np.isfinite(number)):
                raise Finding("sequence or numbers")
        return accepted

    return Target(seeds, False, check, _refusing(egm.read_guidance))


def scaling(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """The scaling document of a Net F/T."""
    return _document(netft.write_scaling(1_000_000, 1_000_000, 1000, "Net F/T"), netft.Scaling.of)


def rsi_config(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """The ETHERNET file of an RSI context."""
    demo = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
    return _document(demo.read_bytes(), lambda data: parse_config(data, "fuzz"))


def _document(seed: bytes, read: Callable[[bytes], object]) -> Target:
    def check(data: bytes) -> bool:
        if not _refusing(read)(data):
            return False
        try:
            ElementTree.fromstring(data)
        except ElementTree.ParseError as fault:
            raise Finding(f"accepted, but an XML library says {fault}") from fault
        return True

    return Target([seed], True, check, _refusing(read))


def _refusing(read: Callable[[bytes], object]) -> Callable[[bytes], bool]:
    """Return whether it was accepted; every error of the package's own is a refusal, any other one is not."""

    def call(data: bytes) -> bool:
        try:
            read(data)
        except CounterflexError:
            return False
        return True

    return call


def _fields(data: bytes) -> list[tuple[int, int, Any]]:
    """Number, wire type and value of each field of a protobuf message that is known to be well-formed."""
    out: list[tuple[int, int, Any]] = []
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        kind = key & 7
        value: Any = None
        if kind == 0:
            value, at = _varint(data, at)
        elif kind == 1:
            value, at = data[at : at + 8], at + 8
        elif kind == 2:
            size, at = _varint(data, at)
            value, at = data[at : at + size], at + size
        elif kind == 5:
            value, at = data[at : at + 4], at + 4
        elif kind == 3:
            at = _group_end(data, at)
        out.append((key >> 3 & 0x1FFFFFFF, kind, value))
    return out


def _group_end(data: bytes, at: int) -> int:
    depth = 1
    while depth and at < len(data):
        key, at = _varint(data, at)
        kind = key & 7
        depth += (kind == 3) - (kind == 4)
        if kind == 0:
            _, at = _varint(data, at)
        elif kind in (1, 5):
            at += 8 if kind == 1 else 4
        elif kind == 2:
            size, at = _varint(data, at)
            at += size
    return at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(data):
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            break
    return value & 0xFFFFFFFFFFFFFFFF, at


def _joined(data: bytes, number: int) -> bytes:
    """All pieces of a message within a message; those that come several times are merged."""
    return b"".join(value for n, kind, value in _fields(data) if n == number and kind == 2)


def _last_varint(data: bytes, number: int) -> int:
    return next((int(v) for n, kind, v in reversed(_fields(data)) if n == number and kind == 0), 0)


def _doubles(data: bytes, number: int) -> list[float]:
    out: list[float] = []
    for n, kind, value in _fields(data):
        if n == number and kind in (1, 2):
            out += struct.unpack(f"<{len(value) // 8}d", value)
    return out


TARGETS: dict[str, Callable[..., Target]] = {
    "rsi": rsi,
    "answer": answer,
    "netft": force,
    "tracker": tracker,
    "egm": egm_robot,
    "egm-sensor": egm_sensor,
    "scaling": scaling,
    "rsi-config": rsi_config,
    **OTHERS,
}
