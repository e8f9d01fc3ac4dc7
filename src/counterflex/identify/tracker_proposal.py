"""What to measure for the tracker's frame: poses that turn the target about all axes, or fiducials around the robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.identify.known_frames import known_frames
from counterflex.identify.model import CellModel
from counterflex.identify.pose_candidates import in_order, measurable
from counterflex.identify.recipe import Proposal

RADIUS_M: Final = 1.5
_HEIGHTS_M = (0.2, 0.9, 1.6)
_FEWEST = {"poses": 4, "fiducials": 4}


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses (``measure = "poses"``) or places of fiducials (``measure = "fiducials"``).

    Args:
        cell: The cell.
        count: How many.
        settings: ``measure``, ``seed``.

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
        return _fiducials(count)
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
    return Proposal(
        recipe="tracker-frame",
        kind="tracker_poses",
        columns={f"q{i + 1}_rad": q[:, i] for i in range(6)},
        expected={},
        remarks=("Let the robot rest for a second before each measurement.",),
    )


def _fiducials(count: int) -> Proposal:
    """On a circle around the robot's foot, heights in turn, over three quarters of a turn in front of it."""
    angle = np.linspace(-135.0, 135.0, count) * DEG
    height = np.array([_HEIGHTS_M[(2 * i) % 3] for i in range(count)])
    return Proposal(
        recipe="tracker-frame",
        kind="fiducials",
        columns={"x_m": RADIUS_M * np.cos(angle), "y_m": RADIUS_M * np.sin(angle), "z_m": height},
        expected={},
        remarks=(
            "Glue nests for reflectors near these places, on what does not move against the robot's foot.",
            "Measure their places in the base once (by a drawing, a measuring arm, or the robot's own flange).",
            "Measure all of them again at the end: the comparison shows whether the tracker has drifted.",
        ),
    )
