"""The ATI Net F/T as a protocol that a cell file can name: its scaling is read first, then its stream is asked for."""

from __future__ import annotations

import time
from typing import Final

from counterflex.core.errors import OutputError
from counterflex.integrations.ati.link.link import NetftLink, fetch_scaling
from counterflex.integrations.ati.link.telegram import Scaling
from counterflex.protocols.force.sensors import ForceSensorKind, Opening


def _scaling(opening: Opening) -> Scaling:
    end = time.monotonic() + opening.wait_s
    while True:
        try:
            return fetch_scaling(opening.host, opening.http_port)
        except OutputError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)


def _open(opening: Opening) -> NetftLink:
    peer = (opening.host, opening.port)
    link = NetftLink(peer, _scaling(opening), range_n=opening.range_n, range_nm=opening.range_nm)
    link.start()
    return link


NETFT: Final = ForceSensorKind(
    "ATI Net F/T: UDP, scaling over HTTP", _open, device="counterflex.integrations.ati.simulated:opened"
)
