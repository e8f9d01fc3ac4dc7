"""Check that the integration step of the simulated cell is short enough for its stuck friction elements.

One step of the plant, linearised with all slip elements stuck and the motors held, is a matrix; its spectral radius
must be at most 1. Above it, friction elements oscillate from step to step with the force at which they slip, and a
force sensor reads that. The plant divides its step where it must (``twin/plant/mjcf.py``). Printed is into how
many parts, and the largest radius over random postures, of the whole step and of the part used. Exit status 1 if that
is above 1 anywhere.

    python benchmarks/step_stability.py [--robots kuka_kr300_r2500_ultra,kuka_kr500_r2830] [--seeds 1-4] [--family mild]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from counterflex.app import examples
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.family import FAMILIES
from seeds_option import seeds_of

ROUNDING: Final = 1e-9
MIDDLE_DEG: Final = (0.0, -90.0, 100.0, 0.0, 0.0, 0.0)
RANGE_DEG: Final = (20.0, 20.0, 20.0, 170.0, 110.0, 170.0)


def radius(plant: Plant, step_s: float) -> float:
    """Spectral radius of one step: ``M v' = M v - h K q``, dampers implicit, ``q' = q + h v'``.

    Args:
        plant: In its posture.
        step_s: h.
    """
    model, data, coordinates = plant._model, plant._data, plant.coordinates
    M: Float = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    k = plant._stiffness.copy()
    for axis, torsion in enumerate(coordinates.torsion):
        if torsion >= 0:
            k[torsion] += plant._slip_stiffness[axis, :-1].sum()
    soft = np.flatnonzero(coordinates.kind >= 0)
    M, n = M[np.ix_(soft, soft)], len(soft)
    held = np.linalg.inv(M + step_s * np.diag(model.dof_damping[soft]))
    from_speed, from_place = held @ M, -step_s * held @ np.diag(k[soft])
    step = np.block([[from_speed, from_place], [step_s * from_speed, np.eye(n) + step_s * from_place]])
    return float(np.abs(np.linalg.eigvals(step)).max())


def main() -> int:
    """Compute and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default="kuka_kr300_r2500_ultra,kuka_kr270_2,kuka_kr500_r2830")
    parser.add_argument("--seeds", type=seeds_of, default="1-4")
    parser.add_argument("--family", choices=list(FAMILIES), default="mild")
    parser.add_argument("--postures", type=int, default=12)
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    robots = chosen.robots.split(",")[: 1 if chosen.quick else None]
    print("| robot | seed | parts of 0.5 ms | radius undivided | radius of a part |\n|---|---|---|---|---|")
    worst = 0.0
    for robot in robots:
        with tempfile.TemporaryDirectory() as scratch:
            (small,) = (file for file in examples.write_all(Path(scratch) / "cell.toml", robot) if "small" in file.name)
            cell = read_cell(small)
        for seed in [1] if chosen.quick else chosen.seeds:
            plant, rng = Plant(truth_of(cell, seed, FAMILIES[chosen.family])), np.random.default_rng(1)
            whole, used = 0.0, 0.0
            for _ in range(chosen.postures):
                plant.reset((np.array(MIDDLE_DEG) + np.array(RANGE_DEG) * rng.uniform(-1.0, 1.0, 6)) * DEG)
                whole = max(whole, radius(plant, plant.step_s))
                used = max(used, radius(plant, plant.step_s / plant.parts))
            print(f"| {robot} | {seed} | {plant.parts} | {whole:.2f} | {used:.3f} |", flush=True)
            worst = max(worst, used)
    return int(worst > 1.0 + ROUNDING)


if __name__ == "__main__":
    raise SystemExit(main())
