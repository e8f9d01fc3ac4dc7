"""From datasets of the tracker to residuals, and the first estimate of its frames with the checks that come before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.identify.data import alternative_readings
from counterflex.identify.data.data_checks import check_finite, check_repeats
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import Misfit, check_reading, thinned
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry import hand_eye_robust
from counterflex.identify.geometry.arm_geometry import ArmGeometry, displaced_arm
from counterflex.identify.geometry.hand_eye import open_offsets
from counterflex.identify.geometry.known_frames import known_drive_errors
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals

FEWEST: Final = 4
ROBOT_M: Final = 5.0 * MM
"""What an uncalibrated robot may be off by; twice that in the median and other readings of the data are tried."""
_NEAREST: Final = 0.05
_FARTHEST: Final = 1.5
"""Of the robot's length, how far the farthest position of the flange is from its foot."""
_QUICK_TRIALS = 25
_READ_ROWS = 24
POINT: Final = "p_tracker_target"
ORIENTATION: Final = "R_tracker_target"


class GivenPoses:
    """An arm whose poses the controller has told: nothing about it has parameters.

    Attributes:
        Ts_base_tcp: (m, 4, 4).
    """

    def __init__(self, Ts_base_tcp: Float) -> None:
        self.Ts_base_tcp = Ts_base_tcp

    def poses(self, x: Float) -> Float:  # noqa: ARG002
        """The poses, whatever the parameters."""
        return self.Ts_base_tcp

    def moved(self, x: Float) -> tuple[Float, Int, Float]:  # noqa: ARG002
        """The poses; no parameter moves them."""
        return self.Ts_base_tcp, np.zeros(0, dtype=np.int64), np.zeros((len(self.Ts_base_tcp), 6, 0))

    def subset(self, rows: Bool) -> GivenPoses:
        """The marked poses only."""
        return GivenPoses(self.Ts_base_tcp[rows])


def arm_of(cell: CellModel, d: Dataset) -> ArmGeometry | GivenPoses:
    """The arm in the poses of a dataset: by its joint angles, or by the flange poses that the controller shows.

    Raises FileFormatError: the dataset has neither ``q`` nor ``p_base_flange`` with ``R_base_flange``.
    """
    if not d.has("q") and d.has("p_base_flange") and d.has("R_base_flange"):
        Ts_base_flange = pose.make(d.values("R_base_flange"), d.values("p_base_flange"))
        return GivenPoses(Ts_base_flange @ cell.nominal_chain.T_flange_tcp)
    return arm_as_known(cell, d.values("q"))


def has_orientation(d: Dataset) -> bool:
    """Return whether the target's orientation was measured."""
    return d.has(ORIENTATION)


def arm_as_known(cell: CellModel, q: Float) -> ArmGeometry:
    """The arm in poses q (m, 6) rad with all that the cell file says: calibration, drive errors, sag."""
    return displaced_arm(cell.nominal_chain, known_drive_errors(cell).link_angles(q), dict(cell.calibration))


def tracker_residuals(
    d: Dataset, arm: ArmGeometry | GivenPoses, tracker: PlacedFrame, target: PlacedFrame
) -> TrackerResiduals:
    """Residuals of a dataset of poses or points.

    Raises FileFormatError: a channel or its standard deviation is missing.
    """
    position = d.channel(POINT)
    sigma = position.need_sigma()
    R = None
    if has_orientation(d):
        orientation = d.channel(ORIENTATION)
        R = orientation.values
        sigma = np.concatenate([sigma, orientation.need_sigma()], axis=1)
    return TrackerResiduals(d.name, d.group, sigma, arm, tracker, target, position.values, R)


def measured_of(d: Dataset) -> Float:
    """Readings of the tracker: poses (m, 4, 4) T_tracker_target, or points (m, 3) p_tracker_target."""
    return pose.make(d.values(ORIENTATION), d.values(POINT)) if has_orientation(d) else d.values(POINT)


def fixes_target(cell: CellModel, d: Dataset) -> bool:
    """Return whether poses turn enough that they tell the target's whole offset on the tool."""
    return len(d) >= FEWEST and len(open_offsets(arm_of(cell, d).poses(np.zeros(0)))) == 0


