"""Compliances that change with the joint angle or the load, kept only where data not used bear them out.

Candidates: for each spring, ``c (1 + a phi)`` with phi of the row: two halves of the angle of its axis or of the next
one (-1/2, +1/2, even in between over :data:`BLEND_RAD`, so that no deflection steps), linear in that angle, the sign of
its load, the size of its load; all centred, so that c stays the mean. What depends on an angle fades outside the angles
measured exactly as :mod:`counterflex.robot.model.elastic_region` has it, so the error on data not used is that of the
plan. Each is screened by what one more parameter would gain in the residuals of the fit (F test, all candidates taken
together), the best are fitted, and the best of these stays if the error on data not used falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG
from counterflex.identify.geometry.compliances import DIRECTIONS
from counterflex.identify.pulls.blocks import Layout
from counterflex.identify.pulls.pulls import Pulls
from counterflex.identify.pulls.residuals import PullResiduals, Shape
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut, cross_validate, position_error
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import element_loads
from counterflex.robot.model.description import ElasticRegion
from counterflex.robot.model.elastic_region import factor

CHANCE: Final = 1e-3
"""Largest probability that the best of all candidates gains as much by chance."""
GAIN: Final = 0.03
"""Least relative decrease of the error on data not used."""
FITTED_CANDIDATES: Final = 2
"""Candidates that are fitted, those with the largest gain in the screening."""
MOST: Final = 3
"""Regions in all."""
PRIOR: Final = 0.5
"""Prior standard deviation of a: relative change of the compliance over the range of phi."""
LEAST_FACTOR: Final = 0.3
"""Least share of the mean that a compliance may have in a region."""
BLEND_RAD: Final = 10.0 * DEG
"""Angle over which one half becomes the other."""
_LEAST_SPREAD = 0.05
_LEAST_SIDE = 0.15
_LEAST_GAP_RAD = 0.2 * DEG


Kind = Literal["half", "slope", "load_sign", "load_size"]


@dataclass(frozen=True, eq=False)
class Region:
    """One compliance that changes with the row, ``phi = (raw - centre) / spread``."""

    spring: int  # place in the springs
    name: str  # of its parameter: `axis2.rz.q2_half`
    text: str
    # what `raw` is: +1/2 above and -1/2 below an angle, the angle (rad), +-1/2 by the sign of the load, or its size
    # over the largest
    kind: Kind
    axis: int  # driven axis 0..5 of the angle
    at: float  # angle between the halves (rad) or the largest load (N, N m)
    # (k,) rad, angles between which `raw` is linear, the measured ones at the ends; none for loads
    knots: tuple[float, ...] = ()
    centre: float = 0.0  # mean of `raw`, weighted by the square of the load
    spread: float = 1.0  # range of `raw`

    def phi(self, chain: ElasticChain, plan: Layout, pulls: Pulls) -> Float:
        """(n,) of some pulls."""
        load = element_loads(chain, pulls.q, pulls.w_tcp_base)
        own = load[:, plan.springs.segment[self.spring], plan.springs.direction[self.spring]]
        if self.axis < 0:
            return (self.raw(pulls.q, own) - self.centre) / self.spread
        return factor(self.element(chain, plan, 1.0), pulls.q) - 1.0

    def element(self, chain: ElasticChain, plan: Layout, change: float) -> ElasticRegion:
        """As a plan uses it: the factor ``1 + change phi`` on the compliance."""
        at = np.array(self.knots)
        raw = self.raw(np.repeat(at[:, None], 6, axis=1), np.zeros(len(at)))
        factors = 1.0 + change * (raw - self.centre) / self.spread
        return ElasticRegion(
            chain.names[plan.springs.segment[self.spring]],
            int(plan.springs.direction[self.spring]),
            self.axis,
            self.knots,
            tuple(float(f) for f in factors),
        )

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest a, so that the compliance nowhere falls below :data:`LEAST_FACTOR` of its mean."""
        ends = {"half": (-0.5, 0.5), "load_sign": (-0.5, 0.5), "load_size": (0.0, 1.0)}.get(self.kind, self.knots)
        low, high = ((float(end) - self.centre) / self.spread for end in (ends[0], ends[-1]))
        return -(1.0 - LEAST_FACTOR) / max(high, _LEAST_SIDE), (1.0 - LEAST_FACTOR) / max(-low, _LEAST_SIDE)

    def raw(self, q: Float, load: Float) -> Float:
        """(n,) before centring; q (n, 6) rad, load (n,) of the spring, N or N m."""
        if self.kind == "half":
            return np.clip((q[:, self.axis] - self.at) / BLEND_RAD, -0.5, 0.5)
        if self.kind == "slope":
            return q[:, self.axis].copy()
        out: Float = 0.5 * np.sign(load) if self.kind == "load_sign" else np.abs(load) / self.at
        return out


