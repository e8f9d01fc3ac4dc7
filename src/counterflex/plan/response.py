"""How the robot answers a force that changes: its arm swings, its end effector follows at once.

The arm (everything up to the flange, drives included) has its lowest mode at 5 to 15 Hz, within reach of the force at
entries, exits and corners; sensor, holder and spindle resonate several times higher and follow statically. The
displacement that has to be corrected is therefore the arm's compliance times the force, passed through the arm's mode,
plus the static deflection of the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive, frozen
from counterflex.core.jit import kernel
from counterflex.plan.cut_kernel import oscillator
from counterflex.robot.chain import ElasticChain


@dataclass(frozen=True)
class Mode:
    """The lowest structural mode, as a tap test at the tool shows it with the drives on.

    Attributes:
        omega_rad_s: Undamped angular frequency, > 0.
        damping_ratio: > 0.
    """

    omega_rad_s: float
    damping_ratio: float

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("mode frequency", self.omega_rad_s)
        as_positive("mode damping ratio", self.damping_ratio)


def arm_of(chain: ElasticChain) -> ElasticChain:
    """The chain with everything beyond the flange rigid."""
    beyond = np.arange(chain.n) > chain.flange_segment
    return replace(chain, compliance=frozen(np.where(beyond[:, None], 0.0, chain.compliance)))


@kernel("void(float64[:,::1], float64[::1], float64, float64, float64[:,::1])")
def _respond(target: Float, time: Float, omega: float, zeta: float, out: Float) -> None:
    x, v = np.zeros(6), np.zeros(6)
    for i in range(1, target.shape[0]):
        dt = time[i] - time[i - 1]
        if dt > 0.0:
            a, b, c, d = oscillator(dt, omega, zeta)
            for k in range(target.shape[1]):
                rest = x[k] - target[i, k]
                x[k] = target[i, k] + a * rest + b * v[k]
                v[k] = c * rest + d * v[k]
        for k in range(target.shape[1]):
            out[i, k] = x[k]


def respond(static: Float, time_s: Float, mode: Mode) -> Float:
    """Displacement of a structure of one mode under a force that changes.

    ``x'' + 2 zeta w x' + w^2 x = w^2 x_static(t)``, started at rest, with the static displacement held over each row
    (row i: from time i - 1 to i); exact for that.

    Args:
        static: (n, 6) displacement that the force of each row would cause if it stayed, m and rad.
        time_s: (n,) non-decreasing.
        mode: The mode.

    Returns:
        (n, 6) displacement at the end of each row.
    """
    target = np.array(as_float("static", static, (None, 6)))
    out = np.zeros_like(target)
    _respond(target, np.array(as_float("time_s", time_s, (len(target),))), mode.omega_rad_s, mode.damping_ratio, out)
    return out
