"""Orientations in which a flange sensor shows its zero, weight and mounting best (greedy, D-optimal)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, ReachError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import greedy
from counterflex.identify.payload.data import readings, sensor_before
from counterflex.identify.payload.hose_pack import ROWS_PER_FUNCTION, degrees_of
from counterflex.identify.payload.residuals import Knowledge, SensorEffects, parameters
from counterflex.identify.recipe import Proposal
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.model.controller_axes import coupled_inside
from counterflex.sensing.flange_sensor import COUNTS

CANDIDATES = 400
FORCE_N, MOMENT_NM = 1.0, 0.1
"""Standard deviations of a reading that expected ones are computed with, unless settings say otherwise."""
HEIGHT_M = 0.3
"""Least height of the tool tip above the base."""
_SWING_RAD = 20.0 * DEG  # of axes 1 to 3 about the middle posture
_WRIST_RAD = 175.0 * DEG
NEAR_SHARE = 1.0 / 3.0
"""Share of the orientations that stand about the working posture."""
_NEAR_ARM_RAD, _NEAR_WRIST_RAD = 5.0 * DEG, 25.0 * DEG
_NEAR_STREAM = 1
_ABOVE_M = 100.0 * MM


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Choose orientations within limits that make zero, weight, mounting and hose pack observable.

    Of random postures near the part, wrist turned any way, tool above ``height_m``, those are taken one by one that
    raise the determinant of the information most (priors counted). A share of them stands about the posture in which
    programs work, where the rest that no function holds matters most. Then ordered cheapest to drive: nearest next.

    ``count``: How many, at least 3. ``settings``: ``seed``; ``height_m`` least height of the tool tip above the base;
    ``force_n`` and ``moment_nm`` noise of a reading; ``hose`` degree of the hose pack (``auto``: 1 from 20
    orientations); ``near_share`` of the orientations about the working posture, never more than leaves three others.

    Raises:
        InputError: Fewer than 3, or no posture that meets the limits.
    """
    if count < 3:
        raise InputError("orientations to propose", value=count, limit=">= 3 (8 or more for a check)")
    hose, degrees = str(settings.get("hose", "auto")), degrees_of(settings, count)
    many = count >= ROWS_PER_FUNCTION * (COUNTS[1] + 1)
    degree = int(many) if hose == "auto" else max(degrees, default=0)
    sensor, chain = sensor_before(cell), cell.chain
    seed, height_m = int(settings.get("seed", 0)), float(settings.get("height_m", HEIGHT_M))
    near = _near_count(count, float(settings.get("near_share", NEAR_SHARE)))
    q = np.concatenate([working_postures(cell, near, seed, height_m), candidates(cell, seed, height_m)])
    sigma = np.repeat([float(settings.get("force_n", FORCE_N)), float(settings.get("moment_nm", MOMENT_NM))], 3)
    data = of_arrays("candidates", "sensor_poses", {"q": q, "w_sensor": np.zeros((len(q), 6))}, {"w_sensor": sigma})
    block = readings(data, chain, sensor, reference_c=sensor.reference_c, start_s=0.0, window_s=0.1)
    free = parameters(replace(sensor, w_offset=np.zeros((0, 6))), Knowledge(), SensorEffects(degree=degree))
    mask = free.free
    J = block.jacobian(free.nominal)[:, :, mask] * free.slope(free.nominal)[mask]
    # Those about the working posture are taken whatever they tell: what no function holds matters most there.
    rows, covariance = greedy(J, count, fixed=near)
    rows = _near_next(q[rows], rows)
    sd = np.sqrt(np.diag(covariance)) * free.slope(free.nominal)[mask]
    names = [p.name for p, f in zip(free, mask, strict=True) if f and not p.name.startswith("offset")]
    return Proposal(
        recipe="payload",
        kind="sensor_poses",
        columns={f"q{i + 1}_rad": q[rows, i] for i in range(6)},
        expected=dict(zip(names, (float(v) for v in sd[: len(names)]), strict=True)),
        units={name: free.units[name] for name in names},
        remarks=(
            "No contact and no cut: spindle off, coolant and hoses as in operation",
            "Wait at each orientation until the arm is still (1 s), then average the reading over 0.5 s or more",
            "Note temperature and time of each reading; repeat the first orientation at the end to see the drift",
            f"Expected standard deviations hold for readings with {sigma[0]:g} N and {sigma[3]:g} N m, hose pack of "
            f"degree {degree} included",
            f"{near} of them are within {_NEAR_WRIST_RAD / DEG:.0f} deg of the wrist around the working posture",
        ),
        settings={"sensor_segment": sensor.segment},
    )


