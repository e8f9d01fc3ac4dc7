"""Measure on the simulated cell what a shop would measure on a real one to set ``[dynamics]`` of a cell file.

Two tests at one point of the part: a force that sets in over a tenth of a second, and a command that does. Both move
the tool by the same amount in the end. Printed are, per direction, the lead that makes the command answer most like the
force, and how much of the motion they then differ by; and the lowest mode from the ringing of the force test.

    python tools/measure_response.py [CELL] [--at-mm X,Y,Z] [--seed N]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from counterflex.app import examples
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MS
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.twin.plant.plant import STEP_S, Plant

MOVE_M = 1.0 * MM
RISE_S = 0.1
TIME_S = 1.0
LEADS_S = np.arange(0.0, 30.5, 0.5) * MS


def responses(cell: Cell, p_part: Float, axis: int, seed: int | None) -> tuple[Float, Float]:
    """Motion of the tool along a part axis under a force and under a command, both settling at 1 mm; (n,) m each."""
    Rs_part_tcp = tool_orientation(np.array([[0.0, 0.0, 1.0]]), cell.tables.posture.rotation_about_tool_deg * DEG)
    T_base_tcp = tool_poses(cell.T_base_part, p_part[None], Rs_part_tcp)
    q = inverse_path(cell.chain, T_base_tcp, cell.tables.posture.branch).q[0]
    direction = cell.T_base_part[:3, axis]
    force = np.zeros(6)
    force[:3] = np.linalg.solve(cartesian_compliance(cell.chain, q)[:3, :3], direction * MOVE_M)
    dq = np.linalg.solve(jacobian(cell.chain, q), np.concatenate([direction * MOVE_M, np.zeros(3)]))
    out = []
    for command in (False, True):
        plant = Plant(truth_of(cell, seed))
        plant.reset(q)
        start, moved = plant.p_base_tcp.copy(), []
        for k in range(round(TIME_S / STEP_S)):
            x = min(1.0, k * STEP_S / RISE_S)
            share, rate = x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / RISE_S
            plant.step(
                q + dq * share if command else q,
                dq * rate if command else np.zeros(6),
                np.zeros(6) if command else force * share,
            )
            moved.append(float((plant.p_base_tcp - start) @ direction))
        out.append(np.array(moved))
    return out[0], out[1]


def best_lead(by_force: Float, by_command: Float) -> tuple[float, float]:
    """Lead at which the command's answer differs least (rms) from the force's, s, and that rms over 1 mm."""
    t = np.arange(len(by_force)) * STEP_S
    rms = [np.sqrt(np.mean((by_force - np.interp(t + lead, t, by_command)) ** 2)) for lead in LEADS_S]
    k = int(np.argmin(rms))
    return float(LEADS_S[k]), float(rms[k] / MOVE_M)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cell", nargs="?", help="cell file; the demonstration cell when left out")
    parser.add_argument("--at-mm", default="100,75,30", help="point in the part")
    parser.add_argument("--seed", type=int, help="truth seed; the nominal truth when left out")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cell.toml"
        if options.cell is None:
            examples.write(path)
        cell = read_cell(options.cell or path)
    p_part = np.array([float(v) for v in options.at_mm.split(",")]) * MM
    print("direction  lead ms  rms difference  lowest mode Hz")
    for axis, name in enumerate("xyz"):
        by_force, by_command = responses(cell, p_part, axis, options.seed)
        lead, rms = best_lead(by_force, by_command)
        ringing = by_force[round(0.15 / STEP_S) :] - by_force[-1]
        spectrum = np.abs(np.fft.rfft(ringing * np.hanning(len(ringing)), 1 << 15))
        hertz = np.fft.rfftfreq(1 << 15, STEP_S)
        mode = hertz[np.argmax(np.where(hertz > 3.0, spectrum, 0.0))]
        print(f"{name:9}  {lead / MS:7.1f}  {100 * rms:12.1f} %  {mode:14.1f}")


if __name__ == "__main__":
    main()
