"""Which loads to hang on and cut off, and where, so that every motor yields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import URAD
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.recipe import Proposal
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.model.description import Servo

FORCE_N: Final = 500.0
CANDIDATES: Final = 60
USUAL_NM_S: Final = (1.5e5, 1.8e5, 1.0e5, 1.0e4, 1.1e4, 4.8e3)
"""K of a large robot, where the cell file has none, for the choice only."""
_ENCODER_RAD = 0.5 * URAD
_SEEN = 40.0
_CORRELATED = 20.0


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and cable forces of ``count`` load steps.

    Chosen one after another so that the sum over the axes of the logarithm of the squared motion grows most.

    ``count``: Load steps; at least 3. ``settings``: ``seed`` of the candidates, ``force_n``.

    Returns:
        ``q1_rad`` ... ``q6_rad``, ``fx_n fy_n fz_n`` (what the cable pulls the tool with, base axes); expected
        standard deviations of K of each axis (without the error of the torque's scale).

    Raises:
        InputError: Fewer than 3 load steps.
        ReachError: Hardly any pose can be measured.
    """
    if count < 3:
        raise InputError("load steps to propose", value=count, limit=">= 3")
    force = float(settings.get("force_n", FORCE_N))
    rng = np.random.default_rng(int(settings.get("seed", 0)))
    q = measurable(cell, CANDIDATES, rng, around_part=0.7)
    way = rng.standard_normal((len(q), 8, 3))
    way[:, :, 2] = -np.abs(way[:, :, 2])  # cables pull down or sideways
    way *= force / np.linalg.norm(way, axis=2, keepdims=True)
    torque = np.einsum("nca,nwc->nwa", jacobian(cell.chain, q)[:, :3, :], way)
    swing = 0.4 * torque / stiffness(cell) / _ENCODER_RAD
    total = np.full(6, 1.0)
    picked: list[tuple[int, int]] = []
    for _ in range(count):
        gain = np.sum(np.log(total + swing**2), axis=2)
        for pose, turn in picked:
            gain[pose, turn] = -np.inf
        best = np.unravel_index(int(np.argmax(gain)), gain.shape)
        picked.append((int(best[0]), int(best[1])))
        total = total + swing[picked[-1]] ** 2
    poses, turns = np.array([p for p, _ in picked]), np.array([t for _, t in picked])
    columns = {f"q{i + 1}_rad": q[poses, i] for i in range(6)}
    columns |= {f"f{a}_n": way[poses, turns, i] for i, a in enumerate("xyz")}
    gains = _gains(cell)
    expected = {f"axis{a + 1}.speed_gain": float(gains[a] * _CORRELATED / np.sqrt(_SEEN * total[a])) for a in range(6)}
    return Proposal(
        "servo",
        "servo_steps",
        columns,
        expected,
        remarks=(
            f"hang {force:.0f} N on a cable in the given direction, let the arm rest, start the trace of the "
            f"controller (command, motor angle and torque of all axes), release the cable, record one more second",
        ),
        units=dict.fromkeys(expected, "N m s/rad"),
    )


def stiffness(cell: CellModel) -> Float:
    """(6,) N m/rad: ``K Kv`` of the axes."""
    known: tuple[Servo | None, ...] = cell.robot.servo or (None,) * 6
    rate = np.array([20.0 if s is None else s.position_gain_per_s for s in known])
    out: Float = _gains(cell) * rate
    return out


def _gains(cell: CellModel) -> Float:
    known: tuple[Servo | None, ...] = cell.robot.servo or (None,) * 6
    return np.array([USUAL_NM_S[a] if s is None else s.speed_gain_nm_s for a, s in enumerate(known)])
