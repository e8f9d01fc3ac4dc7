"""All blocks of an identification as one least-squares problem in fit coordinates.

Tall Jacobians are reduced to triangles, ``[J r] = Q [R z]`` with ``R^T R = J^T J``, ``R^T z = J^T r``, ``|z| = |r|``
within the span: to a trust-region method the two are the same, but R has as many rows as there are parameters. The
reduction goes by slices small enough that a threaded BLAS works on each alone: on a busy machine, threads that wait for
one another cost far more than the work.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals

# Least squares within bounds, when bounds are in the way: Gauss-Newton steps by exact bounded linear least squares.
# A method that keeps away from bounds creeps along them; this one rests on them and leaves them again. Each step solves
# ``min |R d + z|^2`` within the bounds and a trust box by SciPy's active-set method (BVLS).
#
# Source: Stark and Parker 1995 (bounded-variable least squares); Nocedal and Wright, Numerical Optimization, chapter 4.

_WIDEST: Final = 10.0
_POOR: Final = 0.25
_GOOD: Final = 0.75


@dataclass(frozen=True, eq=False)
class Rest:
    """Values at which an inner fit came to rest."""

    x: Float  # (f,) values
    status: int  # as SciPy has them: 0 too many evaluations, 1 gradient, 2 misfit, 3 values
    jac: Float  # (k, f) derivative there


def within_bounds(
    reduced: Callable[[Float], Float | None], u: Float, lower: Float, upper: Float, tolerance: float, most: int
) -> Rest:
    """Minimise half the square of a residual within bounds.

    Args:
        reduced: Triangle (k, f + 1) of derivative and residual (last column), or None where it cannot be computed.
        u: (f,) start, within the bounds; ``reduced`` is known there.
        lower: (f,).
        upper: (f,).
        tolerance: Relative change of misfit and values, and size of the projected gradient, at which it rests.
    """
    here = reduced(u)
    if here is None:
        return Rest(u, 0, np.zeros((0, len(u))))
    box = _WIDEST
    status = 0
    for _ in range(most - 1):
        R, z = here[:, :-1], here[:, -1]
        gradient = R.T @ z
        if np.max(np.abs(u - np.clip(u - gradient, lower, upper))) < tolerance:
            status = 1
            break
        low, high = np.maximum(lower - u, -box), np.minimum(upper - u, box)
        d = np.clip(
            scipy.optimize.lsq_linear(R, -z, bounds=(low, np.maximum(high, low + 1e-300)), method="bvls").x, low, high
        )
        step = float(np.max(np.abs(d)))
        if step < tolerance * (tolerance + float(np.max(np.abs(u)))):
            status = 3
            break
        size = float(z @ z)
        hoped = size - float(np.sum((R @ d + z) ** 2))
        there = reduced(np.clip(u + d, lower, upper))
        gained = -np.inf if there is None else size - float(there[:, -1] @ there[:, -1])
        ratio = gained / max(hoped, 1e-300)
        if ratio < _POOR:
            box = 0.25 * step
        elif ratio > _GOOD:
            box = max(box, 2.0 * step)
        if gained > 0.0 and there is not None:
            u, here = np.clip(u + d, lower, upper), there
        if abs(gained) < tolerance * size and ratio > _POOR:
            status = 2
            break
    return Rest(u, status, here[:, :-1])


_FLOOR: Final = 1e-13
_ALONE: Final = 8000
"""Numbers in a slice and its triangle that BLAS does not share out."""
_FEWEST_ROWS: Final = 32
_WIDE: Final = 60
"""Columns beyond which slices shorter than the triangle would cost more than threads do."""
_ABSURD: Final = 1e30


def triangle(rows: Float, scale: Float) -> Float:
    """Upper triangle R (k, k) with ``R^T R = A^T A`` of ``A = scale rows``.

    Args:
        rows: (m, k).
        scale: (m,) factor of each row.
    """
    m, k = rows.shape
    step = max(_FEWEST_ROWS, _ALONE // k - k, k if k > _WIDE else 0)
    work = np.zeros((k + step, k), order="F")
    R, (size, upper) = np.zeros((k, k)), _reduction(k + step, k)
    for first in range(0, m, step):
        piece = rows[first : first + step]
        end = k + len(piece)
        work[:k] = R
        np.multiply(piece, scale[first : first + step, None], out=work[k:end])
        R = upper * scipy.linalg.lapack.dgeqrf(work[:end], lwork=size)[0][:k]
    return R


@cache
def _reduction(rows: int, k: int) -> tuple[int, Float]:
    """Work space that LAPACK wants for (rows, k) numbers, and ones in an upper triangle (k, k)."""
    return int(scipy.linalg.lapack.dgeqrf_lwork(rows, k)[0]), np.triu(np.ones((k, k)))


class _Weighted:
    """The sum of squares with fixed weights as SciPy asks for it, reduced to a triangle and kept for one place."""

    def __init__(self, stacked: Stacked, weights: Sequence[Float], factors: Sequence[float]) -> None:
        """Of all blocks, each with its weights (rows,) and the factor that its residuals are divided by."""
        self.stacked, self.weights, self.factors = stacked, weights, factors
        self.crossed = False
        self._last: tuple[bytes, Float | None] = (b"", None)

    def reduced(self, u: Float) -> Float | None:
        """None where a residual is absurd or not finite: the trust region then refuses the step."""
        key, stacked = u.tobytes(), self.stacked
        if self._last[0] != key:
            self._last = (key, None)
            if all(np.all(np.abs(r) < _ABSURD) for r in stacked.rows(u)):
                prior = np.column_stack([np.diag(stacked.known), stacked.known * u])
                stack = np.concatenate([*stacked.triangles(u, self.weights, self.factors), prior])
                if np.all(np.abs(stack) < _ABSURD):
                    self._last = (key, triangle(stack, np.ones(len(stack))))
        return self._last[1]

    def cost(self, u: Float) -> Float:
        """(f + 1,) residuals of the triangle; NaN beyond the bounds, which is noted."""
        outside = bool(np.any(u < self.stacked.lower) or np.any(u > self.stacked.upper))
        self.crossed |= outside
        here = None if outside else self.reduced(u)
        return np.full(len(u) + 1, np.nan) if here is None else np.ascontiguousarray(here[:, len(u)])

    def slope(self, u: Float) -> Float:
        """(f + 1, f) derivative of :meth:`cost`."""
        here = self.reduced(u)
        return np.zeros((len(u) + 1, len(u))) if here is None else np.ascontiguousarray(here[:, : len(u)])


class Stacked:
    """Residuals and Jacobian over the free fit coordinates; the last point is remembered.

    Attributes:
        free: (f,) places of the free parameters.
        known: (f,) 1 where a free parameter has a prior, else 0.
        lower: (f,) bounds.
        upper: (f,) bounds.
        start: (f,) where to begin.
        evaluations: Points at which the residuals were computed so far.
    """

    def __init__(self, parameters: Parameters, blocks: Sequence[Residuals], start: Float | None) -> None:
        self.parameters, self.blocks = parameters, tuple(blocks)
        self.free: Int = np.flatnonzero(parameters.free).astype(np.int64)
        if len(self.free) == 0 or sum(len(b.group) for b in blocks) == 0:
            raise InputError(
                "there is nothing to fit",
                value=f"{len(self.free)} free parameters, {sum(len(b.group) for b in blocks)} rows",
                limit="at least one of each",
            )
        self.known = np.array([p.has_prior for p in parameters.items], dtype=np.float64)[self.free]
        lower, upper = parameters.bounds()
        self.lower, self.upper = lower[self.free], upper[self.free]
        begin = parameters.nominal if start is None else np.asarray(start, dtype=np.float64)
        if begin.shape != (len(parameters),) or not np.all(np.isfinite(begin)):
            raise InputError("the start is not one finite number for each parameter", value=begin.shape)
        self._full = parameters.coordinates(np.where(parameters.free, begin, parameters.nominal))
        self.start: Float = np.clip(self._full[self.free], self.lower, self.upper)
        self.evaluations = 0
        self._bounded = False
        self._rows: tuple[bytes, list[Float]] | None = None
        self._slopes: tuple[bytes, list[Float]] | None = None

    def values(self, u: Float) -> Float:
        """(p,) SI values of the free fit coordinates (f,)."""
        self._full[self.free] = u
        return self.parameters.values(self._full)

    def rows(self, u: Float) -> list[Float]:
        """Per block the weighted residuals (rows, components)."""
        key = u.tobytes()
        if self._rows is None or self._rows[0] != key:
            self.evaluations += 1
            # A step too far is refused for what it gives, not by a warning.
            with np.errstate(over="ignore", invalid="ignore"):
                x = self.values(u)
                self._rows = (key, [b.evaluate(x) for b in self.blocks])
        return self._rows[1]

    def slopes(self, u: Float) -> list[Float]:
        """Per block the residuals (last column) and their derivative by the free fit coordinates (numbers, f + 1)."""
        key = u.tobytes()
        if self._slopes is None or self._slopes[0] != key:
            rows, x, f = self.rows(u), self.values(u), len(self.free)
            scale = self.parameters.slope(x)[self.free]
            out = []
            with np.errstate(over="ignore", invalid="ignore"):
                for block, r in zip(self.blocks, rows, strict=True):
                    both = np.empty((r.size, f + 1))
                    np.multiply(block.jacobian(x)[:, :, self.free].reshape(-1, f), scale, out=both[:, :f])
                    both[:, f] = r.reshape(-1)
                    out.append(both)
            self._slopes = (key, out)
        return self._slopes[1]

    def check_finite(self) -> None:
        """Refuse residuals that are not finite at the start. Raises InputError: names block and row."""
        for block, rows in zip(self.blocks, self.rows(self.start), strict=True):
            if not np.all(np.isfinite(rows)):
                row = int(np.argwhere(~np.isfinite(rows))[0, 0])
                raise InputError(
                    "a residual is not finite",
                    where=f"{block.name}: row {row}",
                    hint="Look for gaps in the data and for standard deviations of zero",
                )

    def triangles(self, u: Float, weights: Sequence[Float], factors: Sequence[float]) -> list[Float]:
        """Per block the triangle (f + 1, f + 1) of its weighted derivatives and residuals (last column)."""
        out = []
        for both, r, w, s in zip(self.slopes(u), self.rows(u), weights, factors, strict=True):
            out.append(triangle(both, np.repeat(np.sqrt(w) / s, r.shape[1])))
        return out

    def fit(self, u: Float, weights: Sequence[Float], factors: Sequence[float], tolerance: float, most: int) -> Rest:
        """SciPy's trust-region least squares with fixed weights.

        It knows no bounds until a step would cross one; that step is refused, and the fit goes on by
        :func:`counterflex.identify.solver.stacked_residuals.within_bounds` then and in all later rounds.

        Args:
            u: (f,) start.
            weights: Per block (rows,).
            factors: Per block: its residuals are divided by it.
            tolerance: Relative change of cost, step and gradient at which it rests.
        """
        problem = _Weighted(self, weights, factors)
        if not self._bounded:
            result = scipy.optimize.least_squares(
                problem.cost,
                u,
                problem.slope,
                method="trf",
                x_scale=1.0,
                ftol=tolerance,
                xtol=tolerance,
                gtol=tolerance,
                max_nfev=most,
            )
            u = np.asarray(result.x)
            if not problem.crossed:
                return Rest(u, int(result.status), np.asarray(result.jac))
            self._bounded = True
        return within_bounds(problem.reduced, u, self.lower, self.upper, tolerance, most)

    def covariance(self, parts: Sequence[Float]) -> tuple[Float, list[float]]:
        """Covariance (f, f) in fit coordinates with the priors, and how many parameters each block determines.

        ``C = (sum_b J_b^T J_b + P)^-1`` by SVD with scaled columns, so that neither the squares of the Jacobian nor the
        sizes of the parameters cost digits; directions that neither data nor priors hold get a huge variance. The
        number of a block is ``trace(J_b C J_b^T)``; those of all blocks and the priors add up to f.
        """
        f = len(self.free)
        stack = np.concatenate([*(part[:, :f] for part in parts), np.diag(self.known)])
        scale = np.linalg.norm(stack, axis=0)
        scale[scale == 0.0] = 1.0
        R = triangle(stack / scale, np.ones(len(stack)))
        _, s, vt = np.linalg.svd(R)
        # Floored, not cut off: a direction that nobody holds must show as a huge variance, not as one that is known.
        inverse = vt.T / np.maximum(s, _FLOOR * s[0]) / scale[:, None]
        used = [float(np.sum((part[:, :f] @ inverse) ** 2)) for part in parts]
        out: Float = inverse @ inverse.T
        return out, used
