"""Table ``[timing]`` of a cell file: how late each channel is, and how its clock runs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from counterflex.files.schema import Table

Times = tuple[Annotated[float, Field(ge=-1e4, le=1e4)], ...]
"""ms: one number, or one for each axis."""
Late = Annotated[float, Field(ge=0.0, le=1e4)]


class ChannelTimingTable(Table):
    """Dead time and lag of one channel against another, and its clock.

    A channel shows at the stamp t what was ``dead_time_ms`` before, behind a lag. Where another clock stamped it, the
    difference of the clocks and the dead time cannot be told apart; their sum is ``clock_offset_ms``.
    """

    against: str = ""
    dead_time_ms: Times = ()
    dead_time_sigma_ms: Times = ()
    lag_ms: Late = 0.0
    lag_sigma_ms: Late = 0.0
    lag_damping: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    clock_offset_ms: float | None = None
    clock_offset_sigma_ms: Late = 0.0
    clock_drift_ppm: float = 0.0
    clock_drift_sigma_ppm: Late = 0.0
    bandwidth_hz: Late = 0.0
    source: str = ""


class TimingTable(Table):
    """Timing of all channels of a cell."""

    link_encoder: ChannelTimingTable = ChannelTimingTable()
    drive: ChannelTimingTable = ChannelTimingTable()
    feedback: ChannelTimingTable = ChannelTimingTable()
    tracker: ChannelTimingTable = ChannelTimingTable()
    force: ChannelTimingTable = ChannelTimingTable()
    correction: ChannelTimingTable = ChannelTimingTable()
