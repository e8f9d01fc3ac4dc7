"""Kinematics from tracker poses: the simulated arm at rest under its weight, and what drives and tracker add."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.units import UM, URAD
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.compliances import bearing_of
from counterflex.identify.geometry.considered_sag import with_honest_sigma
from counterflex.identify.kinematics import recipe as kinematics
from counterflex.identify.kinematics.setup import propose, set_up
from counterflex.identify.kinematics.stages import model_of_data, priors_of
from counterflex.identify.solver.solve import solve
from counterflex.twin.laboratory.laboratory import Laboratory, laboratory
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.truth import Truth
from coverage_cases.counted import Counted, counted

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d10_ball.toml"
POSES = 60
PERIODIC_RAD = 15.0 * URAD
"""Periodic errors of each drive, one standard deviation of sine and cosine of each order."""
ORDERS = (1, 2, 80)
LOST = 0.5
"""Share of play and friction by which an axis rests beside its angle, at most."""
WALK_M, WALK_RAD = 3.0 * UM, 3.0 * URAD
"""Drift of the tracker from pose to pose."""


@cache
def cell_file() -> Cell:
    return read_cell(CELL)


@cache
def cell() -> CellModel:
    return model_of(cell_file())


@cache
def angles(count: int = POSES) -> Float:
    columns = propose(cell(), count, {"seed": 0}).columns
    out: Float = np.stack([columns[f"q{i + 1}_rad"] for i in range(6)], axis=1)
    return out


def resting(seed: int, q: Float) -> Float:
    """(n, 6) rad: where the axes stand beside what is shown, by periodic errors, play and friction."""
    rng = np.random.default_rng([21, seed])
    out = np.zeros_like(q)
    for order in ORDERS:
        sine, cosine = PERIODIC_RAD * rng.standard_normal((2, 6))
        out += sine * np.sin(order * q) + cosine * np.cos(order * q)
    chain = cell().chain
    for axis, entry in enumerate(chain.play or ()):
        if entry is not None:
            most = entry.half_band_rad + chain.compliance[chain.torsion[axis], 5] * sum(entry.friction_nm)
            out[:, axis] += LOST * most * rng.uniform(-1.0, 1.0, len(q))
    return out


def seen(truth: Truth, lab: Laboratory, q: Float, *, errors: bool) -> Dataset:
    """Tracker poses of the arm at rest."""
    plant = Plant(truth, friction=False)
    at = q + resting(lab.seed, q) if errors else q
    rng = np.random.default_rng([22, lab.seed])
    ends = np.array([plant.equilibrium(row) for row in at])
    n = len(q)
    walk = np.cumsum(np.repeat([WALK_M, WALK_RAD], 3) * rng.standard_normal((n, 6)), axis=0) * errors
    T = pose.inverse(lab.T_base_tracker @ pose.make(rotation.exp(walk[:, 3:]), walk[:, :3])) @ ends @ lab.T_tcp_target
    noise = np.repeat([lab.tracker_m, lab.tracker_rad], 3) * rng.standard_normal((n, 6))
    arrays = {
        "q": q,
        "p_tracker_target": T[:, :3, 3] + noise[:, :3],
        "R_tracker_target": rotation.exp(noise[:, 3:]) @ T[:, :3, :3],
    }
    sigma: dict[str, float | Float] = {"p_tracker_target": lab.tracker_m, "R_tracker_target": lab.tracker_rad}
    return of_arrays("poses", "tracker_poses", arrays, sigma)


def displacements_of(truth: Truth) -> dict[str, float]:
    """True displacements behind the driven axes; those of a body that is not driven count with them."""
    nominal = (*cell().nominal_robot.segments, *cell().nominal_end_effector.segments)
    out: dict[str, float] = {}
    before, T, T0 = "", np.eye(4), np.eye(4)
    for body, known in zip(truth.bodies, nominal, strict=True):
        T, T0 = T @ body.T_prev_seg, T0 @ known.T_prev_seg
        if body.joint is None:
            continue
        if before:
            shift = pose.transform(T @ pose.inverse(T0), np.zeros(3))
            out |= {f"{before}.d{c}": float(v) for c, v in zip("xyz", shift, strict=True)}
            out |= {f"{before}.dr{c}": 0.0 for c in "xy"}
        out[f"{body.name}.drz"] = body.offset_rad - known.offset_rad
        before, T, T0 = body.name, np.eye(4), np.eye(4)
    return out


def kinematics_of_poses(seed: int, *, errors: bool) -> list[Counted]:
    """One campaign of poses, identified."""
    truth, lab, own = truth_of(cell_file(), seed), laboratory(seed), cell()
    data = seen(truth, lab, angles(), errors=errors)
    options = kinematics.RECIPE.settings
    model = model_of_data(own, [data], priors_of(options), "masses", tied=False)
    setup = set_up(own, model, [data])
    fit = solve(setup.parameters, setup.blocks)
    fit = with_honest_sigma(fit, setup.blocks, float(options["compliance_sigma"]), bearing_of(options))
    return [c for c in counted(fit, displacements_of(truth)) if fit.seen[fit.parameters.index(c.name)] == "determined"]
