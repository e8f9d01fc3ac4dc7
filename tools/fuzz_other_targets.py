"""Further readers of what comes from outside: ADS, force sensors, tracker logs, contexts of RSI."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError, ProtocolError
from counterflex.files.logs.tracker_log import measurements
from counterflex.integrations.ati.link import telegram as netft
from counterflex.integrations.beckhoff.link import telegram as ads
from counterflex.integrations.beckhoff.simulated import AdsServer, PlcVariable
from counterflex.integrations.kuka.link.context import parse_context
from counterflex.integrations.kuka.link.make.files import RsiFiles
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits
from counterflex.protocols.force.stream import SampleStream
from counterflex.protocols.wrench import telegram as wrenches
from fuzz_frame_targets import FRAMES
from fuzz_target import Count, Finding, Target

_ROOT = Path(__file__).resolve().parents[1]


def _refused(read: Callable[[bytes], object]) -> Callable[[bytes], bool]:
    def call(data: bytes) -> bool:
        try:
            read(data)
        except CounterflexError:
            return False
        return True

    return call


def ads_frames(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Frames of Beckhoff ADS, and what the simulated TwinCAT makes of the requests in them."""
    here, there = (bytes(6), 40_000), (bytes([1, 2, 3, 4, 1, 1]), ads.PLC_PORT)
    server = AdsServer({"MAIN.x": PlcVariable("LREAL", 1.5), "MAIN.n": PlcVariable("INT", 7.0)}, port=0)
    name = b"MAIN.x\0"
    read_write = (ads.HANDLE_BY_NAME, 4), (ads.VALUE_BY_HANDLE, 8), (ads.INFO_BY_NAME, 200)
    requests = [(ads.READ_WRITE, struct.pack("<IIII", group, 0, size, len(name)) + name) for group, size in read_write]
    pieces = struct.pack("<IIIIII", ads.PLC_MEMORY, 0, 8, ads.PLC_MEMORY, 8, 2)
    requests += [
        (ads.READ_STATE, b""),
        (ads.READ_DEVICE_INFO, b""),
        (ads.READ, struct.pack("<III", ads.UPLOAD_INFO, 0, 8)),
        (ads.READ, struct.pack("<III", ads.UPLOAD, 0, 400)),
        (ads.READ_WRITE, struct.pack("<IIII", ads.SUM_READ, 2, 18, len(pieces)) + pieces),
        (ads.WRITE, struct.pack("<III", ads.PLC_MEMORY, 0, 8) + struct.pack("<d", 2.5)),
    ]
    seeds = [ads.AmsFrame(there, here, c, ads.REQUEST, 0, k, d).telegram() for k, (c, d) in enumerate(requests)]

    def check(data: bytes) -> bool:
        try:
            frame = ads.read_frame(data)
        except ProtocolError:
            frame = None
        fits = len(data) >= ads.HEADER
        if fits:
            zero, length = struct.unpack_from("<HI", data)
            size = struct.unpack_from("<I", data, 26)[0]
            fits = zero == 0 and size <= ads.LONGEST and length == size + 32 and len(data) == ads.HEADER + size
        if fits != (frame is not None):
            raise Finding("accepted" if frame is not None else "refused, but its lengths fit")
        if frame is None:
            return False
        if frame.telegram()[: ads.HEADER] != data[:30] + data[30:34] + data[34:38]:
            raise Finding("another frame is written than was read")
        reply = server._answer(frame, False, False)
        if (reply.invoke, reply.target, reply.flags) != (frame.invoke, frame.source, ads.REQUEST | ads.RESPONSE):
            raise Finding("the answer is not this request's")
        ads.read_frame(reply.telegram())
        return True

    return Target(seeds, False, check, _refused(ads.read_frame))


