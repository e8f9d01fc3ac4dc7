"""The simulated laboratory measures distances: a telescoping ball bar between the tool tip and a fixed ball."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress
from counterflex.core.units import UM
from counterflex.twin.laboratory.laboratory import Laboratory, Measured
from counterflex.twin.laboratory.tracker_poses import joint_request, reached
from counterflex.twin.truth.truth import Truth

BAR_M = 5.0 * UM
"""Standard deviation of the bar's scale."""
ANCHOR_M = (1.2, -0.3, 0.4)
"""Where the fixed ball stands, in the base."""


def measure(
    truth: Truth,
    laboratory: Laboratory,
    request: Mapping[str, Float],
    settings: Mapping[str, Any],
    progress: Progress,
) -> Measured:
    """Distances of the tool tip from the fixed ball.

    Args:
        truth: The cell as it is.
        laboratory: Noise.
        request: ``q1_rad`` ... ``q6_rad``.
        settings: ``anchor_m``, [x, y, z] of the fixed ball in the base.
        progress: Told about poses.

    Returns:
        ``q``, ``distance``.
    """
    q = joint_request(request)
    Ts, shown = reached(truth, q, progress)
    anchor = np.array(settings.get("anchor_m", ANCHOR_M), dtype=np.float64)
    length = np.linalg.norm(Ts[:, :3, 3] - anchor, axis=1)
    length = length + BAR_M * laboratory.noise("distances").standard_normal(len(q))
    return Measured(
        channels={"q": shown, "distance": length[:, None]},
        sigma={"distance": BAR_M},
        group=np.arange(len(q), dtype=np.int64),
    )
