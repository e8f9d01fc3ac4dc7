"""The error of the path is recovered from a noisy scan; pure noise is no error, however it is correlated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.evaluate.path_error.conftest import Groove

from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.path_error.contacts import UNREST, nodes_of
from counterflex.evaluate.path_error.estimate import path_error
from counterflex.evaluate.path_error.learning import RESTLESS, expected, surface_now


def an_error(groove: Groove) -> np.ndarray:
    s = groove.nodes.station_m
    y = 150 * UM * np.exp(-s / (8.0 * MM)) - 90 * UM
    z = -60 * UM + 40 * UM * s / s[-1]
    return np.column_stack([0.0 * s, y, z])


@pytest.mark.parametrize("seed", [1, 2])
def test_error_is_recovered_through_noise_and_outliers(groove: Groove, seed: int) -> None:
    true = an_error(groove)
    scan = groove.scan(true, 20 * UM, seed)
    wild = np.random.default_rng(seed).random(len(scan)) < 0.01
    scan = replace(scan, deviation_m=np.where(wild, 1.0 * MM, scan.deviation_m))
    found = path_error(scan, groove.nodes, groove.contacts)
    assert found.believed.all()
    assert found.noise_m == pytest.approx(20 * UM, rel=0.1)
    inner = slice(10, -10)  # at the ends the floor is that of the neighbours
    off = (found.error_m - true)[inner, 1:]
    assert np.sqrt(np.mean(off**2)) < 5 * UM
    assert np.mean(np.abs(off) < 3.0 * found.sigma_m[inner, 1:]) > 0.95
    assert not found.seen[inner, 0].any()  # no face of a groove shows an error along it
    assert 0.004 < found.outliers < 0.02


@pytest.mark.parametrize("together", [False, True])
def test_noise_alone_is_no_error(groove: Groove, together: bool) -> None:
    scan = groove.scan(np.zeros((len(groove.nodes), 3)), 20 * UM, 3)
    if together:  # neighbours within a millimetre are off together
        cube = np.unique(np.floor(scan.points / MM + 1e-6).astype(int), axis=0, return_inverse=True)[1].reshape(-1)
        noise = 20 * UM * np.random.default_rng(7).standard_normal(int(cube.max()) + 1)
        scan = replace(scan, deviation_m=noise[cube])
    found = path_error(scan, groove.nodes, groove.contacts)
    assert np.max(np.abs(found.error_m)) < 5 * UM
    assert found.noise_m == pytest.approx(20 * UM, rel=0.1)


@pytest.mark.parametrize("seed", [8, 9])
def test_a_peak_where_the_force_ends_is_seen_by_nodes_that_expect_it(groove: Groove, seed: int) -> None:
    """A peak of 2 mm at the exit of an error that is even otherwise: less of it is taken for noise."""
    x = groove.path.p_part_tcp[:, 0]
    restless = nodes_of(groove.path, np.where(x < 50.0 * MM, 1.0, 0.0)[:, None] * np.array([0.0, 1.0, 0.0]))
    peak = 80 * UM * np.exp(-(((groove.nodes.station_m - 50.0 * MM) / (1.0 * MM)) ** 2))
    true = np.column_stack([0.0 * peak, 40 * UM + peak, 0.0 * peak - 30 * UM])
    scan = groove.scan(true, 20 * UM, seed)
    missed = []
    for nodes in (groove.nodes, restless):
        found = path_error(scan, nodes, groove.contacts)
        missed.append(float(np.max(np.abs(found.error_m - true)[10:-10, 1])))
    assert missed[1] < 0.6 * missed[0]


NOTHING = np.zeros((0, 1, 3))


def test_what_is_taken_back_is_gone_in_the_prediction_and_what_is_not_stays(groove: Groove) -> None:
    found = path_error(groove.scan(an_error(groove), 20 * UM, 4), groove.nodes, groove.contacts)
    nothing = expected(found, groove.contacts, np.zeros_like(found.error_m), NOTHING, 1 * UM)
    assert nothing.low_m <= nothing.now_m * 1.1
    assert nothing.high_m >= nothing.now_m * 0.9
    assert nothing.now_m == surface_now(found, groove.contacts)
    taken = expected(found, groove.contacts, -found.error_m, NOTHING, 1 * UM)
    assert taken.high_m < 0.6 * nothing.now_m
    assert taken.low_m < taken.median_m < taken.high_m


@pytest.mark.parametrize("scatter_um", [5.0, 20.0])
def test_nine_of_ten_parts_of_the_same_program_lie_in_the_interval(groove: Groove, scatter_um: float) -> None:
    """Nothing changes but by chance: each part is off as a whole and by runs of its own."""
    true, rng = 0.2 * an_error(groove), np.random.default_rng(11)
    found = path_error(groove.scan(true, 20 * UM, 6), groove.nodes, groove.contacts)
    predicted = expected(found, groove.contacts, np.zeros_like(true), NOTHING, scatter_um * UM)
    parts = [true + scatter_um * UM * rng.standard_normal(3) for _ in range(200)]
    figures = np.array([np.quantile(np.abs(groove.contacts.left_on(part)), 0.997) for part in parts])
    inside = float(np.mean((predicted.low_m <= figures) & (figures <= predicted.high_m)))
    assert 0.8 <= inside <= 0.98


def test_the_interval_of_a_program_that_does_not_change_is_wider_where_the_force_changes(groove: Groove) -> None:
    """Parts differ there by narrow errors; the interval covers their 99.7 %."""
    x = groove.path.p_part_tcp[:, 0]
    found = path_error(groove.scan(an_error(groove), 20 * UM, 6), groove.nodes, groove.contacts)
    nodes = nodes_of(groove.path, np.where(x < 50.0 * MM, 1.0, 0.0)[:, None] * np.array([0.0, 1.0, 0.0]))
    one, other = (
        expected(replace(found, nodes=n), groove.contacts, -found.error_m, NOTHING, 8 * UM)
        for n in (groove.nodes, nodes)
    )
    assert one.now_m == other.now_m
    sigma = RESTLESS * UNREST * 8 * UM
    assert other.high_m**2 > one.high_m**2 + sigma**2
    assert other.median_m > one.median_m
    none = expected(replace(found, nodes=nodes), groove.contacts, -found.error_m, NOTHING, 0.0)
    assert none.high_m < one.high_m


def test_a_scan_of_another_part_is_refused(groove: Groove) -> None:
    scan = groove.scan(np.zeros((len(groove.nodes), 3)), 20 * UM, 5)
    none = replace(groove.contacts, made=np.zeros(len(scan), dtype=np.bool_))
    with pytest.raises(InputError, match="too few places that this program made"):
        path_error(scan, groove.nodes, none)
