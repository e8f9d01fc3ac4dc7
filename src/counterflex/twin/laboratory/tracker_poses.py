"""The simulated laboratory measures poses: the robot goes to joint angles and rests, the tracker looks at it."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress
from counterflex.core.units import DEG
from counterflex.geometry import pose, rotation
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_move import move
from counterflex.twin.truth.truth import Truth

APPROACH_RAD = 1.0 * DEG
"""Each pose is approached over this stretch of every axis, from where the robot was before: friction and play act."""
MOVE_S = 0.4
REST_S = 0.2


def reached(truth: Truth, q: Float, progress: Progress) -> tuple[Float, Float]:
    """Drive to joint angles one after the other and rest.

    ``q``: (n, 6) rad, commanded.

    Returns:
        (n, 4, 4) T_base_tcp as they truly are, and (n, 6) rad as the controller shows them.
    """
    plant = Plant(truth)
    Ts, shown = np.empty((len(q), 4, 4)), np.empty((len(q), 6))
    before = q[0] - APPROACH_RAD
    for k, row in enumerate(q):
        plant.reset(row + APPROACH_RAD * np.sign(before - row))
        move(plant, row, move_s=MOVE_S, rest_s=REST_S)
        Ts[k], shown[k] = plant.tcp_pose(), plant.q_motor()
        before = row
        progress((k + 1) / len(q), f"pose {k + 1} of {len(q)}")
    return Ts, shown


@Measurement
def measure(order: Order) -> Measured:
    """Poses of the tracker's six-axis target.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``.

    Returns:
        ``q``, ``p_tracker_target``, ``R_tracker_target`` (rotation vectors).
    """
    truth, laboratory, _request, _settings, progress = order
    q = order.q
    Ts, shown = reached(truth, q, progress)
    T = pose.inverse(laboratory.T_base_tracker) @ Ts @ laboratory.T_tcp_target
    noise = laboratory.noise("tracker_poses")
    p = T[:, :3, 3] + laboratory.tracker_m * noise.standard_normal((len(q), 3))
    R = rotation.exp(laboratory.tracker_rad * noise.standard_normal((len(q), 3))) @ T[:, :3, :3]
    return Measured(
        channels={"q": shown, "p_tracker_target": p, "R_tracker_target": rotation.log(R)},
        sigma={"p_tracker_target": laboratory.tracker_m, "R_tracker_target": laboratory.tracker_rad},
        group=np.arange(len(q), dtype=np.int64),
    )
