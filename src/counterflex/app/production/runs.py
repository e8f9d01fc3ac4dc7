"""Run logs as production identification reads them: the right plan, nothing missing, one run after the other."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.run.missing import LogMissing
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MS
from counterflex.cutting.coefficients import Directions, edge_force
from counterflex.files.cell.cell import Cell
from counterflex.files.logs.segments import segments
from counterflex.files.plan_file import TOOL_TURNS, WORKING_PLANE
from counterflex.identify.production.alignment import CHIP_M, EXPONENTS, AlignedRunRecord, PlannedCut, force_of
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import at_points, cut
from counterflex.plan.plan import Plan
from counterflex.runtime.record_ring import COLUMNS, column
from counterflex.runtime.state.states import Cause

# A plan as production identification needs it: its cut computed again, as a linear map of the force constants.
# The plan file holds the force of one law only. The same removal of the same blank is run once for each constant and
# exponent, so that the maps are those that the planner itself multiplies with constants: its grid, its bins, its arcs.

_CONTACT_M3: Final = 1e-12
_UNLIKE: Final = 0.05  # Largest difference of the removed volume, relative: the plan's blank may have a finer grid
_SHAPE: Final = 2.0
"""Largest ratio, along a path, of the force by the law of the cell to that of the plan: laws differ by less."""


@dataclass(frozen=True)
class _Term:
    """A law of one power term, for the planner's kernels."""

    p: float
    direction: int
    h_min_m: float = 1e-9
    h_max_m: float = 1.0
    source: str = ""
    status: str = "derived"

    def terms(self) -> Float:
        out = np.zeros((1, 4))
        out[0, 0], out[0, 1 + self.direction] = self.p, 1.0
        return out

    def scaled(self, factor: float | Directions, status: str | None = None) -> _Term:
        raise InputError("a single term of a force law is not scaled", value=factor, where=status)

    def edge_force(self, h_m: float | Float) -> Float:
        return edge_force(self, h_m)


def planned_cut(
    plan: Plan, about: dict[str, Any], cell: Cell, where: Path, *, compensated: bool, progress: Progress = silent
) -> PlannedCut:
    """Compute the maps of a plan.

    ``progress``: Progress callback, fraction 0 to 1. Raises InputError: a tool that tilts, a robot that holds the part,
    or a plan of another blank or tool.
    """
    if cell.holds_part:
        raise InputError("production runs of a robot that holds the part are not read", where=str(cell.path))
    if about.get(WORKING_PLANE) or about.get(TOOL_TURNS):
        raise InputError(
            "the plan is for a tool that is tilted or turns in the cut",
            where=str(where),
            limit="a tool along z of the part frame",
        )
    n, path = len(plan.path), _writable(plan.path)
    stock = cell.stock()
    maps = np.zeros((n, 3, 3, len(EXPONENTS)))
    removed = np.zeros(n)
    for d in range(3):
        for k, p in enumerate(EXPONENTS):
            result = cut(path, path.p_part_tcp, stock.copy(), cell.cutter, _Term(p, d))
            removed = result.volume_m3
            contact = (path.kind == FEED) & (removed > _CONTACT_M3)
            maps[:, :, d, k] = np.where(contact[:, None], result.w_tcp_part[:, :3], 0.0) / CHIP_M**p
            progress((d * len(EXPONENTS) + k + 1) / (3 * len(EXPONENTS)))
    _check_same(plan, removed, maps, cell, where)
    sent = plan.correction_part if compensated else np.zeros((n, 3))
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1, keepdims=True)
    time = np.diff(path.time_s, prepend=path.time_s[:1])
    return PlannedCut(
        p_part=path.p_part_tcp + sent,
        time_s=path.time_s,
        tool=path.tool,
        motion=path.motion,
        cutting=(path.kind == FEED) & (removed > _CONTACT_M3) & plan.cutting,
        direction=step / np.where(length > 0.0, length, 1.0),
        axis_z=path.axis_part[:, 2],
        feed_m_s=np.where(time > 0.0, length[:, 0] / np.where(time > 0.0, time, 1.0), path.feed_m_s),
        spindle_rad_s=path.spindle_rad_s,
        feed_tooth_m=plan.feed_per_tooth_m,
        depth_m=plan.axial_depth_m,
        entry_rad=plan.entry_rad,
        exit_rad=plan.exit_rad,
        volume_m3=plan.volume_m3,
        f_part=plan.w_tcp_part[:, :3],
        maps_m=maps,
        contained_part=sent,
        cell_m=float(stock.cell_m),
    )


