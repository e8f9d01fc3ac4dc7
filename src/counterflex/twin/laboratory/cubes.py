"""Measuring cubes on the simulated structure, watched by triangulation sensors that stand beside the robot.

Three sensors look at one face of a cube, two at another, one at the third: together they give its position and
orientation. Each load is an experiment of its own on the moving robot, as in :mod:`counterflex.twin.laboratory.pulls`.
"""

from __future__ import annotations

import itertools
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress
from counterflex.core.units import MM, UM
from counterflex.geometry import pose
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.laboratory.pulls import APPROACH_RAD, FORCE_SHARE, HISTORIES, groups_of, pull
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.truth import Truth

BASE: Final = "base"
TRIANGULATION_M: Final = 1.5 * UM
"""Standard deviation of one reading of a triangulation sensor."""
BASELINE_M: Final = 70.0 * MM
"""Distance of the sensors that look at one face of a cube of 100 mm."""
PLACE_M: Final = 0.2 * MM
"""Standard deviation of where a laser tracker finds a cube, per axis."""
READINGS: Final = 25
OFFSET_M: Final = (0.10, 0.05, 0.15)
"""Where a cube sits on its body, in the body's frame."""


@Measurement
def measure(order: Order) -> Measured:
    """Motions of pairs of cubes under loads at the tool tip.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``, ``fx_n`` ... ``fz_n`` and, where a bar turns the tool, ``mx_nm`` ...
    ``mz_nm``, each (n,), base axes. Settings: ``pairs``: ``["base/axis1", ...]``, bodies before and behind, default
    every body against the one before; ``history``, ``approach_rad`` as for pulls; ``readings`` averaged.

    Returns:
        One row per load and pair: ``q``, ``approach``, ``w_tcp_base`` as weighed, ``pair`` (from 1), and of both cubes
        where they are (``p_base_before``, ``p_base_after``) and how they move (``d_before_base``, ``d_after_base``).

    Raises:
        InputError: A column is missing, or a pair names no bodies.
        SimulationError: The load is beyond what the robot carries.
    """
    truth, laboratory, request, settings, progress = order
    q, force = order.q, order.force
    n = len(q)
    moment = order.columns("mx_nm", "my_nm", "mz_nm") if "mx_nm" in request else np.zeros((n, 3))
    history = str(settings.get("history", HISTORIES[0]))
    readings = int(settings.get("readings", READINGS))
    if history not in HISTORIES or readings < 1:
        raise InputError("setting of the cubes", value=f"{history}, {readings} readings", limit=", ".join(HISTORIES))
    names = [BASE, *(b.name for b in truth.bodies)]
    pairs = [str(p) for p in settings.get("pairs", [])] or _neighbours(truth)
    ends = [_ends(names, p) for p in pairs]
    approach = np.broadcast_to(as_float("approach_rad", settings.get("approach_rad", np.full(6, APPROACH_RAD))), (n, 6))
    noise = laboratory.noise("cubes")
    load = np.hstack([force, moment])
    applied = load * (1.0 + FORCE_SHARE * noise.standard_normal((n, 1)))
    watched = sorted({i for pair in ends for i in pair})
    centres, moves = _motions(truth, q, applied, approach, history, watched, progress)
    sigma = np.array([TRIANGULATION_M] * 3 + [np.sqrt(2.0) * TRIANGULATION_M / BASELINE_M] * 3)
    sigma = sigma * np.sqrt(2.0 / readings)
    moving = np.array([names[i] != BASE for i in watched])
    moves = moves + moving[:, None] * sigma * noise.standard_normal(moves.shape)
    seen = centres + PLACE_M * noise.standard_normal(centres.shape)
    row, place = np.repeat(np.arange(n), len(pairs)), np.tile(np.arange(len(pairs)), n)
    before = np.array([watched.index(a) for a, _ in ends])[place]
    after = np.array([watched.index(b) for _, b in ends])[place]
    share = FORCE_SHARE * np.abs(load[row])
    return Measured(
        channels={
            "q": q[row],
            "approach": np.array(approach)[row],
            "w_tcp_base": load[row],
            "pair": np.array(place + 1, dtype=np.float64)[:, None],
            "p_base_before": seen[row, before],
            "p_base_after": seen[row, after],
            "d_before_base": moves[row, before],
            "d_after_base": moves[row, after],
        },
        sigma={"d_before_base": sigma, "d_after_base": sigma, "w_tcp_base": np.maximum(share, 1e-3)},
        group=groups_of(np.hstack([q, load]))[row],
        settings={"pairs": pairs, "readings": readings, "history": history},
    )


def _cubes(plant: Plant, bodies: list[str | None]) -> Float:
    """(k, 4, 4) poses of the cubes on bodies; None: on the base."""
    bodies_poses = np.stack([np.eye(4) if name is None else plant.body_pose(name) for name in bodies])
    out: Float = bodies_poses @ pose.make(p=np.array(OFFSET_M))
    return out


def _motions(
    truth: Truth, q: Float, load: Float, approach: Float, history: str, watched: list[int], progress: Progress
) -> tuple[Float, Float]:
    """Centres (n, k, 3) m of the watched cubes and their motions (n, k, 6) m, rad."""
    plant = Plant(truth)
    read = partial(_cubes, plant, [None if i == 0 else truth.bodies[i - 1].name for i in watched])
    centres, moves = np.empty((len(q), len(watched), 3)), np.empty((len(q), len(watched), 6))
    for row in range(len(q)):
        unloaded, loaded = pull(plant, q[row], load[row], approach[row], history, read)
        centres[row] = unloaded[:, :3, 3]
        moves[row] = pose.difference(unloaded, loaded)
        progress((row + 1) / len(q), f"load {row + 1} of {len(q)}")
    return centres, moves


def _neighbours(truth: Truth) -> list[str]:
    """Every elastic body against the one before."""
    names = [BASE, *(b.name for b in truth.bodies if b.compliance.any() or b.joint is not None)]
    return [f"{a}/{b}" for a, b in itertools.pairwise(names)]


def _ends(names: list[str], pair: str) -> tuple[int, int]:
    before, _, after = pair.partition("/")
    if before not in names or after not in names or names.index(before) >= names.index(after):
        raise InputError(
            "a pair of cubes names the body before and the one behind", value=pair, limit=" / ".join(names)
        )
    return names.index(before), names.index(after)
