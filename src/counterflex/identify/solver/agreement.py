"""Agreement of a fit with what was known before: within noise, or against its priors.

In fit coordinates the former values are 0 with covariance I. An eigendirection of the posterior covariance with the
variance l < 1/2 is one that the data determine; if the former values are the true ones, the fitted value along it has
the variance ``l (1 - l)``. The sum of the squares in these units is chi-squared distributed::

    T = sum_i (v_i . u)^2 / (l_i (1 - l_i)),   l_i < 1/2

Parameters without a prior (frames and the like) have no former values and are marginalised.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.identify.solver.fit import Fit

AGREES: Final = 0.01
"""Probability of a difference at least as large, below which the data contradict the former values."""
DETERMINED: Final = 0.5
"""Variance in units of the prior's below which the data say more about a direction than the prior does."""
OFF: Final = 4.0
"""Prior standard deviations beyond which a determined value contradicts its prior: 1 in 16 000 is as far by chance."""


@dataclass(frozen=True)
class Agreement:
    """Comparison of identified with former values.

    Attributes:
        chance: Probability of at least such a difference if the former values are true; 1 without any to compare.
        directions: Combinations of parameters that the data determine.
        growth: Largest ratio by which a held-out error may exceed that of true former values by the noise of the fit
            alone: ``1 + 4 p / n``, p determined parameters, n degrees of freedom. A fit adds p / n of the variance; few
            rows are held out, so the ratio of two means scatters by as much again.
    """

    chance: float
    directions: int
    growth: float

    @property
    def agrees(self) -> bool:
        """Return whether the data agree with the former values within noise."""
        return self.chance >= AGREES


def agreement(fits: Iterable[Fit]) -> Agreement:
    """Compare the values of fits with those known before."""
    total, count, seen, freedom = 0.0, 0, 0.0, 0.0
    for fit in fits:
        free = fit.free_index
        known = np.array([fit.parameters.items[i].has_prior for i in free], dtype=np.bool_)
        seen += float(sum(how in ("determined", "partly") for how in fit.seen))
        freedom += max(fit.dof, 1.0)
        if not np.any(known):
            continue
        u = fit.parameters.coordinates(fit.values)[free][known]
        variance, directions = np.linalg.eigh(fit.covariance[np.ix_(known, known)])
        determined = (variance < DETERMINED) & (variance > 0.0)
        along = directions[:, determined].T @ u
        total += float(np.sum(along**2 / (variance[determined] * (1.0 - variance[determined]))))
        count += int(np.sum(determined))
    return Agreement(
        float(scipy.stats.chi2.sf(total, count)) if count else 1.0, count, 1.0 + 4.0 * seen / max(freedom, 1.0)
    )


def contradicted(fit: Fit) -> tuple[tuple[str, float], ...]:
    """Names of the parameters that the data determine far from their priors, with the distance in prior sigmas."""
    u = np.abs(fit.parameters.coordinates(fit.values))
    off = [
        (p.label or p.name, float(u[i]))
        for i, (p, how) in enumerate(zip(fit.parameters, fit.seen, strict=True))
        if p.free and p.has_prior and how in ("determined", "partly") and u[i] > OFF
    ]
    return tuple(sorted(off, key=lambda item: -item[1]))
