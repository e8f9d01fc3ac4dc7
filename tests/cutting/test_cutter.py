"""The cutter's outline, its levels and its refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from counterflex.core.errors import InputError
from counterflex.cutting.cutter import CORNER_LEVELS, Cutter

FLAT = Cutter(0.016)
BALL = Cutter(0.010, 0.005)
BULL = Cutter(0.016, 0.003)


def test_outline_of_each_kind() -> None:
    assert FLAT.radius_at(0.0) == 0.008
    assert BALL.radius_at(0.0) == 0.0
    assert BALL.radius_at(0.005) == 0.005
    assert BALL.radius_at(0.001) == pytest.approx(math.sqrt(0.001 * 0.009))
    assert BULL.radius_at(0.0) == pytest.approx(0.005)
    assert BULL.radius_at(1.0) == 0.008


def test_levels_cover_the_corner_once() -> None:
    assert FLAT.levels().tolist() == [0.0, math.inf]
    for cutter in (BALL, BULL):
        levels = cutter.levels()
        assert len(levels) == cutter.n_levels + 1 == CORNER_LEVELS + 2
        assert np.all(np.diff(levels) > 0.0)
        assert levels[CORNER_LEVELS] == pytest.approx(cutter.corner_radius_m)
        assert np.isinf(levels[-1])


@pytest.mark.parametrize("cutter", [BALL, BULL])
def test_level_radii_are_means_of_the_outline(cutter: Cutter) -> None:
    levels, radii = cutter.levels(), cutter.level_radii()
    for k in range(CORNER_LEVELS):
        mean = quad(cutter.radius_at, levels[k], levels[k + 1], epsabs=0.0)[0] / (levels[k + 1] - levels[k])
        assert radii[k] == pytest.approx(mean, rel=1e-7)
    assert radii[-1] == cutter.radius_m
    kappa = cutter.level_inclinations()
    assert np.all(np.diff(kappa) > 0.0)
    assert kappa[-1] == math.pi / 2.0


@pytest.mark.parametrize(
    "arguments",
    [
        {"diameter_m": 0.0},
        {"diameter_m": -0.01},
        {"diameter_m": math.nan},
        {"diameter_m": 16.0},
        {"diameter_m": 0.01, "corner_radius_m": 0.006},
        {"diameter_m": 0.01, "corner_radius_m": -0.001},
        {"diameter_m": 0.01, "flutes": 0},
        {"diameter_m": 0.01, "helix_rad": 1.6},
        {"diameter_m": 0.01, "flute_length_m": 0.0},
        {"diameter_m": 0.01, "runout_m": 0.02},
        {"diameter_m": 0.01, "runout_angle_rad": math.inf},
    ],
)
def test_impossible_cutters_are_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Cutter(**arguments)  # type: ignore[arg-type]


def test_heights_outside_the_cutter_are_refused() -> None:
    with pytest.raises(InputError):
        FLAT.radius_at(-1e-6)
