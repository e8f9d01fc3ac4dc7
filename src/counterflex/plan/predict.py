"""The trial in motion and the prediction: deviation of the tool in the program as it is and in the compensated one.

The command is tried on the moving robot, and mended once by what it leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress
from counterflex.plan.inputs import MENDED, TRIAL, UNCOMPENSATED
from counterflex.plan.plan import across
from counterflex.plan.response import lasting
from counterflex.plan.static_correction import Command, LoadedRobot, command_against, shaped
from counterflex.plan.tool_deviation import run

_BELIEVED = 0.3
"""Share of the deflection that the trial may leave: if it leaves more, the model chatters and teaches nothing."""
_SHARE = 0.7
"""Of what is left: friction and cutting answer otherwise than the one mode that inverts the command."""


def dynamic_trial(
    loaded: LoadedRobot, displacement: Float, command: Command, parts: Mapping[str, Progress]
) -> tuple[Command, Float]:
    """Try a command, take back a share of what lasts of its deviation, and keep the better of the two commands.

    Args:
        loaded: The robot under load.
        displacement: (n, 6) m, rad that the command takes back.
        command: The correction at rest.
        parts: Progress of the parts of the work; without :data:`~counterflex.plan.inputs.MENDED` nothing is mended, and
            without :data:`~counterflex.plan.inputs.UNCOMPENSATED` (no prediction is asked for) nothing is tried for its
            own sake.

    Returns:
        The command, and the deviation (n, 6) m, rad of the tool that it leaves in motion; zero if nothing was tried.
    """
    mends = MENDED in parts and bool(np.any(loaded.cut.contact))
    if not mends and UNCOMPENSATED not in parts:
        return command, np.zeros_like(displacement)
    remaining = _tried(loaded, command, parts[TRIAL])
    if not mends or _size(loaded, remaining) >= _BELIEVED * _size(loaded, loaded.deflection_part):
        return command, remaining
    second = command_against(loaded, displacement + _SHARE * _correctable(loaded, remaining))
    remaining_of_second = _tried(loaded, second, parts[MENDED])
    if _size(loaded, remaining_of_second) < _size(loaded, remaining):
        return second, remaining_of_second
    return command, remaining


def _tried(loaded: LoadedRobot, command: Command, progress: Progress) -> Float:
    return run(loaded.robot, loaded.inputs.stock, command.q, command.correction_part, progress)[1]


def _size(loaded: LoadedRobot, deviation: Float) -> float:
    """Root mean square of a deviation across the path, in contact; m."""
    square = np.sum(across(deviation[:, :3], loaded.inputs.path.p_part_tcp)[loaded.cut.contact] ** 2, axis=1)
    return float(np.sqrt(np.mean(square)))


def _correctable(loaded: LoadedRobot, deviation: Float) -> Float:
    """What of a deviation changes slower than it lasts and may be corrected, shaped in time."""
    setting, path = loaded.inputs.setting, loaded.inputs.path
    left = deviation if setting.orientation else np.pad(deviation[:, :3], ((0, 0), (0, 3)))
    if setting.normal_only:
        left = np.concatenate([across(left[:, :3], path.p_part_tcp), left[:, 3:]], axis=1)
    left = left - lasting(left, path.time_s)
    return shaped(loaded, left, np.zeros_like(left))


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
        parts: Progress of the parts of the work; without :data:`~counterflex.plan.inputs.UNCOMPENSATED` nothing is
            predicted.
    """
    n = len(loaded.inputs.path)
    if UNCOMPENSATED not in parts:
        return Prediction(np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.full((n, 6), np.nan))
    as_it_is = np.zeros((n, 3))
    bent, deviation = run(loaded.robot, loaded.inputs.stock, loaded.inputs.q, as_it_is, parts[UNCOMPENSATED])
    return Prediction(deviation[:, :3], deviation_part[:, :3], bent.w_tcp_part)
