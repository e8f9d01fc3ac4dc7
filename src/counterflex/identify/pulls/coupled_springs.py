"""Directions of an elastic element that move each other: what a diagonal compliance leaves out, the same in all poses.

A housing or a bearing under a moment about one of its axes also turns a little about the others. An element of this
model has six compliances and no coupling between them. Coupling is the same in every pull, so it passes for another
compliance, and neither residuals nor pulls left out show it. It goes through the fit with its usual size
(:mod:`counterflex.identify.solver.considered`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.identify.geometry.compliances import Springs
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import element_jacobians

COUPLING: Final = 0.1
"""Compliance between two directions of an element over the root of the product of theirs, one standard deviation."""


def coupled_by(
    chain: ElasticChain,
    springs: Springs,
    q: Float,
    w_tcp_base: Float,
    at: Callable[[Float], Float],
    acts: Bool | None = None,
) -> Float:
    """How one standard deviation of each coupling moves the tool.

    ``d = k sqrt(c_a c_b) (J_a (J_b^T w) + J_b (J_a^T w))`` for each two directions a, b of an element, k
    :data:`COUPLING`.

    Args:
        chain: The cell's.
        springs: Its compliances.
        q: (n, 6) rad.
        w_tcp_base: (n, 6) N, N m.
        at: Takes twists (n, 6, m) given at the TCP to the point whose displacement is wanted.
        acts: (n, k) whether a spring lies between what is compared in a row; None is all.

    Returns:
        (n, 6, m) m, rad, base axes: a column for each two directions of one element.
    """
    J = element_jacobians(chain, q)  # (n, s, 6, 6)
    soft = springs.of_chain(chain)
    out = []
    for a, b in itertools.combinations(range(len(springs)), 2):
        if springs.segment[a] != springs.segment[b] or soft[a] * soft[b] == 0.0:
            continue
        Ja, Jb = (J[:, springs.segment[k], :, springs.direction[k]] for k in (a, b))
        moved = Ja * np.sum(Jb * w_tcp_base, axis=1)[:, None] + Jb * np.sum(Ja * w_tcp_base, axis=1)[:, None]
        if acts is not None:
            moved = moved * acts[:, a, None]
        out.append(COUPLING * np.sqrt(soft[a] * soft[b]) * moved)
    return at(np.stack(out, axis=2)) if out else np.zeros((len(q), 6, 0))
