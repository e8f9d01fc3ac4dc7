"""A kernel that assigns to a slice refuses an array of another shape, as NumPy does."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba.np import arrayobj

from counterflex.core import compiled
from counterflex.core.arrays import Float


@numba.njit  # type: ignore[untyped-decorator]
def _assign(out: Float, values: Float) -> None:
    out[1:3] = values


def test_another_shape_is_refused_and_the_own_one_is_taken() -> None:
    out = np.zeros(4)
    _assign(out, np.ones(2))
    np.testing.assert_array_equal(out, [0.0, 1.0, 1.0, 0.0])
    with pytest.raises(ValueError, match="cannot assign slice"):
        _assign(out, np.ones(3))


def test_the_message_is_the_short_one_of_this_package() -> None:
    """Numba's own names both shapes; where it calls another function one day, the kernels compile long again."""
    assert arrayobj.raise_with_shape_context is compiled._wrong_size
    with pytest.raises(ValueError, match=r"different size$"):
        _assign(np.zeros(4), np.ones(3))
