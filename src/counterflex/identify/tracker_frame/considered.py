"""Uncertainty that all readings of a tracker share: its scale, its rest, where the arm stands.

No residual shows these. A scale of lengths that is off by 5 in a million moves a tracker 4.5 m away by 22 um along its
line of sight; a tracker that wanders by less than a test can tell stands elsewhere at the end; an arm that stands
beside its foot takes the frame along with it. Each goes through the fit with what is known of it
(:mod:`counterflex.identify.solver.jackknife`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.geometry import pose, rotation
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.arm_parameters import ArmPriors
from counterflex.identify.geometry.considered_sag import with_honest_sigma
from counterflex.identify.geometry.fiducials import FiducialResiduals
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import added, considered
from counterflex.identify.solver.residuals import Residuals
from counterflex.robot.model.calibration import BASE

# Drift watch: whether repeated measurements of the same fiducials show that the tracker, or the robot, has moved. The
# k-th measurement of each fiducial belongs to round k. Each later round is registered on the first: the six components
# of ``p_first = (1 + [r]x) p_k + t`` by weighted least squares, about the centre of the fiducials. Against no motion at
# all, ``d^T C^-1 d`` is chi-squared with six degrees of freedom; the probability of a larger value by noise alone is
# the significance.

SIGNIFICANT: Final = 0.01


@dataclass(frozen=True, eq=False)
class Drift:
    """Motion of the tracker between the first round and a later one."""

    round: int  # 1, 2, ...
    time_s: float  # mean time after the first round, or the round's number where no time is known
    shift_m: Float  # (3,) how the fiducials seem to have moved, tracker axes, at their centre
    shift_sigma_m: Float  # (3,)
    rotation_rad: Float  # (3,) rotation vector
    rotation_sigma_rad: Float  # (3,)
    probability: float  # of as large a value without any motion

    @property
    def significant(self) -> bool:
        """Motion, not noise."""
        return self.probability < SIGNIFICANT


def rounds_of(group: Int, time_s: Float | None) -> Int:
    """(m,) round of each row: how often its fiducial was measured before (in time, else in order of rows)."""
    order = np.arange(len(group)) if time_s is None else np.argsort(time_s, kind="stable")
    out = np.zeros(len(group), dtype=np.int64)
    seen: dict[int, int] = {}
    for i in order:
        key = int(group[i])
        out[i] = seen.get(key, 0)
        seen[key] = int(out[i]) + 1
    return out


def drifts(group: Int, p_tracker: Float, sigma: Float, time_s: Float | None = None) -> tuple[Drift, ...]:
    """Motion of every later round against the first.

    Args:
        group: (m,) fiducial of each row.
        p_tracker: (m, 3) m, measured.
        sigma: (m, 3) m, standard deviations of the measurement alone.
        time_s: (m,) s, or None.

    Returns:
        One entry for every round with three fiducials or more in common with the first, not all on one line.
    """
    rounds = rounds_of(group, time_s)
    first = {int(g): i for i, g in enumerate(group) if rounds[i] == 0}
    out = []
    for k in range(1, int(rounds.max(initial=0)) + 1):
        rows = np.flatnonzero(rounds == k)
        before = np.array([first[int(g)] for g in group[rows]], dtype=np.int64)
        if len(rows) < 3:
            continue
        a, b = p_tracker[before], p_tracker[rows]
        centre = a.mean(axis=0)
        spread = np.linalg.svd(a - centre, compute_uv=False)
        if spread[1] < 1e-3 * spread[0]:
            continue
        # About the centre of the fiducials: there shift and turn are least correlated, and each means what it says.
        J = np.concatenate([np.broadcast_to(np.eye(3), (len(rows), 3, 3)), -rotation.skew(a - centre)], axis=-1)
        s = np.sqrt(sigma[before] ** 2 + sigma[rows] ** 2)
        weighted = (J / s[:, :, None]).reshape(-1, 6)
        C = np.linalg.inv(weighted.T @ weighted)
        d = C @ (weighted.T @ ((b - a) / s).reshape(-1))
        size = np.sqrt(np.diag(C))
        later = float(k) if time_s is None else float(np.mean(time_s[rows]) - np.mean(time_s[before]))
        chance = float(scipy.stats.chi2.sf(float(d @ np.linalg.solve(C, d)), 6))
        out.append(Drift(k, later, d[:3], size[:3], d[3:], size[3:], chance))
    return tuple(out)


SCALE: Final = 5e-6
"""How true the lengths are that a tracker shows: temperature and pressure of the air, zero of its distances."""
_BIT: Final = 1e-3


def with_frame_sigma(
    fit: Fit, blocks: Sequence[Residuals], moved: Sequence[Float], *, compliance: float, bearing_m: float, scale: float
) -> Fit:
    """The fit with standard deviations that hold for what the frames' model lacks.

    Args:
        blocks: Fiducials and tracker poses.
        moved: Per block (rows, components, k) from :func:`unrest`, with k = 0 where nothing is known of it.
        compliance: Relative standard deviation of the compliances that are not fitted.
        bearing_m: Standard deviation, per axis, of the points that the elements turn about.
        scale: Relative standard deviation of the tracker's lengths.

    Returns:
        See :func:`counterflex.identify.geometry.considered_sag.with_honest_sigma`, and the quantities of this module.
    """
    wide = with_honest_sigma(fit, blocks, compliance, bearing_m)
    x = fit.values
    everything = []
    for k, block in enumerate(blocks):
        before = block.evaluate(x)
        columns = [(before - _scaled(block).evaluate(x)) * block.sigma * (scale / _BIT)]
        columns += [(before - _standing(block, step).evaluate(x)) * block.sigma for step in _steps()]
        for j, unsteady in enumerate(moved):
            columns += [c if j == k else np.zeros_like(before) for c in np.moveaxis(unsteady, 2, 0)]
        everything.append(np.stack(columns, axis=2))
    return added(wide, considered(fit, blocks, everything))


def sigma_at(fit: Fit, tracker: PlacedFrame, p_base: Float) -> Float:
    """Standard deviation (3,) m, base axes, of a point p_base (3,) m that the tracker sees.

    The numbers of a frame stand for each other: a turn that moves the tracker's place by millimetres may leave the
    point where it is. So ``G C G^T`` with the whole covariance, ``G = [R0, -[p - p0]x R0 J]``.
    """
    index = [int(np.flatnonzero(fit.free_index == i)[0]) for i in tracker.index]
    slope = fit.parameters.slope(fit.values)[tracker.index]
    C = fit.covariance[np.ix_(index, index)] * np.outer(slope, slope)
    R0, at = tracker.T0[:3, :3], tracker.at(fit.values)[:3, 3]
    G = np.hstack([R0, -rotation.skew(p_base - at) @ R0 @ tracker.turned(fit.values)])
    out: Float = np.sqrt(np.diag(G @ C @ G.T))
    return out


def unrest(block: FiducialResiduals, measured: Float, sigma: Float, time_s: Float | None, x: Float) -> Float:
    """Possible motion of the tracker between rounds of fiducials that are fitted as one.

    The frame found is that of the mean of the rounds, the one in use that of the last: what the rounds show of a
    motion, noise or not, is what they cannot exclude.

    Args:
        block: Their residuals.
        measured: (m, 3) m, in the tracker.
        sigma: (m, 3) m, of the measurement alone.
        time_s: (m,) s or None.
        x: (p,) values.

    Returns:
        (m, 3, 1) m, base axes; (m, 3, 0) where there is one round only.
    """
    motions = drifts(block.group, measured, sigma, time_s)
    if not motions:
        return np.zeros((len(measured), 3, 0))
    rounds = rounds_of(block.group, time_s)
    centre = measured[rounds == 0].mean(axis=0)
    last, shift = motions[-1], np.zeros_like(measured)
    for d in (None, *motions):
        rows = rounds == (0 if d is None else d.round)
        moved, turned = (np.zeros(3), np.zeros(3)) if d is None else (d.shift_m, d.rotation_rad)
        shift[rows] = (moved - last.shift_m) + np.cross(turned - last.rotation_rad, measured[rows] - centre)
    R = block.tracker.at(x)[:3, :3]
    return (shift @ R.T)[:, :, None]


def _scaled(block: Residuals) -> Residuals:
    if isinstance(block, FiducialResiduals):
        return cast(Residuals, replace(block, p_tracker=block.p_tracker * (1.0 + _BIT)))
    if isinstance(block, TrackerResiduals):
        return cast(Residuals, replace(block, p=block.p * (1.0 + _BIT)))
    return block


def _steps() -> list[Float]:
    """Six displacements (4, 4) of an arm in its base, one standard deviation each."""
    known = ArmPriors()
    size = np.diag(np.repeat([known.length_m, known.angle_rad], 3))
    return [pose.make(rotation.exp(d[3:]), d[:3]) for d in size]


def _standing(block: Residuals, step: Float) -> Residuals:
    """Poses of an arm beside its foot, where that is not among its parameters: as if the tracker had moved."""
    if not isinstance(block, TrackerResiduals):
        return block
    if isinstance(block.arm, ArmGeometry) and BASE in block.arm.layout.displaced:
        return block
    return replace(block, tracker=replace(block.tracker, T0=pose.inverse(step) @ block.tracker.T0))
