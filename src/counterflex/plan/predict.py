"""The prediction: deviation of the tool in the program as it is and in the compensated one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress
from counterflex.plan.static_correction import LoadedRobot
from counterflex.plan.tool_deviation import run
from counterflex.plan.work import UNCOMPENSATED


@dataclass(frozen=True, eq=False)
class Prediction:
    """Deviations of the tool from the programmed path, part axes; NaN where nothing was predicted.

    Attributes:
        deviation_nominal_part: (n, 3) m, the program as it is.
        deviation_compensated_part: (n, 3) m, the compensated program.
        w_nominal_part: (n, 6) N, N m, force on the tool that the program as it is makes.
    """

    deviation_nominal_part: Float
    deviation_compensated_part: Float
    w_nominal_part: Float


def predict_deviations(loaded: LoadedRobot, deviation_part: Float, parts: Mapping[str, Progress]) -> Prediction:
    """Run the program as it is on the moving robot; what the compensated one leaves is known from its trial.

    Args:
        loaded: The robot under load.
        deviation_part: (n, 6) m, rad, deviation of the compensated program.
        parts: Progress of the parts of the work; without :data:`~counterflex.plan.work.UNCOMPENSATED` nothing is
            predicted.
    """
    n = len(loaded.inputs.path)
    if UNCOMPENSATED not in parts:
        return Prediction(np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.full((n, 6), np.nan))
    as_it_is = np.zeros((n, 3))
    bent, deviation = run(loaded.robot, loaded.inputs.stock, loaded.inputs.q, as_it_is, parts[UNCOMPENSATED])
    return Prediction(deviation[:, :3], deviation_part[:, :3], bent.w_tcp_part)
