"""Frames described in the cell file as a protocol that it can name."""

from __future__ import annotations

from typing import Final

from counterflex.core.errors import InputError
from counterflex.protocols.force.sensors import ForceSensorKind, Opening
from counterflex.protocols.frame.link import FrameLink, FrameSource


def _open(opening: Opening) -> FrameLink:
    if not isinstance(opening.frame, FrameSource):
        raise InputError('protocol = "frame" needs the table [sensor.frame]')
    return FrameLink(
        opening.host,
        opening.port,
        opening.frame,
        wait_s=opening.wait_s,
        range_n=opening.range_n,
        range_nm=opening.range_nm,
    )


FRAME: Final = ForceSensorKind(
    "frames of a fixed length over UDP or TCP, described in the cell file",
    _open,
    device="counterflex.app.simulated_cell.instruments:frame_sender",
)
