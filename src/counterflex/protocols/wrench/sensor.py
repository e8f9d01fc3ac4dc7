"""The generic wrench datagram as a protocol that a cell file can name: the loop listens, the source sends."""

from __future__ import annotations

from typing import Final

from counterflex.protocols.force.sensors import ForceSensorKind, Opening
from counterflex.protocols.wrench.link import WrenchLink


def _open(opening: Opening) -> WrenchLink:
    return WrenchLink(
        opening.host,
        opening.port,
        sender=str(opening.values["sender"]),
        source=int(opening.values["source"]),
        range_n=opening.range_n,
        range_nm=opening.range_nm,
    )


WRENCH: Final = ForceSensorKind(
    "generic wrench datagram: UDP, any sensor behind a bridge",
    _open,
    {"sender": "", "source": -1},
    "counterflex.app.simulated_cell.force_devices:wrench_sender",
)
