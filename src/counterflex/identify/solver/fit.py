"""Result of a fit: values with standard deviations, what is seen and what is not, outliers, why it stopped."""

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
    """A row whose residual is too large to be noise."""

    block: str  # name of its block
    row: int  # row in the block
    size: float  # norm of its weighted residual, per root of the number of components (1 is what noise gives)
    weight: float  # weight it was left with, 0..1


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of :func:`counterflex.identify.solver.solve.solve`."""

    parameters: Parameters
    values: Float  # (p,) SI
    sigma: Float  # (p,) standard deviations, SI (0 for held ones)
    covariance: Float  # (f, f) of the free parameters in fit coordinates
    free_index: Int  # (f,) which parameters these are
    seen: tuple[Seen, ...]  # (p,) how much of each comes from the data
    residuals: tuple[Float, ...]  # per block (rows, components) at the solution, unweighted by robustness
    weights: tuple[Float, ...]  # per block (rows,) robust weight
    outliers: tuple[Outlier, ...]
    # per block, the factor by which the residuals exceed the stated standard deviations, at least 1; the block's
    # standard deviations were widened by it (Birge ratio; with robust weights Huber's form of it)
    sigma_factors: tuple[float, ...]
    chi2_reduced: float  # weighted sum of squares per degree of freedom
    dof: float  # measured numbers minus what the data determine (effective number of parameters)
    rank: int  # rank of the weighted Jacobian without priors, in fit coordinates
    condition: float  # its condition number (largest by smallest singular value)
    hidden: tuple[str, ...]  # sentences: which parameters cannot be separated from which
    reason: str  # why the solver stopped, in words
    evaluations: int  # number of evaluations
    converged: bool = True  # whether it came to rest (else `reason` says what it was doing)
    # names of the free parameters that rest against a bound and that the data see: they would have them beyond it
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
