"""All blocks of an identification as one least-squares problem in fit coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr
from scipy.optimize import OptimizeResult, least_squares

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.parameters import Parameters
from counterflex.identify.residuals import Residuals

_FLOOR = 1e-13


class Stacked:
    """Residuals and Jacobian over the free fit coordinates; the last point is remembered.

    Attributes:
        parameters: All of them.
        blocks: The measurements.
        free: (f,) places of the free parameters.
        known: (f,) 1 where a free parameter has a prior, else 0.
        lower: (f,) bounds.
        upper: (f,) bounds.
        start: (f,) where to begin.
        evaluations: Residuals computed so far.
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
            x = self.values(u)
            self._rows = (key, [b.evaluate(x) for b in self.blocks])
        return self._rows[1]

    def slopes(self, u: Float) -> list[Float]:
        """Per block the derivative of the rows by the free fit coordinates (rows, components, f)."""
        key = u.tobytes()
        if self._slopes is None or self._slopes[0] != key:
            x = self.values(u)
            scale = self.parameters.slope(x)[self.free]
            self._slopes = (key, [b.jacobian(x)[:, :, self.free] * scale for b in self.blocks])
        return self._slopes[1]

    def check_finite(self) -> None:
        """Refuse residuals that are not finite at the start.

        Raises:
            InputError: Names block and row.
        """
        for block, rows in zip(self.blocks, self.rows(self.start), strict=True):
            if not np.all(np.isfinite(rows)):
                row = int(np.argwhere(~np.isfinite(rows))[0, 0])
                raise InputError(
                    "a residual is not finite",
                    where=f"{block.name}: row {row}",
                    hint="Look for gaps in the data and for standard deviations of zero",
                )

    def fit(
        self, u: Float, weights: Sequence[Float], factors: Sequence[float], tolerance: float, most: int
    ) -> OptimizeResult:
        """SciPy's trust-region least squares with fixed weights.

        Args:
            u: (f,) start.
            weights: Per block (rows,).
            factors: Per block: its residuals are divided by it.
            tolerance: Relative change of cost, step and gradient at which it rests.
            most: Most evaluations.
        """
        ties = np.diag(self.known)[self.known > 0.0]
        roots = [np.sqrt(w) / s for w, s in zip(weights, factors, strict=True)]

        def cost(u: Float) -> Float:
            parts = [(r * w[:, None]).reshape(-1) for r, w in zip(self.rows(u), roots, strict=True)]
            return np.concatenate([*parts, u[self.known > 0.0]])

        def slope(u: Float) -> Float:
            parts = [(J * w[:, None, None]).reshape(-1, len(u)) for J, w in zip(self.slopes(u), roots, strict=True)]
            return np.concatenate([*parts, ties])

        return least_squares(
            cost,
            u,
            slope,
            bounds=(self.lower, self.upper),
            method="trf",
            x_scale=1.0,
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
            max_nfev=most,
        )

    def weighted(self, u: Float, weights: Sequence[Float], factors: Sequence[float]) -> list[Float]:
        """Per block the weighted Jacobian (rows * components, f)."""
        return [
            (J * (np.sqrt(w) / s)[:, None, None]).reshape(-1, len(u))
            for J, w, s in zip(self.slopes(u), weights, factors, strict=True)
        ]

    def covariance(self, parts: Sequence[Float]) -> tuple[Float, list[float]]:
        """Covariance (f, f) in fit coordinates with the priors, and how many parameters each block determines.

        ``C = (sum_b J_b^T J_b + P)^-1`` by QR and SVD with scaled columns, so that neither the squares of the Jacobian
        nor the sizes of the parameters cost digits; directions that neither data nor priors hold get a huge variance.
        The number of a block is ``trace(J_b C J_b^T)``; those of all blocks and the priors add up to f.

        Args:
            parts: Per block the weighted Jacobian (m, f).
        """
        f = len(self.free)
        stack = np.concatenate([*parts, np.diag(self.known)[self.known > 0.0], np.zeros((f, f))])
        scale = np.linalg.norm(stack, axis=0)
        scale[scale == 0.0] = 1.0
        (R,) = qr(stack / scale, mode="r", check_finite=False)
        _, s, vt = np.linalg.svd(R[:f])
        inverse = vt.T / np.maximum(s, _FLOOR * s[0]) / scale[:, None]
        used = [float(np.sum((part @ inverse) ** 2)) for part in parts]
        out: Float = inverse @ inverse.T
        return out, used
