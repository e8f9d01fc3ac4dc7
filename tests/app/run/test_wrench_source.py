"""The generic wrench datagram as the force of the loop, over sockets: it corrects, holds, and says why."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.protocols.wrench.sensor import WrenchLink
from counterflex.protocols.wrench.telegram import INVALID, WARNING
from counterflex.twin.devices.wrench import WrenchSender
from counterflex_lab.faults.rig import Rig


class WrenchRig(Rig):
    """The rig with a sensor that sends wrench datagrams."""

    def _instrument(self) -> tuple[Any, Any]:
        link = WrenchLink(range_n=2000.0)
        return WrenchSender(link.address), link


def steady(time_s: float) -> Float:
    return np.array([0.0, 200.0, 0.0])


@pytest.mark.parametrize(
    ("status", "sends", "said"),
    [
        (INVALID, True, "hold (force stale)"),
        (1, True, "hold (force saturated)"),
        (0, False, "hold (force stale)"),
        (WARNING, True, "active"),
    ],
)
def test_it_corrects_and_a_lost_source_holds_until_it_is_back(status: int, sends: bool, said: str) -> None:
    with WrenchRig(force=steady, holds_feed=False) as rig:
        rig.activate().run(200)
        assert rig.seen.path()[-1] == "active"
        before = rig.seen.correction_m[-1]
        assert np.linalg.norm(before) > 1e-4
        rig.sensor.status, rig.sense = status, sends
        rig.run(10)
        assert rig.seen.path()[-1] == said
        assert np.linalg.norm(rig.seen.correction_m[-1] - before) < rig.step_limit_m
        rig.sensor.status, rig.sense = 0, True
        rig.run(60)
        assert rig.seen.path()[-1] == "active"


def test_a_bridge_that_is_started_again_goes_on_after_a_hold() -> None:
    with WrenchRig(force=steady, holds_feed=False) as rig:
        rig.activate().run(100)
        rig.sensor.close()
        rig.sensor = WrenchSender(rig.force_link.address)
        rig.run(100)
        assert rig.seen.path()[-1] == "active"
        assert rig.force_link.restarts == 1
