"""Residuals of tracker measurements: poses of a six-axis target, or points of a reflector.

``T_tracker_target = T_tracker_base T_base_tcp(q) T_tcp_target``; the components of a row are measured minus predicted
position and, for poses, the rotation vector of measured against predicted orientation, in tracker axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, MRAD
from counterflex.geometry import pose, rotation
from counterflex.geometry.rotation import inverse_left_jacobian, left_jacobian
from counterflex.identify.solver.parameters import Parameter

# A frame that measurements place: a first estimate, displaced by six parameters. ``T = T0 D(d)`` with ``D(d) =
# Trans(d_0..2) Exp(d_3..5)`` and d read from the parameters; an index of -1 is a component that stays zero.

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
NO_PARAMETERS: Int = np.full(6, -1, dtype=np.int64)


def components(x: Float, index: Int) -> Float:
    """Values (6,) of the parameters at six places of x, zero where the place is -1."""
    return np.where(index >= 0, x[index], 0.0)


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """A frame with parameters."""

    T0: Float  # (4, 4) first estimate
    index: Int  # (6,) places of its displacement among the parameters, or -1

    def at(self, x: Float) -> Float:
        """The frame (4, 4) at the values x (p,) of all parameters."""
        d = components(x, self.index)
        out: Float = self.T0 @ pose.make(rotation.exp(d[3:]), d[:3])
        return out

    def turned(self, x: Float) -> Float:
        """(3, 3) what a unit change of the rotation parameters turns, in the axes of ``T0``: columns, rad per rad."""
        return left_jacobian(components(x, self.index)[3:])


def frame_parameters(name: str, label: str, sigma: Float | None = None, *, point: bool = False) -> list[Parameter]:
    """Six parameters of a frame's displacement from its first estimate.

    ``name``: Of the frame, for example ``T_base_tracker``. ``label``: What a user calls it, for example ``tracker in
    the base``. ``sigma``: (6,) m, rad prior standard deviations of the first estimate, or None where nothing is known.
    Returns parameters ``<name>.x`` ... ``<name>.rz``, nominally zero.
    """
    return [
        Parameter(
            name=f"{name}.{c}",
            unit="m" if i < 3 else "rad",
            nominal=0.0,
            prior_sigma=np.inf if sigma is None else float(sigma[i]),
            scale=MM if i < 3 else MRAD,
            label=f"{label}, {c}",
        )
        for i, c in enumerate(COMPONENTS[: 3 if point else 6])
    ]


_POSE = ("x m", "y m", "z m", "rx rad", "ry rad", "rz rad")


class PosedArm(Protocol):
    """An arm in poses, see :class:`counterflex.identify.geometry.arm_geometry.ArmGeometry`."""

    def poses(self, x: Float) -> Float:
        """T_base_tcp (m, 4, 4)."""

    def moved(self, x: Float) -> tuple[Float, Int, Float]:
        """T_base_tcp, places of parameters, and their twists (m, 6, k)."""

    def subset(self, rows: Bool) -> PosedArm:
        """The marked poses only."""


@dataclass(frozen=True, eq=False)
class TrackerResiduals:
    """Tracker poses (R given) or tracker points (R None) of one target seen from one place of the tracker."""

    name: str
    group: Int  # (m,) ids of poses
    sigma: Float  # (m, 6) or (m, 3) m, rad
    arm: PosedArm  # the arm in the m poses
    tracker: PlacedFrame
    target: PlacedFrame
    p: Float  # (m, 3) m, measured p_tracker_target
    R: Float | None  # (m, 3, 3) measured R_tracker_target, or None

    @property
    def components(self) -> tuple[str, ...]:
        """Names of a row's numbers."""
        return _POSE if self.R is not None else _POSE[:3]

    def predicted(self, x: Float) -> Float:
        """T_tracker_target (m, 4, 4) at the values x."""
        out: Float = pose.inverse(self.tracker.at(x)) @ self.arm.poses(x) @ self.target.at(x)
        return out

    def evaluate(self, x: Float) -> Float:
        """(m, 6 or 3) measured minus predicted over sigma."""
        T = self.predicted(x)
        return np.concatenate(self._differences(T), axis=-1) / self.sigma

    def _differences(self, T: Float) -> list[Float]:
        parts = [self.p - T[:, :3, 3]]
        if self.R is not None:
            parts.append(rotation.log(self.R @ np.swapaxes(T[:, :3, :3], -1, -2)))
        return parts

    def jacobian(self, x: Float) -> Float:
        """(m, 6 or 3, p) derivative of :meth:`evaluate`."""
        T_base_tcp, places, columns = self.arm.moved(x)
        T_base_tracker, T_tcp_target = self.tracker.at(x), self.target.at(x)
        T_base_target = T_base_tcp @ T_tcp_target
        R_tracker_base = T_base_tracker[:3, :3].T
        m = len(self.p)
        v = np.zeros((m, 3, len(x)))
        w = np.zeros((m, 3, len(x)))
        lever = T_base_target[:, :3, 3] - T_base_tcp[:, :3, 3]
        v[:, :, places] = columns[:, :3] - rotation.skew(lever) @ columns[:, 3:]
        w[:, :, places] = columns[:, 3:]
        self._target_columns(x, T_base_tcp, v, w)
        v, w = R_tracker_base @ v, R_tracker_base @ w
        self._tracker_columns(x, T_base_target, v, w)
        rows = [-v]
        if self.R is not None:
            T = pose.inverse(T_base_tracker) @ T_base_target
            r = rotation.log(self.R @ np.swapaxes(T[:, :3, :3], -1, -2))
            rows.append(-np.swapaxes(inverse_left_jacobian(r), -1, -2) @ w)
        out: Float = np.concatenate(rows, axis=1) / self.sigma[:, :, None]
        return out

    def _target_columns(self, x: Float, T_base_tcp: Float, v: Float, w: Float) -> None:
        """Twists (base axes, at the target) of the target's own displacement."""
        R = T_base_tcp[:, :3, :3] @ self.target.T0[:3, :3]
        axes = R @ self.target.turned(x)
        for c, place in enumerate(self.target.index):
            if place >= 0 and c < 3:
                v[:, :, place] += R[:, :, c]
            elif place >= 0:  # its rotation turns about its own origin
                w[:, :, place] += axes[:, :, c - 3]

    def _tracker_columns(self, x: Float, T_base_target: Float, v: Float, w: Float) -> None:
        """Twists (tracker axes, at the target) of the tracker's displacement: all it sees moves the other way."""
        d = components(x, self.tracker.index)
        back = rotation.exp(-d[3:])
        y = pose.transform(pose.inverse(self.tracker.T0), T_base_target[:, :3, 3]) - d[:3]
        turned = left_jacobian(d[3:])
        for c, place in enumerate(self.tracker.index):
            if place >= 0 and c < 3:
                v[:, :, place] -= back[:, c]
            elif place >= 0:
                axis = turned[:, c - 3]
                v[:, :, place] -= rotation.cross(axis, y) @ back.T
                w[:, :, place] -= back @ axis

    def subset(self, rows: Bool) -> TrackerResiduals:
        """The marked rows only."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            arm=self.arm.subset(rows),
            p=self.p[rows],
            R=None if self.R is None else self.R[rows],
        )