def check_tracker_data(
    cell: CellModel, d: Dataset, *, as_stated: bool = False, partly: bool = False, target: Float | None = None
) -> tuple[str, ...]:
    """Refuse what a fit would hide: gaps, too few poses, contradicting repeats, another reading that fits far better.

    ``as_stated``: The user insists on the data as they are. ``partly``: Poses that turn about one axis only will do.
    ``target``: T_tcp_target (4, 4) where other data fix it: only the tracker is looked for. Raises InputError: see
    above; the message names what was found. Raises FileFormatError: a channel is missing.
    """
    channel = "q" if d.has("q") or not d.has("p_base_flange") else "p_base_flange"
    channels = [channel, POINT] + ([ORIENTATION] if has_orientation(d) else [])
    check_finite(d, channels)
    distinct = len(np.unique(np.round(d.values(channel), 5), axis=0))
    if distinct < FEWEST:
        raise InputError(
            "too few different poses",
            where=d.where or d.name,
            value=f"{distinct} of {len(d)} rows",
            limit=f"{FEWEST} or more",
            hint="Measure poses that differ in position and orientation",
        )
    if channel != "q":
        _check_reach(cell, d)
    check_repeats(d, POINT, same=(channel,))
    # Poses that leave a frame open are refused by the hand-eye calibration with its reason.
    start_frames(cell, thinned(d), trials=0, partly=partly, target=target)
    remarks = check_reading(
        d, readings_of(d), lambda sample: _misfit(cell, sample, partly, target), as_stated=as_stated, rows=_READ_ROWS
    )
    if not remarks and not as_stated:
        residual_m = float(np.median(start_frames(cell, thinned(d), partly=partly, target=target).error_m))
        if residual_m > 2.0 * ROBOT_M:
            raise InputError(
                "the measurements contradict the robot",
                where=d.where or d.name,
                value=f"median error {residual_m / MM:.4g} mm",
                limit=f"{2.0 * ROBOT_M / MM:g} mm",
                hint="Check robot, order and signs of the joint angles, units and columns; or, where the zeros of the "
                "axes are off by that much, add --set as_stated=true",
            )
    return remarks


def _check_reach(cell: CellModel, d: Dataset) -> None:
    """Refuse poses of the flange that this robot cannot take: they are in another unit."""
    # The farthest is then beyond the robot's length, or hardly away from its foot.
    length = float(np.sum(np.linalg.norm(cell.nominal_chain.fixed[:, :3, 3], axis=1)))
    farthest = float(np.max(np.linalg.norm(d.values("p_base_flange"), axis=1)))
    if not _NEAREST * length <= farthest <= _FARTHEST * length:
        raise InputError(
            "the positions of the flange are not those of this robot",
            where=f"{d.where or d.name}: channels.p_base_flange",
            value=f"{farthest / MM:.4g} mm from the robot's foot at most",
            limit=f"{_NEAREST * length / MM:.4g} .. {_FARTHEST * length / MM:.4g} mm",
            hint="Check unit under [channels.p_base_flange], and the frame: the foot of the robot, no workpiece frame",
        )


def start_frames(
    cell: CellModel,
    d: Dataset,
    *,
    trials: int = hand_eye_robust.TRIALS,
    partly: bool = False,
    target: Float | None = None,
    tracker: Float | None = None,
) -> hand_eye_robust.HandEye:
    """Robust first estimate of tracker and target from a dataset of poses or points.

    Args:
        cell: Its robot predicts the poses.
        d: Poses or points.
        trials: Random samples; 0 is plain least squares.
        partly: Poses that turn about one axis only will do, see
            :func:`counterflex.identify.geometry.hand_eye.of_poses`.
        target: T_tcp_target (4, 4) where it is known: only the tracker is looked for.
        tracker: T_base_tracker (4, 4) where it is known: only the target is looked for.

    Raises:
        InputError: Poses that do not turn, too few, on one line.
    """
    Ts, measured = arm_of(cell, d).poses(np.zeros(0)), measured_of(d)
    if target is not None:
        return hand_eye_robust.robust_tracker(Ts, measured, target, trials=trials)
    if tracker is not None:
        return hand_eye_robust.robust_target(Ts, measured, tracker, trials=trials)
    if has_orientation(d):
        return hand_eye_robust.robust_of_poses(Ts, measured, trials=trials, partly=partly)
    return hand_eye_robust.robust_of_points(Ts, measured, trials=trials, partly=partly)