def requests(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Requests to a force sensor, as the simulated one reads them."""
    seeds = [
        netft.request(c, n) for c, n in ((netft.START, 0), (netft.STOP, 0), (netft.SET_BIAS, 7), (0xFFFF, 2**32 - 1))
    ]

    def check(data: bytes) -> bool:
        try:
            found: tuple[int, int] | None = netft.read_request(data)
        except ProtocolError:
            found = None
        good = len(data) == 8 and struct.unpack_from(">H", data)[0] == 0x1234
        if found != (struct.unpack(">HI", data[2:]) if good else None):
            raise Finding(f"read {found}")
        return good

    return Target(seeds, False, check, _refused(netft.read_request))


def wrench(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Generic wrench datagrams, several one behind the other. An input is cut into rows of 72 bytes."""
    seeds = [
        b"".join(
            wrenches.Wrench((first + k) % 2**32, 10**6 * k, status, k, (1.0, -2.0, 3.0, 4.0, 5.0, k)).written()
            for k in range(4)
        )
        for first, status in ((7, 0), (2**32 - 2, 4), (5, 1), (9, 2))
    ]
    rows, lengths = np.zeros((64, 2048), dtype=np.uint8), np.zeros(64, dtype=np.int64)

    def pieces(data: bytes) -> list[bytes]:
        return [data[k : k + 72] for k in range(0, min(len(data), 64 * 72), 72)]

    def stream(data: bytes) -> SampleStream:
        cut = pieces(data)
        for k, piece in enumerate(cut):
            rows[k, : len(piece)] = np.frombuffer(piece, dtype=np.uint8)
            lengths[k] = len(piece)
        read, good = wrenches.rows_of(rows, lengths, len(cut))
        out, taken = SampleStream(range_n=1000.0), read[good]
        out.begin()
        out.malformed = int(np.sum(~good))
        if len(taken):
            out.take(
                taken["wrench"],
                sequence=taken["sequence"],
                time_ns=taken["time_ns"],
                invalid=taken["status"] & 2 != 0,
                saturated=taken["status"] & 1 != 0,
            )
        out.end()
        return out

    def check(data: bytes) -> bool:
        found = stream(data)
        good, lost, bad, malformed, total = _wrench_judge(pieces(data))
        counted = found.good, found.lost, found.bad, found.malformed
        if counted != (good, lost, bad, malformed):
            raise Finding(f"counted {counted}, the judge {good, lost, bad, malformed}")
        if good and not np.allclose(found.w_sensor * good, total, rtol=1e-12, atol=1e-6):
            raise Finding(f"mean {found.w_sensor}, sum of the judge {total}")
        return good > 0

    return Target(seeds, False, check, stream)


def _wrench_fields(piece: bytes) -> tuple[int, int, tuple[float, ...]] | None:
    """Sequence, status and numbers of a datagram by struct; None where it is none."""
    if len(piece) != 72:
        return None
    name, sequence, _, status, _, *w = struct.unpack("<4sIQII6d", piece)
    known = status & 2 != 0 or all(math.isfinite(v) and abs(v) <= 1e6 for v in w)
    return (sequence, status, tuple(w)) if name == b"CFW1" and status <= 7 and known else None


def _wrench_judge(pieces: list[bytes]) -> tuple[int, int, int, int, Float]:
    """Good, lost, invalid and malformed datagrams, and the sum of the good ones."""
    count = Count(32)
    good, lost, bad, malformed, total = 0, 0, 0, 0, np.zeros(6)
    for piece in pieces:
        fields = _wrench_fields(piece)
        if (fields is not None) != _refused(wrenches.read_wrench)(piece):
            raise Finding(f"by struct {fields}")
        if fields is None:
            malformed += 1
            continue
        sequence, status, w = fields
        step = count.steps(sequence)
        if step == 0:
            continue
        lost += step - 1
        if status & 2 or not all(map(math.isfinite, w)):
            bad += 1
        elif not status & 1:
            good, total = good + 1, total + w
    return good, lost, bad, malformed, total


def tracker_log(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """Lines of a tracker's own program, as the bridge reads them."""
    seeds = [
        b"time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0.001,1.5,-2,3e3,1,0,0,0\n0.002,1.5,-2,3e3,0.6,0,0.8,0\n",
        b"time_ns,distance_mm,azimuth_deg,zenith_deg,status,sigma_mm\n1000,3000.5,12,85,0,0.015\n# x\n2000,1,2,3,1,0\n",
    ]

    def read(data: bytes) -> list[object]:
        return list(measurements(data.decode("utf-8", "replace").splitlines(), "fuzz"))

    def check(data: bytes) -> bool:
        lines = data.decode("utf-8", "replace").splitlines()
        try:
            found = list(measurements(lines, "fuzz"))
        except FileFormatError:
            return False
        names = lines[0].lstrip("\ufeff").strip().split(",") if lines else []
        rows = [line.strip().split(",") for line in lines[1:] if line.strip() and not line.strip().startswith("#")]
        if len(rows) != len(found):
            raise Finding(f"{len(found)} measurements in {len(rows)} lines")
        for row, one in zip(rows, found, strict=True):
            T = one.T_tracker_target
            texts = {name.strip(): text for name, text in zip(names, row, strict=True)}
            lengths = ("distance_mm",) if "distance_mm" in texts else ("x_mm", "y_mm", "z_mm")
            if not np.all(np.isfinite(T)) or abs(np.linalg.det(T[:3, :3]) - 1.0) > 1e-9:
                raise Finding("a pose is none")
            p = [1e3 * x for x in T[:3, 3]]
            far = math.hypot(*(float(texts[name]) for name in lengths))
            if not math.isclose(math.hypot(*p), far, rel_tol=1e-9, abs_tol=1e-9):
                raise Finding(f"the target is {math.hypot(*p)} mm away, the line says {far}")
        return True

    return Target(seeds, True, check, _refused(read))


def rsi_context(*, compiled: bool = True) -> Target:  # noqa: ARG001 - nothing of it is compiled
    """The context of RSI, in the form that ``rsi make`` writes."""
    limits = (OnlineLimits(2.0, 0.3, 1.5, 4), OnlineLimits(2.0, 0.3, 1.5, 12, axes=True))
    seeds = [RsiFiles("counterflex", "192.168.1.10", 49152, "ImFree", one).context().encode() for one in limits]

    def read(data: bytes) -> object:
        return parse_context(data, "fuzz")

    def check(data: bytes) -> bool:
        if not _refused(read)(data):
            return False
        try:
            ElementTree.fromstring(data)
        except ElementTree.ParseError as fault:
            raise Finding(f"accepted, but an XML library says {fault}") from fault
        return True

    return Target(seeds, True, check, _refused(read))


OTHERS: dict[str, Callable[..., Target]] = {
    "ads": ads_frames,
    "netft-request": requests,
    "wrench": wrench,
    "tracker-log": tracker_log,
    "rsi-context": rsi_context,
    **FRAMES,
}
