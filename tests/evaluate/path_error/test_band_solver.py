"""The band solver against dense Gaussian formulas: covariance, mean, evidence, draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.path_error.band_solver import WIDTH, Gathered, Observations, Prior, solved, values_of
from counterflex.evaluate.path_error.contacts import Nodes

PRIOR = Prior(80 * UM, 30 * MM, 40 * UM, 4 * MM)


def nodes() -> Nodes:
    """Two runs of 9 nodes, unevenly spaced."""
    rng = np.random.default_rng(1)
    station = np.concatenate([np.cumsum(rng.uniform(0.5, 2.0, 9)) * MM for _ in range(2)])
    chain = np.repeat([0, 1], 9)
    station -= np.where(chain == 0, station[0], station[9])
    return Nodes(np.arange(18), chain, station, rng.uniform(1.0, 4.0, 18))


def covariance(n: Nodes) -> Float:
    """Closed form: Matern 3/2 of both lengths, the narrow one larger where it is restless; runs independent."""
    apart = np.abs(n.station_m[:, None] - n.station_m[None, :])
    K = np.zeros((18, 18))
    wide, narrow = np.full(18, PRIOR.wide_m), PRIOR.narrow_m * n.unrest
    for sigma, length in ((wide, PRIOR.wide_length_m), (narrow, PRIOR.narrow_length_m)):
        r = np.sqrt(3.0) * apart / length
        K += np.outer(sigma, sigma) * (1.0 + r) * np.exp(-r)
    return np.kron(K * (n.chain[:, None] == n.chain[None, :]), np.eye(3))


def observations(seed: int) -> tuple[Observations, Float]:
    """Forty of them, and their matrix on the values of the nodes."""
    rng = np.random.default_rng(seed)
    node = rng.choice([k for k in range(18) if k not in (0, 9)], 40)
    normal = rng.normal(size=(40, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    share = rng.uniform(size=40)
    seen = Observations(node, share, normal, 100 * UM * rng.normal(size=40), rng.uniform(5, 30, 40) ** 2 * UM**2)
    H = np.zeros((40, 54))
    for row in range(40):
        H[row, 3 * (node[row] - 1) : 3 * node[row]] += (1.0 - share[row]) * normal[row]
        H[row, 3 * node[row] : 3 * node[row] + 3] += share[row] * normal[row]
    return seen, H


def test_mean_and_evidence_are_those_of_the_dense_formulas() -> None:
    n = nodes()
    K = covariance(n)
    seen, H = observations(2)
    done = solved(n, PRIOR, Gathered.of(seen, WIDTH * 18))
    S = H @ K @ H.T + np.diag(seen.variance_m2)
    np.testing.assert_allclose(values_of(done.mean).ravel(), K @ H.T @ np.linalg.solve(S, seen.y_m), atol=1e-9)
    assert done.log_evidence == pytest.approx(float(multivariate_normal.logpdf(seen.y_m, cov=S)), rel=1e-6)


def test_draws_scatter_as_the_dense_covariance_says() -> None:
    n = nodes()
    K = covariance(n)
    seen, H = observations(3)
    done = solved(n, PRIOR, Gathered.of(seen, WIDTH * 18))
    S = H @ K @ H.T + np.diag(seen.variance_m2)
    after = np.sqrt(np.diag(K - K @ H.T @ np.linalg.solve(S, H @ K)))
    drawn = np.std(values_of(done.draws(4000, 4)), axis=0).ravel()
    # standard deviations of 4000 draws are known to 1.1 %; four times that
    np.testing.assert_allclose(drawn, after, rtol=0.05)
