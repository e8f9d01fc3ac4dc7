"""Play and friction from slow reversals of the simulated axes, and what gears and tracker do beside the model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float, rows_of_each
from counterflex.core.units import UM, URAD
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.play import proposal as reversals_proposal, recipe as reversals
from counterflex.identify.recipe import Identification
from counterflex.identify.solver.intervals import intervals
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.reversals import measure
from counterflex.twin.truth.truth import Truth
from coverage_cases.counted import Counted, counted
from coverage_cases.poses import cell, cell_file

MOTIONS = 24
QUICK_MOTIONS = 12
AXES = (1, 4)
CREEP, CREEP_S = 0.10, 0.7
"""Wind-up that comes late: share of what the link lags behind, and its time constant."""
SOFT_RAD = 8.0 * URAD
"""Travel over which a dead band opens and closes that has no sharp ends, one standard deviation."""
POSE = 0.05
"""How far friction and play differ from pose to pose, of themselves, one standard deviation."""
MESH_RAD, MESH_ORDERS = 1.0 * URAD, (200.0, 3000.0)
"""Transmission error of the gear: amplitude, and how often in a turn."""
WALK_M = 0.05 * UM
"""Drift of the tracker from reading to reading."""


@dataclass(frozen=True)
class QuickAxis:
    """Outcome of the short form of the recipe for an axis."""

    axis: int  # 1..6
    seen: str  # how its half dead band is seen
    inside: bool  # the 95 % interval of the half dead band holds the truth
    written: bool  # its values go into the cell file
    link_nm: float  # dry friction on the side of the link as identified
    true_all_nm: float  # true dry friction of link and motor


@cache
def proposal(count: int = MOTIONS) -> dict[str, Float]:
    columns = reversals_proposal.propose(cell(), count, {"seed": 0}).columns
    return {name: np.asarray(values) for name, values in columns.items()}


@cache
def measured(seed: int, axes: tuple[int, ...] = AXES, count: int = MOTIONS) -> dict[str, Float]:
    """Channels of the simulated laboratory, and their groups."""
    request = proposal(count)
    rows = np.isin(request["axis"], np.array(axes) + 1)
    m = measure(truth_of(cell_file(), seed), laboratory(seed), {k: v[rows] for k, v in request.items()}, {})
    group = np.asarray(m.group, dtype=np.float64)
    return {**m.channels, "group": group, "sigma": np.asarray(m.sigma["p_tracker_target"])}


def lagging(steps: Float, values: Float, length: float) -> Float:
    """Values (n,) that follow with a lag, over steps (n,) of time or travel."""
    out, now = np.empty_like(values), values[0]
    for k, (step, value) in enumerate(zip(steps, values, strict=True)):
        now += (value - now) * -np.expm1(-step / length)
        out[k] = now
    return out


def beside(seed: int, time_s: Float, q: Float, lost: Float, place: int) -> Float:
    """(n,) rad: how the link turns beside the model, from its lost motion (n,) rad."""
    gear, pose_ = np.random.default_rng([51, seed]), np.random.default_rng([52, seed, place])
    soft, order, phase = gear.standard_normal(), gear.uniform(*MESH_ORDERS), gear.uniform(0.0, 2.0 * np.pi)
    late = lagging(np.diff(time_s, prepend=time_s[0]), lost, CREEP_S)
    round_ = lagging(np.abs(np.diff(q, prepend=q[0])), lost, SOFT_RAD * abs(soft) + 1e-9)
    return np.asarray(
        CREEP * (late - lost)
        + (round_ - lost)
        + POSE * pose_.standard_normal() * (lost - lost.mean())
        + MESH_RAD * np.sin(order * q + phase)
    )


def disturbed(seed: int, channels: dict[str, Float]) -> Float:
    """(n, 3) m: what the tracker shows of an axis and of itself that the model does not have."""
    p = np.array(channels["p_tracker_target"])
    rng = np.random.default_rng([53, seed])
    poses: dict[tuple[float, ...], int] = {}
    for _, rows in rows_of_each(channels["group"].astype(np.int64)):
        q = channels["q_motor"][rows]
        axis = int(np.argmax(np.ptp(q, axis=0)))
        angle = q[:, axis]
        slope = np.polyfit(angle - angle.mean(), p[rows] - p[rows].mean(axis=0), 1)[0]
        lever = float(np.linalg.norm(slope))
        lost = (p[rows] @ slope) / lever**2 - angle
        place = poses.setdefault(tuple(np.round(np.delete(q[0], axis), 4)), len(poses))
        p[rows] += np.outer(beside(seed, channels["time_s"][rows, 0], angle, lost - lost[0], place), slope)
        p[rows] += WALK_M * np.cumsum(rng.standard_normal((len(rows), 3)), axis=0)
    return p


def plays_of(truth: Truth, axes: tuple[int, ...]) -> dict[str, float]:
    """True constants by name of the parameter."""
    out: dict[str, float] = {}
    for axis in axes:
        drive, name = truth.drives[axis], f"axis{axis + 1}"
        out[f"{name}.half_band"] = drive.dead_band_rad
        out |= {f"{name}.friction{e + 1}": f for e, f in enumerate(drive.link_friction_nm)}
        out |= {f"{name}.slip{e + 1}": d for e, d in enumerate(drive.link_slip_rad)}
    return out


def identified(seed: int, axes: tuple[int, ...], count: int, *, errors: bool) -> Identification:
    """One campaign of reversals, identified; axes that the recipe would not write are used all the same."""
    channels = dict(measured(seed, axes, count))
    numbers, sigma = channels.pop("group"), float(channels.pop("sigma"))
    if errors:
        channels["p_tracker_target"] = disturbed(seed, {**channels, "group": numbers})
    data = of_arrays("reversals", "reversals", channels, {"p_tracker_target": sigma}, group=numbers.astype(np.int64))
    return reversals.RECIPE.identify(cell(), [data], [], {"as_stated": True})


def play_of_reversals(seed: int, *, errors: bool, axes: tuple[int, ...] = AXES) -> list[Counted]:
    """One campaign of reversals, identified."""
    result = identified(seed, axes, MOTIONS, errors=errors)
    known = plays_of(truth_of(cell_file(), seed), axes)
    return [c for fit in result.fits.values() for c in counted(fit, known)]


def quick_form(seed: int, *, errors: bool, axes: tuple[int, ...]) -> list[QuickAxis]:
    """The short form of 12 motions, axes 1..6."""
    truth = truth_of(cell_file(), seed)
    result = identified(seed, tuple(axis - 1 for axis in axes), QUICK_MOTIONS, errors=errors)
    out = []
    for axis in axes:
        fit, name = result.fits[f"axis {axis}"], f"axis{axis}"
        place, drive = fit.parameters.index(f"{name}.half_band"), truth.drives[axis - 1]
        low, high = intervals(fit)[place]
        friction = sum(fit.value(n) for n in fit.parameters.names if n.startswith(f"{name}.friction"))
        withheld = any(r.startswith(f"axis {axis}") and "used as stated" in r for r in result.remarks)
        true_all = drive.motor_friction_nm + sum(drive.link_friction_nm)
        inside = bool(low <= drive.dead_band_rad <= high)
        out.append(QuickAxis(axis, fit.seen[place], inside, not withheld, friction, true_all))
    return out
