"""Choose reversals to measure: for every axis balanced and loaded poses, slow and slower, far from the axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MRAD, UM
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.play.data import ReversalMotion
from counterflex.identify.play.parameters import axis_play, blocks, parameters
from counterflex.identify.recipe import Proposal
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.play import axis_torque

TURNS: Final = (0.0, -1.0, 1.0, -1.0, 0.25, -0.25, 0.0)
"""Where the axis reverses, in amplitudes from the pose."""
AMPLITUDE_RAD: Final = (0.4 * MRAD, 0.4 * MRAD, 0.4 * MRAD, 0.6 * MRAD, 0.6 * MRAD, 0.6 * MRAD)
SPEEDS_RAD_S: Final = ((0.25 * MRAD, 0.5 * MRAD),) * 3 + ((0.5 * MRAD, 1.0 * MRAD),) * 3
"""Slow enough that the link, caught by the gear at the end of its play, hardly rings: the amplitude is speed over the
lowest mode's angular frequency."""
CANDIDATES: Final = 1000
FIRM: Final = 1.6
"""An axis that stands still while another one moves keeps its flank where its weight exceeds its dry friction by this
factor, or falls below by it; in between the link creeps across its play."""
_STEP_S = 0.02
_TRACKER_M = 4.0 * UM


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and speeds of ``count`` motions, dealt to the six axes in turn.

    Per axis one pose is balanced (its weight turns the gear neither way, so that the dead band shows), one loaded (so
    that only friction shows): two motions of an axis are one of each, the slower one balanced. The next two are the
    same poses at the other speed (a delay grows with the speed, play does not), further ones are in further poses. The
    other axes stand firmly on one flank of their gears; of the poses that qualify the one with the longest lever is
    taken.

    ``count``: Motions; at least 12 (two of each axis). ``settings``: ``seed`` of the candidates.

    Returns:
        A row for each motion: pose ``q1_rad`` ... ``q6_rad``, ``axis`` (1..6), ``amplitude_rad``,
        ``speed_rad_s``; expected standard
        deviations of half bands and friction.

    Raises:
        InputError: Fewer than 12 motions.
        ReachError: Hardly any pose can be measured.
    """
    if count < 12:
        raise InputError("motions to propose", value=count, limit=">= 12, two of each axis")
    chain = cell.chain
    rng = np.random.default_rng(int(settings.get("seed", 0)))
    q = measurable(cell, CANDIDATES, rng)
    torque, lever = axis_torque(chain, q), np.linalg.norm(jacobian(chain, q)[:, :3, :], axis=1)
    rows: list[tuple[int, int, float]] = []
    unbalanced = []
    used: list[set[int]] = [set() for _ in range(6)]
    pairs: list[list[int]] = [[] for _ in range(6)]
    for k in range(count):
        axis, turn = k % 6, k // 6
        loaded = turn % 2
        if turn % 4 < 2:
            pose, balanced = _choose(cell, axis, torque, lever[:, axis], loaded, used[axis])
            used[axis].add(pose)
            pairs[axis] = [*pairs[axis][-1:], pose]
            if not loaded and not balanced:
                unbalanced.append(axis + 1)
        else:
            pose = pairs[axis][loaded]
        rows.append((axis, pose, SPEEDS_RAD_S[axis][loaded if turn % 4 < 2 else 1 - loaded]))
    rows.sort(key=lambda row: (row[0], row[1], row[2]))
    poses = q[[pose for _, pose, _ in rows]]
    axes = np.array([axis for axis, _, _ in rows])
    speeds = np.array([speed for _, _, speed in rows])
    remarks = [
        "turn the axis from the pose by -1, 1, -1, 0.25, -0.25 and 0 amplitudes with rounded corners and record motor "
        "angles, tracker (mean of 20 readings every 20 ms) and, where there is one, the motor's torque",
        "approach each pose slowly and let the arm rest; motions of one axis follow one another",
    ]
    if unbalanced:
        which = ", ".join(map(str, sorted(set(unbalanced))))
        remarks.append(
            f"no pose balances axis {which}: its dead band will hardly be determined, and "
            f"hardly matters if its load never changes its sign"
        )
    columns = {f"q{i + 1}_rad": poses[:, i] for i in range(6)}
    columns |= {"axis": axes + 1.0, "amplitude_rad": np.array(AMPLITUDE_RAD)[axes], "speed_rad_s": speeds}
    expected, units = _expected(cell, chain, poses, axes, speeds)
    return Proposal("play", "reversals", columns, expected, tuple(remarks), units=units)


def motion(amplitude_rad: float, speed_rad_s: float) -> tuple[Float, Float]:
    """Times (n,) s and angles (n,) rad from the pose of one motion: straight lines between :data:`TURNS`."""
    corners = np.array(TURNS) * amplitude_rad
    at = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / speed_rad_s)])
    t = np.arange(0.0, at[-1] + 0.5 * _STEP_S, _STEP_S)
    return t, np.interp(t, at, corners)


def _choose(cell: CellModel, axis: int, torque: Float, lever: Float, turn: int, used: set[int]) -> tuple[int, bool]:
    """A candidate: balanced for even turns, loaded for odd ones; the other axes firmly on one flank where possible."""
    friction = np.array([sum(axis_play(cell, a)[0].friction_nm) for a in range(6)])
    others = [a for a in range(1, 6) if a != axis]
    load = np.maximum(np.abs(torque[:, others]), 1e-6) / friction[others]
    # By logarithm: friction that is misjudged by a factor shifts all loads alike, whichever side of it they are on.
    firm = np.min(np.abs(np.log(load)), axis=1)
    free = np.array([i not in used for i in range(len(torque))])
    size = np.abs(torque[:, axis]) / friction[axis]
    fits = free & (size < 0.3 if turn % 2 == 0 else size > 2.0)
    if not fits.any():
        best = int(np.argmin(np.where(free, size if turn % 2 == 0 else -size, np.inf)))
        return best, bool(size[best] < 0.7)
    steady = fits & (firm > np.log(FIRM))
    if not steady.any():
        return int(np.argmax(np.where(fits, firm, -1.0))), True
    return int(np.argmax(np.where(steady, lever, -1.0))), True


def _expected(
    cell: CellModel, chain: ElasticChain, q: Float, axes: Float, speeds: Float
) -> tuple[dict[str, float], dict[str, str]]:
    """Expected standard deviations and their SI units, by name."""
    out: dict[str, float] = {}
    units: dict[str, str] = {}
    for axis in range(6):
        p, places = parameters(cell, axis, free_compliance=False, delay=True)
        runs = []
        for k in np.flatnonzero(axes == axis):
            t, moved = motion(AMPLITUDE_RAD[axis], float(speeds[k]))
            angles = np.repeat(q[k][None], len(t), axis=0)
            angles[:, axis] += moved
            lever = float(np.linalg.norm(jacobian(chain, q[k])[:3, axis]))
            runs.append(
                ReversalMotion(
                    int(k),
                    axis,
                    "tracker",
                    angles[:, axis],
                    axis_torque(chain, angles)[:, axis],
                    t,
                    lever * angles[:, axis],
                    np.full(len(t), _TRACKER_M),
                    None,
                    "",
                )
            )
        if not runs:
            continue
        free = np.flatnonzero(p.free)
        slope = p.slope(p.nominal)[free]
        information = np.diag([1.0 if p.items[i].has_prior else 0.0 for i in free])
        for block in blocks(runs, places):
            J = block.jacobian(p.nominal)[:, 0][:, free] * slope
            information = information + J.T @ J
        sigma = np.sqrt(np.diag(np.linalg.inv(information))) * slope
        out |= {p.names[i]: float(s) for i, s in zip(free, sigma, strict=True)}
        units |= p.units
    return out, units
