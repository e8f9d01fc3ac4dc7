"""A simulated controller's own compensation of play: half of it, in the direction of the commanded motion."""

from __future__ import annotations

import numpy as np

from counterflex.core.units import URAD
from counterflex.twin.devices.commanded_motion import OwnBacklash

HALF = np.array([20.0, 20.0, 20.0, 50.0, 50.0, 0.0]) * URAD


def test_it_follows_the_direction_and_stays_where_nothing_moves() -> None:
    own, q = OwnBacklash(HALF, 4e-3), np.zeros(6)
    for _ in range(50):
        q = q + 1e-5
        up = own(q).copy()
    for _ in range(50):
        rest = own(q).copy()
    for _ in range(50):
        q = q - 1e-5
        down = own(q).copy()
    np.testing.assert_allclose(up, HALF, atol=1e-12)
    np.testing.assert_array_equal(rest, up)
    np.testing.assert_allclose(down, -HALF, atol=1e-12)


def test_it_is_taken_up_without_a_jump() -> None:
    own, q, last = OwnBacklash(HALF, 4e-3), np.zeros(6), np.zeros(6)
    for k in range(100):
        q = q + 1e-5 * np.sign(np.sin(0.3 * k))
        value = own(q).copy()
        assert np.all(np.abs(value - last) <= HALF / 5.0 + 1e-15)
        last = value
