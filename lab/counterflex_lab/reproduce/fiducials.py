"""Register fiducials around a part: the tracker's frame tied to the part's, with the tracker's noise."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose, rotation
from counterflex.twin.laboratory.laboratory import Laboratory

_ROUNDS: Final = 20
"""Readings of each fiducial, and of the target on the spindle, of which the mean is taken."""
REACH_M: Final = 240.0 * MM
"""Half the distance between fiducials, along x and y of the part."""
_RAISED_M: Final = 200.0 * MM


def tracker_table(cell: Cell, lab: Laboratory, T_base_part: Float) -> dict[str, object]:
    """Table ``[tracker]`` of a cell whose fiducials around the part were measured by the tracker.

    The fiducials stand around the part's origin, their places in the part are known; the tracker measures each twenty
    times, and so it does the target on the standing spindle.

    Args:
        cell: Cell file; its part frame is the one that the controller works in.
        lab: Where tracker and target truly are, and how well it measures.
        T_base_part: (4, 4) where the part truly lies.
    """
    noise = lab.noise("fiducials of the part")
    h = REACH_M
    points = np.array([[-h, -h, 0.0], [h, -h, 0.0], [h, h, 0.0], [-h, h, 0.0], [0.0, 0.0, _RAISED_M]])
    seen = pose.transform(pose.inverse(lab.T_base_tracker) @ T_base_part, points)
    seen = seen + lab.tracker_m / np.sqrt(_ROUNDS) * noise.standard_normal(seen.shape)
    T_part_tracker, _ = pose.register(points, seen)
    T = cell.T_base_part @ T_part_tracker
    target = lab.T_tcp_target.copy()
    target[:3, 3] += lab.tracker_m / np.sqrt(_ROUNDS) * noise.standard_normal(3)
    turned = rotation.exp(lab.tracker_rad / np.sqrt(_ROUNDS) * noise.standard_normal(3))
    target[:3, :3] = turned @ target[:3, :3]
    return {**_frame(T, ""), **_frame(target, "target_"), "target_on": "tcp", "source": "fiducials around the part"}


def _frame(T: Float, prefix: str) -> dict[str, float]:
    angles = rotation.to_zyx(T[:3, :3]) / DEG
    out = {f"{prefix}{name}_mm": float(v) / MM for name, v in zip("xyz", T[:3, 3], strict=True)}
    return out | {f"{prefix}{name}_deg": float(v) for name, v in zip("abc", angles, strict=True)}
