"""Scale of a correction by what is not known: closed forms, limits, and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.plan.correction_scale import MOST, Aim, scale_for

AIMS: tuple[Aim, ...] = ("share", "square", "percentile_95", "full")
C = np.random.default_rng(3).normal(size=(40, 3)) * 1e-3
WEIGHT = np.random.default_rng(4).uniform(0.5, 2.0, 40)


def needed(factors: Float) -> Float:
    """What cells need beyond the correction that all yield by one factor."""
    return (factors - 1.0)[:, None, None] * C


@pytest.mark.parametrize("aim", AIMS)
def test_without_a_spread_the_correction_is_whole(aim: Aim) -> None:
    assert scale_for(aim, C, np.zeros((10, 40, 3)), WEIGHT) == 1.0


@pytest.mark.parametrize("aim", AIMS)
def test_the_scale_tends_to_one_with_the_spread(aim: Aim) -> None:
    z = np.random.default_rng(5).standard_normal(2000)
    off = [abs(scale_for(aim, C, needed(np.exp(s * z)), WEIGHT) - 1.0) for s in (0.4, 0.1, 0.025)]
    assert off[0] >= off[1] >= off[2]
    assert off[2] <= 0.012 + 0.04 * (aim == "percentile_95")


@pytest.mark.parametrize("aim", ["share", "square", "percentile_95"])
@pytest.mark.parametrize("factor", [0.5, 0.8, 1.3])
def test_one_linear_draw_is_met(aim: Aim, factor: float) -> None:
    assert scale_for(aim, C, needed(np.array([factor])), WEIGHT) == pytest.approx(factor, abs=1e-9)


def test_stiffness_by_a_lognormal_factor_in_closed_form() -> None:
    """``E[1/x] / E[1/x^2] = exp(-3/2 s^2)`` of the share, ``E[x] = exp(s^2 / 2)`` of the square."""
    s = 0.3
    x = np.exp(s * np.random.default_rng(6).standard_normal(50_000))
    x = np.concatenate([x, 1.0 / x])
    rows = slice(0, 2)  # few points are enough, all cells yield alike
    d = (x - 1.0)[:, None, None] * C[rows]
    assert scale_for("share", C[rows], d, WEIGHT[rows]) == pytest.approx(np.exp(-1.5 * s * s), rel=0.005)
    assert scale_for("square", C[rows], d, WEIGHT[rows]) == pytest.approx(np.exp(0.5 * s * s), rel=0.005)


def test_no_other_scale_leaves_less() -> None:
    rng = np.random.default_rng(7)
    d = needed(np.exp(0.4 * rng.standard_normal(500))) + 2e-4 * rng.standard_normal((500, 1, 3))
    x = C + d
    size = np.einsum("rnk,n->r", x * x, WEIGHT)

    def left(s: float) -> Float:
        out: Float = np.einsum("rnk,n->r", (x - s * C) ** 2, WEIGHT) / size
        return out

    best = {aim: scale_for(aim, C, d, WEIGHT) for aim in AIMS}
    for other in np.arange(0.3, 1.5, 0.05):
        assert np.mean(left(best["share"])) <= np.mean(left(other)) + 1e-12
        assert np.mean(left(best["square"]) * size) <= np.mean(left(other) * size) + 1e-18
        assert np.quantile(left(best["percentile_95"]), 0.95) <= np.quantile(left(other), 0.95) + 1e-3


def test_cells_that_need_the_opposite_get_nothing_and_soft_ones_no_more_than_the_bound() -> None:
    assert scale_for("share", C, needed(np.array([-1.0])), WEIGHT) == 0.0
    assert scale_for("square", C, needed(np.array([9.0])), WEIGHT) == MOST


def test_nothing_corrected_is_left_as_it_is() -> None:
    assert scale_for("share", np.zeros((40, 3)), needed(np.array([2.0])), WEIGHT) == 1.0
