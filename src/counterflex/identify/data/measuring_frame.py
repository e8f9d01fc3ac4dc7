"""A measuring frame: distance sensors beside the robot look at flat faces on the tool and show how it moves.

Sensor i stands at ``p_i`` and looks along the unit vector ``u_i``; it shows the distance s to a plane of the tool with
the normal ``n_i``, which it meets in the foot ``a_i = p_i + s_i u_i``. The tool moves by v at the reference point r and
by the rotation vector omega, so that with ``R = Exp(omega)`` the plane has the normal ``R n_i`` and goes through
``r + v + R (a_i - r)``::

    s_i' = R n_i . (r + v + R (a_i - r) - p_i) / (R n_i . u_i)
    ds_i = n_i . (v + omega x (a_i - r)) / (n_i . u_i)                              (first order)

Weighted least squares, repeated about the motion found, gives v and omega from six sensors on; with three to five the
rotation is left out, which is right only where all normals pass through r. Laser triangulation sensors and dial gauges
alike; the latter count the other way (``signs`` in the manifest).

Source: the set-up of Haehn2020 section 2.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import rotation

FEWEST: Final = 3
"""Sensors that a displacement takes."""
SIX: Final = 6
"""Sensors that displacement and rotation take."""
_ROUNDS: Final = 8
_SETTLED: Final = 1e-12


@dataclass(frozen=True, eq=False)
class SensorFrame:
    """The sensors of a measuring frame, in common axes."""

    names: tuple[str, ...]  # k of them
    position: Float  # (k, 3) m, where each would show zero
    direction: Float  # (k, 3) unit vectors in which the distance grows
    normal: Float  # (k, 3) unit vectors of the planes, towards the sensors
    point: Float  # (k, 3) m, a point of each plane, NaN where none is stated
    # what the vectors are given in: `base`, `tcp` (axes of the unloaded tool, from the tool tip), or `frame` (axes of
    # the measuring frame, whose place each row states)
    axes: str
    where: str = ""  # manifest, for messages

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Motion of the tool by the sensors."""

    # (n, 6) or (n, 3) m (and rad), displacement of the reference point (and rotation vector), axes of the sensors
    d: Float
    covariance: Float  # (n, c, c) of it, by the stated standard deviations of the readings
    residual: Float  # (n, k) m, reading less what the motion found gives
    sigma: Float  # (n, k) m, standard deviation of the change of each reading

    @property
    def spare(self) -> int:
        """Readings more than numbers found."""
        return int(self.residual.shape[1] - self.d.shape[1])

    def misfit(self) -> Float:
        """(n,) root of ``chi^2 / spare`` of each row, 1 for noise as stated; NaN without a spare reading."""
        if self.spare < 1:
            return np.full(len(self.d), np.nan)
        out: Float = np.sqrt(np.sum((self.residual / self.sigma) ** 2, axis=1) / self.spare)
        return out


def feet(frame: SensorFrame, s: Float) -> Float:
    """(n, k, 3) m, where the beams meet the planes, by the readings (n, k) m."""
    out: Float = frame.position + s[:, :, None] * frame.direction
    return out


def shown(frame: SensorFrame, s_unloaded: Float, d: Float, reference: Float) -> Float:
    """Readings after a motion, exactly.

    ``s_unloaded``: (n, k) m, readings before. ``d``: (n, 6) m, rad, motion of the reference point; (n, 3) without
    rotation. ``reference``: (n, 3) m, the reference point before, axes of the sensors. Returns (n, k) m.
    """
    R, moved = _turned(d), reference + d[:, :3]
    at = moved[:, None] + (R[:, None] @ (feet(frame, s_unloaded) - reference[:, None])[..., None])[..., 0]
    normal = (R[:, None] @ frame.normal[..., None])[..., 0]
    along = np.sum(normal * frame.direction, axis=2)
    out: Float = np.sum(normal * (at - frame.position), axis=2) / along
    return out


