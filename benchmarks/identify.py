"""Identification: how long the solver takes for large campaigns, against scipy with finite differences in the same run.

*Stiffness*: 2000 pulls of 750 N with 60 compliances of the example cell free. *Kinematics*: 1500 six-component tracker
poses with the geometry, masses and frames of the same cell. Both have truths drawn from the priors, noise as stated and
5 % gross errors, and start at nominal. The finite differences solve the same weighted problem (with the weights found,
so without rounds of weighing) by ``scipy.optimize.least_squares`` with the same tolerance. The bound is the time of one
dense QR of the weighted Jacobian: no solver that looks at the data once needs less. Goals are judged by wall time;
ratios, and what takes part in them, are of processor time.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/identify.py``; ``--quick`` takes a tenth of the rows, ``--json`` prints
one JSON object. For matrices of this size more threads gain nothing, and on a busy machine they wait for one another.
Goals: stiffness within 5 s, kinematics within 10 s on two cores.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM, URAD
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.geometry.arm_parameters import ArmPriors, arm_model
from counterflex.identify.geometry.compliances import springs
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals, frame_parameters
from counterflex.identify.pulls.residuals import COMPONENTS, PullResiduals, gains
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import cross_validate
from counterflex.identify.solver.intervals import intervals
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import Stop, solve

CELL = Path(__file__).resolve().parents[1] / "examples" / "cells" / "kr300_d16_flat.toml"
SPRINGS = 60
PULLS = 2000
POSES = 1500
GROSS = 0.05
GOALS_S = {"stiffness": 5.0, "kinematics": 10.0}


def timed(job: Callable[[], Any]) -> tuple[float, float, Any]:
    """Wall and processor seconds of a job, and its result."""
    wall, cpu = time.perf_counter(), time.process_time()
    out = job()
    return time.perf_counter() - wall, time.process_time() - cpu, out


def drawn(parameters: Parameters, rng: np.random.Generator) -> Float:
    """Values from the priors."""
    u = rng.standard_normal(len(parameters)) * parameters.free
    lower, upper = parameters.bounds()
    return parameters.values(np.clip(u, lower, upper))


def stiffness(cell: CellModel, rows: int, rng: np.random.Generator) -> tuple[Parameters, Residuals, Float]:
    """Pulls at the tool tip in random directions: parameters, measurements, truth."""
    chain = cell.chain
    every = springs(chain, {"prior": 0.5, "free": "all"}).parameters
    held = [p.name for p in every if p.free][SPRINGS:]
    kept = springs(chain, {"prior": 0.5, "free": "all", "held": " ".join(held)})
    q = measurable(cell, rows, rng)
    w = np.hstack([rng.standard_normal((rows, 3)), np.zeros((rows, 3))])
    w *= 750.0 / np.linalg.norm(w, axis=1, keepdims=True)
    block = PullResiduals(
        name="pulls",
        group=np.arange(rows, dtype=np.int64),
        components=COMPONENTS,
        sigma=np.tile([20.0 * UM] * 3 + [40.0 * URAD] * 3, (rows, 1)),
        measured=np.zeros((rows, 6)),
        gain=gains(chain, kept, q, w, np.zeros(3)),
        columns=np.arange(len(kept), dtype=np.int64),
        offset=np.zeros((rows, 6)),
        band_gain=np.zeros((rows, 6, 6)),
        band_columns=np.full(6, -1, dtype=np.int64),
    )
    truth = drawn(kept.parameters, rng)
    noise = rng.standard_normal((rows, 6))
    noise[rng.random(rows) < GROSS] *= 500.0
    return kept.parameters, replace(block, measured=block.predicted(truth) + block.sigma * noise), truth


def kinematics(cell: CellModel, rows: int, rng: np.random.Generator) -> tuple[Parameters, Residuals, Float]:
    """Poses of a tracker target; the frames of tracker and target are unknown: parameters, measurements, truth."""
    model = arm_model(cell, ArmPriors(), sag="masses")
    frames = [*frame_parameters("T_base_tracker", "tracker"), *frame_parameters("T_tcp_target", "target")]
    names = [p.name for p in frames]
    parameters = model.parameters + Parameters.of(frames)
    first = len(model.parameters)
    q = measurable(cell, rows, rng)
    block = TrackerResiduals(
        "tracker poses",
        np.arange(rows, dtype=np.int64),
        np.tile([20.0 * UM] * 3 + [40.0 * URAD] * 3, (rows, 1)),
        model.at(q),
        PlacedFrame(pose.make(rotation.about_z(np.pi), np.array([4.5, 0.5, 1.2])), np.arange(first, first + 6)),
        PlacedFrame(pose.make(p=np.array([0.0, 0.0, 50.0 * MM])), np.arange(first + 6, first + 12)),
        np.zeros((rows, 3)),
        np.broadcast_to(np.eye(3), (rows, 3, 3)),
    )
    known = drawn(parameters.with_fixed(names), rng)
    truth = np.where(np.arange(len(known)) < first, known, 0.05 * rng.standard_normal(len(known)))
    T = block.predicted(truth)
    noise = rng.standard_normal((rows, 6)) * block.sigma
    noise[rng.random(rows) < GROSS] *= 500.0
    measured = replace(block, p=T[:, :3, 3] + noise[:, :3], R=rotation.exp(noise[:, 3:]) @ T[:, :3, :3])
    return parameters, measured, truth


def finite_differences(parameters: Parameters, block: Residuals, fit: Fit, tolerance: float) -> Float:
    """The same weighted problem from nominal, derivatives by differences: the values found (p,)."""
    free = fit.free_index
    full = parameters.coordinates(parameters.nominal)
    known = np.array([parameters.items[i].has_prior for i in free])
    root = np.sqrt(fit.weights[0])[:, None] / fit.sigma_factors[0]

    def cost(u: Float) -> Float:
        full[free] = u
        return np.concatenate([(block.evaluate(parameters.values(full)) * root).reshape(-1), u[known]])

    lower, upper = parameters.bounds()
    # On a bound SciPy's method stops where it stands: rigid directions start half a prior standard deviation inside.
    inside = np.where(lower[free] == 0.0, 0.5, 0.0)
    result = least_squares(
        cost,
        inside,
        bounds=(lower[free], upper[free]),
        x_scale=1.0,
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
    )
    full[free] = result.x
    return parameters.values(full)


def measured(name: str, parameters: Parameters, block: Residuals, truth: Float, *, held_out: bool) -> dict[str, Any]:
    """Figures of one problem."""
    block.evaluate(truth), block.jacobian(truth)  # compiled kernels at hand
    wall, cpu, fit = timed(lambda: solve(parameters, [block]))
    free = fit.free_index
    J = (block.jacobian(fit.values)[:, :, free] * parameters.slope(fit.values)[free]).reshape(-1, len(free))
    bound = min(timed(lambda: qr(J, mode="r", check_finite=False))[1] for _ in range(5))
    evaluate = min(timed(lambda: block.evaluate(truth))[1] for _ in range(3))
    differentiate = min(timed(lambda: block.jacobian(truth))[1] for _ in range(3))
    fd_wall, fd_cpu, x = timed(lambda: finite_differences(parameters, block, fit, Stop().tolerance))
    ends = intervals(fit)
    inside = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
    out = {
        "case": name,
        "rows": len(block.group),
        "numbers": int(block.sigma.size),
        "parameters": len(free),
        "wall_s": round(wall, 3),
        "cpu_s": round(cpu, 3),
        "goal_s": GOALS_S[name],
        "evaluations": fit.evaluations,
        "one_evaluation_s": round(evaluate, 4),
        "one_jacobian_s": round(differentiate, 4),
        "qr_s": round(bound, 4),
        "times_qr": round(cpu / bound, 1),
        "differences_wall_s": round(fd_wall, 3),
        "differences_cpu_s": round(fd_cpu, 3),
        "faster": round(fd_cpu / cpu, 1),
        "apart_sigma": float(np.max(np.abs(x - fit.values)[free] / fit.sigma[free])),
        "outliers": len(fit.outliers),
        "inside_95": round(float(np.mean(inside[free])), 3),
    }
    if held_out:
        _, fold_cpu, _ = timed(lambda: cross_validate(parameters, [block], start=fit.values))
        out["five_folds_cpu_s"] = round(fold_cpu, 3)
    return out


def run(share: float) -> dict[str, Any]:
    """Both problems."""
    cell = model_of(read_cell(CELL))
    rng = np.random.default_rng(0)
    rows = []
    for name, problem, count in (("stiffness", stiffness, PULLS), ("kinematics", kinematics, POSES)):
        parameters, block, truth = problem(cell, round(share * count), rng)
        rows.append(measured(name, parameters, block, truth, held_out=share == 1.0))
    return {"share": share, "cases": rows, "within_goals": all(r["wall_s"] <= r["goal_s"] for r in rows)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the rows, for a smoke run")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    result = run(0.1 if options.quick else 1.0)
    if options.json:
        print(json.dumps(result))
        return 0
    head = ("case", "rows", "par.", "wall s", "CPU s", "goal s", "QR s", "x QR", "diff. CPU", "faster", "inside 95 %")
    print("{:12}{:>6}{:>6}{:>9}{:>9}{:>8}{:>9}{:>7}{:>10}{:>8}{:>13}".format(*head))
    for r in result["cases"]:
        print(
            f"{r['case']:12}{r['rows']:6d}{r['parameters']:6d}{r['wall_s']:9.3f}{r['cpu_s']:9.3f}{r['goal_s']:8.1f}"
            f"{r['qr_s']:9.4f}{r['times_qr']:7.1f}{r['differences_cpu_s']:10.2f}{r['faster']:8.1f}{r['inside_95']:13.3f}"
        )
        print(
            f"  {r['evaluations']} evaluations of {1e3 * r['one_evaluation_s']:.1f} ms, Jacobian"
            f" {1e3 * r['one_jacobian_s']:.1f} ms; differences {r['apart_sigma']:.2g} standard deviations apart;"
            f" {r['outliers']} outliers"
            + (f"; five folds {r['five_folds_cpu_s']:.1f} s" if "five_folds_cpu_s" in r else "")
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
