"""Make examples/touches.csv: a simulated spindle and arm of another kind warm up while the robot touches one place."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from counterflex.app.proof.truth import truth_of
from counterflex.app.unknown_stiffness import corner_of_blank
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.family import OTHER
from counterflex.twin.truth.truth import Truth

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NOISE_M = 4.0 * UM


def places(truth: Truth, q: Float, times_s: Float) -> Float:
    """(n, 3) m, base axes: where the tip truly stands in one posture as time goes on, spindle running."""
    plant, out = Plant(truth), []
    for time_s in times_s:
        plant.program_time(float(time_s), 1)
        plant.reset(q)
        out.append(plant.p_base_tcp.copy())
    return np.array(out)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path, default=EXAMPLES / "touches.csv")
    given = parser.parse_args()
    cell = read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")
    truth = truth_of(cell, given.seed, OTHER)
    times_s: Float = 240.0 * np.arange(16, dtype=np.float64)
    p_base = places(truth, corner_of_blank(cell), times_s)
    rng = np.random.default_rng(given.seed)
    p_part = (p_base - p_base[0]) @ cell.T_base_part[:3, :3] + NOISE_M * rng.standard_normal((len(times_s), 3))
    lines = ["time_s,x_mm,y_mm,z_mm,spindle_rpm,sigma_um"]
    for time_s, p in zip(times_s, p_part / MM, strict=True):
        rpm = 0 if time_s == 0.0 else 12_000
        lines.append(f"{time_s:g},{p[0]:.4f},{p[1]:.4f},{p[2]:.4f},{rpm},{NOISE_M / UM:g}")
    given.out.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
