"""Turns of axes 2 and 3 under own weight, by compliance times moment where masses are not known.

A joint turns by its compliance times the moment of all that it carries. With the wrist counted to link 3 as it is on
average, three moments are left: of link 2 about axis 2, and of link 3 with all that follows about axes 2 and 3. Each
has two numbers, the products of the compliance and the weight's first moment along x and y of the link::

    delta q_a = sign_a sum_b sum_(e in x, y) k_abe (R_b e) . (u x z_a)

with u the direction of gravity, ``z_a`` the axis, ``R_b e`` the link's own x or y in the rigid chain. In an arm of
vertical first axis these are sines and cosines of q2 and of q2 + q3. The wrist's own part, and what bends elsewhere, is
left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import ModelError
from counterflex.core.units import MRAD
from counterflex.robot.elasticity.chain import ElasticChain

TERMS: Final = (
    (1, 1, "x"),
    (1, 1, "y"),
    (1, 2, "x"),
    (1, 2, "y"),
    (2, 2, "x"),
    (2, 2, "y"),
)
"""Axis 0..5 that turns, axis that drives the link that is carried, direction in the link: one for each number."""
LARGEST_RAD: Final = 20.0 * MRAD
"""Largest number that is accepted: no arm yields that much."""


def arm_is_heavy(chain: ElasticChain) -> bool:
    """Return whether any body of the robot that axis 2 carries has a mass; what hangs on its flange is not asked."""
    first = int(np.flatnonzero(chain.joint == TERMS[0][0])[0])
    return bool(np.any(chain.mass[first : chain.flange_segment + 1] > 0.0))


def turned_axis() -> Int:
    """(6,) axis 0..5 that each number turns."""
    return np.array([axis for axis, _, _ in TERMS], dtype=np.int64)


def unit_turns(chain: ElasticChain, q: Float) -> Float:
    """Turns of axes 2 and 3 per unit of each of the six numbers.

    Args:
        chain: Its rigid geometry and the direction of its gravity.
        q: (..., 6) rad, controller angles.

    Returns:
        (..., 6) rad per rad, positive in the positive direction of the controller's angle, in the order of
        :data:`TERMS`; the axis is that of :func:`turned_axis`.
    """
    q = as_float("q", q)
    size = float(np.linalg.norm(chain.gravity))
    down = chain.gravity / size if size > 0.0 else np.zeros(3)
    R: Float = np.eye(3)
    Rs: dict[int, Float] = {}
    sign: dict[int, float] = {}
    for i, axis in enumerate(chain.joint.tolist()):
        R = R @ chain.fixed[i][:3, :3]
        if axis >= 0:
            R = _turned(R, chain.sign[i] * q[..., axis] + chain.offset[i])
            Rs[axis], sign[axis] = R, float(chain.sign[i])
        if axis == TERMS[-1][0]:
            break
    columns = []
    for axis, link, direction in TERMS:
        lever = np.cross(down, Rs[axis][..., :, 2])
        columns.append(sign[axis] * np.sum(Rs[link][..., :, "xyz".index(direction)] * lever, axis=-1))
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


@dataclass(frozen=True, eq=False)
class AxisSag:
    """Turns of axes 2 and 3 by own weight."""

    chain: ElasticChain  # the rigid chain that it acts on
    moments_rad: Float  # (6,) compliance times weight's first moment, rad, in the order of TERMS

    def __post_init__(self) -> None:
        """Check the six numbers.

        Raises:
            ModelError: Not six finite numbers, far too large, or on a robot that has masses.
        """
        if arm_is_heavy(self.chain):
            raise ModelError(
                "own weight would count twice: axis_sag stands for masses that are not known, and the robot has masses",
                where="axis_sag",
                hint="Delete [axis_sag], or set mass_kg = 0 in [[robot.elastic]] from axis 2 on",
            )
        values = np.asarray(self.moments_rad, dtype=np.float64)
        if values.shape != (len(TERMS),) or not np.all(np.isfinite(values)):
            raise ModelError(
                "the sag of axes 2 and 3 is not six finite numbers", where="axis_sag", value=values.tolist()
            )
        if np.max(np.abs(values)) > LARGEST_RAD:
            raise ModelError(
                "the sag of axes 2 and 3 is far too large",
                where="axis_sag",
                value=f"{float(np.max(np.abs(values))) / MRAD:.3g} mrad",
                limit=f"<= {LARGEST_RAD / MRAD:g} mrad",
                hint="Check the unit: mrad",
            )

    def turns(self, q: Float) -> Float:
        """(..., 6) rad that each axis is turned by at controller angles q (..., 6) rad; 0 but for axes 2 and 3."""
        q = as_float("q", q)
        each = unit_turns(self.chain, q) * self.moments_rad
        out = np.zeros_like(q)
        for k, axis in enumerate(turned_axis()):
            out[..., axis] += each[..., k]
        return out


def _turned(R: Float, angle: Float) -> Float:
    """R (..., 3, 3) followed by a turn about its z by angle (...)."""
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    R = np.broadcast_to(R, (*np.shape(angle), 3, 3))
    return np.stack([c * R[..., 0] + s * R[..., 1], c * R[..., 1] - s * R[..., 0], R[..., 2]], axis=-1)
