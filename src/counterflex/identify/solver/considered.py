"""What is known beforehand, is the same for all rows and is not fitted: its part in the standard deviations.

Where each bearing sits, how true the scale of a load cell is: such a quantity moves all rows together, so that no
residual, no fold and no part left out shows it. Its standard deviation goes through the fit instead::

    G = C sum_b J_b^T W_b D_b        covariance = C + G G^T

with C the covariance, J_b and W_b weighted rows and weights of a block, and D_b what one standard deviation of each
quantity moves its weighted rows by.

Source: Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter VIII (considered parameters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.residuals import Residuals


def considered(fit: Fit, blocks: Sequence[Residuals], moved: Sequence[Float]) -> Float:
    """(f, f) covariance that quantities which are not fitted add, in fit coordinates.

    ``fit``: Of these blocks, its covariance that of independent rows. ``moved``: Per block (rows, components, m) what
    one standard deviation of each of m quantities, the same m in all blocks, moves the measured values by, in their
    units.

    Returns:
        ``G G^T``; independent of the sign of ``moved``.
    """
    x, free = fit.values, fit.free_index
    slope = fit.parameters.slope(x)[free]
    pulled = np.zeros((len(free), moved[0].shape[2] if moved else 0))
    for block, by, weight, factor in zip(blocks, moved, fit.weights, fit.sigma_factors, strict=True):
        J = block.jacobian(x)[:, :, free] * slope * (weight / factor**2)[:, None, None]
        pulled += np.einsum("ncf,ncm->fm", J, by / block.sigma[:, :, None])
    G = fit.covariance @ pulled
    out: Float = G @ G.T
    return out


def added(fit: Fit, covariance: Float) -> Fit:
    """The fit with a covariance (f, f) of its free fit coordinates added."""
    before = np.diag(fit.covariance)
    grown = np.sqrt(1.0 + np.diag(covariance) / np.maximum(before, 1e-300))
    sigma = fit.sigma.copy()
    sigma[fit.free_index] *= grown
    return replace(fit, covariance=fit.covariance + covariance, sigma=sigma)
