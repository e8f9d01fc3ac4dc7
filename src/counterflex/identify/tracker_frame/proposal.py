"""What to measure for the tracker's frame: poses that turn the target about all axes, or fiducials around the robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM
from counterflex.geometry import pose
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import candidates_of, expected_sigma, prior_information
from counterflex.identify.design.pose_candidates import in_order, measurable
from counterflex.identify.geometry.arm_parameters import ArmPriors, arm_model, sag_as_known
from counterflex.identify.geometry.fiducials import FiducialResiduals
from counterflex.identify.geometry.foreseen import foreseen
from counterflex.identify.geometry.known_frames import KnownFrames, known_frames
from counterflex.identify.geometry.placed_frame import PlacedFrame, frame_parameters
from counterflex.identify.recipe import Proposal
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals

RADIUS_M: Final = 1.5
_HEIGHTS_M = (0.2, 0.9, 1.6)
FIDUCIAL_M: Final = 30.0 * UM
"""What a fiducial is off by per axis: its known place in the base and the tracker's reading of it."""
_FEWEST = {"poses": 4, "fiducials": 4}


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses (``measure = "poses"``) or places of fiducials (``measure = "fiducials"``).

    ``settings``: ``measure``, ``seed``.

    Raises:
        InputError: Too few, or another ``measure``.
        ReachError: Hardly any pose can be measured.
    """
    what = str(settings.get("measure", "poses"))
    if what not in _FEWEST:
        raise InputError("cannot propose that", value=what, limit=" or ".join(_FEWEST))
    if count < _FEWEST[what]:
        raise InputError(f"too few {what}", value=count, limit=f"{_FEWEST[what]} or more")
    if what == "fiducials":
        return _fiducials(count, known_frames(cell))
    rng = np.random.default_rng(int(settings.get("seed", 0)))
    known = known_frames(cell)
    q = measurable(
        cell,
        count,
        rng,
        tracker=None if known is None else known.T_base_tracker[:3, 3],
        p_tcp_target=None if known is None else known.T_tcp_target[:3, 3],
    )
    q = in_order(cell.nominal_chain, q)
    model = arm_model(cell, ArmPriors(), sag=sag_as_known(cell.nominal_chain))
    parameters, block = foreseen(model, q, known)
    expected = _expected(parameters, block)
    expected = {name: sigma for name, sigma in expected.items() if name.startswith("T_")}
    return Proposal(
        recipe="tracker-frame",
        kind="tracker_poses",
        columns={f"q{i + 1}_rad": q[:, i] for i in range(6)},
        expected=expected,
        units={name: parameters.units[name] for name in expected},
        remarks=("Let the robot rest for a second before each measurement.",),
    )


def _fiducials(count: int, known: KnownFrames | None) -> Proposal:
    """On a circle around the robot's foot, heights in turn, over three quarters of a turn in front of it."""
    angle = np.linspace(-135.0, 135.0, count) * DEG
    height = np.array([_HEIGHTS_M[(2 * i) % 3] for i in range(count)])
    places = np.stack([RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), height], axis=-1)
    parameters = Parameters.of(frame_parameters("T_base_tracker", "tracker in the base"))
    T0 = np.eye(4) if known is None else known.T_base_tracker
    block = FiducialResiduals(
        "fiducials",
        np.arange(count, dtype=np.int64),
        np.full((count, 3), FIDUCIAL_M),
        PlacedFrame(T0, np.arange(6, dtype=np.int64)),
        places,
        pose.transform(pose.inverse(T0), places),
    )
    return Proposal(
        recipe="tracker-frame",
        kind="fiducials",
        columns=dict(zip(("x_m", "y_m", "z_m"), places.T, strict=True)),
        expected=_expected(parameters, block),
        units=parameters.units,
        remarks=(
            "Glue nests for reflectors near these places, on what does not move against the robot's foot.",
            "Measure their places in the base once (by a drawing, a measuring arm, or the robot's own flange).",
            "Measure all of them again at the end: the comparison shows whether the tracker has drifted.",
        ),
    )


def _expected(parameters: Parameters, block: Residuals) -> dict[str, float]:
    """Standard deviations of the free parameters after all rows of the block were measured, SI."""
    J = candidates_of(parameters, [block]).jacobian.reshape(-1, int(np.sum(parameters.free)))
    covariance = np.asarray(np.linalg.inv(np.diag(prior_information(parameters)) + J.T @ J), dtype=np.float64)
    return expected_sigma(parameters, covariance)
