"""The sensor's side of the force protocols: by the name in the cell file, and of those that belong to no maker."""

from __future__ import annotations

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.registry import imported
from counterflex.protocols.force.frame_format import FrameFormat
from counterflex.protocols.force.sensors import FORCE_SENSORS
from counterflex.protocols.frame.link import FrameSource
from counterflex.protocols.wrench.telegram import INVALID, SATURATED, Wrench
from counterflex.twin.devices.force_device import ForceDevice, ForceStart
from counterflex.twin.devices.wrench import WrenchSender


def force_device(protocol: str, start: ForceStart) -> ForceDevice:
    """Start a simulated force sensor.

    Args:
        protocol: Its name, as in the cell file.

    Raises:
        InputError: The protocol has no simulated sensor, or the settings do not fit it.
        OutputError: A port is taken.
    """
    place = FORCE_SENSORS[protocol].device
    if not place:
        raise InputError(
            "no simulated force sensor speaks this protocol",
            where=start.where,
            value=f'protocol = "{protocol}"',
            limit=", ".join(name for name, kind in FORCE_SENSORS.items() if kind.device),
        )
    device: ForceDevice = imported(place)(start)
    return device


def wrench_sender(start: ForceStart) -> WrenchSender:
    """A sensor that sends wrench datagrams."""
    source = max(0, int(start.values.get("source", -1)))
    sender = WrenchSender(_peer(start, "wrench"), start.faults, source=source)
    sender.status = start.status
    return sender


def frame_sender(start: ForceStart) -> WrenchSender:
    """A sensor that sends the frames of the cell file by itself."""
    peer, own = _peer(start, "frame"), start.frame
    assert isinstance(own, FrameSource)
    if own.transport != "udp" or own.start or own.request:
        raise InputError(
            "the simulated cell sends frames by itself over UDP only",
            where=start.where,
            value="[sensor.frame] with " + ("tcp" if own.transport == "tcp" else "start or request"),
        )
    return WrenchSender(peer, start.faults, write=lambda one: _frame_of(own.frame, one))


def _frame_of(frame: FrameFormat, one: Wrench) -> bytes:
    bits = frame.saturated_bits if one.status & SATURATED else 0
    bits |= frame.invalid_bits if one.status & INVALID else 0
    return frame.write(np.array(one.w_sensor), one.sequence, bits)


def _peer(start: ForceStart, protocol: str) -> tuple[str, int]:
    if start.port == 0:
        raise InputError(
            "where the force sensor sends to is not said",
            where=start.where,
            value=f'protocol = "{protocol}"',
            hint="Give force_sensor.address (--scenario), the same as for counterflex run",
        )
    return start.host, start.port
