"""Compliances that change with the joint angle or the load, kept only where data not used bear them out.

Candidates: for each spring, ``c (1 + a phi)`` with phi of the row: two halves of the angle of its axis or of the next
one (-1/2, +1/2, even in between over :data:`BLEND_RAD`, so that no deflection steps), linear in that angle, the sign of
its load, the size of its load up to a share of the largest; all centred, so that c stays the mean. The load is the
whole one, own weight included: a pull moves a gear along its curve from where weight has it. What depends on an angle
fades outside the angles measured exactly as :mod:`counterflex.robot.model.elastic_region` has it, what depends on a
load is a curve of :mod:`counterflex.robot.model.description`, so the error on data not used is that of the plan.
Each is screened by what one more parameter would gain in the residuals of the fit (F test, all candidates taken
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
from counterflex.identify.pulls.blocks import PullLayout
from counterflex.identify.pulls.pulls import Pulls
from counterflex.identify.pulls.residuals import PullResiduals, PullShape
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut, cross_validate, position_error
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import element_loads
from counterflex.robot.elasticity.gravity import weight_loads
from counterflex.robot.model.description import ComplianceCurve, ElasticRegion
from counterflex.robot.model.elastic_region import factor

CHANCE: Final = 1e-3
"""Largest probability that the best of all candidates gains as much by chance."""
GAIN: Final = 0.03
"""Least relative decrease of the error on data not used."""
FITTED_CANDIDATES: Final = 2
"""Candidates that are fitted, those with the largest gain in the screening."""
MOST: Final = 6
"""Regions in all."""
PRIOR: Final = 0.5
"""Prior standard deviation of a: relative change of the compliance over the range of phi."""
LEAST_FACTOR: Final = 0.3
"""Least share of the mean that a compliance may have in a region."""
BLEND_RAD: Final = 10.0 * DEG
"""Angle over which one half becomes the other."""
SOFT_SHARES: Final = (0.15, 0.4, 1.0)
"""Shares of the largest load up to which a compliance may change with the size of its load."""
BLEND_LOAD: Final = 0.05
"""Share of the largest load over which one sign becomes the other."""
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
    # what `raw` is: +1/2 above and -1/2 below an angle, the angle (rad), +-1/2 by the sign of the whole load, or its
    # size over `at`, 1 at most
    kind: Kind
    axis: int  # driven axis 0..5 of the angle
    at: float  # angle between the halves (rad), or load (N, N m)
    # (k,) rad, angles between which `raw` is linear, the measured ones at the ends; N, N m for loads
    knots: tuple[float, ...] = ()
    centre: float = 0.0  # mean of `raw`, weighted by the square of the load
    spread: float = 1.0  # range of `raw`

    def phi(self, chain: ElasticChain, plan: PullLayout, pulls: Pulls) -> Float:
        """(n,) of some pulls."""
        element = self.element(chain, plan, 1.0)
        if isinstance(element, ElasticRegion):
            return factor(element, pulls.q) - 1.0
        at = (slice(None), plan.springs.segment[self.spring], self.direction(plan))
        return (
            element.secant(weight_loads(chain, pulls.q)[at], element_loads(chain, pulls.q, pulls.w_tcp_base)[at]) - 1.0
        )

    def direction(self, plan: PullLayout) -> int:
        """Direction 0..5 of its spring."""
        return int(plan.springs.direction[self.spring])

    def element(self, chain: ElasticChain, plan: PullLayout, change: float) -> ElasticRegion | ComplianceCurve:
        """As a plan uses it: the factor ``1 + change phi`` on the compliance."""
        at = np.array(self.knots)
        raw = self.raw(np.repeat(at[:, None], 6, axis=1), at)
        factors = tuple((1.0 + change * (raw - self.centre) / self.spread).tolist())
        segment, direction = chain.names[plan.springs.segment[self.spring]], self.direction(plan)
        if self.axis < 0:
            return ComplianceCurve(segment, direction, self.knots, factors)
        return ElasticRegion(segment, direction, self.axis, self.knots, factors)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest a, so that the compliance nowhere falls below :data:`LEAST_FACTOR` of its mean."""
        ends = self.knots if self.kind == "slope" else (0.0, 1.0) if self.kind == "load_size" else (-0.5, 0.5)
        low, high = ((float(end) - self.centre) / self.spread for end in (ends[0], ends[-1]))
        return -(1.0 - LEAST_FACTOR) / max(high, _LEAST_SIDE), (1.0 - LEAST_FACTOR) / max(-low, _LEAST_SIDE)

    def mean_raw(self, q: Float, weight: Float, load: Float) -> Float:
        """(n,) mean of :meth:`raw` while a load (n,) is put on what the spring carries."""
        if self.axis >= 0:
            return self.raw(q, load)
        at = np.array(self.knots)
        curve = ComplianceCurve("", 0, self.knots, tuple(self.raw(np.zeros((len(at), 6)), at).tolist()))
        return curve.secant(weight, load)

    def raw(self, q: Float, load: Float) -> Float:
        """(n,) before centring; q (n, 6) rad, whole load (n,) of the spring, N or N m."""
        if self.kind == "half":
            return np.clip((q[:, self.axis] - self.at) / BLEND_RAD, -0.5, 0.5)
        if self.kind == "slope":
            return q[:, self.axis].copy()
        if self.kind == "load_sign":
            return np.clip(load / (2.0 * BLEND_LOAD * self.at), -0.5, 0.5)
        out: Float = np.minimum(np.abs(load) / self.at, 1.0)
        return out


