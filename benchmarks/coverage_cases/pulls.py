"""Stiffness from pulls: the simulated arm at rest, and what its springs, cable and tracker do beside the model."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.units import UM, URAD
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.compliances import DIRECTIONS
from counterflex.identify.recipe import Proposal
from counterflex.identify.stiffness import recipe as stiffness
from counterflex.robot.elasticity.compliance import cartesian_compliance, element_jacobians
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.pulls import measure
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.perturb import perturbed
from counterflex.twin.truth.truth import CuttingTruth, Truth
from coverage_cases.counted import Counted, counted
from known_drives import cell_with_drives

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d16_flat.toml"
PULLS = 60
CROSS = 0.1
"""Coupling of two directions of an element, of the root of the product of their compliances, one standard deviation."""
CABLE_RAD = 0.01
"""Direction of the cable, one standard deviation per axis and pull."""
STUCK = 0.3
"""Share of what dry friction can hold that stays in a reading, at most."""
DRIFT_M, DRIFT_RAD = 8.0 * UM, 5.0 * URAD
"""Drift of the tracker between the two readings of a pull, one standard deviation."""
FLOOR_RAD_NM = 2e-9
"""Tilting of the foundation, which the cell file has no element for, one standard deviation."""


@cache
def cell() -> CellModel:
    return model_of(cell_with_drives(CELL))


@cache
def proposal() -> Proposal:
    return stiffness.propose(cell(), PULLS, {"seed": 0})


def truth_of(seed: int) -> Truth:
    own = cell()
    cutting = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.25, 0.25))
    return perturbed(nominal_truth(own.nominal_robot, own.nominal_end_effector, cutting), seed)


def compliances_of(truth: Truth) -> dict[str, float]:
    """True compliances by name of the parameter."""
    return {f"{b.name}.{d}": float(c) for b in truth.bodies for d, c in zip(DIRECTIONS, b.compliance, strict=True)}


def unmodelled(seed: int, q: Float, w: Float) -> Float:
    """(n, 6) m, rad: displacement of the tool that the springs of the model do not have."""
    rng = np.random.default_rng([11, seed])
    chain, n = cell().chain, len(q)
    J = element_jacobians(chain, q)
    out = np.zeros((n, 6))
    for i in range(chain.n):
        c = np.sqrt(chain.compliance[i])
        mixed = np.triu(CROSS * rng.standard_normal((6, 6)) * np.outer(c, c), 1)
        out += np.einsum("nab,bc,ndc,nd->na", J[:, i], mixed + mixed.T, J[:, i], w)
    first = J[:, 0]
    tilting = np.array([0, 0, 0, 1.0, 1.0, 0]) * FLOOR_RAD_NM * np.abs(rng.standard_normal(6))
    out += np.einsum("nab,b,ndb,nd->na", first, tilting, first, w)
    for axis, entry in enumerate(chain.play or ()):
        if entry is not None:
            soft = chain.compliance[chain.torsion[axis], 5]
            held = STUCK * soft * sum(entry.friction_nm) * rng.uniform(-1.0, 1.0, n)
            out += J[:, chain.torsion[axis], :, 5] * held[:, None]
    drift = np.repeat([DRIFT_M, DRIFT_RAD], 3)
    return out + drift * rng.standard_normal((n, 6))


def stiffness_of_pulls(seed: int, *, errors: bool) -> list[Counted]:
    """One campaign of pulls, identified."""
    truth, lab = truth_of(seed), laboratory(seed)
    m = measure(truth, lab, proposal().columns, {"history": "relaxed", "axes": "base"})
    channels = dict(m.channels)
    if errors:
        force = channels["f_tcp_base"]
        turned = CABLE_RAD * np.random.default_rng([12, seed]).standard_normal(force.shape)
        chain, q = cell().chain, channels["q"]
        w = np.hstack([force, np.zeros_like(force)])
        aside = np.hstack([np.cross(turned, force), np.zeros_like(force)])
        channels["d_tcp_base"] = (
            channels["d_tcp_base"]
            + unmodelled(seed, q, w)
            + np.einsum("nab,nb->na", cartesian_compliance(chain, q), aside)
        )
    data = of_arrays("pulls", "pulls", channels, m.sigma, group=m.group, settings=m.settings)
    found = stiffness.RECIPE.identify(cell(), [data], [], {"regions": False, "folds": 2, "as_stated": True})
    return counted(found.fits["stiffness"], compliances_of(truth))
