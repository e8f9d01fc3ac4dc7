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
from counterflex.app.proof.truth import best_lead, responses, truth_of
from counterflex.core.units import MM, MS
from counterflex.files.cell.cell import read_cell
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.twin.plant.plant import STEP_S


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
    Rs_part_tcp = tool_orientation(np.array([[0.0, 0.0, 1.0]]), cell.tables.posture.rotation_about_tool_rad)
    T_base_tcp = tool_poses(cell.T_base_part, p_part[None], Rs_part_tcp)
    q = inverse_path(cell.chain, T_base_tcp, cell.tables.posture.branch).q[0]
    truth = truth_of(cell, options.seed)
    print("direction  lead ms  rms difference  lowest mode Hz")
    for axis, name in enumerate("xyz"):
        by_force, by_command = responses(cell, truth, q, axis)
        lead, rms = best_lead([(by_force, by_command)])
        ringing = by_force[round(0.15 / STEP_S) :] - by_force[-1]
        spectrum = np.abs(np.fft.rfft(ringing * np.hanning(len(ringing)), 1 << 15))
        hertz = np.fft.rfftfreq(1 << 15, STEP_S)
        mode = hertz[np.argmax(np.where(hertz > 3.0, spectrum, 0.0))]
        print(f"{name:9}  {lead / MS:7.1f}  {100 * rms:12.1f} %  {mode:14.1f}")


if __name__ == "__main__":
    main()