def _writable(path: ToolPath) -> ToolPath:
    """The path with arrays of its own: compiled code takes none that are read-only, as files give them."""
    return replace(path, **{f.name: np.array(getattr(path, f.name)) for f in fields(path)})


def _check_same(plan: Plan, removed_m3: Float, maps: Float, cell: Cell, where: Path) -> None:
    """Refuse a plan whose cut is not that of the cell: removed volume and shape of the force are so for every law."""
    if not np.any(plan.cutting):
        raise InputError("the plan takes no material", where=str(where))
    fed = plan.path.kind == FEED
    here, there = float(np.sum(removed_m3[fed])), float(np.sum(plan.volume_m3[fed]))
    if abs(here - there) > _UNLIKE * there:
        raise InputError(
            "the plan is not of this cell's blank and tools",
            where=str(where),
            value=f"{here * 1e6:.3f} cm3 removed from the blank of {cell.path.name}",
            limit=f"{there * 1e6:.3f} cm3 of the plan, to {100.0 * _UNLIKE:g} %",
            hint="Give the cell file that the plan was made with, or one with the same part and tools",
        )
    contact = fed & (removed_m3 > _CONTACT_M3)
    force = at_points(force_of(maps, cell.force_law.terms()), contact)
    size = np.linalg.norm(plan.w_tcp_part[:, :3], axis=1)
    both = contact & (size > 0.2 * float(np.max(size)))
    ratio = np.linalg.norm(force[both], axis=1) / size[both]
    low, high = (float(np.quantile(ratio, q)) for q in (0.1, 0.9))
    if high > _SHAPE * low:
        raise InputError(
            "the force of the plan does not follow from this cell's blank and tools",
            where=str(where),
            value=f"ratio from {low:.2f} to {high:.2f} along the path",
            limit=f"within a factor of {_SHAPE:g}, as laws differ",
            hint="Give the cell file that the plan was made with, or one with the same part and tools",
        )


_WRENCH: Final = [column(f"wrench_{a}") for a in ("fx", "fy", "fz", "mx", "my", "mz")]
_PLACE: Final = [column(f"nominal_{a}") for a in "xyz"]
_SENT: Final = [column(f"correction_{a}") for a in "xyz"]
_Q: Final = [column(f"q{i}") for i in range(1, 7)]
_NEEDED: Final = (*_WRENCH, *_PLACE, *_SENT, *_Q)
_SATURATED: Final = int(Cause.FORCE_SATURATED)
_LEAST_CYCLES: Final = 250
_STALE_CYCLES: Final = 25


@dataclass(frozen=True, eq=False)
class LoggedRun:
    """A run of a log."""

    record: AlignedRunRecord
    folder: Path  # Of the log
    number: int  # Of the run in it
    sha256: str  # Over its records
    plan_sha256: str  # Of the plan that it was made with, or empty
    cell_sha256: str  # Of its cell file
    compensated: bool  # The robot ran the compensated program
    begun_s: float  # When it began, seconds since 1970, 0 where the log does not say

    def plan_among(self, plans: Sequence[Path], digests: Mapping[Path, str]) -> Path:
        """The plan of a run among those given. Raises InputError: the run had none, or it is not among them."""
        if not self.plan_sha256:
            raise InputError(
                "the run was made without a plan",
                where=self.record.name,
                hint="Give run --plan, also where it only watches",
            )
        for plan in plans:
            if digests[plan] == self.plan_sha256:
                return plan
        raise InputError(
            "the run was made with another plan",
            where=self.record.name,
            value=", ".join(f"{p.name} {digests[p][:12]}" for p in plans),
            limit=f"SHA-256 {self.plan_sha256[:12]}...",
            hint="Give the plan of that run with a --plan of its own",
        )


