"""The simulated laboratory measures fiducials: points whose places in the base are known, looked at by the tracker."""

from __future__ import annotations

import numpy as np

from counterflex.core.units import UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order

KNOWN_M = 20.0 * UM
"""Standard deviation, per axis, with which the places of the fiducials in the base are known."""
ROUND_S = 1800.0


@Measurement
def measure(order: Order) -> Measured:
    """Fiducials, in one round or several.

    ``order``: Request: ``x_m``, ``y_m``, ``z_m`` in the base. Settings: ``rounds`` (1), and how the tracker moves from
    one round to the next: ``drift_um`` and ``drift_urad``, [x, y, z] in its axes (none).

    Returns:
        ``p_base_fiducial``, ``p_tracker_fiducial``, ``time_s``; the group is the fiducial.

    Raises:
        InputError: A column is missing.
    """
    _truth, laboratory, _request, settings, progress = order
    places = order.columns("x_m", "y_m", "z_m")
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
