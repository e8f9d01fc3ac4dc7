"""A measuring frame beside the simulated cell: eight triangulation sensors look at a cube in place of the tool.

The cube's centre is where the tool's tip was. Three sensors look at its face towards +x, three at that towards +y, two
at that towards +z of the tool. The frame is put up anew at each pose, square to the cube by eye; it stands still while
the load comes on. What the sensors show is the way along each beam to the face, taken from where the cube truly is.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.geometry import pose, rotation

SENSOR_M: Final = 1.5 * UM
"""Standard deviation of one reading."""
PUT_UP_M: Final = 0.5 * MM
"""Standard deviation of where the frame comes to stand, per axis."""
PUT_UP_RAD: Final = 0.05 * DEG
"""Standard deviation of how it stands, per axis."""
STAND_OFF_M: Final = 40.0 * MM
HALF_EDGE_M: Final = 50.0 * MM
_SPACING_M: Final = 35.0 * MM
_PLACES: Final = (
    ("X1", 0, (-1.0, -1.0)),
    ("X2", 0, (1.0, -1.0)),
    ("X3", 0, (0.0, 1.0)),
    ("Y1", 1, (-1.0, -1.0)),
    ("Y2", 1, (1.0, -1.0)),
    ("Y3", 1, (0.0, 1.0)),
    ("Z1", 2, (-1.0, 0.0)),
    ("Z2", 2, (1.0, 0.0)),
)
"""Name, axis of the face, and where on it, by the two other axes in turn."""


def beams() -> tuple[Float, Float, Float]:
    """Where the sensors stand, where they look, and the middle of the faces, (8, 3) each, in axes of the cube, m."""
    stand, look, middle = np.zeros((3, len(_PLACES), 3))
    for i, (_, axis, at) in enumerate(_PLACES):
        middle[i, axis] = HALF_EDGE_M
        look[i, axis] = -1.0
        stand[i, axis] = HALF_EDGE_M + STAND_OFF_M
        stand[i, [(axis + 1) % 3, (axis + 2) % 3]] = _SPACING_M * np.array(at)
    return stand, look, middle


def described() -> tuple[dict[str, Any], ...]:
    """The sensors as a laboratory would write them down, m, axes of the tool."""
    stand, look, middle = beams()
    return tuple(
        {
            "name": name,
            "position_m": stand[i].tolist(),
            "direction": look[i].tolist(),
            "normal": (0.0 - look[i]).tolist(),
            "point_m": middle[i].tolist(),
        }
        for i, (name, _, _) in enumerate(_PLACES)
    )


def read(T_base_cube: Float, noise: np.random.Generator, readings: int) -> tuple[Float, float]:
    """Distances before and under load.

    ``T_base_cube``: (n, 2, 4, 4) the cube without and with load.

    Returns:
        (n, 2, 8) m, and their standard deviation, m.
    """
    n = len(T_base_cube)
    stand, look, middle = beams()
    turned = rotation.exp(PUT_UP_RAD * noise.standard_normal((n, 3)))
    T_base_frame = T_base_cube[:, 0] @ pose.make(turned, PUT_UP_M * noise.standard_normal((n, 3)))
    out = np.empty((n, 2, len(stand)))
    for state in range(2):
        T_cube_frame = pose.inverse(T_base_cube[:, state]) @ T_base_frame
        origin = stand @ np.swapaxes(T_cube_frame[:, :3, :3], 1, 2) + T_cube_frame[:, None, :3, 3]
        ray = look @ np.swapaxes(T_cube_frame[:, :3, :3], 1, 2)
        # In axes of the cube each face is a plane of one coordinate.
        out[:, state] = np.sum((middle - origin) * -look, axis=2) / np.sum(ray * -look, axis=2)
    sigma_m = SENSOR_M / np.sqrt(readings)
    return out + sigma_m * noise.standard_normal(out.shape), float(sigma_m)
