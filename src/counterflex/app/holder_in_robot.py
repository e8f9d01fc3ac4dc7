"""Mounting of the spindle and compliance of the arm: deflection of the tool tip by pose, over the working space."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.placement.spindle_mounting import Mounting
from counterflex.core.arrays import Float
from counterflex.core.errors import ReachError
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_all


@dataclass(frozen=True)
class Spindle:
    """Spindle and angles that are mapped."""

    cell: Path
    mounting: Mounting | None = None  # Body and angles of the spindle, or None: as the cell file has it
    force_n: float = 500.0
    points: int = 9  # Places along each axis of a map

    def maps(self) -> dict[str, Any]:
        """Radial and axial compliance at the tool tip, tool vertical, over an upright plane in front of the robot.

        At each place the posture of least radial compliance is taken. Radial is the softest direction across the tool.

        Returns:
            The places, and for each angle of the spindle the two maps in um/N and the figures of the middle of the map.

        Raises:
            CounterflexError: The cell cannot be read, or has no such body.
        """
        cell = read_cell(self.cell)
        mounting = self.mounting
        angles: list[float | None] = [None]
        if mounting is not None:
            angles = list(dict.fromkeys([mounting.present_deg(cell), *mounting.values_deg]))
        T = cell.T_base_part
        reach = float(np.linalg.norm(T[:3, 3]))
        x = np.linspace(0.55, 1.25, self.points) * float(np.linalg.norm(T[:2, 3]))
        z = T[2, 3] + np.linspace(-0.25, 0.25, self.points) * reach
        rows = []
        for angle in angles:
            own = cell if mounting is None or angle is None else mounting.cell(cell, angle)
            rows.append(_maps(own, angle, x, z, self.force_n))
        return {
            "cell": cell.label,
            "force_n": self.force_n,
            "mounting": None if mounting is None else f"{mounting.body}.{mounting.key}",
            "x_mm": [round(v / MM, 1) for v in x.tolist()],
            "z_mm": [round(v / MM, 1) for v in z.tolist()],
            "angles": rows,
        }


def _maps(cell: Cell, angle: float | None, x: Float, z: Float, force_n: float) -> dict[str, Any]:
    radial: list[list[float | None]] = []
    axial: list[list[float | None]] = []
    bearing = np.arctan2(cell.T_base_part[1, 3], cell.T_base_part[0, 3])
    for height in z:
        places = [_at(cell, bearing, float(along), float(height)) for along in x]
        radial.append([None if one is None else round(one[0] / UM, 4) for one in places])
        axial.append([None if one is None else round(one[1] / UM, 4) for one in places])
    known = np.array([value for row in radial for value in row if value is not None])
    return {
        "angle_deg": angle,
        "radial_um_n": radial,
        "axial_um_n": axial,
        "reached": len(known),
        "median_um": None if len(known) == 0 else round(float(np.median(known)) * force_n, 2),
        "least_um": None if len(known) == 0 else round(float(known.min()) * force_n, 2),
        "most_um": None if len(known) == 0 else round(float(known.max()) * force_n, 2),
    }


def _at(cell: Cell, bearing: float, along: float, height: float) -> tuple[float, float] | None:
    """Least radial compliance over the postures at a place and the axial one in it, m/N; None where none reaches."""
    best: tuple[float, float] | None = None
    for turn in np.radians([0.0, 90.0, 180.0, 270.0]):
        c, s = np.cos(bearing + turn), np.sin(bearing + turn)
        T = np.eye(4)
        T[:3, :3] = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
        T[:3, 3] = along * np.cos(bearing), along * np.sin(bearing), height
        try:
            solutions = inverse_all(cell.chain, T)
        except ReachError:
            continue
        for one in solutions:
            C = cartesian_compliance(cell.chain, one.q)[:3, :3]
            soft = float(np.linalg.eigvalsh(C[:2, :2])[-1])
            if best is None or soft < best[0]:
                best = soft, float(C[2, 2])
    return best
