"""The simulated laboratory measures distances: a telescoping ball bar between the tool tip and a fixed ball."""

from __future__ import annotations

import numpy as np

from counterflex.core.units import UM
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.laboratory.tracker_poses import reached

BAR_M = 5.0 * UM
"""Standard deviation of the bar's scale."""
ANCHOR_M = (1.2, -0.3, 0.4)
"""Where the fixed ball stands, in the base."""


@Measurement
def measure(order: Order) -> Measured:
    """Distances of the tool tip from the fixed ball.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``. Settings: ``anchor_m``, [x, y, z] of the fixed ball in the base.

    Returns:
        ``q``, ``distance``.
    """
    truth, laboratory, _request, settings, progress = order
    q = order.q
    Ts, shown = reached(truth, q, progress)
    anchor = np.array(settings.get("anchor_m", ANCHOR_M), dtype=np.float64)
    length = np.linalg.norm(Ts[:, :3, 3] - anchor, axis=1)
    length = length + BAR_M * laboratory.noise("distances").standard_normal(len(q))
    return Measured(
        channels={"q": shown, "distance": length[:, None]},
        sigma={"distance": BAR_M},
        group=np.arange(len(q), dtype=np.int64),
    )
