"""Lower the programmed feed where the undisturbed cut is beyond what spindle, tool or robot bear.

At every row of the path each limit that is known is held against what the cut asks for: mean force, spindle torque and
power, bending of the tool under the mean force, torque on each axis, deflection square to the path, acceleration
``v^2 kappa`` where the path turns. All but the last grow with the force, and that by about the power
:data:`EXPONENT` of the feed; so the feed is multiplied by ``(limit / value)^(1 / EXPONENT)`` for the limit that is
exceeded most, the path is cut anew, and so on until every limit is kept. Acceleration goes with the square. The limit
that lowered a row most is remembered: it *binds* there. Shares are those of :mod:`counterflex.plan.feed_schedule`: in
steps, one for a group, never below :data:`counterflex.plan.feed_schedule.LEAST` nor below its least chip, nor so low
that the mean chip leaves the range of the cutting constants, unless the cell file allows that. A corner without an arc
has no curvature; there :mod:`counterflex.plan.feed_schedule` slows down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.progress import silent
from counterflex.core.units import plain
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.feed_schedule import LEAST, LEAST_CHIP_M, STEP, FeedGroups, at_feed
from counterflex.plan.inputs import CompensationInputs
from counterflex.plan.plan import across
from counterflex.plan.process_limits import ProcessLimits, axis_torques
from counterflex.plan.undisturbed_cut import UndisturbedCut, undisturbed_cut
from counterflex.robot.elasticity import compliance

ROUNDS: Final = 6
EXPONENT: Final = 0.75
"""Of the feed in the force: Kienzle's 1 - m for common materials; another only needs more rounds."""
ACCELERATION: Final = "acceleration"
_CORNER_RAD: Final = 0.35
"""A turn between two segments that is no arc but a corner."""


@dataclass(frozen=True)
class LimitedLine:
    """Feed of a source line under the limits."""

    line: int  # in the source
    share: float  # lowest share of its programmed feed
    limit: str  # the limit that binds there
    before: float  # share of that limit that the programmed feed uses, largest of the line
    after_share: float  # the same at the lowered feed; above 1 where the least feed does not reach the limit

    @property
    def kept(self) -> bool:
        """Return whether the limit is kept at the lowered feed."""
        return bool(self.after_share <= 1.001)

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        return plain(self, "line feed_percent=share:1 limit before_percent=before:1 after_percent=after_share:1 kept")


@dataclass(frozen=True, eq=False)
class LimitedFeed:
    """A path at feeds within limits."""

    path: ToolPath  # at these feeds
    share: Float  # (n,) of the programmed feed
    programmed_m_s: Float  # (n,) m/s, the programmed feed
    binds: tuple[str, ...]  # (n,) name of the limit that binds, empty where the feed is the programmed one
    lines: tuple[LimitedLine, ...]  # that were slowed down or stay beyond a limit, in order
    extra_s: float  # time that it costs

    @property
    def way_m(self) -> Float:
        """(n,) m, length of the path up to each point."""
        p = self.path.p_part_tcp
        out: Float = np.cumsum(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1))
        return out


def known(limits: ProcessLimits) -> bool:
    """Return whether any limit is known that a feed can keep."""
    some = (limits.power_w, limits.torque_nm, limits.force_n, limits.deflection_m, limits.acceleration_m_s2)
    bends = limits.bending_m is not None and limits.overhang_m is not None
    return (
        bends
        or bool(limits.torque_by_speed)
        or limits.axis_torque_nm is not None
        or any(limit is not None for limit in some)
    )


@dataclass(frozen=True, eq=False)
class CutDemand:
    """Demand of a cut on spindle, tool and robot, row by row; 0 where nothing is cut."""

    values: dict[str, Float]  # (n,) by name of the limit that it is held against, SI
    displacement_part: Float  # (n, 6) m, rad, elastic displacement of the tool in the part


