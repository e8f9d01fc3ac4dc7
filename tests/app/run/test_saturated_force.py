"""R15: a force sensor beyond its range holds the loop on the first sample; it goes on after 50 clean cycles.

Its range is what the cell file says, else what the sensor says that it is calibrated for, and in any case what its
counts can show: a sensor that stands at the end of them need not say so in its status.
"""

from __future__ import annotations

import math
import socket

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.integrations.ati.link import telegram as netft
from counterflex.integrations.ati.link.link import NetftLink
from counterflex.integrations.ati.simulated import COUNTS
from counterflex_lab.faults.rig import Rig

BEYOND_N = 9000.0
CLEAN = 50
HELD = "hold (force saturated)"


@pytest.mark.parametrize("cycles", [1, 20])
def test_a_saturated_sensor_holds_in_the_same_cycle_until_it_is_clean(cycles: int) -> None:
    saturated = False

    def force(time_s: float) -> Float:
        return np.array([0.0, BEYOND_N if saturated else 200.0, 0.0])

    with Rig(force=force, holds_feed=False) as rig:
        rig.activate().run(200)
        assert rig.seen.path()[-1] == "active"
        before = rig.seen.correction_m[-1]
        assert np.linalg.norm(before) > 1e-4
        saturated = True
        for _ in range(cycles):
            rig.cycle()
            assert rig.seen.path()[-1] == HELD
        saturated = False
        rig.run(CLEAN - 2)
        assert rig.seen.path()[-1] == HELD
        held = np.array(rig.seen.correction_m[2 - CLEAN :])
        assert not np.any(held - held[0])
        assert np.linalg.norm(held[0] - before) < rig.step_limit_m
        rig.run(10)
        assert rig.seen.path()[-1] == "active"
        assert rig.seen.steps()[-cycles - CLEAN :].max() < rig.step_limit_m


@pytest.mark.parametrize("force_n", [2147.0, -2147.4])
def test_counts_near_their_end_are_no_force_although_the_sensor_calls_them_good(force_n: float) -> None:
    at_the_rail = False

    def force(time_s: float) -> Float:
        return np.array([0.0, force_n if at_the_rail else 200.0, 0.0])

    with Rig(force=force, holds_feed=False) as rig:
        rig.activate().run(200)
        before = rig.seen.correction_m[-1]
        at_the_rail = True
        rig.run(20)
        assert rig.sensor.status == netft.GOOD
        assert rig.seen.path()[-1] == HELD
        assert np.linalg.norm(rig.seen.correction_m[-1] - before) < rig.step_limit_m


@pytest.mark.parametrize(
    ("said", "told", "shown", "saturated"),
    [
        (None, None, 2000.0, False),
        (None, None, 2041.0, True),
        (330.0, None, 313.0, False),
        (330.0, None, 314.0, True),
        (330.0, 1000.0, 900.0, False),
        (330.0, 1000.0, 951.0, True),
        (None, 1e6, -2041.0, True),
    ],
)
def test_the_range_is_the_cell_file_s_else_the_calibration_s_and_never_beyond_the_counts(
    said: float | None, told: float | None, shown: float, saturated: bool
) -> None:
    sensor = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sensor.bind(("127.0.0.1", 0))
    rated = (math.inf if said is None else said,) * 3
    scaling = netft.Scaling(1.0 / COUNTS, 1.0 / COUNTS, 1000, "Net F/T", rated)
    link = NetftLink(sensor.getsockname(), scaling, range_n=told)
    try:
        link.start()
        peer = sensor.recvfrom(100)[1]
        counts = (0, 0, round(shown * COUNTS), 0, 0, 0)
        sensor.sendto(netft.NetftRecord(1, 1, netft.GOOD, counts).written(), peer)
        assert link.drain() == 1
        assert link.saturated == saturated
    finally:
        link.close()
        sensor.close()
