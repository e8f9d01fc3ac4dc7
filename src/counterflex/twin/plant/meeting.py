"""Where tool and part meet: the tip in the part, and what the process does to what the robot's hand holds."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.geometry import wrench
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.process import Process


def tip_in_part(plant: Plant, process: Process, T_base_tcp: Float | None) -> Float:
    """(3,) m, tip of the tool in the part frame.

    ``plant``: The robot; its hand holds the tool, or the part. ``T_base_tcp``: (4, 4) tool frame of a spindle that
    stands, where the robot holds the part; else None.
    """
    if T_base_tcp is None:
        T = process.T_base_part
        out: Float = (plant.p_base_tcp - T[:3, 3]) @ T[:3, :3]
        return out
    held: Float = (T_base_tcp[:3, 3] - plant.p_base_tcp) @ plant.R_base_tcp
    return held


def load_on_hand(plant: Plant, process: Process, T_base_tcp: Float | None) -> Float:
    """(6,) N, N m, what the process does to the robot, about the origin of its hand, base axes.

    Args:
        plant: See :func:`tip_in_part`.
        process: Likewise; where the robot holds the part, it is told where that is now.
        T_base_tcp: Likewise.
    """
    if T_base_tcp is None:
        return process.wrench(plant.p_base_tcp)
    process.T_base_part[:3, :3], process.T_base_part[:3, 3] = plant.R_base_tcp, plant.p_base_tcp
    on_tool = process.wrench(T_base_tcp[:3, 3].copy())
    return -wrench.shift(on_tool, T_base_tcp[:3, 3] - plant.p_base_tcp)
