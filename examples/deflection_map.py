"""Print how far a force of 300 N across the feed bends the tool, over the top of the part."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.robot.elasticity import compliance, gravity
from counterflex.robot.kinematics.inverse import inverse_path

CELL = Path(__file__).parent / "cells" / "kr300_d16_flat.toml"
FORCE_N = 300.0


def main() -> None:
    """Solve the joints on a grid, load the tool along part y, and tabulate the deflection and the sag."""
    cell = read_cell(CELL)
    x_mm, y_mm = np.linspace(0.0, 200.0, 6), np.linspace(0.0, 160.0, 5)
    grid = np.array([[x, y, 40.0] for y in y_mm for x in x_mm]) * MM
    axes = np.tile([0.0, 0.0, 1.0], (len(grid), 1))
    Rs_part_tcp = tool_orientation(axes, cell.tables.posture.rotation_about_tool_deg * DEG)
    q = inverse_path(cell.chain, tool_poses(cell.T_base_part, grid, Rs_part_tcp), cell.tables.posture.branch).q

    w_tcp_base = np.zeros(6)
    w_tcp_base[:3] = cell.T_base_part[:3, :3] @ np.array([0.0, FORCE_N, 0.0])
    deflection = compliance.deflection(cell.chain, q, w_tcp_base)
    sag = gravity.sag(cell.chain, q)

    print(f"{cell.name}: deflection in um under {FORCE_N:g} N along part y, at the top of the part")
    length = np.linalg.norm(deflection[:, :3], axis=1).reshape(len(y_mm), len(x_mm)) / UM
    print("   y \\ x " + "".join(f"{x:9.0f}" for x in x_mm) + "  mm")
    for y, row in zip(y_mm, length, strict=True):
        print(f"{y:8.0f} " + "".join(f"{value:9.0f}" for value in row))
    print(
        f"from {length.min():.0f} to {length.max():.0f} um: {100.0 * (length.max() / length.min() - 1.0):.1f} % apart"
    )
    spread = sag[:, :3] - sag[:, :3].mean(axis=0)
    print(
        f"own-weight sag is {np.linalg.norm(sag[:, :3], axis=1).mean() / UM:.0f} um, but varies by at most "
        f"{np.linalg.norm(spread, axis=1).max() / UM:.0f} um over the part, which is what touching the part leaves"
    )


if __name__ == "__main__":
    main()
