"""Parts together: weights in closed form, what repeats told from what does not."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.core.units import UM
from counterflex.evaluate.path_error.repeated import MeasuredError, repeated

N = 200


def part(
    taken_um: float, error_um: float, sigma_um: float = 3.0, *, scatter: np.ndarray | None = None
) -> MeasuredError:
    error = np.full((N, 3), error_um * UM) + (0.0 if scatter is None else scatter)
    return MeasuredError(np.full((N, 3), taken_um * UM), error, np.full((N, 3), sigma_um * UM), np.ones((N, 3), bool))


def test_one_part_asks_for_what_it_took_and_what_it_left() -> None:
    assert repeated([part(20.0, 100.0)]).total_m[0, 0] == pytest.approx(120 * UM)


def test_a_later_part_nearer_to_its_target_says_more() -> None:
    first, second = part(0.0, 100.0), part(100.0, 20.0)
    w = np.array([1.0 / (3.0**2 + 10.0**2), 1.0 / (3.0**2 + 2.0**2)])
    both = repeated([first, second])
    assert both.total_m[0, 0] == pytest.approx((w @ [100.0, 120.0]) / w.sum() * UM, rel=1e-9)
    assert both.sigma_m[0, 0] == pytest.approx(UM / np.sqrt(w.sum()), rel=1e-9)
    assert np.isnan(both.between_m)  # no two parts of one program


def test_scatter_between_parts_of_one_program_is_found_beside_that_of_the_scans() -> None:
    rng = np.random.default_rng(1)
    parts = [part(0.0, 0.0, 3.0, scatter=UM * np.hypot(12.0, 3.0) * rng.standard_normal((N, 3))) for _ in range(4)]
    # four parts of 600 values: known to about 3 %
    assert repeated(parts).between_m == pytest.approx(12 * UM, rel=0.1)


def test_what_no_part_shows_stays_as_it_is() -> None:
    blind = MeasuredError(
        np.full((N, 3), 30 * UM), np.zeros((N, 3)), np.full((N, 3), 300 * UM), np.zeros((N, 3), dtype=np.bool_)
    )
    np.testing.assert_allclose(repeated([blind, blind]).total_m, 30 * UM)


def test_parts_of_other_programs_are_refused() -> None:
    few = np.zeros((5, 3))
    short = MeasuredError(few, few, few, np.ones((5, 3), dtype=np.bool_))
    with pytest.raises(InputError, match="different lengths"):
        repeated([part(0.0, 1.0), short])
    with pytest.raises(InputError, match="no part"):
        repeated([])
