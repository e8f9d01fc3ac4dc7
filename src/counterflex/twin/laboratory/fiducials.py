"""The simulated laboratory measures fiducials: points whose places in the base are known, looked at by the tracker."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress
from counterflex.core.units import UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.twin.laboratory.laboratory import Laboratory, Measured
from counterflex.twin.truth.truth import Truth

KNOWN_M = 20.0 * UM
"""Standard deviation, per axis, with which the places of the fiducials in the base are known."""
ROUND_S = 1800.0


def measure(
    truth: Truth,  # noqa: ARG001
    laboratory: Laboratory,
    request: Mapping[str, Float],
    settings: Mapping[str, Any],
    progress: Progress,
) -> Measured:
    """Fiducials, in one round or several.

    Args:
        truth: Not used: the fiducials stand on the foot of the robot.
        laboratory: Where the tracker is, and its noise.
        request: ``x_m``, ``y_m``, ``z_m`` in the base.
        settings: ``rounds`` (1), and how the tracker moves from one round to the next: ``drift_um`` and
            ``drift_urad``, [x, y, z] in its axes (none).
        progress: Told when done.

    Returns:
        ``p_base_fiducial``, ``p_tracker_fiducial``, ``time_s``; the group is the fiducial.

    Raises:
        InputError: A column is missing.
    """
    missing = [name for name in ("x_m", "y_m", "z_m") if name not in request]
    if missing:
        raise InputError("the request has no places of fiducials", value=missing)
    places = np.stack([np.asarray(request[name], dtype=np.float64) for name in ("x_m", "y_m", "z_m")], axis=-1)
    n, rounds = len(places), int(settings.get("rounds", 1))
    noise = laboratory.noise("fiducials")
    known = places + KNOWN_M * noise.standard_normal((n, 3))
    shift = np.array(settings.get("drift_um", [0.0, 0.0, 0.0]), dtype=np.float64) * UM
    turn = np.array(settings.get("drift_urad", [0.0, 0.0, 0.0]), dtype=np.float64) * URAD
    seconds = np.repeat(ROUND_S * np.arange(rounds), n) + 20.0 * np.tile(np.arange(n), rounds)
    rows = []
    for k in range(rounds):
        T_base_tracker = laboratory.T_base_tracker @ pose.make(rotation.exp(k * turn), k * shift)
        seen = pose.transform(pose.inverse(T_base_tracker), places)
        rows.append(seen + laboratory.tracker_m * noise.standard_normal((n, 3)))
    progress(1.0, f"{n} fiducials")
    return Measured(
        channels={
            "p_base_fiducial": np.tile(known, (rounds, 1)),
            "p_tracker_fiducial": np.concatenate(rows),
            "time_s": seconds[:, None],
        },
        sigma={"p_base_fiducial": KNOWN_M, "p_tracker_fiducial": laboratory.tracker_m},
        group=np.tile(np.arange(1, n + 1, dtype=np.int64), rounds),
    )
