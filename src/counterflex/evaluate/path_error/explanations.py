"""Constants that explain an error of the path: force, stiffness, the part frame, or nothing that was thought of.

A cause moves the tool by a known pattern times an unknown factor: ``d = sum_j B_j b_j + f``, with f smooth and of no
cause. What is known of each factor before (normal, from what ``cell check`` says) makes the evidence of an explanation,
``log N(y; 0, H (B P B^T + K) H^T + W^-1)``: one that fits no better than a simpler one loses by what it could have been
and was not. The sizes of f are at their likeliest, where the form of the model is known to leave :data:`STRUCTURE` of
the deflection along a run and :data:`DRIVES` of it where the force changes, within :data:`FACTOR` (log-normal).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.path_error.band_solver import WIDTH, Gathered, Observations, Prior, solved
from counterflex.evaluate.path_error.contacts import Nodes

NOTHING: Final = "no constant"
ALIKE: Final = 3.0
"""Explanations whose logarithms of evidence differ by less cannot be told apart: one to twenty."""
STRUCTURE: Final = 0.06
DRIVES: Final = 0.10
"""As in the interval of a plan's prediction: what identified models leave of the deflection."""
FACTOR: Final = 2.0
_STEPS: Final = 16


@dataclass(frozen=True, eq=False)
class ErrorCause:
    """Something that may be other than planned with."""

    name: str  # what
    factors: tuple[str, ...]  # (q,) names of its factors, the unit last
    pattern: Float  # (q, k, 3) displacement of the tool at the nodes by one of each, m
    sigma: Float  # (q,) what is known of each: standard deviation about 0


@dataclass(frozen=True, eq=False)
class Explanation:
    """Evidence that some causes together explain the deviations."""

    name: str  # the causes
    factors: tuple[str, ...]  # (q,) names
    value: Float  # (q,) estimates
    sigma: Float  # (q,) their standard deviations
    correlation: Float  # (q, q) of the estimates
    log_evidence: float  # logarithm of the evidence over that of no cause at all
    explained: float  # share of the sum of squares of the deviations

    @classmethod
    def weighed(
        cls, observed: Observations, nodes: Nodes, prior: Prior, gathered: Gathered, causes: tuple[ErrorCause, ...]
    ) -> Explanation:
        """Evidence and factors of some causes, sizes of the rest at their likeliest."""
        patterns = np.concatenate([c.pattern for c in causes]) if causes else np.zeros((0, len(nodes), 3))
        before = np.concatenate([c.sigma for c in causes]) if causes else np.zeros(0)
        begin, end = patterns[:, observed.node - 1], patterns[:, observed.node]
        HB = np.sum((begin + observed.share[:, None] * (end - begin)) * observed.normal, axis=2).T * before
        index, weight = observed.columns()
        w = 1.0 / observed.variance_m2
        columns = np.column_stack([observed.y_m, HB])
        states = WIDTH * len(nodes)
        right = np.zeros((states, columns.shape[1]))
        for i in range(index.shape[1]):
            for j in range(columns.shape[1]):
                right[:, j] += np.bincount(index[:, i], w * weight[:, i] * columns[:, j], minlength=states)
        at = partial(_factors, nodes, prior, gathered, columns.T @ (w[:, None] * columns), right)
        low, high = np.log(0.3 * UM), np.log(3.0 * MM)
        usual = np.clip(np.log([prior.wide_m, prior.narrow_m]), low, high)
        best = scipy.optimize.minimize(
            lambda x: -at(np.clip(x, low, high))[0] + 0.5 * float(np.sum(((x - usual) / np.log(FACTOR)) ** 2)),
            usual,
            method="Nelder-Mead",
            options={"maxfev": _STEPS, "xatol": 0.1},
        )
        _, factor, covariance = at(np.clip(best.x, low, high))
        evidence = -float(best.fun)
        sigma = np.sqrt(np.diag(covariance))
        left = observed.y_m - HB @ factor
        return cls(
            " + ".join(c.name for c in causes) or NOTHING,
            tuple(name for c in causes for name in c.factors),
            factor * before,
            sigma * before,
            covariance / np.outer(sigma, sigma),
            evidence,
            1.0 - float(np.sum(left**2)) / max(float(np.sum(observed.y_m**2)), 1e-30),
        )


def explanations(
    observed: Observations,
    nodes: Nodes,
    prior: Prior,
    deflection_m: float,
    causes: Sequence[ErrorCause],
    together: Sequence[tuple[str, ...]],
) -> list[Explanation]:
    """Weigh explanations against each other.

    Args:
        observed: Places of a part, assigned to stretches.
        prior: Lengths of what has no cause; its sizes are found for every explanation.
        deflection_m: Root mean square of the planned deflection in the cut, m.
        together: Names of causes that are also tried together.

    Returns:
        The likeliest first; :data:`NOTHING` is among them.
    """
    gathered = Gathered.of(observed, WIDTH * len(nodes))
    known = {cause.name: cause for cause in causes}
    left = Prior(STRUCTURE * deflection_m, prior.wide_length_m, DRIVES * deflection_m, prior.narrow_length_m)
    none = Explanation.weighed(observed, nodes, left, gathered, ())
    tried = [tuple(known[name] for name in names) for names in [*((cause.name,) for cause in causes), *together]]
    out = [none, *(Explanation.weighed(observed, nodes, left, gathered, some) for some in tried)]
    base = none.log_evidence
    out = [
        Explanation(e.name, e.factors, e.value, e.sigma, e.correlation, e.log_evidence - base, e.explained) for e in out
    ]
    return sorted(out, key=lambda e: -e.log_evidence)


def _factors(
    nodes: Nodes, prior: Prior, gathered: Gathered, gram: Float, right: Float, sizes: Float
) -> tuple[float, Float, Float]:
    """Evidence, factors of the causes and their covariance, with sizes (logarithms) of the rest."""
    a, b = np.exp(sizes).tolist()
    done = solved(nodes, Prior(a, prior.wide_length_m, b, prior.narrow_length_m), gathered)
    S = gram - right.T @ done.solve(right)
    M = np.eye(len(S) - 1) + S[1:, 1:]
    covariance: Float = np.asarray(np.linalg.inv(M), dtype=np.float64)
    factor = covariance @ S[1:, 0]
    gain = 0.5 * (float(S[0, 1:] @ factor) - float(np.linalg.slogdet(M)[1]))
    return done.log_evidence + gain, factor, covariance
