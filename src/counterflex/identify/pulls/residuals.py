"""Residuals of pulls: measured minus predicted displacement, linear in the compliances.

The tool moves by ``d = sum_k c_k J_k (J_k^T w) + o``: spring k with compliance c_k turns (or shifts) by c_k times the
part of the load that it feels, and carries the tool along. ``o`` is what is not linear in the compliances: lost motion
of the axes and the second order of the elastic deflection, both computed at the compliances found before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.geometry.rotation import exp, left_jacobian, skew
from counterflex.identify.geometry.compliances import Springs
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.elasticity.compliance import element_jacobians, load_factors
from counterflex.robot.model.elastic_region import growth

COMPONENTS = ("x m", "y m", "z m", "rx rad", "ry rad", "rz rad")


def gains(chain: ElasticChain, springs: Springs, q: Float, w_tcp_base: Float, p_tcp_point: Float) -> Float:
    """Displacement per compliance of each spring, ``f_k(q, w) J_k(point) (J_k^T w)``, f_k of its regions and curves.

    ``q``: (n, 6) rad. ``w_tcp_base``: (n, 6) N, N m about the TCP in base axes. ``p_tcp_point``: (3,) m, the point
    whose displacement is wanted, in the frame of the TCP. Returns (n, 6, k): displacement of the point and rotation
    vector, base axes, per m/N or rad/(N m).
    """
    columns = element_jacobians(chain, q)[:, springs.segment, :, springs.direction]  # (k, n, 6)
    J = np.moveaxis(columns, 0, -1)
    load = np.einsum("nck,nc->nk", J, w_tcp_base)
    grown = growth(chain.regions, chain.names, q) * load_factors(chain, q, w_tcp_base)
    load *= grown[:, springs.segment, springs.direction]
    out: Float = carried(chain, q, J, p_tcp_point) * load[:, None, :]
    return out


def misplaced(
    chain: ElasticChain, springs: Springs, q: Float, w_tcp_base: Float, p_tcp_point: Float, bearing_m: float
) -> Float:
    """Standard deviation of a displacement where the elements turn about points that are known to ``bearing_m`` only.

    A bearing that sits beside where it is thought to be feels another moment (``b |f|``), and carries the tool along
    another lever (b times its angle)::

        s^2 = sum_k (J_k c_k b |f|)^2 + (b c_k J_k^T w)^2    (the latter for the translation only)

    ``q``: (n, 6) rad. ``w_tcp_base``: (n, 6) N, N m. ``p_tcp_point``: (3,) m, in the frame of the TCP. Returns (n, 6)
    m, rad, base axes.
    """
    turning = springs.direction >= 3
    columns = element_jacobians(chain, q)[:, springs.segment[turning], :, springs.direction[turning]]
    J = np.moveaxis(columns, 0, -1)
    c = springs.of_chain(chain)[turning]
    angle = np.einsum("nck,nc->nk", J, w_tcp_base) * c
    moment = bearing_m * np.linalg.norm(w_tcp_base[:, :3], axis=1)
    variance = np.sum((carried(chain, q, J, p_tcp_point) * c * moment[:, None, None]) ** 2, axis=2)
    variance[:, :3] += (bearing_m**2 * np.sum(angle**2, axis=1))[:, None]
    out: Float = np.sqrt(variance)
    return out


def misplaced_by(
    chain: ElasticChain,
    springs: Springs,
    q: Float,
    w_tcp_base: Float,
    bearing_m: float,
    at: Callable[[Float], Float],
    acts: Bool | None = None,
) -> Float:
    """Displacements of the tool by one standard deviation of the place where each element turns, alike in all rows.

    With the axes a_k of the rotations of an element at p + b, ``d(c_k J_k J_k^T w) / db`` for b along each axis of the
    element: ``c_k ((b x a_k) (J_k^T w) + J_k (b x a_k)^T f)``, summed over its rotations.

    Args:
        chain: The cell's.
        springs: k of them; only the rotations matter.
        q: (n, 6) rad.
        w_tcp_base: (n, 6) N, N m.
        bearing_m: b, per axis.
        at: Takes twists (n, 6, 1) given at the TCP to the point whose displacement is wanted.
        acts: (n, k) whether a spring lies between what is compared in a row; None is all.

    Returns:
        (n, 6, 3 s) m, rad, base axes: three columns for each of the s segments of the chain.
    """
    J = element_jacobians(chain, q)  # (n, s, 6, 6)
    out = np.zeros((len(q), 6, 3 * chain.n))
    soft = springs.of_chain(chain)
    for k, (segment, direction) in enumerate(zip(springs.segment, springs.direction, strict=True)):
        if direction < 3:
            continue
        c = soft[k] * (np.ones(len(q)) if acts is None else acts[:, k])[:, None, None]
        own, place = J[:, segment, :, direction], slice(3 * int(segment), 3 * int(segment) + 3)
        axes = bearing_m * J[:, segment, 3:, 3:]  # (n, 3, 3): columns are the axes of the element
        aside = np.cross(axes, own[:, 3:, None], axis=1)
        load = np.einsum("nc,nc->n", own, w_tcp_base)
        out[:, :3, place] += c * aside * load[:, None, None]
        more = np.einsum("nck,nc->nk", aside, w_tcp_base[:, :3])
        out[:, :, place] += c * at(own[:, :, None]) * more[:, None, :]
    return out


def carried(chain: ElasticChain, q: Float, twists: Float, p_tcp_point: Float) -> Float:
    """Twists (n, 6, k) given at the TCP, taken at a point beside it: ``v + omega x r``."""
    if not np.any(p_tcp_point):
        return twists
    lever = (forward(chain, q)[:, :3, :3] @ p_tcp_point[:, None])[..., 0]
    out = twists.copy()
    out[:, :3] -= skew(lever) @ twists[:, 3:]
    return out


@dataclass(frozen=True, eq=False)
class PullShape:
    """A compliance that changes with the row: ``c_k (1 + a phi)``; several on one spring multiply."""

    spring: int  # k, place in the springs
    column: int  # place of the parameter a among all parameters
    phi: Float  # (n,) of each row


@dataclass(frozen=True, eq=False)
class PullResiduals:
    """Pulls of one dataset."""

    name: str  # of the dataset
    group: Int
    components: tuple[str, ...]  # of a row
    sigma: Float  # (n, c)
    measured: Float  # (n, c) displacement, base axes; tracker axes where `turn` is given
    gain: Float  # (n, c, k) displacement per compliance, base axes
    columns: Int  # (k,) places of the compliances among all parameters
    offset: Float  # (n, c) what else is predicted, base axes
    band_gain: Float  # (n, c, 6) displacement per half band of each axis' play, base axes
    band_columns: Int  # (6,) places of the half bands, -1 where not fitted
    shapes: tuple[PullShape, ...] = ()  # compliances that change with the row
    R_tracker_base: Float | None = None  # (3, 3), where measured in tracker axes, else None
    turn: Int | None = None  # (3,) places of the rotation vector r that corrects it, `R_base_tracker Exp(r)`, or None
    # (n, c, m) what one standard deviation of each of m quantities that are not fitted moves `measured` by, the same in
    # all rows (counterflex.identify.solver.jackknife)
    moved: Float = field(default_factory=lambda: np.zeros((0, 0, 0)))

    def evaluate(self, x: Float) -> Float:
        """See :class:`counterflex.identify.solver.residuals.Residuals`."""
        out: Float = (self.measured - self.predicted(x)) / self.sigma
        return out

    def predicted(self, x: Float) -> Float:
        """(n, c) predicted displacement in the axes it was measured in, m and rad."""
        out: Float = self._seen(self._in_base(x), x)
        return out

    def _in_base(self, x: Float) -> Float:
        effective = x[self.columns] * self._growth(x)
        out: Float = np.einsum("nck,nk->nc", self.gain, effective) + self.offset
        fitted = self.band_columns >= 0
        if np.any(fitted):
            out = out + self.band_gain[:, :, fitted] @ x[self.band_columns[fitted]]
        return out

    def _growth(self, x: Float) -> Float:
        grown = np.ones((len(self.group), len(self.columns)))
        for shape in self.shapes:
            grown[:, shape.spring] *= 1.0 + x[shape.column] * shape.phi
        return grown

    def _seen(self, base: Float, x: Float) -> Float:
        if self.R_tracker_base is None:
            return base
        R = self.R_tracker_base if self.turn is None else exp(-x[self.turn]) @ self.R_tracker_base
        out: Float = np.concatenate([base[:, i : i + 3] @ R.T for i in range(0, base.shape[1], 3)], axis=1)
        return out

    def jacobian(self, x: Float) -> Float:
        """See :class:`counterflex.identify.solver.residuals.Residuals`."""
        n, c = self.measured.shape
        base = np.zeros((n, c, len(x)))
        grown = self._growth(x)
        base[:, :, self.columns] = self.gain * grown[:, None, :]
        for shape in self.shapes:
            others = grown[:, shape.spring] / (1.0 + x[shape.column] * shape.phi)
            value = x[self.columns[shape.spring]] * others
            base[:, :, shape.column] += self.gain[:, :, shape.spring] * (value * shape.phi)[:, None]
        fitted = self.band_columns >= 0
        base[:, :, self.band_columns[fitted]] = self.band_gain[:, :, fitted]
        if self.R_tracker_base is None:
            plain: Float = -base / self.sigma[:, :, None]
            return plain
        back = np.eye(3) if self.turn is None else exp(-x[self.turn])
        R = back @ self.R_tracker_base
        out = np.concatenate([R @ base[:, i : i + 3] for i in range(0, c, 3)], axis=1)
        if self.turn is not None:
            u, right = self._in_base(x), left_jacobian(x[self.turn])
            turned = [back @ skew(u[:, i : i + 3] @ self.R_tracker_base.T) @ right for i in range(0, c, 3)]
            out[:, :, self.turn] = np.concatenate(turned, axis=1)
        slope: Float = -out / self.sigma[:, :, None]
        return slope

    def subset(self, rows: Bool) -> PullResiduals:
        """See :class:`counterflex.identify.solver.residuals.Residuals`."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            measured=self.measured[rows],
            gain=self.gain[rows],
            offset=self.offset[rows],
            band_gain=self.band_gain[rows],
            moved=self.moved[rows] if len(self.moved) else self.moved,
            shapes=tuple(replace(s, phi=s.phi[rows]) for s in self.shapes),
        )