@dataclass(frozen=True, eq=False)
class PiecewiseSearch:
    """Result of the search."""

    regions: tuple[Region, ...]  # kept ones, in the order found
    parameters: Parameters  # all parameters, those of the regions last
    blocks: tuple[PullResiduals, ...]  # with their shapes
    # mean error on data not used before any and after each region, m; empty where none was promising
    error: tuple[float, ...]


def candidates(chain: ElasticChain, plan: Layout, pulls: Sequence[Pulls]) -> list[Region]:
    """All regions that the poses and loads of some pulls tell apart."""
    q = np.concatenate([p.q for p in pulls])
    loads = np.concatenate([element_loads(chain, p.q, p.w_tcp_base) for p in pulls])
    axis_of = np.maximum.accumulate(chain.joint)
    out = []
    for k, (segment, direction) in enumerate(zip(plan.springs.segment, plan.springs.direction, strict=True)):
        load = loads[:, segment, direction]
        largest = float(np.max(np.abs(load), initial=0.0))
        if not plan.springs.parameters.items[k].free or largest == 0.0:
            continue
        spring = f"{chain.names[segment]}.{DIRECTIONS[direction]}"
        own = int(axis_of[segment])
        regions = [
            Region(k, f"{spring}.load_sign", f"{spring}, by the sign of its load", "load_sign", -1, 0.0),
            Region(k, f"{spring}.load_size", f"{spring}, by the size of its load", "load_size", -1, largest),
        ]
        for axis in sorted({max(own, 0), min(own + 1, 5)}):
            at, name = float(np.median(q[:, axis])), f"{spring}.q{axis + 1}"
            words = f"{spring}, by the angle of axis {axis + 1}"
            low, high = float(q[:, axis].min()), float(q[:, axis].max())
            ends = [
                a
                for a in (at - 0.5 * BLEND_RAD, at + 0.5 * BLEND_RAD)
                if low + _LEAST_GAP_RAD < a < high - _LEAST_GAP_RAD
            ]
            if high - low < _LEAST_GAP_RAD:
                continue
            sides = f"{words} above and below {at / DEG:.0f} deg"
            regions.append(Region(k, f"{name}_half", sides, "half", axis, at, (low, *ends, high)))
            regions.append(Region(k, f"{name}_slope", f"{words}, linear", "slope", axis, at, (low, high)))
        for region in regions:
            raw = region.raw(q, load)
            spread, weight = float(np.ptp(raw)), load**2 / float(np.sum(load**2))
            centre = float(weight @ raw)
            if spread > _LEAST_SPREAD and float(weight @ (raw - centre) ** 2) > (_LEAST_SIDE * spread) ** 2:
                out.append(replace(region, centre=centre, spread=spread))
    return out


def search(
    chain: ElasticChain,
    plan: Layout,
    pulls: Sequence[Pulls],
    blocks: Sequence[PullResiduals],
    fit: Fit,
    progress: Progress = silent,
) -> PiecewiseSearch:
    """Regions that the data demand. Returns the regions kept; none where data not used do not bear one out."""
    parameters, now = plan.parameters, list(blocks)
    accepted: list[Region] = []
    errors: list[float] = []
    open_ = candidates(chain, plan, pulls)
    phi = {r.name: tuple(r.phi(chain, plan, p) for p in pulls) for r in open_}
    for turn in range(MOST):
        gains = _gains(fit, now, [(r.spring, phi[r.name]) for r in open_], parameters)
        limit = float(scipy.stats.f.isf(CHANCE / max(len(open_), 1), 1.0, max(fit.dof - 1.0, 1.0)))
        promising = [int(i) for i in np.argsort(-gains)[:FITTED_CANDIDATES] if gains[i] >= limit]
        if not promising:
            break
        if not errors:
            errors.append(_error(parameters, now, plan))
        trials = []
        for k, i in enumerate(promising):
            wider, shaped = _with(parameters, now, open_[i], phi[open_[i].name])
            trials.append((_error(wider, shaped, plan), open_[i], wider, shaped))
            # Each round is half as likely as the one before.
            progress(1.0 - 0.5**turn * (1.0 - 0.5 * (k + 1) / len(promising)), "regions of stiffness")
        error, region, wider, shaped = min(trials, key=lambda trial: trial[0])
        if error > (1.0 - GAIN) * errors[-1]:
            break
        parameters, now = wider, shaped
        accepted.append(region)
        open_.remove(region)
        errors.append(error)
        fit = solve(parameters, now, start=np.append(fit.values, 0.0))
    return PiecewiseSearch(tuple(accepted), parameters, tuple(now), tuple(errors))


