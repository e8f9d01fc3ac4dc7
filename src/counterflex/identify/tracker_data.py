"""From datasets of the tracker to residuals, and the first estimate of its frames with the checks that come before."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM
from counterflex.geometry import pose
from counterflex.identify.arm_geometry import ArmGeometry, displaced_arm
from counterflex.identify.dataset import Dataset
from counterflex.identify.hand_eye import HandEye, robust_of_points, robust_of_poses
from counterflex.identify.model import CellModel
from counterflex.identify.placed_frame import PlacedFrame
from counterflex.identify.pose_residuals import TrackerResiduals

_FEWEST = 4
_WORSE_M = 20.0 * MM


def has_orientation(d: Dataset) -> bool:
    """Whether the target's orientation was measured."""
    return d.has("R_tracker_target")


def tracker_residuals(d: Dataset, arm: ArmGeometry, tracker: PlacedFrame, target: PlacedFrame) -> TrackerResiduals:
    """Residuals of a dataset of poses or points.

    Raises:
        FileFormatError: A channel or its standard deviation is missing.
    """
    position = d.channel("p_tracker_target")
    sigma = position.need_sigma()
    R = None
    if has_orientation(d):
        orientation = d.channel("R_tracker_target")
        R = orientation.values
        sigma = np.concatenate([sigma, orientation.need_sigma()], axis=1)
    return TrackerResiduals(d.name, d.group, sigma, arm, tracker, target, position.values, R)


def start_frames(cell: CellModel, d: Dataset, p_tcp_target: Float | None = None) -> HandEye:
    """Robust first estimate of tracker and target from a dataset of poses or points.

    Raises:
        InputError: Too few poses; poses that do not turn; data that contradict the robot, with what would explain it
            (angles in deg, lengths in mm, a mirrored frame, another convention of angles).
    """
    q, p = d.values("q"), d.values("p_tracker_target")
    distinct = len(np.unique(np.round(q, 5), axis=0))
    if distinct < _FEWEST:
        raise InputError(
            "too few different poses",
            where=d.where,
            value=f"{distinct} of {len(d)} rows",
            limit=f"{_FEWEST} or more",
            hint="Measure poses that differ in position and orientation",
        )
    Ts = _poses(cell, q)
    R = d.values("R_tracker_target") if has_orientation(d) else None
    found = robust_of_points(Ts, p, p_tcp_target) if R is None else robust_of_poses(Ts, pose.make(R, p))
    if found.median_m > _WORSE_M:
        _explain(cell, d, found)
    return found


def _poses(cell: CellModel, q: Float) -> Float:
    return displaced_arm(cell.nominal_chain, q, dict(cell.calibration)).poses(np.zeros(0))


def _explain(cell: CellModel, d: Dataset, found: HandEye) -> None:
    """Name what would make data agree that contradict the robot."""
    q, p = d.values("q"), d.values("p_tracker_target")
    R = d.values("R_tracker_target") if has_orientation(d) else None
    S = np.diag([1.0, 1.0, -1.0])
    trials: list[tuple[str, Float, Float, Float | None]] = [
        ("joint angles are in deg but were read as rad", np.radians(q), p, R),
        ("joint angles are in rad but were read as deg", np.degrees(q), p, R),
        ("positions are in mm but were read as m", q, p * MM, R),
        ("positions are in m but were read as mm", q, p / MM, R),
        ("positions are in inches but were read as mm", q, p * INCH / MM, R),
        ("the tracker's frame is left-handed, or two columns are swapped", q, p @ S, None if R is None else S @ R @ S),
    ]
    if R is not None:
        T = pose.inverse(pose.make(R, p))
        back = np.swapaxes(R, -1, -2)
        trials += [
            ("the pose of the tracker in the target was given instead of the target in the tracker", q, T[:, :3, 3],
             T[:, :3, :3]),
            ("rotations are transposed", q, p, back),
        ]  # fmt: skip
    best: tuple[float, str] | None = None
    for words, q_, p_, R_ in trials:
        try:
            Ts = _poses(cell, q_)
            trial = robust_of_points(Ts, p_) if R_ is None else robust_of_poses(Ts, pose.make(R_, p_))
        except InputError:
            continue
        if best is None or trial.median_m < best[0]:
            best = (trial.median_m, words)
    if R is not None:
        alone = robust_of_points(_poses(cell, q), p)
        if alone.median_m < 0.2 * found.median_m and (best is None or alone.median_m < best[0]):
            best = (
                alone.median_m,
                "positions agree with the robot but orientations do not, so another convention of angles was meant",
            )
    if best is not None and best[0] < 0.2 * found.median_m:
        raise InputError(
            "the measurements contradict the robot",
            where=d.where,
            value=f"median error {found.median_m / MM:.4g} mm",
            hint=f"They agree to {best[0] / MM:.3g} mm if {best[1]}: correct the manifest",
        )
    raise InputError(
        "the measurements contradict the robot",
        where=d.where,
        value=f"median error {found.median_m / MM:.4g} mm",
        limit=f"{_WORSE_M / MM:g} mm",
        hint="Check the order and signs of the joint angles, the robot, units and columns",
    )
