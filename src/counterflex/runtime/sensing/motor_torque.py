"""From the currents of a robot's motors to the torque that the process puts on its axes, in the cycle.

A motor gives ``c i`` on the link side of its gear, c its torque per current; in slow motion this holds against weight,
process and friction, all torques on the axis positive in its positive direction::

    0 = c i + weight(q) + (J^T w) + friction        so        -c i - weight(q) = J^T w + friction

Friction and what is wrong with the weight stay in: the estimator learns them where the plan cuts air
(:mod:`counterflex.runtime.estimator.idle_torque`). Acceleration is left out: at milling feeds it is small but for
corners.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.batch import weight_torque
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact


@kernel(
    "void(Chain, float64[::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[::1],"
    " float64[::1])",
    Chain=CHAIN,
    entry=True,
)
def _process_torque(
    chain: Compact,
    per_current: Float,
    q: Float,
    current: Float,
    frame: Float,
    still: Float,
    trig: Float,
    out: Float,
) -> None:
    weight_torque(chain, q, frame, still, trig, out)
    for k in range(6):
        out[k] = -per_current[k] * current[k] - out[k]


class MotorTorque:
    """Motor currents of one robot as torque of process and friction.

    Args:
        chain: Its masses, payload and counterbalance.
        per_current: (6,) N m on the link side per unit of current as the controller sends it (A, or % where it sends
            %), positive where a positive current turns the axis in its positive direction.

    Attributes:
        current: (6,) last currents, to be filled in before the call.

    Raises:
        InputError: A number is zero or not finite.
    """

    def __init__(self, chain: ElasticChain, per_current: Float) -> None:
        torque_per_current = as_float("per_current", per_current, (6,))
        if not np.all(np.abs(torque_per_current) > 0.0):
            raise InputError(
                "torque per motor current", value=torque_per_current.tolist(), limit="six numbers that are not zero"
            )
        self._per_current: Float = np.ascontiguousarray(torque_per_current)
        self._chain = chain.compact
        m = len(self._chain.stations) - 1
        self._frame: Float = np.zeros((m + 1, 12))
        self._still: Float = np.zeros((m, 6))
        self._trig: Float = np.zeros(12)
        self.current: Float = np.zeros(6)

    def __call__(self, q: Float, out: Float) -> None:
        """Torque of process and friction about the axes, of :attr:`current`.

        Args:
            q: (6,) rad, C order.
            out: (6,) N m, positive in the positive direction of each axis; written.
        """
        _process_torque(self._chain, self._per_current, q, self.current, self._frame, self._still, self._trig, out)
