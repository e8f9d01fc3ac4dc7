"""What a fit found: values with standard deviations, what is seen and what is not, outliers, why it stopped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.identify.solver.parameters import Parameters

Seen = Literal["determined", "partly", "prior", "held"]
"""How much of a parameter's value comes from the data: ``determined`` (standard deviation below half of the prior's),
``partly`` (also where the value rests against a bound), ``prior`` (above nine tenths: the data do not see it) or
``held`` (not free)."""


@dataclass(frozen=True)
class Outlier:
    """A row whose residual is too large to be noise.

    Attributes:
        block: Name of its block.
        row: Row in the block.
        size: Norm of its weighted residual, per root of the number of components (1 is what noise gives).
        weight: Weight it was left with, 0..1.
    """

    block: str
    row: int
    size: float
    weight: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of :func:`counterflex.identify.solver.solve.solve`.

    Attributes:
        values: (p,) SI.
        sigma: (p,) standard deviations, SI (0 for held ones).
        covariance: (f, f) of the free parameters in fit coordinates.
        free_index: (f,) which parameters these are.
        seen: (p,) how much of each comes from the data.
        residuals: Per block (rows, components) at the solution, unweighted by robustness.
        weights: Per block (rows,) robust weight.
        sigma_factors: Per block, the factor by which the residuals exceed the stated standard deviations, at least 1;
            the block's standard deviations were widened by it (Birge ratio; with robust weights Huber's form of it).
        chi2_reduced: Weighted sum of squares per degree of freedom.
        dof: Measured numbers minus what the data determine (effective number of parameters).
        rank: Rank of the weighted Jacobian without priors, in fit coordinates.
        condition: Its condition number (largest by smallest singular value).
        hidden: Sentences: which parameters cannot be separated from which.
        reason: Why the solver stopped, in words.
        evaluations: Number of evaluations.
        converged: Whether it came to rest (else ``reason`` says what it was doing).
        at_bound: Names of the free parameters that rest against a bound and that the data see: they would have them
            beyond it.
    """

    parameters: Parameters
    values: Float
    sigma: Float
    covariance: Float
    free_index: Int
    seen: tuple[Seen, ...]
    residuals: tuple[Float, ...]
    weights: tuple[Float, ...]
    outliers: tuple[Outlier, ...]
    sigma_factors: tuple[float, ...]
    chi2_reduced: float
    dof: float
    rank: int
    condition: float
    hidden: tuple[str, ...]
    reason: str
    evaluations: int
    converged: bool = True
    at_bound: tuple[str, ...] = ()

    def value(self, name: str) -> float:
        """SI value of a parameter."""
        return float(self.values[self.parameters.index(name)])

    def sigma_of(self, name: str) -> float:
        """SI standard deviation of a parameter."""
        return float(self.sigma[self.parameters.index(name)])

    @property
    def correlation(self) -> Float:
        """(f, f) correlation coefficients of the free parameters, in the order of ``free_index``."""
        spread = np.sqrt(np.diag(self.covariance))
        out: Float = self.covariance / np.outer(spread, spread)
        return out

    def determined(self) -> Bool:
        """(p,) which parameters the data determine."""
        return np.array([state == "determined" for state in self.seen], dtype=np.bool_)