def cut_demand(inputs: CompensationInputs, cut: UndisturbedCut, limits_of: Callable[[int], ProcessLimits]) -> CutDemand:
    """Return what a cut asks for at every row: forces, torques, power, bending, deflection, acceleration.

    ``limits_of``: gives overhang and modulus for a tool number.
    """
    path, setting, w, axis = inputs.path, inputs.setting, cut.w_tcp_part, inputs.path.axis_part
    along = np.sum(w[:, :3] * axis, axis=1)[:, None] * axis
    side, moment = np.linalg.norm(w[:, :3] - along, axis=1), np.abs(np.sum(w[:, 3:] * axis, axis=1))
    values = {
        "force": np.linalg.norm(w[:, :3], axis=1),
        "spindle torque": moment,
        "spindle power": moment * np.abs(path.spindle_rad_s),
    }
    bending = np.zeros(len(path))
    for number in np.unique(path.tool[cut.contact]).tolist():
        rows = path.tool == number
        bending[rows] = limits_of(number).bending(setting.cutter_of(number).diameter_m, side[rows])
    values["tool bending"] = bending
    relative = setting.relative_motion(path)
    load = relative.load(w)
    torques = np.abs(axis_torques(setting.chain, inputs.q, load))
    values |= {f"torque of axis {k + 1}": torques[:, k] for k in range(torques.shape[1])}
    bent = relative.displacement(compliance.deflection(setting.chain, inputs.q, load))
    values["deflection"] = np.linalg.norm(across(bent[:, :3], path.p_part_tcp), axis=1)
    values = {name: np.where(cut.contact, value, 0.0) for name, value in values.items()}
    values[ACCELERATION] = path.feed_m_s**2 * curvature(path)
    return CutDemand(values, np.where(cut.contact[:, None], bent, 0.0))


def uses(
    inputs: CompensationInputs, cut: UndisturbedCut, limits_of: Callable[[int], ProcessLimits]
) -> dict[str, Float]:
    """Share of each known limit that every row uses.

    Args:
        inputs: Path and setting.
        cut: The undisturbed cut along it.
        limits_of: Gives the limits for a tool number.

    Returns:
        By name, (n,); 0 where nothing is cut (but for the acceleration).
    """
    values, path = cut_demand(inputs, cut, limits_of).values, inputs.path
    # Limits are those of spindle and robot. What differs by tool, overhang and modulus, is in the values already.
    known_limits = limits_by_name(limits_of(int(path.tool[-1])), path.spindle_rad_s)
    if not values["tool bending"].any():
        known_limits.pop("tool bending", None)
    return {name: values[name] / limit for name, limit in known_limits.items()}


def limits_by_name(limits: ProcessLimits, spindle_rad_s: Float) -> dict[str, Float | float]:
    """Limits that are known, by the names of :func:`cut_demand`.

    Args:
        limits: Of spindle, tool and robot.
        spindle_rad_s: (n,) speed of the spindle.
    """
    axes = limits.axis_torque_nm
    given: dict[str, Float | float | None] = {
        "force": limits.force_n,
        "spindle torque": limits.torque_at(spindle_rad_s),
        "spindle power": limits.power_w,
        "tool bending": limits.bending_m,
        **({} if axes is None else {f"torque of axis {k + 1}": axes[k] for k in range(len(axes))}),
        "deflection": limits.deflection_m,
        ACCELERATION: limits.acceleration_m_s2,
    }
    return {name: limit for name, limit in given.items() if limit is not None}


def curvature(path: ToolPath) -> Float:
    """(n,) 1/m, curvature of arcs at the end of each feed segment; 0 at corners, at ends and on straight lines."""
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    moves = (path.kind == FEED) & (length > 0.0)
    unit = step / np.where(length > 0.0, length, 1.0)[:, None]
    turn = np.arccos(np.clip(np.sum(unit[1:] * unit[:-1], axis=1), -1.0, 1.0))
    arc = moves[1:] & moves[:-1] & (turn < _CORNER_RAD) & (turn > 1e-6)
    out = np.zeros(len(path))
    out[:-1] = np.where(arc, turn / np.where(arc, 0.5 * (length[1:] + length[:-1]), 1.0), 0.0)
    last: Float = np.where(moves & (out == 0.0), np.concatenate([[0.0], out[:-1]]), 0.0)
    return np.maximum(out, last)


