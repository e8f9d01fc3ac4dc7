"""Pulls at the simulated cell: a cable pulls at the tool, a tracker watches a target on the spindle.

Each pull is a small experiment of its own on the moving robot, with drives, dry friction and play: the pose is
approached from one side, the target is read, the load comes on, and, with the history ``approached again``, the pose
is left and approached once more the same way before the second reading.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MRAD
from counterflex.geometry import pose
from counterflex.twin.laboratory import distance_frame
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_move import move

INSTRUMENTS: Final = ("tracker", "frame")
HISTORIES: Final = ("approached again", "held", "relaxed")
READINGS: Final = 10
"""Readings of the tracker that are averaged."""
FORCE_SHARE: Final = 0.002
"""Standard deviation of the force that a cable and weight give, relative."""
APPROACH_RAD: Final = -0.7 * MRAD
_MOVE_S, _REST_S = 0.6, 0.6  # as slow as it takes for the arm not to ring: ringing would shake the friction loose


@Measurement
def measure(order: Order) -> Measured:
    """Displacement of the tracker target under loads at the tool tip.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``, ``fx_n``, ``fy_n``, ``fz_n`` (base axes), each (n,). Settings:
    ``history``: ``approached again`` (default), ``held`` (the load comes on while the axes hold still) or ``relaxed``
    (static equilibrium without friction; play only); ``readings`` averaged; ``approach_rad`` (6,): where each pose is
    approached from, angles there minus those of the pose; ``axes``: ``tracker`` (default) or ``base``; ``instrument``:
    ``tracker`` (default), or ``frame``: the distance sensors of :mod:`counterflex.twin.laboratory.distance_frame`
    instead, whose raw readings are given.

    Returns:
        ``q``, ``approach`` (n, 6) rad, ``f_tcp_base`` (n, 3) N as weighed, ``d_tracker_target`` (n, 6) or
        ``d_tcp_base`` (n, 6) m, rad, or ``s_unloaded`` and ``s_loaded`` (n, 8) m.

    Raises:
        InputError: A column is missing or a setting is unknown.
        SimulationError: The load is beyond what the robot carries.
    """
    truth, laboratory, _request, settings, progress = order
    q, force = order.q, order.force
    history = str(settings.get("history", HISTORIES[0]))
    axes = str(settings.get("axes", "tracker"))
    instrument = str(settings.get("instrument", INSTRUMENTS[0]))
    if instrument not in INSTRUMENTS:
        raise InputError("instrument of the pulls", value=instrument, limit=", ".join(INSTRUMENTS))
    if history not in HISTORIES or axes not in ("tracker", "base"):
        raise InputError("setting of the pulls", value=f"{history}, {axes}", limit=", ".join(HISTORIES))
    readings = int(settings.get("readings", READINGS))
    if readings < 1:
        raise InputError("readings of the tracker", value=readings, limit=">= 1")
    n = len(q)
    approach = np.broadcast_to(as_float("approach_rad", settings.get("approach_rad", np.full(6, APPROACH_RAD))), (n, 6))
    noise = laboratory.noise("pulls")
    applied = force * (1.0 + FORCE_SHARE * noise.standard_normal((n, 1)))
    plant = Plant(truth)
    ends = np.empty((n, 2, 4, 4))
    for row in range(n):
        load = np.concatenate([applied[row], np.zeros(3)])
        ends[row] = pull(plant, q[row], load, approach[row], history, plant.tcp_pose)
        progress((row + 1) / n, f"pull {row + 1} of {n}")
    recorded: dict[str, Any] = {"readings": readings, "history": history}
    plain = {"q": q, "approach": np.array(approach), "f_tcp_base": force}
    weighed = {"f_tcp_base": np.maximum(FORCE_SHARE * np.abs(force), 0.1)}
    if instrument == INSTRUMENTS[1]:
        shown, sigma_m = distance_frame.read(ends, laboratory.noise("distance frame"), readings)
        return Measured(
            channels={**plain, "s_unloaded": shown[:, 0], "s_loaded": shown[:, 1]},
            sigma={**weighed, "s_unloaded": sigma_m, "s_loaded": sigma_m},
            group=groups_of(q),
            settings={**recorded, "sensor_axes": "tcp"},
            sensors=distance_frame.described(),
        )
    T_tracker_base = pose.inverse(laboratory.T_base_tracker)
    T_tcp_target = laboratory.T_tcp_target
    if axes == "base":
        T_tracker_base, T_tcp_target = np.eye(4), np.eye(4)
    seen = T_tracker_base @ ends @ T_tcp_target
    d = pose.difference(seen[:, 0], seen[:, 1])
    sigma = np.repeat([laboratory.tracker_m, laboratory.tracker_rad], 3) * np.sqrt(2.0 / readings)
    d = d + sigma * noise.standard_normal((n, 6))
    name = "d_tracker_target" if axes == "tracker" else "d_tcp_base"
    return Measured(channels={**plain, name: d}, sigma={name: sigma, **weighed}, group=groups_of(q), settings=recorded)


def pull(
    plant: Plant, q: Float, w_tcp_base: Float, approach: Float, history: str, read: Callable[[], Float]
) -> tuple[Float, Float]:
    """Readings without and with load.

    Args:
        q: (6,) rad.
        w_tcp_base: (6,) N, N m on the tool about its tip in base axes.
        approach: (6,) rad, from where the pose is approached, minus ``q``.
        history: One of :data:`HISTORIES`.
        read: Takes a reading of the plant as it is.

    Returns:
        The reading without load and the one with it.
    """
    if history == "relaxed":
        plant.reset(q)
        unloaded = read()
        plant.reset(q, w_tcp_base)
        return unloaded, read()
    plant.reset(q + approach)
    move(plant, q, move_s=_MOVE_S, rest_s=_REST_S)
    unloaded = read()
    again = history == HISTORIES[0]
    move(plant, q, w_tcp_base, move_s=_MOVE_S, rest_s=0.1 if again else _REST_S)
    if again:
        move(plant, q + approach, w_tcp_base, move_s=_MOVE_S, rest_s=0.0)
        move(plant, q, w_tcp_base, move_s=_MOVE_S, rest_s=_REST_S)
    return unloaded, read()


def groups_of(q: Float) -> Int:
    """Ids of rows at the same pose."""
    _, ids = np.unique(np.round(q, 9), axis=0, return_inverse=True)
    return np.asarray(ids, dtype=np.int64).reshape(-1)
