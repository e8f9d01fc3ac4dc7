"""A motion that shows delays: the tool swings along all three axes of the base with rising frequency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MS, UM
from counterflex.geometry import pose
from counterflex.identify.data.model import CellModel
from counterflex.identify.delays.delay import Pair, build
from counterflex.identify.delays.stamped import Stamped
from counterflex.identify.recipe import Proposal
from counterflex.identify.timing.start_pose import over_part
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import inverse_path

CYCLE_S: Final = 4.0 * MS
FREQUENCY_HZ: Final = {"program": (0.15, 1.2), "correction": (0.15, 4.0)}
"""A lag of a sensor interface shows by its phase, near its bandwidth; all else is sought where the arm follows."""
SPEED_M_S: Final = 0.05
ACCELERATION_M_S2: Final = 0.3
_MOST_M = 20.0 * MM
_TRACKER_M = 15.0 * UM
_TURNS = (1.0, 1.13, 0.87)


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """A chirp of the commanded tool tip for a record of ``count`` seconds.

    The amplitude falls with the frequency so that speed and acceleration stay bounded; the three axes have slightly
    different frequencies so that they can be told apart.

    Args:
        cell: Its robot controller is to follow.
        count: Length of the record, s; 5 to 120.
        settings: ``through``: ``program`` (default) or ``correction`` (sensor interface); ``seed`` is not used.

    Returns:
        Columns ``time_s``, ``x_m y_m z_m`` (commanded tip in the base), ``q1_rad`` ... ``q6_rad``; expected standard
        deviations of delay and lag of a tracker with 15 um.

    Raises:
        InputError: ``count`` or ``through`` out of range.
        ReachError: The joints do not allow the motion where the part lies.
    """
    if not 5 <= count <= 120:
        raise InputError("length of the record", value=f"{count} s", limit="5 .. 120 s")
    through = str(settings.get("through", "program"))
    if through not in ("program", "correction"):
        raise InputError("through", value=through, limit="program, correction")
    chain = cell.nominal_chain
    q0 = over_part(cell)
    t: Float = CYCLE_S * np.arange(round(count / CYCLE_S) + 1, dtype=np.float64)
    T = forward(chain, q0)
    tip: Float = T[:3, 3] + chirp(t, FREQUENCY_HZ[through])
    q = inverse_path(chain, pose.make(np.broadcast_to(T[:3, :3], (len(t), 3, 3)), tip), q0).q
    columns = {"time_s": t, **{f"{a}_m": tip[:, i] for i, a in enumerate("xyz")}}
    columns |= {f"q{i + 1}_rad": q[:, i] for i in range(6)}
    return Proposal(
        recipe="timing",
        kind="record",
        columns=columns,
        expected=_expected(t, tip),
        remarks=(
            f"{count} s; record command, position reported by the controller, tracker and force over the whole "
            f"time, each with the time stamps of its own clock",
        ),
        settings={"through": through},
        units={"tracker.delay": "s", "tracker.lag": "s"},
    )


def chirp(time_s: Float, band_hz: tuple[float, float]) -> Float:
    """Displacement (n, 3) m: sines of frequency rising through a band, bounded in speed and acceleration."""
    span = as_positive("length of the chirp", float(time_s[-1]))
    low, high = band_hz
    out: Float = np.empty((len(time_s), 3))
    fade = np.clip(np.minimum(time_s, span - time_s) / 1.0, 0.0, 1.0)
    fade = fade * fade * (3.0 - 2.0 * fade)
    for axis, turn in enumerate(_TURNS):
        f = turn * (low + (high - low) * time_s / span)
        phase = 2.0 * np.pi * turn * (low * time_s + 0.5 * (high - low) * time_s**2 / span)
        w = 2.0 * np.pi * f
        size = np.minimum(np.minimum(SPEED_M_S / w, ACCELERATION_M_S2 / w**2), _MOST_M)
        out[:, axis] = fade * size * np.sin(phase)
    return out


def _expected(t: Float, tip: Float) -> dict[str, float]:
    """Standard deviations of a tracker's delay and lag behind the command, white noise."""
    command = Stamped("p_base_command", t, tip, np.full(tip.shape, _TRACKER_M), "controller", (), "")
    answer = Stamped("p_tracker_target", t, tip, np.full(tip.shape, _TRACKER_M), "controller", (), "")
    pair = Pair("tracker", command, answer, tuple("xyz"), ("x m", "y m", "z m"), mixing="matrix")
    parameters, block, start, _ = build(pair, "first", 0.0)
    J = block.jacobian(start).reshape(-1, len(parameters))
    scale = np.linalg.norm(J, axis=0)
    covariance = np.linalg.inv((J / scale).T @ (J / scale)) / np.outer(scale, scale)
    sigma = np.sqrt(np.diag(covariance))
    return {name: float(sigma[parameters.index(name)]) for name in ("tracker.delay", "tracker.lag")}