def shaped_like(
    result: PiecewiseSearch, chain: ElasticChain, plan: Layout, pulls: Pulls, block: PullResiduals
) -> PullResiduals:
    """Another block with the shapes of the regions kept."""
    first = len(plan.parameters)
    shapes = tuple(Shape(r.spring, first + i, r.phi(chain, plan, pulls)) for i, r in enumerate(result.regions))
    return replace(block, shapes=shapes)


def elements(result: PiecewiseSearch | None, chain: ElasticChain, plan: Layout, fit: Fit) -> tuple[ElasticRegion, ...]:
    """Regions that a plan can use: those over an angle; a compliance that changes with load is its mean."""
    regions = () if result is None else result.regions
    return tuple(r.element(chain, plan, fit.value(r.name)) for r in regions if r.axis >= 0)


def _with(
    parameters: Parameters, blocks: Sequence[PullResiduals], region: Region, phi: Sequence[Float]
) -> tuple[Parameters, list[PullResiduals]]:
    low, high = region.bounds
    wider = parameters + Parameters.of([Parameter(region.name, "1", 0.0, PRIOR, low, high, label=region.text)])
    shaped = [
        replace(b, shapes=(*b.shapes, Shape(region.spring, len(parameters), own)))
        for b, own in zip(blocks, phi, strict=True)
    ]
    return wider, shaped


def _error(parameters: Parameters, blocks: Sequence[PullResiduals], plan: Layout) -> float:
    held_out: HeldOut = cross_validate(parameters, blocks, needed=plan.frame_names, error=position_error)
    return held_out.mean()[0]


def _gains(
    fit: Fit, blocks: Sequence[PullResiduals], candidates: Sequence[tuple[int, Sequence[Float]]], parameters: Parameters
) -> Float:
    """F statistic of each one more parameter at the fit: decrease of the sum of squares over the variance left."""
    free = np.flatnonzero(parameters.free)
    scale = parameters.slope(fit.values)[free]
    roots = [np.sqrt(weight)[:, None] / factor for weight, factor in zip(fit.weights, fit.sigma_factors, strict=True)]
    slopes = [b.jacobian(fit.values) for b in blocks]
    rows = np.concatenate([(b.evaluate(fit.values) * r).reshape(-1) for b, r in zip(blocks, roots, strict=True)])
    J = np.concatenate(
        [(s[:, :, free] * scale * r[:, :, None]).reshape(-1, len(free)) for s, r in zip(slopes, roots, strict=True)]
    )
    Q, _ = np.linalg.qr(np.vstack([J, np.eye(len(free))]))
    whole = np.concatenate([rows, parameters.coordinates(fit.values)[free]])
    variance = max(float(rows @ rows) / max(fit.dof, 1.0), 1e-300)
    extra = np.zeros((len(whole), len(candidates)))
    for i, (spring, phis) in enumerate(candidates):
        parts = [
            (s[:, :, b.columns[spring]] * fit.values[b.columns[spring]] * phi[:, None] * r).reshape(-1)
            for s, b, phi, r in zip(slopes, blocks, phis, roots, strict=True)
        ]
        extra[: len(rows), i] = np.concatenate(parts)
    reduced = extra - Q @ (Q.T @ extra)
    size, before = np.sum(reduced**2, axis=0), np.sum(extra**2, axis=0)
    seen = size > 1e-12 * np.maximum(before, 1e-300)
    out: Float = np.where(seen, (reduced.T @ whole) ** 2 / np.where(seen, size, 1.0) / variance, 0.0)
    return out