def read_runs(folder: Path) -> list[LoggedRun]:
    """Read all runs of a folder.

    Raises FileFormatError: there is no run log, it cannot be read, or it is of a version that recorded less. Raises
    InputError: stretches are missing, or it has no force.
    """
    rows: dict[int, list[Float]] = {}
    about: dict[int, Mapping[str, Any]] = {}
    missing = LogMissing()
    for segment in segments(folder):
        missing.add(segment)
        if segment.about:
            rows.setdefault(segment.run, []).append(segment.rows)
            about.setdefault(segment.run, segment.about)
            absent = [name for name in segment.absent if column(name) in _NEEDED]
            if absent:
                raise FileFormatError(
                    "the run log is of a version that did not record what is needed",
                    where=str(folder / segment.name),
                    value=", ".join(absent[:4]),
                    limit=f"{len(_NEEDED)} of {len(COLUMNS)} columns",
                )
    missing.end(folder)
    if missing.incomplete:
        raise InputError(
            "stretches of the run log are missing",
            where=str(folder),
            value=f"{missing.missing} cycles; {missing.lines()[0]}",
            limit="a complete log",
            hint="log show lists them; a force that is averaged over a gap would be another one",
        )
    return [_logged(folder, number, np.concatenate(parts), about[number]) for number, parts in sorted(rows.items())]


def _logged(folder: Path, number: int, rows: Float, about: Mapping[str, Any]) -> LoggedRun:
    name = folder.name if number == 0 else f"{folder.name}, run {number}"
    received = rows[:, column("elapsed")] > 0
    rows = rows[received]
    if len(rows) < _LEAST_CYCLES:
        raise InputError(
            "the run is too short", where=str(folder), value=f"{len(rows)} cycles", limit=f">= {_LEAST_CYCLES}"
        )
    if not np.any(rows[:, _WRENCH]):
        raise InputError(
            "the run has no force: it was made without a force sensor",
            where=str(folder),
            hint="A run whose loop has a force sensor logs its readings, also where it only watches",
        )
    counter = rows[:, column("counter_ms")]
    time = np.cumsum(np.concatenate([[0.0], np.diff(counter)])) * MS
    if np.any(np.diff(time) <= 0.0):
        raise InputError(
            "the controller's clock runs backwards within the run",
            where=str(folder),
            value=f"cycle {int(rows[1 + int(np.argmin(np.diff(time))), column('cycle')])}",
            hint="The controller was started again: give each run a folder of its own",
        )
    soft = rows[:, column("flag_soft")].astype(np.int64)
    record = AlignedRunRecord(
        name=name,
        time_s=time,
        p_part=np.ascontiguousarray(rows[:, _PLACE]),
        w_part=np.ascontiguousarray(rows[:, _WRENCH]),
        q=np.ascontiguousarray(rows[:, _Q]),
        online_part=np.ascontiguousarray(rows[:, _SENT]),
        good=_fresh(rows) & np.all(np.isfinite(rows[:, _WRENCH]), axis=1),
        saturated=soft == _SATURATED,
        period_s=float(np.median(np.diff(time))),
    )
    hashes = about.get("sha256", {})
    return LoggedRun(
        record,
        folder,
        number,
        hashlib.sha256(np.ascontiguousarray(rows[:, list(_NEEDED)]).tobytes()).hexdigest(),
        str(hashes.get("plan", "")),
        str(hashes.get("cell", "")),
        bool(about.get("compensated", True)),
        (float(rows[0, column("received_ns")]) + float(about.get("wall_minus_monotonic_ns", 0))) * 1e-9,
    )


def _fresh(rows: Float) -> Bool:
    """(m,) cycles with a reading that is new, or next to new: a loop that needs no force does not count its age."""
    fresh = rows[:, column("flag_force_age")] == 0
    samples = rows[:, column("w_good")] > 0
    if np.any(samples):
        cycle = np.arange(len(rows))
        last = np.maximum.accumulate(np.where(samples, cycle, -_STALE_CYCLES - 1))
        fresh &= cycle - last <= _STALE_CYCLES
    return np.array(fresh, dtype=np.bool_)
