"""Test cuts on the twin: what the sensor shows, what the zero takes out, and what identification makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, RPM
from counterflex.files.cell.cell import read_cell
from counterflex.identify.cutting.proposal import machine_settings
from counterflex.identify.cutting.recipe import RECIPE
from counterflex.identify.cutting.steady_cuts import pieces_of
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.twin.laboratory.laboratory import Measured, laboratory
from counterflex.twin.laboratory.slots import measure
from counterflex.twin.truth.truth import Truth

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d16_small.toml"


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return model_of(read_cell(CELL))


@pytest.fixture(scope="module")
def known() -> Truth:
    return truth_of(read_cell(CELL), None)


@pytest.fixture(scope="module")
def settings(cell: CellModel) -> dict[str, Any]:
    return {**machine_settings(cell, 1, cell.cutter_of(1)), "measure_depth": True}


def request(*cuts: tuple[float, float, float]) -> dict[str, Float]:
    """Straight cuts along x through the blank: y of the line, depth, feed (mm, mm, mm/s)."""
    y, depth, feed = np.array(cuts).T
    n = len(cuts)
    return {
        "blank": np.zeros(n),
        "cut": np.arange(float(n)),
        "start_x_m": np.full(n, -38.0 * MM),
        "start_y_m": y * MM,
        "start_z_m": (40.0 - depth) * MM,
        "end_x_m": np.full(n, 85.0 * MM),
        "end_y_m": y * MM,
        "end_z_m": (40.0 - depth) * MM,
        "feed_m_s": feed * MM,
        "spindle_rad_s": np.full(n, 13000.0 * RPM),
        "width_m": np.full(n, 16.0 * MM),
    }


def taken(truth: Truth, columns: Mapping[str, Float], settings: Mapping[str, Any], seed: int = 0) -> Measured:
    return measure(truth, laboratory(seed), columns, settings)


@pytest.fixture(scope="module")
def one(known: Truth, settings: dict[str, Any]) -> Measured:
    return taken(known, request((20.0, 3.0, 25.0)), settings)


def test_sensor_shows_the_weight_in_air_and_the_cut_beside_it(one: Measured, known: Truth) -> None:
    f, depth = one.channels["f_tcp_base"], one.channels["depth"]
    air = f[depth == 0.0]
    weight = 9.80665 * known.bodies[-1].mass_kg
    assert -np.median(air[:, 2]) == pytest.approx(weight, abs=80.0)  # zero of the sensor: 20 N, drift 2 N
    settled = f[(depth > 0.0)][60:90] - np.median(air, axis=0)
    assert np.all(np.abs(settled.mean(axis=0)[:2]) > 20.0)
    assert depth.max() == pytest.approx(3.0 * MM)


def test_same_seed_same_record_other_session_other_noise(known: Truth, one: Measured, settings: dict[str, Any]) -> None:
    again = taken(known, request((20.0, 3.0, 25.0)), settings)
    np.testing.assert_array_equal(again.channels["f_tcp_base"], one.channels["f_tcp_base"])
    other = measure(known, replace(laboratory(0), session="b"), request((20.0, 3.0, 25.0)), settings)
    assert not np.array_equal(other.channels["f_tcp_base"], one.channels["f_tcp_base"])


def test_zero_is_found_whatever_the_bias(
    known: Truth, one: Measured, settings: dict[str, Any], cell: CellModel
) -> None:
    other = taken(known, request((20.0, 3.0, 25.0)), settings, seed=5)
    forces = [
        pieces_of(cell, [of_arrays("c", "slots", dict(m.channels), dict(m.sigma), group=m.group)]).pieces.force
        for m in (one, other)
    ]
    assert forces[0].shape == (1, 3)
    np.testing.assert_allclose(forces[0], forces[1], atol=1.5)


def test_tool_gives_way_and_the_gauge_says_so(one: Measured, settings: dict[str, Any], known: Truth) -> None:
    stiff = replace(known, bodies=tuple(replace(b, compliance=1e-3 * b.compliance) for b in known.bodies))
    rigid = taken(stiff, request((20.0, 3.0, 25.0)), settings)

    def floor(m: Measured) -> float:
        return float(np.median(m.channels["depth_measured"][m.channels["depth"] > 0.0]))

    assert floor(rigid) == pytest.approx(3.0 * MM, abs=0.05 * MM)
    assert abs(floor(one) - 3.0 * MM) > 0.02 * MM


def test_a_higher_blank_is_cut_deeper(known: Truth, one: Measured, settings: dict[str, Any]) -> None:
    higher = taken(replace(known, stock_top_offset_m=0.3 * MM), request((20.0, 3.0, 25.0)), settings)
    deeper = higher.channels["depth_measured"] - one.channels["depth_measured"]
    assert float(np.median(deeper[one.channels["depth"] > 0.0])) == pytest.approx(0.3 * MM, abs=0.06 * MM)
    assert (
        "depth_measured" not in taken(known, request((20.0, 3.0, 25.0)), {**settings, "measure_depth": False}).channels
    )


@pytest.mark.long
def test_identified_law_predicts_cuts_of_another_proposal(cell: CellModel) -> None:
    truth = truth_of(read_cell(CELL), 4)  # force constants about 10 % off, ploughing and runout that the law lacks
    data = []
    for count, seed in ((8, 4), (3, 1004)):
        proposal = RECIPE.propose(cell, count, {"seed": seed})
        m = measure(truth, laboratory(4), proposal.columns, proposal.settings)
        data.append(of_arrays(str(seed), "slots", dict(m.channels), dict(m.sigma), group=m.group))
    found = RECIPE.identify(cell, data[:1], data[1:], {}, lambda fraction, what="": None)  # noqa: ARG005
    head = found.headline[0]
    assert head.nominal is not None
    assert head.value < 5.0 < head.nominal


def test_requests_that_cannot_be_milled(known: Truth, settings: dict[str, Any]) -> None:
    columns = request((20.0, 3.0, 25.0))
    with pytest.raises(InputError, match="lacks a column"):
        taken(known, {k: v for k, v in columns.items() if k != "width_m"}, settings)
    with pytest.raises(InputError, match="no length or no feed"):
        taken(known, {**columns, "feed_m_s": np.zeros(1)}, settings)
    with pytest.raises(InputError, match="lack a value"):
        taken(known, columns, {k: v for k, v in settings.items() if k != "opw_m"})
    with pytest.raises(InputError, match="never come near"):
        taken(known, {**columns, "start_z_m": np.full(1, 0.2), "end_z_m": np.full(1, 0.2)}, settings)