@dataclass(frozen=True, eq=False)
class PiecewiseSearch:
    """Result of the search."""

    regions: tuple[Region, ...]  # kept ones, in the order found
    parameters: Parameters  # all parameters, those of the regions last
    blocks: tuple[PullResiduals, ...]  # with their shapes
    # mean error on data not used before any and after each region, m; empty where none was promising
    error: tuple[float, ...]

    def shaped_like(self, chain: ElasticChain, plan: PullLayout, pulls: Pulls, block: PullResiduals) -> PullResiduals:
        """Another block with the shapes of the regions kept."""
        first = len(plan.parameters)
        shapes = tuple(PullShape(r.spring, first + i, r.phi(chain, plan, pulls)) for i, r in enumerate(self.regions))
        return replace(block, shapes=shapes)


def candidates(chain: ElasticChain, plan: PullLayout, pulls: Sequence[Pulls]) -> list[Region]:
    """All regions that the poses and loads of some pulls tell apart."""
    q = np.concatenate([p.q for p in pulls])
    loads = np.concatenate([element_loads(chain, p.q, p.w_tcp_base) for p in pulls])
    weights = weight_loads(chain, q)
    axis_of = np.maximum.accumulate(chain.joint)
    out = []
    for k, (segment, direction) in enumerate(zip(plan.springs.segment, plan.springs.direction, strict=True)):
        load, carried = loads[:, segment, direction], weights[:, segment, direction]
        largest = float(np.max(np.abs([carried, carried + load]), initial=0.0))
        if not plan.springs.parameters.items[k].free or not load.any():
            continue
        spring = f"{chain.names[segment]}.{DIRECTIONS[direction]}"
        steep = (-BLEND_LOAD * largest, BLEND_LOAD * largest)
        own = int(axis_of[segment])
        regions = [
            Region(k, f"{spring}.load_sign", f"{spring}, by the sign of its load", "load_sign", -1, largest, steep),
            *(
                Region(
                    k,
                    f"{spring}.load_size_{share:.0%}",
                    f"{spring}, by the size of its load up to {share:.0%} of the largest",
                    "load_size",
                    -1,
                    share * largest,
                    (-share * largest, 0.0, share * largest),
                )
                for share in SOFT_SHARES
            ),
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
            raw = region.mean_raw(q, carried, load)
            spread, weight = float(np.ptp(raw)), load**2 / float(np.sum(load**2))
            centre = float(weight @ raw)
            if spread > _LEAST_SPREAD and float(weight @ (raw - centre) ** 2) > (_LEAST_SIDE * spread) ** 2:
                out.append(replace(region, centre=centre, spread=spread))
    return out


def search(
    chain: ElasticChain,
    plan: PullLayout,
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
        # Over the number of candidates (Bonferroni): of a hundred shapes one gains something by chance.
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


def elements(
    result: PiecewiseSearch | None, chain: ElasticChain, plan: PullLayout, fit: Fit
) -> tuple[ElasticRegion | ComplianceCurve, ...]:
    """Regions and curves as a plan uses them; curves of one spring as one, with that of the cell."""
    curves = {(c.segment, c.direction): c for c in chain.curves}
    regions, new = [], {}
    for region in () if result is None else result.regions:
        element = region.element(chain, plan, fit.value(region.name))
        if isinstance(element, ElasticRegion):
            regions.append(element)
        else:
            key = (element.segment, element.direction)
            curves[key] = new[key] = curves[key].times(element) if key in curves else element
    return (*regions, *new.values())


def _with(
    parameters: Parameters, blocks: Sequence[PullResiduals], region: Region, phi: Sequence[Float]
) -> tuple[Parameters, list[PullResiduals]]:
    low, high = region.bounds
    wider = parameters + Parameters.of([Parameter(region.name, "1", 0.0, PRIOR, low, high, label=region.text)])
    shaped = [
        replace(b, shapes=(*b.shapes, PullShape(region.spring, len(parameters), own)))
        for b, own in zip(blocks, phi, strict=True)
    ]
    return wider, shaped


def _error(parameters: Parameters, blocks: Sequence[PullResiduals], plan: PullLayout) -> float:
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
