"""What to measure for the geometry: poses that make its parameters observable, in an order that keeps travel short."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import candidates_of, choose, expected_sigma, prior_information
from counterflex.identify.design.order import order_of_poses, wrong_sides
from counterflex.identify.design.pose_candidates import in_order, measurable
from counterflex.identify.geometry.arm_parameters import ArmPriors, arm_model
from counterflex.identify.geometry.foreseen import foreseen
from counterflex.identify.geometry.known_frames import known_frames
from counterflex.identify.recipe import Proposal

FEWEST: Final = 8
CANDIDATES: Final = 6
"""Candidates per pose that is chosen, but 400 at most."""


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses of a six-axis tracker target that determine geometry, masses and frames best (D-optimal).

    ``cell``: The cell; with a ``[tracker]`` table only poses that the tracker sees are proposed. ``settings``:
    ``seed``, ``sag`` as in the recipe.

    Raises:
        InputError: Too few.
        ReachError: Hardly any pose can be measured.
    """
    if count < FEWEST:
        raise InputError("too few poses", value=count, limit=f"{FEWEST} or more, better 40")
    rng = np.random.default_rng(int(settings.get("seed", 0)))
    known = known_frames(cell)
    q = measurable(
        cell,
        max(count, min(CANDIDATES * count, 400)),
        rng,
        tracker=None if known is None else known.T_base_tracker[:3, 3],
        p_tcp_target=None if known is None else known.T_tcp_target[:3, 3],
    )
    model = arm_model(cell, ArmPriors(), sag=str(settings.get("sag", "auto")))
    parameters, block = foreseen(model, q, known)
    candidates = candidates_of(parameters, [block])
    choice = choose(candidates.jacobian, count, prior_information(parameters))
    speeds = model.chain.joint_speeds_rad_s
    chosen = in_order(cell.nominal_chain, q[choice.indices])
    chosen = chosen[order_of_poses(chosen, np.ones(6) if speeds is None else speeds)]
    return Proposal(
        recipe="kinematics",
        kind="tracker_poses",
        columns={f"q{i + 1}_rad": chosen[:, i] for i in range(6)},
        expected=expected_sigma(parameters, choice.covariance),
        units=parameters.units,
        remarks=(
            f"{count} of {len(q)} poses within limits, above the floor and clear of the column"
            + (", seen by the tracker." if known is not None else "; line of sight is not checked without [tracker]."),
            f"{int(np.sum(wrong_sides(chosen)))} of {6 * count} times an axis arrives with falling angle; "
            "to take up its play, approach such poses from 2 deg below.",
            "Let the robot rest for a second before each measurement.",
        ),
    )