def candidates(cell: CellModel, seed: int, height_m: float) -> Float:
    """Postures (n, 6) rad near the part with the wrist turned any way, tool tip at least so high above the base.

    Raises InputError: none meets the limits.
    """
    chain = cell.chain
    rng = np.random.default_rng(seed)
    limits = chain.joint_limits_rad + np.array([1.0, -1.0]) * cell.joint_margin_rad
    middle = _middle(cell, chain, limits)
    low = np.maximum(limits[:, 0], np.r_[middle[:3] - _SWING_RAD, np.full(3, -_WRIST_RAD)])
    high = np.minimum(limits[:, 1], np.r_[middle[:3] + _SWING_RAD, np.full(3, _WRIST_RAD)])
    bent = 4
    if middle[bent] > 0.0:  # the wrist stays on the side that the programs use: hoses lie differently on the other
        low[bent] = max(low[bent], 0.0)
    else:
        high[bent] = min(high[bent], 0.0)
    q: Float = rng.uniform(low, high, (6 * CANDIDATES, 6))
    allowed = coupled_inside(chain.axes, chain.joint_limits_rad, q, cell.joint_margin_rad)
    q = q[allowed & (forward(chain, q)[:, 2, 3] >= height_m)][:CANDIDATES]
    if len(q) < 3:
        raise InputError(
            "no posture keeps the tool at the requested height",
            where=cell.name,
            value=f"{height_m} m above the base",
            hint="Lower the setting height_m",
        )
    return q


def working_postures(cell: CellModel, count: int, seed: int, height_m: float) -> Float:
    """Postures (count, 6) rad about the one in which programs are run, tool above the part and the height asked for.

    The working posture has the tool square to the part's zero plane, turned about itself as the cell says, over the
    middle of the blank.

    ``count``: How many; 0 gives none. ``height_m``: Least height of the tool tip above the base. Raises InputError:
    none meets the limits.
    """
    if count == 0:
        return np.zeros((0, 6))
    chain = cell.chain
    rng = np.random.default_rng([seed, _NEAR_STREAM])
    limits = chain.joint_limits_rad + np.array([1.0, -1.0]) * cell.joint_margin_rad
    middle = _working(cell, chain, height_m)
    least = max(height_m, float(cell.T_base_part[2, 3]))
    swing = np.r_[np.full(3, _NEAR_ARM_RAD), np.full(3, _NEAR_WRIST_RAD)]
    low, high = np.maximum(limits[:, 0], middle - swing), np.minimum(limits[:, 1], middle + swing)
    q: Float = rng.uniform(low, np.maximum(low, high), (20 * count + 40, 6))
    allowed = coupled_inside(chain.axes, chain.joint_limits_rad, q, cell.joint_margin_rad)
    q = q[allowed & (q[:, 4] * middle[4] > 0.0) & (forward(chain, q)[:, 2, 3] >= least)][:count]
    if len(q) < count:
        raise InputError(
            "too few postures near the working posture keep the tool above the part",
            where=cell.name,
            value=len(q),
            limit=count,
            hint="Lower the setting height_m, or set near_share = 0",
        )
    return q


def _near_count(count: int, share: float) -> int:
    if not 0.0 <= share <= 1.0:
        raise InputError("setting near_share", value=share, limit="0 to 1")
    return max(0, min(round(share * count), count - 3))


def _near_next(q: Float, rows: Int) -> Int:
    """The rows in an order with short moves: always the nearest that is left."""
    order, remaining = [0], list(range(1, len(rows)))
    while remaining:
        here = order[-1]
        nearest = remaining[int(np.argmin(np.abs(q[remaining] - q[here]).max(axis=1)))]
        order.append(nearest)
        remaining.remove(nearest)
    out: Int = rows[np.array(order)]
    return out


def _middle(cell: CellModel, chain: ElasticChain, limits: Float) -> Float:
    """A posture at the part, or the middle of the limits where the part is out of reach as it stands."""
    target = np.array(cell.T_base_part)
    target[:3, :3] = target[:3, :3] @ np.diag([1.0, -1.0, -1.0])  # tool down on the part
    return _reached(cell, chain, limits, target)


def _working(cell: CellModel, chain: ElasticChain, height_m: float) -> Float:
    """The posture in which programs are run, tool over the middle of the blank and at least so high."""
    box = np.zeros((2, 3)) if cell.blank_part is None else cell.blank_part
    over = np.array([*box.mean(axis=0)[:2], box[1, 2] + _ABOVE_M])
    down = rotation.about_z(cell.rotation_about_tool_rad) @ np.diag([1.0, -1.0, -1.0])
    target = cell.T_base_part @ pose.make(down, over)
    target[2, 3] = max(target[2, 3], height_m + _ABOVE_M)
    limits = chain.joint_limits_rad + np.array([1.0, -1.0]) * cell.joint_margin_rad
    return _reached(cell, chain, limits, target)


def _reached(cell: CellModel, chain: ElasticChain, limits: Float, target: Float) -> Float:
    try:
        q: Float = inverse(chain, target, cell.branch).q
    except (ReachError, InputError):
        q = limits.mean(axis=1)
    out: Float = np.clip(q, limits[:, 0], limits[:, 1])
    return out
