"""Choose a place of the external axes for each operation of a program, and check the whole program with its moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from counterflex.app.inputs import Job, Reading
from counterflex.app.placement.placement import Prepared
from counterflex.app.placement.region import ProgramInCell, Stand
from counterflex.app.placement.whole_program import Divided, PlacesFault, require_runs
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.set_up import AxisMove
from counterflex.plan.placement.operations import (
    Operation,
    OperationSite,
    best_postures,
    cheapest_places,
    operations_of,
    sites_of,
)
from counterflex.plan.placement.search import PlacementBounds
from counterflex.plan.posture.held import PostureTask
from counterflex.plan.posture.survey_kernel import POWER
from counterflex.robot.model.opw import BRANCHES

PLACES: Final = 25
"""Places that every operation is tried at, over the travel of all axes, before the best are refined."""
POSTURES: Final = 3
"""Postures whose places are refined: so many by their deflection, and as many by their error, lost motion and swing
included, of :data:`TRIED`."""
TRIED: Final = 16
"""Postures that have the least deflection, each operation in its own best place."""
_REFINED: Final = 12  # Places that are tried about the best one of each operation and axis
_MOVE: Final = 0.01
"""Share of the sum over all operations that a move must save: it takes time, and the axis must find its place again."""
_ROUNDS: Final = 20


@dataclass(frozen=True, eq=False)
class _Search:
    """Search for places: its inputs."""

    task: PostureTask
    frame: ProgramInCell
    part: Float  # (4,) the place of the part, as a candidate has it
    sites: list[OperationSite]
    operations: list[Operation]  # The same as rows

    def place(self, values: Float) -> Float:
        """(4 + k,) a candidate with values (k,) of the axes, as a cell file states them."""
        stand = self.frame.stand(np.concatenate([self.part, values]))
        units = [MM if axis.kind == "linear" else DEG for axis in self.frame.axes]
        shown = [stand.axes[axis.name] * unit for axis, unit in zip(self.frame.axes, units, strict=True)]
        return np.concatenate([self.part, shown])

    def cost(self, number: int, values: Float, branch: str, rotation_rad: float, least_damping: float) -> float:
        """m^(POWER + 1): length times error of an operation; infinite where it cannot be run, or feeds a swing."""
        site = self.sites[number]
        error, damping = site.held(self.frame.seen(self.place(values)), branch, rotation_rad)
        if damping < least_damping:
            return float("inf")
        return site.length_m * error**POWER


def per_operation(
    program: str | Path, given: Prepared, region: PlacementBounds, *, reading: Reading,
    one: tuple[Stand, str, float] | None, least_damping: float, progress: Progress = silent,
) -> Divided:  # fmt: skip
    """Choose a place of the external axes for each operation, with one posture for all.

    Args:
        region: Values of the external axes; the part stays where ``one`` has it.
        one: Best place for all operations, branch and rotation in rad; None where there is none.
        least_damping: That an operation must keep in the cut, as that of the best place for all.

    Raises:
        InputError: The cell has no external axes, the robot holds the part, or the program is one operation.
        ReachError: An operation can be run nowhere, or the axes cannot go from one place to the next.
    """
    job, cell, frame = given.job, given.cell, given.frame
    search = _search_of(program, given, one)
    grid = _grid(region, search, one)
    costs = np.stack([
        np.stack([site.posture_costs(frame.seen(search.place(values))) for values in grid]) for site in search.sites
    ])  # fmt: skip
    progress(0.5)
    low, high = np.array(region.low[4:]), np.array(region.high[4:])
    best: tuple[float, Divided] | None = None
    fault: ReachError | None = None
    postures = _chosen_postures(search, costs, grid, least_damping)
    if one is not None:  # no worse than one place for all
        freedom = search.sites[0].site.freedom
        turn, number = round(one[2] / freedom.step_rad) % freedom.rotations, BRANCHES.index(one[1])
        postures.append((one[2], one[1], costs[:, :, turn, number].argmin(axis=1).astype(np.int64)))
    for done, (rotation, branch, chosen) in enumerate(postures, start=1):
        values = [
            _refined(search, number, grid[place], (low, high), (branch, float(rotation), least_damping))
            for number, place in enumerate(chosen.tolist())
        ]
        try:
            made = _along(program, job, cell, search, np.array(values), one, reading,
                          (branch, float(rotation), least_damping))  # fmt: skip
        except ReachError as refused:
            fault = refused
        else:
            best = min([*([] if best is None else [best]), made], key=lambda pair: pair[0])
        progress(0.5 + 0.5 * done / len(postures))
    if best is None:
        raise fault or _nowhere(job, search, costs)
    return best[1]


def _nowhere(job: Job, search: _Search, costs: Float) -> ReachError:
    """Return the error of operations that share no posture; names the first that is reached in no place at all."""
    value = f"{len(search.sites)} operations, {costs.shape[1]} places"
    alone = np.flatnonzero(~np.isfinite(costs).any(axis=(1, 2, 3)))
    if len(alone):
        one, motion = search.operations[int(alone[0])], job.machined.motion
        first, last = (int(job.line_of_motion[motion[row]]) for row in (one.first, one.last))
        datum = alone[0] == 0 and search.sites[0].site.datum_points is not None
        touched = " with the datum points of the part" if datum else ""
        value = f"lines {first} to {last}{touched} are reached in none of {costs.shape[1]} places"
    return ReachError(
        "an operation can be run nowhere in a posture that all operations share", where=Path(job.program.name).name,
        value=value, limit="every point in one posture within all limits",
        hint="Widen --region E1=A,B, measure the part where the first operation is cut (part.datum_points_mm), or "
        "write a program for each operation",
    )  # fmt: skip


def _chosen_postures(
    search: _Search, costs: Float, grid: list[Float], least_damping: float
) -> list[tuple[float, str, Int]]:
    """Postures that are refined, with their places of the grid."""
    out: list[tuple[float, int, tuple[float, str, Int]]] = []
    for turn, number, chosen in best_postures(costs, TRIED):
        rotation, branch = float(search.sites[0].site.freedom.grid_rad[turn]), BRANCHES[number]
        total = sum(
            search.cost(k, grid[place], branch, rotation, least_damping) for k, place in enumerate(chosen.tolist())
        )
        out.append((total, len(out), (rotation, branch, chosen)))
    first = [number for _, number, _ in sorted(out)[:POSTURES]]
    return [out[number][2] for number in dict.fromkeys([*range(min(POSTURES, len(out))), *first])]


def require_operations(program: str | Path, cell: Cell, task: PostureTask) -> list[Operation]:
    """Return the operations of a program.

    Raises:
        InputError: The cell has no external axes, the robot holds the part, or the program is one operation.
    """
    if cell.holds_part or not cell.tables.external_axes:
        raise InputError(
            "a place for each operation needs external axes, and a part that stands", where=str(cell.path),
            value="the robot holds the part" if cell.holds_part else "no [[external_axes]]",
            limit="a rail under the robot, or a positioner under the part",
            hint="Leave --per-operation out: one place for all operations",
        )  # fmt: skip
    clearance = cell.tables.limits.preflight(cell.tables.controller, cell.robot).clearance_m
    top = float(cell.stock().z.max())
    operations = operations_of(task.path, task.cut.weight_m, top, clearance)
    if len(operations) < 2:
        raise InputError(
            "the program is one operation: between no two cuts a rapid ends clear of the blank",
            where=Path(program).name, limit=f"limits.clearance_mm = {clearance / MM:g} over the blank, {top / MM:g} mm",
            hint="Retract higher between the operations, or leave --per-operation out",
        )  # fmt: skip
    return operations


def _search_of(program: str | Path, given: Prepared, one: tuple[Stand, str, float] | None) -> _Search:
    """Operations of a program, and where its part stands."""
    task, frame = given.task, given.frame
    operations = require_operations(program, given.cell, task)
    part = frame.here[:4].copy()
    if one is not None:
        seen = frame.at(one[0])
        zero = frame.seen(np.concatenate([part, frame.here[4:]]))
        if not np.allclose(seen.T_base_standing, zero.T_base_standing, atol=1e-9):
            part = _part_of(frame, one[0])
    return _Search(task, frame, part, sites_of(task, operations, given.stretches), operations)


def _part_of(frame: ProgramInCell, stand: Stand) -> Float:
    """(4,) place of the part of a stand, as a candidate has it."""
    if all(stand.part[key] == getattr(frame.table, key) for key in stand.part):
        return frame.here[:4].copy()
    at_zero = Stand(stand.part, {axis.name: 0.0 for axis in frame.axes})
    T = frame.at(at_zero).T_base_standing
    level = (T[:3, :3] @ frame.middle + T[:3, 3])[:2]
    turned = (stand.part["a_deg"] - frame.table.a_deg) * DEG
    return np.array([*level, T[2, 3], turned])


def _grid(region: PlacementBounds, search: _Search, one: tuple[Stand, str, float] | None) -> list[Float]:
    """Values of the axes that every operation is tried at: evenly for one axis, Sobol points for several."""
    low, high = np.array(region.low[4:]), np.array(region.high[4:])
    free = np.flatnonzero(high > low)
    out = [search.frame.here[4:]]
    if one is not None:
        units = [MM if axis.kind == "linear" else DEG for axis in search.frame.axes]
        out.append(np.array([one[0].axes[axis.name] * u for axis, u in zip(search.frame.axes, units, strict=True)]))
    if len(free) == 1:
        shares = np.linspace(0.0, 1.0, PLACES)[:, None]
    else:
        shares = scipy.stats.qmc.Sobol(max(1, len(free)), scramble=False).random(64) if len(free) else np.zeros((0, 0))
    for share in shares:
        values = low.copy()
        values[free] += share * (high - low)[free]
        out.append(values)
    return out


def _refined(
    search: _Search, number: int, start: Float, bounds: tuple[Float, Float], posture: tuple[str, float, float]
) -> Float:
    """Values of the axes with the least cost about a start, axis by axis, by halving the step."""
    low, high = bounds
    best, values = search.cost(number, start, *posture), start.copy()
    for axis in np.flatnonzero(high > low).tolist():
        step = (high[axis] - low[axis]) / PLACES
        for _ in range(_REFINED // 2):
            for side in (-step, step):
                tried = values.copy()
                tried[axis] = min(max(values[axis] + side, low[axis]), high[axis])
                cost = search.cost(number, tried, *posture)
                if cost < best:
                    best, values = cost, tried
                    break
            else:
                step *= 0.5
    return values


def _along(
    program: str | Path, job: Job, cell: Cell, search: _Search, values: Float, one: tuple[Stand, str, float] | None,
    reading: Reading, posture: tuple[str, float, float],
) -> tuple[float, Divided]:  # fmt: skip
    """The cheapest way through the operations in a posture that the whole program with its moves can be run by."""
    if one is not None:
        units = [MM if axis.kind == "linear" else DEG for axis in search.frame.axes]
        common = [one[0].axes[axis.name] * unit for axis, unit in zip(search.frame.axes, units, strict=True)]
        values = np.vstack([values, common])
    values = np.unique(np.stack([search.place(row)[4:] for row in values]), axis=0)
    costs = np.array([
        [search.cost(number, row, *posture) for row in values] for number in range(len(search.sites))
    ])  # fmt: skip
    allowed: Bool = np.ones((len(search.sites) - 1, len(values), len(values)), dtype=np.bool_)
    least = costs.min(axis=1)
    refused: ReachError | None = None
    for _ in range(_ROUNDS):
        way = cheapest_places(costs, allowed, _MOVE * float(least.sum()))
        if way is None:
            break
        made = _made(job, search, values[way], posture)
        try:
            require_runs(program, cell, made, reading)
        except PlacesFault as fault:
            refused = fault.reason
            _block(fault.place, way, costs, allowed)
        else:
            total = float(costs[np.arange(len(way)), way].sum())
            return total, _with_errors(made, search, (costs, way), one)
    raise refused or ReachError(
        "no places lead through all operations in this posture", where=Path(job.program.name).name,
        hint="Widen --region E1=A,B, or write a program for each operation",
    )  # fmt: skip


def _block(place: float, way: Int, costs: Float, allowed: Bool) -> None:
    """Leave out the move, or the place of the operation, at which a program cannot be run."""
    changes = np.flatnonzero(np.diff(way))
    if place != round(place) and len(changes):
        number = int(changes[min(int(place), len(changes) - 1)])
        allowed[number, way[number], way[number + 1]] = False
        return
    bounds = [0, *(changes + 1).tolist(), len(way)]
    k = min(round(place), len(bounds) - 2)
    costs[bounds[k] : bounds[k + 1], way[bounds[k]]] = np.inf


def _made(job: Job, search: _Search, values: Float, posture: tuple[str, float, float]) -> Divided:
    """Cell file keys of places (operations, axes)."""
    path = job.machined
    along = np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1)) / MM
    stands = [search.frame.stand(np.concatenate([search.part, row])) for row in values]
    moves: dict[str, list[AxisMove]] = {}
    for axis in search.frame.axes:
        now = stands[0].axes[axis.name]
        for one, stand in zip(search.operations[:-1], stands[1:], strict=True):
            if stand.axes[axis.name] != now:
                now = stand.axes[axis.name]
                point = (path.p_part_tcp[one.arrival] / MM).tolist()
                move = AxisMove(float(along[one.last]), float(along[one.arrival]), now, point)
                moves.setdefault(axis.name, []).append(move)
    rows = [
        {
            "lines": [int(job.line_of_motion[path.motion[one.first]]), int(job.line_of_motion[path.motion[one.last]])],
            **stand.axes,
        }
        for one, stand in zip(search.operations, stands, strict=True)
    ]
    branch, rotation, _ = posture
    return Divided(stands[0], branch, rotation, moves, {"operations": rows})


def _with_errors(
    made: Divided, search: _Search, chosen: tuple[Float, Int], one: tuple[Stand, str, float] | None
) -> Divided:
    """The choice with the errors of its operations, beside those of the best place for all."""
    costs, way = chosen
    lengths = np.array([site.length_m for site in search.sites])
    rows = made.summary["operations"]
    own = costs[np.arange(len(way)), way]
    common = None
    if one is not None:
        stand, branch, rotation = one
        seen = search.frame.at(stand)
        common = np.array([site.held(seen, branch, rotation)[0] for site in search.sites])
    for number, row in enumerate(rows):
        row["cut_mm"] = round(lengths[number] / MM, 1)
        row["error_um"] = round((own[number] / lengths[number]) ** (1.0 / POWER) / UM, 2)
        row["in_one_place_um"] = None if common is None or np.isinf(common[number]) else round(common[number] / UM, 2)
    total = (float(own.sum()) / float(lengths.sum())) ** (1.0 / POWER)
    whole = None
    if common is not None and np.all(np.isfinite(common)):
        whole = (float(np.sum(lengths * common**POWER)) / float(lengths.sum())) ** (1.0 / POWER)
    about = {
        "per_operation": {
            "error_um": round(total / UM, 2),
            "in_one_place_um": None if whole is None else round(whole / UM, 2),
            "reduction_percent": None if whole is None else round(100.0 * (1.0 - total / whole), 1),
            "moves": sum(len(moves) for moves in made.moves.values()),
            "branch": made.branch,
            "rotation_about_tool_deg": round(made.rotation_rad / DEG, 4),
        }
    }
    return replace(made, summary=made.summary | about)
