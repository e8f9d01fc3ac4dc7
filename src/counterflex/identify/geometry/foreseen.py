"""What readings of a tracker target at poses not yet measured would say: residuals for choosing poses."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import UM, URAD
from counterflex.identify.geometry.arm_parameters import ArmModel
from counterflex.identify.geometry.known_frames import KnownFrames
from counterflex.identify.geometry.placed_frame import PlacedFrame, frame_parameters
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.solver.parameters import Parameters

POSITION_M: Final = 50.0 * UM
ROTATION_RAD: Final = 100.0 * URAD
"""What a pose may be off by for other reasons than geometry: tracker, play, friction."""


def foreseen(model: ArmModel, q: Float, known: KnownFrames | None) -> tuple[Parameters, TrackerResiduals]:
    """Parameters, and the residuals that readings of a six-axis target at poses not yet measured would have.

    ``q``: (n, 6) rad. ``known``: First estimates of tracker and target; None: in the base and at the tool tip.

    Returns:
        The parameters of the arm, ``T_base_tracker.*`` and ``T_tcp_target.*`` (nothing is known of these two); the
        residuals, whose Jacobian counts, weighted by :data:`POSITION_M` and :data:`ROTATION_RAD`.
    """
    first = len(model.parameters)
    parameters = model.parameters + Parameters.of(
        [*frame_parameters("T_base_tracker", "tracker in the base"), *frame_parameters("T_tcp_target", "target")]
    )
    T0 = np.eye(4) if known is None else known.T_base_tracker
    X0 = np.eye(4) if known is None else known.T_tcp_target
    block = TrackerResiduals(
        "candidates",
        np.arange(len(q), dtype=np.int64),
        np.tile([POSITION_M] * 3 + [ROTATION_RAD] * 3, (len(q), 1)),
        model.at(q),
        PlacedFrame(T0, np.arange(first, first + 6, dtype=np.int64)),
        PlacedFrame(X0, np.arange(first + 6, first + 12, dtype=np.int64)),
        np.zeros((len(q), 3)),
        np.broadcast_to(np.eye(3), (len(q), 3, 3)),
    )
    return parameters, block
