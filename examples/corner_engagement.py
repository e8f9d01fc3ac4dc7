"""Print how the engagement grows in an inside corner, booked by the removal simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.app.inputs import read_job
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG, MM
from counterflex.cutting.engagement import figures
from counterflex.cutting.removal import remove_tool_path
from counterflex.files.cell.cell import read_cell

HERE = Path(__file__).parent
LINES = (19, 20)  # of the program: towards the corner, and away from it


def main() -> None:
    """Cut the program into the blank and print the engagement of its second pass, every millimetre."""
    cell = read_cell(HERE / "cells" / "kr300_d16_small.toml")
    job = read_job(HERE / "programs" / "corner.ngc", cell)
    result = remove_tool_path(cell.stock(), job.path, cell.cutter(1))
    if result.engagement is None:
        raise ModelError("the removal simulation booked no engagement")
    step = np.linalg.norm(np.diff(job.path.p_part_tcp[:, :2], axis=0), axis=1)
    seen = figures(result.engagement, step, cell.cutter(1), least_m=1.0 * MM)
    print("4 mm of material on the right, 4 mm deep, D16; the corner is at x 38, y 22 mm")
    print(f"{'x mm':>6} {'y mm':>6} {'entry deg':>10} {'exit deg':>9} {'depth mm':>9} {'width mm':>9} {'area mm2':>9}")
    for i in range(len(seen.first)):
        row = seen.last[i]
        x, y, _ = job.path.p_part_tcp[row] / MM
        if job.line_of_motion[job.path.motion[row]] in LINES and x > 24.0 and y < 36.0 and seen.volume_m3[i] > 0.0:
            print(
                f"{x:6.1f} {y:6.1f} {seen.entry_rad[i] / DEG:10.1f} {seen.exit_rad[i] / DEG:9.1f} "
                f"{seen.axial_depth_m[i] / MM:9.2f} {seen.radial_width_m[i] / MM:9.2f} "
                f"{seen.chip_area_m2[i] / MM**2:9.1f}"
            )


if __name__ == "__main__":
    main()
