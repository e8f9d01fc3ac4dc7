"""The error of a program in a place and posture, on the moving robot: swings that a deflection at rest does not show.

Places of equal deflection differ by how far the arm reaches: a stretched arm that is stiff along the normal of the wall
is soft across it, and swings. The model of the plan says how much of that becomes error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.stock import HeightMap
from counterflex.plan.compensate import predict_uncompensated
from counterflex.plan.posture.held import SHARE, Held, Task


def foreseen_error(task: Task, stock: HeightMap, posture: Held, T_base_part: Float) -> float:
    """Predicted error of the uncompensated program that 99.7 % of the cut stay below, m.

    Args:
        task: The program.
        stock: The blank; left as it is.
        posture: In which it is run.
        T_base_part: (4, 4) where the part stands.

    Returns:
        Size of the deviation in the directions that matter.

    Raises:
        CounterflexError: The program cannot be run or cut so.
    """
    setting = replace(
        task.setting,
        T_base_part=T_base_part,
        branch=posture.branch,
        rotation_about_tool_rad=posture.rotation_rad,
        turning=posture.turning,
    )
    deviation = predict_uncompensated(task.path, task.line, stock, setting)
    along = np.einsum("nki,ni->nk", task.cut.normals_part, deviation)
    cutting = task.cut.weight_m > 0.0
    size = np.linalg.norm(along[cutting], axis=1)
    return float(np.quantile(size, SHARE, weights=task.cut.weight_m[cutting], method="inverted_cdf"))
