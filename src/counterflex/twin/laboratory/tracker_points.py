"""The simulated laboratory measures points: reflectors on the spindle, looked at one after the other in each pose."""

from __future__ import annotations

import numpy as np

from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.laboratory.tracker_poses import reached

NESTS_M = np.array([[0.0, 0.0, 0.0], [120.0, 0.0, -40.0], [-60.0, 100.0, -80.0], [-50.0, -110.0, -20.0]]) * MM
"""Where the nests of the reflectors sit in the frame of the six-axis target."""


@Measurement
def measure(order: Order) -> Measured:
    """Points of one reflector or several.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``. Settings: ``reflectors`` 1 to 4 (1).

    Returns:
        ``q``, ``p_tracker_target``, ``target`` (number of the reflector); the group is the pose.
    """
    truth, laboratory, _request, settings, progress = order
    q = order.q
    count = min(max(int(settings.get("reflectors", 1)), 1), len(NESTS_M))
    Ts, shown = reached(truth, q, progress)
    T = pose.inverse(laboratory.T_base_tracker) @ Ts @ laboratory.T_tcp_target
    noise = laboratory.noise("tracker_points")
    seen = np.concatenate([pose.transform(T, nest) for nest in NESTS_M[:count]])
    n = len(q)
    return Measured(
        channels={
            "q": np.tile(shown, (count, 1)),
            "p_tracker_target": seen + laboratory.tracker_m * noise.standard_normal(seen.shape),
            "target": np.repeat(np.arange(1.0, count + 1.0), n)[:, None],
        },
        sigma={"p_tracker_target": laboratory.tracker_m},
        group=np.tile(np.arange(n, dtype=np.int64), count),
    )
