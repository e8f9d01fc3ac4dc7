"""The cause that made the deviations is the likeliest; what the data cannot tell apart is not told apart."""

from __future__ import annotations

import numpy as np
import pytest
from tests.evaluate.path_error.conftest import Groove

from counterflex.core.units import MM, UM
from counterflex.evaluate.path_error.band_solver import Observations
from counterflex.evaluate.path_error.estimate import path_error
from counterflex.evaluate.path_error.explanations import ALIKE, NOTHING, ErrorCause, explanations

DEFLECTION_M = 500 * UM


def causes(groove: Groove) -> list[ErrorCause]:
    """A force that is not even along the groove, a stiffness that says the same, and an offset."""
    s = groove.nodes.station_m / groove.nodes.station_m[-1]
    size = DEFLECTION_M * (0.4 + np.where(s > 0.5, 0.9, 0.0))
    bent = np.column_stack([0.0 * s, size, -0.4 * size])
    return [
        ErrorCause("force", ("force, relative",), bent[None], np.array([0.3])),
        ErrorCause("stiffness", ("compliance, relative",), bent[None] * 1.0001, np.array([0.3])),
        ErrorCause("offset", ("y, m", "z, m"), np.tile(np.eye(3)[1:, None], (1, len(s), 1)), np.full(2, 100 * UM)),
    ]


@pytest.mark.parametrize(("cause", "value", "lead"), [(0, [0.25], ALIKE), (2, [130 * UM, -70 * UM], 1.0)])
def test_the_cause_behind_the_data_is_the_likeliest(
    groove: Groove, cause: int, value: list[float], lead: float
) -> None:
    known = causes(groove)
    true = np.tensordot(np.array(value), known[cause].pattern, axes=1)
    found = path_error(groove.scan(true, 20 * UM, 11), groove.nodes, groove.contacts)
    weighed = explanations(found.observed, groove.nodes, found.prior, DEFLECTION_M, known, [("force", "offset")])
    by_name = {one.name: one for one in weighed}
    right = by_name[known[cause].name]
    other = by_name["offset" if cause == 0 else "force"]
    # an even offset is also what a smooth rest without a cause is like
    assert right.log_evidence > max(other.log_evidence, by_name[NOTHING].log_evidence) + lead
    assert np.all(np.abs(right.value - value) < 3.0 * right.sigma)
    assert right.explained > 0.8
    # force and stiffness have one pattern: no data tell them apart
    assert by_name["force"].log_evidence == pytest.approx(by_name["stiffness"].log_evidence, abs=0.2)


def test_two_causes_of_one_pattern_are_correlated(groove: Groove) -> None:
    known = causes(groove)
    scan = groove.scan(0.2 * known[0].pattern[0], 20 * UM, 12)
    found = path_error(scan, groove.nodes, groove.contacts)
    seen: Observations = found.observed
    both = explanations(seen, groove.nodes, found.prior, DEFLECTION_M, known, [("force", "stiffness")])
    pair = next(one for one in both if one.name == "force + stiffness")
    assert pair.correlation[0, 1] < -0.9
    assert pair.value.sum() == pytest.approx(0.2, abs=0.03)
    assert np.all(pair.sigma > 0.1)  # each by itself stays as open as it was


def test_nothing_is_explained_in_a_part_that_is_right(groove: Groove) -> None:
    found = path_error(groove.scan(np.zeros((len(groove.nodes), 3)), 20 * UM, 13), groove.nodes, groove.contacts)
    weighed = explanations(found.observed, groove.nodes, found.prior, DEFLECTION_M, causes(groove), [])
    assert weighed[0].name == NOTHING or weighed[0].log_evidence < ALIKE
    assert all(np.all(np.abs(one.value) < 3.0 * one.sigma + 5 * UM) for one in weighed)
    assert pytest.approx(groove.nodes.station_m[-1]) == 60 * MM