def _misfit(cell: CellModel, d: Dataset, partly: bool, target: Float | None) -> Misfit:
    frames = start_frames(cell, d, trials=_QUICK_TRIALS, partly=partly, target=target)
    numbers = len(d) * (6 if has_orientation(d) else 3)
    return Misfit(frames.error_m / ROBOT_M, np.zeros(0), float(max(numbers - (12 if target is None else 6), 1)))


def readings_of(d: Dataset) -> tuple[alternative_readings.AlternativeReading, ...]:
    """Other readings of a table of tracker poses or points."""
    channel = "q" if d.has("q") else "p_base_flange"
    out = [
        *alternative_readings.unit_mistakes(d, channel),
        *alternative_readings.unit_mistakes(d, POINT),
        *alternative_readings.swapped_columns(d, channel),
        *alternative_readings.sign_mistakes(d, channel),
        *alternative_readings.row_mistakes(POINT),
    ]
    if channel != "q" and d.has("R_base_flange"):
        out += [
            *alternative_readings.quaternion_mistakes("R_base_flange"),
            alternative_readings.transposed("R_base_flange"),
            *euler_mistakes("R_base_flange"),
        ]
    if not has_orientation(d):
        return (*out, *alternative_readings.left_handed((POINT,)))
    return (
        *out,
        *alternative_readings.left_handed((POINT,), (ORIENTATION,)),
        *alternative_readings.swapped_columns(d, POINT),
        *alternative_readings.sign_mistakes(d, POINT),
        alternative_readings.inverted_pose(POINT, ORIENTATION),
        alternative_readings.transposed(ORIENTATION),
        *alternative_readings.quaternion_mistakes(ORIENTATION),
        *euler_mistakes(ORIENTATION),
    )


_FORMS: Final[dict[str, tuple[Callable[[Float], Float], Callable[[Float], Float]]]] = {
    "angles about x, y', z''": (
        lambda R: -rotation.to_zyx(np.swapaxes(R, -1, -2))[..., ::-1],
        lambda a: np.swapaxes(rotation.from_zyx(-a[..., ::-1]), -1, -2),
    ),
    "angles about z, y', x'' in the order x, y, z": (
        lambda R: rotation.to_zyx(R)[..., ::-1],
        lambda a: rotation.from_zyx(a[..., ::-1]),
    ),
    "angles about z, y', x'' in the order z, y, x": (rotation.to_zyx, rotation.from_zyx),
    "a rotation vector": (rotation.log, rotation.exp),
}
"""Three numbers of a rotation, and back."""


def euler_mistakes(channel: str) -> tuple[alternative_readings.AlternativeReading, ...]:
    """The three numbers of the orientation read by another convention than meant, or in deg where they are rad."""
    out = [
        alternative_readings.AlternativeReading(
            channel,
            f"the numbers of '{channel}' are in rad, not in deg ({form})",
            f'write unit = "rad" under [channels.{channel}]',
            _reread(channel, numbers, matrix, 1.0 / DEG),
        )
        for form, (numbers, matrix) in _FORMS.items()
    ]
    for read, (numbers, _) in _FORMS.items():
        for actual, (_, matrix) in _FORMS.items():
            if read != actual:
                out.append(
                    alternative_readings.AlternativeReading(
                        channel,
                        f"the numbers of '{channel}' are {actual}, not {read}",
                        f"state that under [channels.{channel}]: rotation = ...",
                        _reread(channel, numbers, matrix),
                    )
                )
    return tuple(out)


def _reread(
    channel: str, numbers: Callable[[Float], Float], matrix: Callable[[Float], Float], size: float = 1.0
) -> Callable[[Dataset], Dataset]:
    def change(d: Dataset) -> Dataset:
        old = d.channel(channel)
        values = np.ascontiguousarray(matrix(size * numbers(old.values)))
        return replace(d, channels={**d.channels, channel: replace(old, values=values)})

    return change
