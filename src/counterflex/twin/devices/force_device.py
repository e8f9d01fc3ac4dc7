"""Simulated force sensor as the simulated cell needs it, whatever it speaks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.twin.network.faults import FaultSchedule

Address = tuple[str, int]


@dataclass(frozen=True, eq=False, kw_only=True)
class ForceStart:
    """Settings of a simulated force sensor."""

    host: str = "127.0.0.1"  # address that it binds; of a sensor that sends by itself, where it sends to
    port: int = 0  # UDP port; 0 takes a free one, and says of a sensor that sends by itself that nobody has named one
    http_port: int = 0  # of a document that it serves; 0 takes a free one
    rate_hz: int = 1000  # samples in a second
    status: int = 0  # of every sample
    # scripted, by the time of the samples and their number
    faults: FaultSchedule = field(default_factory=FaultSchedule)
    # of ``[sensor.link]`` in the cell file
    values: Mapping[str, float | int | str | bool] = field(default_factory=dict)
    frame: object = None  # of ``[sensor.frame]``, see Opening
    where: str = ""  # cell file, for messages

    def peer(self, protocol: str) -> tuple[str, int]:
        """Address that the device sends to."""
        if self.port == 0:
            raise InputError(
                "where the force sensor sends to is not said",
                where=self.where,
                value=f'protocol = "{protocol}"',
                hint="Give force_sensor.address (--scenario), the same as for counterflex run",
            )
        return self.host, self.port


class ForceDevice(Protocol):
    """A force sensor on a socket."""

    dead: bool
    """It never sends again."""

    @property
    def address(self) -> Address | None:
        """Address at which it is asked; None: it sends by itself."""

    @property
    def http_address(self) -> Address | None:
        """Address of a document about it."""

    def poll(self) -> None:
        """Take what was asked of it."""

    def send(self, w_sensor: Float, time_s: float | None = None) -> None:
        """Send a sample (6,) N, N m; without a time it counts samples."""

    def counts(self, taken: int, /) -> dict[str, int]:
        """Counts of what left it, by name, after so many samples."""

    def close(self) -> None:
        """Free the sockets."""