def limit_feed(inputs: CompensationInputs, feeds: FeedGroups, limits_of: Callable[[int], ProcessLimits]) -> LimitedFeed:
    """Lower the feed of a path until the undisturbed cut keeps every limit, as far as the least feed lets it.

    ``inputs``: path at the programmed feed, blank, tools, law.

    Raises:
        CounterflexError: What cutting raises.
    """
    path = inputs.path
    moves = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) > 0.0
    free: Bool = (path.kind == FEED) & moves & ~feeds.fixed
    cut = undisturbed_cut(inputs, silent)
    first = now = uses(inputs, cut, limits_of)
    least = _least(cut, 0.0 if inputs.setting.allow_extrapolation else inputs.setting.law.h_min_m)
    share: Float = np.ones(len(path))
    for _ in range(ROUNDS):
        factor = np.min([_factor(name, used) for name, used in now.items()], axis=0)
        lowered = _grouped(np.where(free, np.minimum(share, share * factor), 1.0), least, free, feeds.group)
        if np.all(lowered >= share - 1e-9):
            break
        share = np.minimum(share, lowered)
        slowed = replace(inputs, path=at_feed(path, share))
        now = uses(slowed, undisturbed_cut(slowed, silent), limits_of)
    result = at_feed(path, share)
    return LimitedFeed(
        result,
        share,
        path.feed_m_s,
        _binds(first, share, feeds.group),
        _lines(inputs.line, share, first, now),
        float(result.time_s[-1] - path.time_s[-1]),
    )


def _binds(first: dict[str, Float], share: Float, group: Int) -> tuple[str, ...]:
    """The limit that is exceeded most at the programmed feed, in the group of each row that was slowed down."""
    if not first:
        return ("",) * len(share)
    names = list(first)
    factors = np.stack([_factor(name, first[name]) for name in names])
    order = np.argsort(-factors.min(axis=0), kind="stable")  # the row that is beyond most comes last, and stays
    worst = np.zeros(int(group.max(initial=0)) + 1, dtype=np.int64)
    worst[group[order]] = factors.argmin(axis=0)[order]
    return tuple(names[k] if slowed else "" for k, slowed in zip(worst[group], share < 1.0 - 1e-9, strict=True))


def _factor(name: str, used: Float) -> Float:
    power = 0.5 if name == ACCELERATION else 1.0 / EXPONENT
    out: Float = np.maximum(used, 1.0) ** -power
    return out


def _least(cut: UndisturbedCut, thinnest_m: float) -> Float:
    """(n,) least share of the feed: its own, by feed per tooth, by the thinnest mean chip of the constants."""
    fz, chip = cut.cut.feed_per_tooth_m, cut.cut.chip_m
    known_chip = cut.contact & np.isfinite(fz) & (fz > 0.0)
    out: Float = np.maximum(LEAST, np.where(known_chip, LEAST_CHIP_M / np.where(known_chip, fz, 1.0), 0.0))
    inside = cut.contact & (chip >= thinnest_m) & (chip > 0.0)
    in_steps = np.ceil(thinnest_m / np.where(inside, chip, 1.0) / STEP - 1e-9) * STEP
    return np.minimum(np.maximum(out, np.where(inside, in_steps, 0.0)), 1.0)


def _grouped(share: Float, least: Float, free: Bool, group: Int) -> Float:
    """Shares in steps, at least the least, the lowest of each group."""
    stepped = np.where(free, np.maximum(np.floor(share / STEP + 1e-9) * STEP, least), 1.0)
    lowest: Float = np.ones(int(group.max(initial=0)) + 1)
    np.minimum.at(lowest, group[free], stepped[free])
    return np.where(free, lowest[group], 1.0)


def _lines(line: Int, share: Float, first: dict[str, Float], now: dict[str, Float]) -> tuple[LimitedLine, ...]:
    if not now:
        return ()
    names = list(first)
    before, after = (np.stack([values[name] for name in names]) for values in (first, now))
    touched = (share < 1.0) | np.any(after > 1.0 + 1e-3, axis=0)
    factors = np.stack([_factor(name, values) for name, values in zip(names, before, strict=True)])
    out = []
    for number in np.unique(line[touched]).tolist():
        rows = np.flatnonzero((line == number) & touched)
        which = int(np.unravel_index(np.argmin(factors[:, rows]), (len(names), len(rows)))[0])
        out.append(
            LimitedLine(
                number,
                float(share[rows].min()),
                names[which],
                float(before[which, rows].max()),
                float(after[:, rows].max()),
            )
        )
    return tuple(out)
