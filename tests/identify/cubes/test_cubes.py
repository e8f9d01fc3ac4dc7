"""Measuring cubes: relative motion, recovery on the simulated structure, splitting of sums, wrong data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.geometry import pose, rotation
from counterflex.identify.counted_coverage import COUNTED
from counterflex.identify.cubes import recipe as cubes
from counterflex.identify.cubes.pairs import block, read_cubes
from counterflex.identify.cubes.recipe import pairs_of
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.compliances import DIRECTIONS, springs
from counterflex.identify.pulls.blocks import layout
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.elasticity.compliance import shares
from counterflex.twin.laboratory.cubes import measure
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.perturb import perturbed
from counterflex.twin.truth.truth import CuttingTruth, Truth
from derivative_check import convergence_order
from known_drives import cell_with_drives

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return model_of(cell_with_drives(EXAMPLES / "cells" / "kr300_d16_flat.toml"))


def truth_of(cell: CellModel, seed: int) -> Truth:
    cutting = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.25, 0.25))
    return perturbed(nominal_truth(cell.nominal_robot, cell.nominal_end_effector, cutting), seed)


@pytest.fixture(scope="module")
def measured(cell: CellModel) -> tuple[Truth, Dataset]:
    truth = truth_of(cell, 0)
    proposal = cubes.propose(cell, 16, {"seed": 1})
    m = measure(truth, laboratory(0), proposal.columns, {**proposal.settings, "history": "relaxed"})
    return truth, of_arrays("cubes", "cubes", m.channels, m.sigma, group=m.group, settings=m.settings)


def test_a_rigid_motion_of_both_cubes_is_no_relative_motion(cell: CellModel) -> None:
    rng = np.random.default_rng(0)
    n = 12
    before, after = rng.uniform(-1.0, 1.0, (n, 3)), rng.uniform(-1.0, 1.0, (n, 3))
    move = pose.make(rotation.exp(2e-3 * rng.standard_normal((n, 3))), 1e-3 * rng.standard_normal((n, 3)))

    def motion(p: Float) -> Float:
        return pose.difference(pose.make(p=p), move @ pose.make(p=p))

    data = of_arrays(
        "rigid",
        "cubes",
        {
            "q": np.tile([0.1, -1.2, 1.5, 0.2, 0.9, 0.3], (n, 1)),
            "w_tcp_base": rng.standard_normal((n, 6)),
            "pair": np.ones((n, 1)),
            "p_base_before": before,
            "p_base_after": after,
            "d_before_base": motion(before),
            "d_after_base": motion(after),
        },
        {"d_before_base": 1e-6, "d_after_base": 1e-6},
        settings={"pairs": ["axis1/axis2"]},
    )
    assert np.max(np.abs(read_cubes(cell.chain, data).pulls.d)) < 1e-15
    assert read_cubes(cell.chain, data).pulls.d_sigma[0, 0] > 1e-6


def test_all_pairs_together_make_the_deflection_of_the_tool(cell: CellModel) -> None:
    """Relative motions of neighbouring bodies, taken at the tool, are the shares of the segments."""
    chain = cell.chain
    pairs = pairs_of(chain)
    assert pairs[0] == "base/axis1"
    assert len(pairs) == 10
    q, w = np.array([0.3, -1.3, 1.6, 0.4, 0.8, 0.5]), np.array([300.0, -500.0, 200.0, 30.0, 10.0, -40.0])
    k = len(pairs)
    tip = np.tile(forward(chain, q)[:3, 3], (k, 1))
    data = of_arrays(
        "shares",
        "cubes",
        {
            "q": np.tile(q, (k, 1)),
            "w_tcp_base": np.tile(w, (k, 1)),
            "pair": np.arange(1.0, k + 1.0)[:, None],
            "p_base_before": tip,
            "p_base_after": tip,
            "d_before_base": np.zeros((k, 6)),
            "d_after_base": np.zeros((k, 6)),
        },
        {"d_before_base": 1e-6, "d_after_base": 1e-6},
        settings={"pairs": list(pairs)},
    )
    plan = layout(chain, springs(chain, {}), [])
    own = block(chain, plan, read_cubes(chain, data))
    known = shares(chain, q, w)
    named = [chain.names.index(p.split("/")[1]) for p in pairs]
    np.testing.assert_allclose(own.predicted(plan.parameters.nominal), known[named], rtol=1e-9, atol=1e-15)


def test_compliances_of_the_simulated_structure_are_found(cell: CellModel, measured: tuple[Truth, Dataset]) -> None:
    truth, data = measured
    result = cubes.RECIPE.identify(cell, [data], [], {})
    fit = result.fits["cubes"]
    true = {b.name: b.compliance for b in truth.bodies}
    off, size = [], []
    for k, item in enumerate(fit.parameters):
        name, letter = item.name.split(".")
        if letter == "half_band" or fit.seen[k] != "determined":
            continue
        wanted = true[name][DIRECTIONS.index(letter)]
        off.append((fit.values[k] - wanted) / fit.sigma[k])
        size.append(abs(fit.values[k] / wanted - 1.0))
    assert len(off) >= 20
    assert np.median(size) < 0.03
    assert np.mean(np.abs(off) < 2.0) > 0.8
    assert result.headline[0].nominal is not None
    assert result.headline[0].value < 0.85 * result.headline[0].nominal


def test_jacobian_is_the_derivative(cell: CellModel, measured: tuple[Truth, Dataset]) -> None:
    motions = read_cubes(cell.chain, measured[1].rows(np.arange(len(measured[1])) < 20))
    plan = layout(cell.chain, springs(cell.chain, {}), [motions.pulls])
    own = block(cell.chain, plan, motions)
    x = plan.parameters.nominal * 1.2
    assert np.min(convergence_order(own, x, 0.1 * np.abs(x))) > 1.9


def test_a_sum_is_split_by_the_known_sensor(cell: CellModel) -> None:
    """One pair spans axis 6 and the sensor: only their sum is seen; the data sheet of the sensor splits it."""
    truth = truth_of(cell, 2)
    sensor = next(b for b in truth.bodies if b.name == "sensor")
    proposal = cubes.propose(cell, 10, {"seed": 2})
    settings = {"pairs": ["axis5/sensor"], "history": "relaxed"}
    m = measure(truth, laboratory(2), proposal.columns, settings)
    data = of_arrays("hand", "cubes", m.channels, m.sigma, group=m.group, settings=m.settings)
    exact = np.where(sensor.compliance > 0.0, sensor.compliance, 0.0)
    hand = tuple(replace(s, compliance=exact) if s.name == "sensor" else s for s in cell.end_effector.segments)
    known = replace(cell, end_effector=replace(cell.end_effector, segments=hand))
    result = cubes.RECIPE.identify(known, [data], [], {"known": "sensor", "known_prior": 0.02})
    fit = result.fits["cubes"]
    wanted = next(b for b in truth.bodies if b.name == "axis6").compliance
    for place, letter in ((3, "rx"), (4, "ry")):
        assert fit.value(f"axis6.{letter}") == pytest.approx(wanted[place], rel=0.08)
    assert any("axis6 and sensor" in r and "sum" in r for r in result.remarks)
    assert any("No pair of cubes spans" in r and "axis1" in r for r in result.remarks)
    assert COUNTED["cubes"].text in result.remarks


@pytest.mark.long
def test_wrong_data_are_named(cell: CellModel, measured: tuple[Truth, Dataset]) -> None:
    data = measured[1].rows(np.arange(len(measured[1])) < 30)
    turned = replace(data.channel("w_tcp_base"), values=-data.values("w_tcp_base"))
    with pytest.raises(CounterflexError, match="sign"):
        cubes.RECIPE.identify(cell, [replace(data, channels={**data.channels, "w_tcp_base": turned})], [], {})
    with pytest.raises(FileFormatError, match="names the body before"):
        cubes.RECIPE.identify(cell, [replace(data, settings={**data.settings, "pairs": ["axis2/axis1"] * 10})], [], {})
    with pytest.raises(FileFormatError, match="does not name"):
        cubes.RECIPE.identify(cell, [replace(data, settings={**data.settings, "pairs": ["base/axis1"]})], [], {})
