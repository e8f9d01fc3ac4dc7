"""Further readers of what comes from outside: ADS, requests to a force sensor, tracker logs, contexts of RSI."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from counterflex.core.errors import CounterflexError, FileFormatError, ProtocolError
from counterflex.files.logs.tracker_log import measurements
from counterflex.protocols.ads import telegram as ads
from counterflex.protocols.kuka_rsi.context import parse_context
from counterflex.protocols.kuka_rsi.make.files import RsiFiles
from counterflex.protocols.kuka_rsi.setup import OnlineLimits
from counterflex.protocols.netft import telegram as netft
from counterflex.twin.devices.ads import AdsServer, PlcVariable
from fuzz_target import Finding, Target

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
    seeds = [ads.write_frame(ads.Frame(there, here, c, ads.REQUEST, 0, k, d)) for k, (c, d) in enumerate(requests)]

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
        if ads.write_frame(frame)[: ads.HEADER] != data[:30] + data[30:34] + data[34:38]:
            raise Finding("another frame is written than was read")
        reply = server._answer(frame, False, False)
        if (reply.invoke, reply.target, reply.flags) != (frame.invoke, frame.source, ads.REQUEST | ads.RESPONSE):
            raise Finding("the answer is not this request's")
        ads.read_frame(ads.write_frame(reply))
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
    "tracker-log": tracker_log,
    "rsi-context": rsi_context,
}
