"""Follow one path point through the whole code: from its line of G-code to the line that is written (docs/tour.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.app.compensation.languages import write
from counterflex.app.inputs import read_job, setting_of
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MM_PER_MIN, RPM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose
from counterflex.plan.compensate import plan as make_plan
from counterflex.robot.elasticity import compliance, gravity

HERE = Path(__file__).parent
PROGRAM, CELL = HERE / "programs" / "groove.ngc", HERE / "cells" / "kr300_d16_small.toml"
X_MM = 30.0  # the point: the middle of the groove


def show(what: str, values: Float | float, digits: int = 1) -> None:
    """Print one quantity."""
    numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
    print(f"  {what:44}" + "".join(f" {round(float(v), digits) + 0.0:9.{digits}f}" for v in numbers))


def main() -> None:
    """Plan the program and print what every room says about the one point."""
    cell = read_cell(CELL)
    job = read_job(PROGRAM, cell)
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), feeds=job.feeds)
    at = plan.cutting & (np.abs(plan.path.p_part_tcp[:, 0] / MM - X_MM) < 1e-6)
    row = int(np.flatnonzero(at)[0])

    line = int(plan.line[row])
    print(f"1 programs/   line {line}: {job.program.lines[line - 1]}")
    show("start of the motion, mm", job.program.motions[plan.path.motion[row]].p_start / MM)
    show("its end, mm", job.program.motions[plan.path.motion[row]].p_end / MM)

    print(f"2 path/       row {row} of {len(plan.path)}")
    show("programmed tool tip, mm", plan.path.p_part_tcp[row] / MM)
    show("time s, feed mm/min, spindle 1/min", np.array([
        plan.path.time_s[row], plan.path.feed_m_s[row] / MM_PER_MIN, plan.path.spindle_rad_s[row] / RPM
    ]), 3)  # fmt: skip

    print("3 robot/      the pose in joint angles")
    q = plan.q[row]
    show("axes 1 to 6, deg", q / DEG, 2)

    print("4 cutting/    the undisturbed cut")
    show("immersion from, to, deg", np.array([plan.entry_rad[row], plan.exit_rad[row]]) / DEG)
    show("feed per tooth, um", plan.feed_per_tooth_m[row] / UM)
    show("mean force on the tool, part axes, N", plan.w_tcp_part[row, :3])
    show("its moment about the tip, N m", plan.w_tcp_part[row, 3:], 2)

    print("5 robot/      how far that bends the robot")
    w_tcp_base = pose.rotate_wrench(cell.T_base_part[:3, :3], plan.w_tcp_part[row])
    linear = compliance.deflection(cell.chain, q, w_tcp_base, nonlinear=False)[:3]
    finite = compliance.deflection(cell.chain, q, w_tcp_base)[:3]
    show("deflection, linear, base axes, um", linear / UM)
    show("deflection, finite rotations, base axes, um", finite / UM)
    for name, part in zip(cell.chain.names, compliance.shares(cell.chain, q, w_tcp_base), strict=True):
        share = float(part[:3] @ linear) / float(linear @ linear)
        if abs(share) >= 0.1:
            print(f"    {100.0 * share:5.1f} % of it in {name}")

    print("6 plan/       what own weight and the drives leave")
    show("sag, base axes, um", gravity.sag(cell.chain, q)[:3] / UM)
    show("left after touching the part, part axes, um", plan.sag_part[row] / UM)

    show("play and friction of the axes, part axes, um", plan.play_part[row] / UM)

    print("7 plan/       the correction, part axes")
    show("correction, um", plan.correction_part[row] / UM)
    show("deviation without it by the model, um", plan.deviation_nominal_part[row] / UM)
    show("deviation with it by the model, um", plan.deviation_compensated_part[row] / UM)

    files, said = write(job, plan, cell, "gcode")
    print(f"8 programs/   written: {said['vertices_added']} blocks added, {said['largest_written_error_um']} um off")
    text = next(iter(files.values())).splitlines()
    after = [i for i, block in enumerate(text) if block.startswith("G1 X")]
    print("    " + "\n    ".join(text[i] for i in after[:4]) + "\n    ...")


if __name__ == "__main__":
    main()