def slopes(frame: SensorFrame, s: Float, d: Float, reference: Float) -> Float:
    """Derivatives (n, k, c) of the readings by a further motion ``v + dv``, ``Exp(domega) R``.

    ``s``: (n, k) m, readings after the motion d. ``d``: (n, c) motion so far, c is 3 or 6. ``reference``: (n, 3) m, the
    reference point before any motion.
    """
    R = _turned(d)
    normal = (R[:, None] @ frame.normal[..., None])[..., 0]
    along = np.sum(normal * frame.direction, axis=2)[..., None]
    lever = feet(frame, s) - (reference + d[:, :3])[:, None]
    J = np.concatenate([normal, np.cross(lever, normal)], axis=2) / along
    out: Float = J[:, :, : d.shape[1]]
    return out


def motion(frame: SensorFrame, s_unloaded: Float, s_loaded: Float, sigma: Float, reference: Float) -> FrameMotion:
    """Motion of the tool from readings before and after.

    Args:
        frame: k sensors, of which the motion can be seen (:func:`condition`).
        s_unloaded: (n, k) m.
        s_loaded: (n, k) m.
        sigma: (n, k) m, standard deviation of the change of each reading.
        reference: (n, 3) m, the point whose displacement is wanted, before the motion, axes of the sensors.

    Returns:
        Six components from six sensors on, else three.
    """
    n, k = s_unloaded.shape
    d = np.zeros((n, SIX if k >= SIX else 3))
    for _ in range(_ROUNDS):
        s = shown(frame, s_unloaded, d, reference)
        J = slopes(frame, s, d, reference) / sigma[:, :, None]
        step = (np.linalg.pinv(J) @ ((s_loaded - s) / sigma)[:, :, None])[..., 0]
        if d.shape[1] == SIX:
            # Rotations compose from the left, as the derivative is taken; added vectors would differ in second order.
            d[:, 3:] = rotation.log(rotation.exp(step[:, 3:]) @ rotation.exp(d[:, 3:]))
        d[:, :3] += step[:, :3]
        if float(np.max(np.abs(step), initial=0.0)) < _SETTLED:
            break
    s = shown(frame, s_unloaded, d, reference)
    J = slopes(frame, s, d, reference) / sigma[:, :, None]
    covariance = np.asarray(np.linalg.inv(np.swapaxes(J, 1, 2) @ J), dtype=np.float64)
    return FrameMotion(d, covariance, s_loaded - s, sigma)


def condition(frame: SensorFrame, s_unloaded: Float, reference: Float) -> tuple[float, Float]:
    """Condition of a row of readings for the motion, rotations as the way at the mean lever arm of the feet.

    ``s_unloaded``: (k,) m. ``reference``: (3,) m. Returns largest by smallest singular value, and the motion that is
    seen worst: (6,) or (3,) m, rad.
    """
    s, at = s_unloaded[None], reference[None]
    lever = feet(frame, s)[0] - reference
    length = max(float(np.sqrt(np.mean(np.sum(lever**2, axis=1)))), 1e-3)
    # Rotations as a way at the mean lever arm: else the condition would depend on the unit of length.
    size = np.array([1.0, 1.0, 1.0, length, length, length])[: SIX if len(frame) >= SIX else 3]
    _, values, axes = np.linalg.svd(slopes(frame, s, np.zeros((1, len(size))), at)[0] / size)
    worst: Float = axes[-1] / size
    least = float(values[-1]) if len(values) == len(size) else 0.0
    return float(values[0]) / max(least, 1e-300), worst


def meeting_point(frame: SensorFrame, s: Float) -> Float:
    """(n, 3) m, the point that the normals through the feet come nearest to: a cube's centre, where it is looked at.

    ``s``: (n, k) m, readings.
    """
    across = np.eye(3) - frame.normal[:, :, None] * frame.normal[:, None, :]
    sums = np.sum(across[None] @ feet(frame, s)[..., None], axis=1)
    out: Float = (np.linalg.pinv(np.sum(across, axis=0)) @ sums)[..., 0]
    return out


def passing(frame: SensorFrame, s_unloaded: Float, reference: Float) -> Float:
    """(n, k) m, by how much each normal passes the reference point: the reading per radian of the worst rotation."""
    lever = feet(frame, s_unloaded) - reference[:, None]
    along = np.sum(frame.normal * frame.direction, axis=1)
    out: Float = np.linalg.norm(np.cross(lever, frame.normal), axis=2) / np.abs(along)
    return out


def _turned(d: Float) -> Float:
    if d.shape[1] == SIX:
        return rotation.exp(d[:, 3:])
    return np.broadcast_to(np.eye(3), (len(d), 3, 3))
