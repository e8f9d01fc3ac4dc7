"""Factor of one run's force over that of one law."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.identify.production.residuals import LAW, ProductionResiduals


@dataclass(frozen=True)
class RunFactor:
    """The force of a run by one law.

    Attributes:
        factor: Measured by expected force.
        sigma: Its standard deviation: noise, zero, height of the work.
    """

    factor: float
    sigma: float


def run_factor(block: ProductionResiduals, x: Float) -> RunFactor:
    """Factor of one run's force, its tops found beside it, bounds and give as they are in x.

    Args:
        block: Stretches of one run; its growth is not used.
        x: (p,) constants and geometry.
    """
    inside = x.copy()
    tops = [i for i, p in enumerate(block.geometry.parameters) if p.name.startswith("top.")]
    mine = [i for i in tops if np.any(block.geometry.top == i)]
    inside[[LAW + i for i in mine]] = 0.0
    bare = ProductionResiduals(block.pieces, block.geometry, block.cutter, block.h_ref_m, block.group)
    only_law = bare.predict(inside)
    fixed = inside.copy()
    fixed[:3], fixed[6:9] = 0.0, 0.0
    geometry = bare.predict(fixed)
    columns = [((only_law - geometry) / block.sigma).reshape(-1)]
    columns += [(-block.jacobian(x)[:, :, LAW + i]).reshape(-1) for i in mine]
    A = np.stack(columns, axis=1)
    y = ((block.pieces.force - geometry) / block.sigma).reshape(-1)
    prior = np.array([0.0] + [1.0 / block.geometry.parameters.items[i].prior_sigma ** 2 for i in mine])
    info = A.T @ A + np.diag(prior)
    value = np.linalg.solve(info, A.T @ y)
    rest = (y - A @ value).reshape(-1, 3)
    # Components and stretches of one contact err alike: they count as one.
    contacts = np.unique(block.group)
    square = sum(float(np.mean(rest[block.group == g] ** 2)) for g in contacts)
    excess = max(1.0, square / max(len(contacts) - 1, 1) if len(contacts) > 1 else square)
    share = len(block.pieces) / len(contacts)
    covariance = np.linalg.inv(info / (excess * share) + np.diag(prior) * (1.0 - 1.0 / (excess * share)))
    return RunFactor(float(value[0]), math.sqrt(float(covariance[0, 0])))
