"""Stretches of a run over which the planned force is steady: mean forces with standard deviations, zero taken out."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM, plain
from counterflex.cutting.arc_force import ArcCuts, TermForce
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.identify.cutting.record import mean_with_sigma, zero
from counterflex.identify.cutting.steady_cuts import Cutting
from counterflex.identify.data.model import CellModel
from counterflex.identify.production.alignment import Aligned, AlignedRunRecord, PlannedCut, force_of
from counterflex.robot.elasticity.compliance import cartesian_compliance

AIR_ROWS: Final = 20
"""Fewest cycles out of the cut from which a zero is taken."""
_AIR_S: Final = 2.0
_STEADY: Final = 0.1
LONGEST_S: Final = 0.5
SHORTEST_S: Final = 0.16
_WALL_RAD: Final = 0.18  # beyond what the grid of a blank leaves beside a full slot
_LEAST_N: Final = 5.0
_MOST_BAD: Final = 0.05
_LEVEL_M: Final = 0.5 * MM
_CHOICE: Final = Cutting(trim_diameters=0.6, settle_s=0.15)  # Mean forces of a run need no settled record


@dataclass(frozen=True, eq=False)
class Stretches:
    """Mean forces of steady stretches, in the feed frame: along the feed, to its left, up. n rows, SI."""

    force: Float  # (n, 3) N on the tool
    sigma: Float  # (n, 3) N standard deviation of these means: noise, zero, delay
    maps_m: Float  # (n, 3, 3, k) as PlannedCut has them, at the feed that was run, in the feed frame
    by_depth: Float  # (n, 3) N/m, change of the force by the axial depth, by the law known before
    # (n, 3) N/m, change by a bound of the work at the left that moves to the left; 0 where there is none
    by_left: Float
    by_right: Float  # (n, 3) N/m, the same at the right
    depth_m: Float  # (n,) planned axial depth
    entry_rad: Float  # (n,) of the engagement
    exit_rad: Float  # (n,) of the engagement
    feed_tooth_m: Float  # (n,) feed per tooth that was run
    give_m: Float  # (n, 3) displacement of the tool by the elastic model under the measured force
    sent_m: Float  # (n, 3) displacement that was commanded against it, contained and online
    axes: Float  # (n, 3, 3) from part axes to the feed frame
    cut: Int  # (n,) contact of the run that it is of: what is left of its zero is common to it
    top_m: Float  # (n,) height of the work above it, part frame: the floor of an earlier pass or the blank
    run_m: Float  # (n,) length of cut of this run before it
    grid_m: Float  # (n,) grid of the blank of the plan
    row: Int  # (n,) row of the plan

    def __len__(self) -> int:
        """Number of stretches."""
        return len(self.cut)

    def subset(self, rows: Bool) -> Stretches:
        """The marked ones."""
        return Stretches(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True, eq=False)
class RunCut:
    """Cut of one run with one tool."""

    stretches: Stretches  # the steady stretches
    cut_m: float  # length that it cut
    volume_m3: float  # that it removed
    contact_s: float  # time in the cut
    zero_drift_n: Float  # (3,) largest change of the zero over a cut
    online_m: float  # largest correction that was sent online in the cut

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        return plain(self, "zero_drift_n:2 largest_online_um=online_m:1")


def joined(parts: list[Stretches]) -> Stretches:
    """Several as one; contacts are numbered on."""
    first = 0
    cuts = []
    for part in parts:
        cuts.append(part.cut + first)
        first = int(np.max(cuts[-1], initial=first - 1)) + 1
    values = {f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Stretches)}
    return Stretches(**{**values, "cut": np.concatenate(cuts)})


def stretches_of(
    cell: CellModel,
    run: AlignedRunRecord,
    plan: PlannedCut,
    at: Aligned,
    tool: int,
    choice: Cutting = _CHOICE,
) -> RunCut:
    """Find the steady stretches of a run with one tool.

    Raises InputError: a saturated sensor, a force that is missing in the cut, no air cut to take the zero from, or no
    steady stretch.
    """
    cutter = cell.cutter_of(tool)
    inside = at.row >= 0
    row = np.where(inside, np.minimum(at.row, len(plan.time_s) - 1), 0)
    touching = inside & plan.cutting[row] & (plan.tool[row] == tool)
    _check(run, touching)
    contacts = _contacts(touching, run.time_s)
    reader = _StretchReader(cell, cutter, run, plan, at, row, choice)
    out: list[dict[str, object]] = []
    drift, length, online = np.zeros(3), 0.0, 0.0
    speed = np.linalg.norm(np.gradient(run.p_part, run.time_s, axis=0), axis=1)
    step = np.diff(run.time_s, prepend=run.time_s[0])
    for number, (begin, end) in enumerate(contacts):
        out += reader.stretches(begin, end, number, length, drift)
        length += float(np.sum((speed * step)[begin:end]))
        online = max(online, float(np.max(np.linalg.norm(run.online_part[begin:end], axis=1))))
    if not out:
        raise InputError(
            "no steady stretch of a cut was found in the run",
            where=run.name,
            value=f"{len(contacts)} cuts with T{tool}",
            hint=f"A stretch needs {SHORTEST_S:g} s of constant engagement, {choice.trim_diameters:g} diameters and "
            f"{choice.settle_s:g} s away from entry and exit: set trim_diameters and settle_s lower",
        )
    met = np.unique(row[touching])
    return RunCut(
        Stretches(**{f.name: np.array([item[f.name] for item in out]) for f in fields(Stretches)}),
        length,
        float(np.sum(plan.volume_m3[met])),
        float(np.sum(step[touching])),
        drift,
        online,
    )


def _check(run: AlignedRunRecord, touching: Bool) -> None:
    if not np.any(touching):
        raise InputError("the run did not cut", where=run.name, hint="Is it the run of this plan and tool?")
    lost = int(np.sum(run.saturated & touching))
    if lost:
        raise InputError(
            "the force sensor was saturated in the cut",
            where=run.name,
            value=f"{lost} cycles, first at {float(run.time_s[np.argmax(run.saturated & touching)]):.2f} s",
            limit="none",
            hint="Cut with less force, or with a sensor of a wider range",
        )
    bad = float(np.mean(~run.good[touching]))
    if bad > _MOST_BAD:
        raise InputError(
            "the force is missing in a part of the cut",
            where=run.name,
            value=f"{100.0 * bad:.0f} % of its cycles",
            limit=f"at most {100.0 * _MOST_BAD:g} %",
            hint="log show names when and why",
        )


def _contacts(touching: Bool, time_s: Float) -> list[tuple[int, int]]:
    """First and last + 1 of each contact; those less than 0.2 s apart are one."""
    change = np.diff(np.concatenate([[0], touching.astype(np.int8), [0]]))
    begin, end = np.flatnonzero(change > 0), np.flatnonzero(change < 0)
    out: list[tuple[int, int]] = []
    for b, e in zip(begin.tolist(), end.tolist(), strict=True):
        if out and time_s[b] - time_s[out[-1][1] - 1] < 0.2:
            out[-1] = (out[-1][0], e)
        else:
            out.append((b, e))
    return out


class _StretchReader:
    """One run, contact by contact."""

    def __init__(
        self,
        cell: CellModel,
        cutter: Cutter,
        run: AlignedRunRecord,
        plan: PlannedCut,
        at: Aligned,
        row: Int,
        choice: Cutting,
    ) -> None:
        self.cell, self.cutter, self.run, self.plan, self.at = cell, cutter, run, plan, at
        self.row, self.choice = row, choice
        self.law: ForceLaw = cell.force_law
        self.terms = self.law.terms()
        self.expected = force_of(plan.maps_m, self.terms)
        self.chain, self.R_base_part = cell.chain, cell.T_base_part[:3, :3]
        settle = max(1, round(0.1 / run.period_s))
        self.air = ~plan.cutting[row] & run.good & run.steady(settle) & (at.row >= 0)
        near = np.convolve((~self.air & plan.cutting[row]).astype(float), np.ones(2 * settle + 1), mode="same") > 0.0
        self.air &= ~near
        time = run.time_s
        self.speed = np.linalg.norm(np.gradient(run.p_part, time, axis=0), axis=1)

    def stretches(self, begin: int, end: int, number: int, cut_m: float, drift: Float) -> list[dict[str, object]]:
        """Those of one contact; ``drift`` (3,) takes the largest change of the zero."""
        run, time = self.run, self.run.time_s
        before = np.flatnonzero(self.air[:begin] & (time[:begin] > time[begin] - _AIR_S))
        after = end + np.flatnonzero(self.air[end:] & (time[end:] < time[end - 1] + _AIR_S))
        sides = [s for s in (before, after) if len(s) >= AIR_ROWS]
        if not sides:
            raise InputError(
                "no air cut beside a cut: the zero of the force sensor is not known there",
                where=run.name,
                value=f"{len(before)} good cycles before it and {len(after)} after it, at {time[begin]:.1f} s",
                limit=f"at least {AIR_ROWS} on one side",
                hint="Let the tool move through air at feed for half a second before the cut",
            )
        inside = np.arange(begin, end)
        rows = np.sort(np.concatenate([*sides, inside]))
        touching = np.isin(rows, inside)
        base = zero(run.w_part[rows], time[rows], touching)
        drift[:] = np.maximum(drift, np.abs(base.drift[:3]))
        shown = run.w_part[inside] - base.value[touching]
        out = []
        travel = np.cumsum(np.diff(time[inside], prepend=time[begin]) * self.speed[inside])
        for part in self._steady(inside, travel):
            item = self._one(inside[part], shown[part], base.sigma, number)
            if item is not None:
                out.append({**item, "run_m": cut_m + float(travel[part[0]])})
        return out

    def _steady(self, rows: Int, travel: Float) -> list[Int]:
        """Places of the steady stretches within one contact."""
        run, plan, choice = self.run, self.plan, self.choice
        trim = choice.trim_diameters * self.cutter.diameter_m
        time = run.time_s[rows] - run.time_s[rows[0]]
        kept = (travel > trim) & (travel < travel[-1] - trim)
        kept &= (time > choice.settle_s) & (time < time[-1] - choice.settle_s)
        kept &= run.good[rows] & (np.abs(plan.axis_z[self.row[rows]]) > 1.0 - 1e-6)
        motion = plan.motion[self.row[rows]]
        size = np.linalg.norm(self.expected[self.row[rows]], axis=1)
        edge = np.flatnonzero(np.diff(motion) | np.diff(kept.astype(np.int8)) | (np.diff(time) > 1.5 * run.period_s))
        most = max(2, round(LONGEST_S / run.period_s))
        out = []
        for first, last in itertools.pairwise([0, *(edge + 1).tolist(), len(rows)]):
            if not kept[first]:
                continue
            if first and motion[first] != motion[first - 1]:  # the arm swings behind a corner
                first += round(choice.settle_s / run.period_s)
            count = max(1, (last - first) // most)
            for part in np.array_split(np.arange(first, last), count):
                if len(part) * run.period_s < SHORTEST_S:
                    continue
                quarters = np.array([q.mean() for q in np.array_split(size[part], 4)])  # the blank has a grain
                if float(np.ptp(quarters)) < _STEADY * float(np.mean(quarters)) > _STEADY * _LEAST_N:
                    out.append(part)
        return out

    def _one(self, rows: Int, shown: Float, zero_sigma: Float, number: int) -> dict[str, object] | None:
        run, plan = self.run, self.plan
        at = self.row[rows]
        direction = plan.direction[at].mean(axis=0)
        level = float(np.hypot(direction[0], direction[1]))
        if level < 0.7:
            return None
        x, y = direction[:2] / level
        R = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
        mean, sigma = mean_with_sigma(shown, None)
        sigma = np.hypot(sigma, zero_sigma)
        # The force that the plan has a little earlier and later: what the delay's uncertainty makes of it.
        duration = float(run.time_s[rows[-1]] - run.time_s[rows[0]])
        change = np.abs(self.expected[at[-1]] - self.expected[at[0]])
        # A ramp of the force that is read too late by the doubt of the delay is off by its slope times it.
        late = change * self.at.delay_sigma_s / max(duration, run.period_s)
        turned = np.sqrt(R**2 @ (sigma[:3] ** 2 + late**2))
        share = float(np.mean(self.speed[rows] / np.maximum(plan.feed_m_s[at], 1e-9)))
        share = 1.0 if abs(share - 1.0) < 0.02 else share
        powers = share ** np.array([0.0, 0.25, 0.5, 0.75, 1.0])
        maps = np.einsum("ab,bck->ack", R, plan.maps_m[at].mean(axis=0)) * powers
        q, give = run.q[rows].mean(axis=0), np.zeros(3)
        load = np.concatenate([self.R_base_part @ mean[:3], self.R_base_part @ mean[3:]])
        give = R @ self.R_base_part.T @ (cartesian_compliance(self.chain, q) @ load)[:3]
        sent = R @ (plan.contained_part[at] + run.online_part[rows]).mean(axis=0)
        depth = float(np.median(plan.depth_m[at]))
        entry, leave = (float(np.median(v[at])) for v in (plan.entry_rad, plan.exit_rad))
        feed_tooth = float(np.mean(plan.feed_tooth_m[at])) * share
        by_depth, by_left, by_right = self._slopes(depth, entry, leave, feed_tooth)
        top = float(np.median(plan.p_part[at, 2] - plan.contained_part[at, 2])) + depth
        return {
            "force": R @ mean[:3],
            "sigma": turned,
            "maps_m": maps,
            "by_depth": by_depth,
            "by_left": by_left,
            "by_right": by_right,
            "depth_m": depth,
            "entry_rad": entry,
            "exit_rad": leave,
            "feed_tooth_m": feed_tooth,
            "give_m": give,
            "sent_m": sent,
            "axes": R,
            "cut": number,
            "top_m": round(top / _LEVEL_M) * _LEVEL_M,
            "grid_m": plan.cell_m,
            "row": int(at[0]),
        }

    def _slopes(self, depth: float, entry: float, leave: float, feed_tooth: float) -> tuple[Float, Float, Float]:
        """(3,) N/m each: change of the force by depth and by the bounds of the work, law known before."""
        depths, begins, ends, feeds = (np.array([v]) for v in (depth, entry, leave, feed_tooth))
        cuts = ArcCuts(self.cutter, depths, begins, ends, feeds, np.zeros(1))
        by_depth, left, right = np.zeros(3), np.zeros(3), np.zeros(3)
        for p, *k in self.terms:
            term, constants = TermForce.of(cuts, float(p)), np.array(k)
            by_depth += term.by_depth[0] @ constants
            left += term.by_entry[0] @ constants
            right += term.by_exit[0] @ constants
        radius = self.cutter.radius_m
        left *= -1.0 / (radius * np.sin(entry)) if entry > _WALL_RAD else 0.0
        right *= -1.0 / (radius * np.sin(leave)) if leave < np.pi - _WALL_RAD else 0.0
        return by_depth, left, right


def widths_known(grid_m: Float) -> Float:
    """Standard deviation of a bound of the work, m: two edges of the grid, and what an earlier pass was off by."""
    out: Float = np.hypot(50.0 * UM, grid_m / np.sqrt(6.0))
    return out
