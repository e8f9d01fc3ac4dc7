"""All checks of a program on a cell, each with its worst place; what cannot be reached is a row, not an error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import CounterflexError, ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import rotation
from counterflex.path.external_axes import moving
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.cut import at_points
from counterflex.plan.inputs import Setting, joint_angles, programmed_poses
from counterflex.plan.preflight import joints as joint_checks
from counterflex.plan.preflight.approximation import approximation_rows, corners_of
from counterflex.plan.preflight.bodies import CollisionBody
from counterflex.plan.preflight.collision import collision_rows
from counterflex.plan.preflight.external_moves import external_row, standing_along
from counterflex.plan.preflight.hazards import complete
from counterflex.plan.preflight.held_speed import HeldSpeed, held_speed
from counterflex.plan.preflight.machined_stock import MachinedStock
from counterflex.plan.preflight.process.cut_rows import (
    NEEDS_CUT,
    OF_LOAD,
    AsWritten,
    Machining,
    MadeCut,
    cut_rows,
    cutter_or_none,
    demanded,
    made_cut,
)
from counterflex.plan.preflight.process.demands import CORRECTION
from counterflex.plan.preflight.rapids import with_points_in_rapids
from counterflex.plan.preflight.reversals import ReversalEvent, event_row, reversals, unloadings
from counterflex.plan.preflight.row import NOT_LOOKED_AT, CheckLimits, Row
from counterflex.plan.preflight.size import size_rows
from counterflex.plan.preflight.spacing import BlockSpacing, blocks_of, spacing_rows
from counterflex.plan.preflight.speed_row import speed_row
from counterflex.plan.preflight.swung_arcs import Swung, axes_row, linear_rows, swung, taken
from counterflex.programs.robot_text.program import Stated
from counterflex.robot.kinematics.inverse import SIGMA_FLOOR, PathSolution
from counterflex.robot.kinematics.inverse_seeds import extension
from counterflex.robot.model.controller_axes import room

CHECK: Final = "posture of the program"
_WORDS: Final = "S of PTP targets, robconf under ConfJ or ConfL, CONFIG, or shoulder, elbow and wrist"


def posture_row(stated: dict[int, Stated] | None, branch: str, path: ToolPath) -> Row:
    """Row of the posture.

    Args:
        stated: By motion, of a program in a language of robots; None of other languages.
        branch: Posture that is checked, such as ``front up noflip``.
    """
    if stated is None:
        return Row(CHECK, "ok", what=f"the program states none; checked in {branch}")
    if not stated:
        what = f"no target states a posture ({_WORDS}): it is that in which the robot comes; checked in {branch}"
        return Row(CHECK, NOT_LOOKED_AT, what=what)
    others = {index: words for index, (posture, words) in stated.items() if not posture.agrees(branch)}
    if not others:
        return Row(CHECK, "ok", float(0), float(0), what=f"{branch}, as {len(stated)} targets say")
    first = min(others)
    rows = np.flatnonzero(path.motion == first)
    return Row(
        CHECK, "fail", float(len(others)), float(0), "", int(rows[-1]) if rows.size else None,
        f"targets with another posture than {branch}, in which reach, axes and bodies are checked: {others[first]}",
        advice="Set shoulder, elbow and wrist of [posture] to those of the program, or post the program for these",
    )  # fmt: skip


JOINTS, CUTTING, COLLISION = "joint angles", "cut", "collisions"
REVERSALS: Final = "reversals in the cut"
UNLOADINGS: Final = "unloadings in the cut"
_STRETCHED_M: Final = 20.0 * MM
_NOT_REACHED: Final = "the start of the program is not reached"


@dataclass(frozen=True, eq=False)
class AlongPath:
    """Curves along the first m rows of the path."""

    held: HeldSpeed  # path speed
    joint_speeds_rad_s: Float  # (m, 6) at the programmed feed
    joint_accelerations_rad_s2: Float  # (m, 6) likewise
    blocks: BlockSpacing  # of the path
    reversals: Sequence[ReversalEvent]  # axes that turn round in the cut
    cutting: Bool  # (m,) segments that remove material; all at feed where none does


@dataclass(frozen=True, eq=False)
class Preflight:
    """Result of all checks."""

    rows: tuple[Row, ...]  # the table
    path: ToolPath  # the path that was looked at: rapids have points between
    q: Float  # (m, 6) rad, controller angles of its first m rows: all of them where everything is reached
    margin_rad: Float  # (m, 6) distance of each axis to its nearer limit
    bodies: tuple[CollisionBody, ...]  # coarse bodies
    along: AlongPath | None  # curves for a picture; None where nothing is reached
    bounds: CheckLimits  # what was compared with

    @property
    def failed(self) -> bool:
        """A hard check failed."""
        return any(row.verdict == "fail" for row in self.rows)


def preflight(
    path: ToolPath,
    stock: HeightMap,
    setting: Setting,
    bounds: CheckLimits,
    machining: Machining,
    bodies: Sequence[CollisionBody],
    written: AsWritten,
    progress: Progress = silent,
) -> Preflight:
    """Check a program.

    Args:
        path: As a machine runs it, without stops of planning.
        stock: The blank; left as it is.
        bounds: What the checks of motion compare with.
        machining: What the checks of the cut compare with.
        bodies: Coarse bodies of the cell.
        written: What the program says of its corners, its offsets, and its size.
        progress: Progress callback, fraction 0 to 1.
    """
    parts = in_parts(progress, {JOINTS: 1.0, CUTTING: 4.0, COLLISION: 3.0})
    swung_path, reached, rows = _reach(path, setting)
    fine, setting, solution = swung_path.path, swung_path.setting, swung_path.solution
    rows.append(axes_row(swung_path, setting, written.left_out))
    parts[JOINTS](1.0)
    made = made_cut(fine, stock, setting, parts[CUTTING])
    rows += cut_rows(made, setting, machining, written)
    rows.append(external_row(fine, setting, stock, cutter_or_none(setting.cutter_of)))
    contact = made.contact
    cuts = bool(np.any(contact))
    cutting = contact if cuts else fine.kind == FEED
    q, margin, along = np.empty((0, 6)), np.empty((0, 6)), None
    reasons = {"": _NOT_REACHED}
    if solution is not None:
        q = solution.q
        margin = room(setting.controller_chain.axes, setting.controller_chain.joint_limits_rad, q)
        first = _first_rows(fine, reached)
        try:
            turns, load_rows = _loads(made, q, setting, bounds, machining)
        except CounterflexError as fault:
            turns, load_rows = [], [Row(CORRECTION, "fail", what=fault.what, advice="Lower the load of the cut")]
            reasons |= dict.fromkeys((*OF_LOAD, REVERSALS, UNLOADINGS), fault.what)
        along = _along(first, q, swung_path, bounds, written, turns, cutting[:reached])
        rows += _joint_rows(first, solution, margin, along, bounds, "cutting path" if cuts else "path at feed")
        rows.append(joint_checks.between_row(setting.controller_chain.axes))
        rows += collision_rows(
            setting.controller_chain, bodies, q, first.tool, standing_along(first, setting), bounds.clearance_m,
            parts[COLLISION], None if made.result is None else lambda: MachinedStock(made.turning, stock, setting),
            fine.kind[:reached] == RAPID,
        )  # fmt: skip
        rows += load_rows
    if made.result is None:
        reasons |= dict.fromkeys((*NEEDS_CUT, REVERSALS, UNLOADINGS), f"the cut cannot be computed: {made.fault}")
    rows += spacing_rows(fine, bounds)
    corners = corners_of(fine, blocks_of(fine), written.approximation_m, bounds.blending_m)
    rows += approximation_rows(corners, cutting, bounds)
    rows += size_rows(written.size)
    rows.append(posture_row(written.postures, setting.branch, fine))
    parts[COLLISION](1.0)
    return Preflight(complete(rows, reasons), fine, q, margin, tuple(bodies), along, bounds)


def _first_rows(path: ToolPath, count: int) -> ToolPath:
    return taken(path, np.arange(count))


def _solved(setting: Setting, path: ToolPath) -> PathSolution:
    """The solution that planning takes; where that leaves the joint limits, one that says by how much."""
    try:
        return joint_angles(path, setting, sigma_floor=0.0)
    except ReachError:
        # A path beyond the limits is solved all the same: the row says by how much.
        return joint_angles(path, setting, enforce_limits=False, sigma_floor=0.0)


def _reach(path: ToolPath, setting: Setting) -> tuple[Swung, int, list[Row]]:
    """The path with points in its rapids and joint angles, how many rows are reached, and the row of reach."""
    path = linear_rows(path, setting)
    path = with_points_in_rapids(path, lines=~setting.by_axes.rows(path.motion)[0])
    reserve = extension(setting.controller_chain, programmed_poses(path, setting), setting.branch)
    try:
        solution = _solved(setting, path)
    except ReachError as fault:
        stop = int(fault.data.get("point", 0))
        before = _solved(setting, _first_rows(path, stop)) if stop > 0 else None
        row = _unreached(_reason(setting, path) or fault, stop, reserve)
        out = swung(path, setting, before)
        return out, 0 if stop == 0 else int(out.row[stop - 1]) + 1, [_at(row, out)]
    out = swung(path, setting, solution)
    return out, len(out.path), [_at(_reach_row(solution, reserve), out)]


def _at(row: Row, out: Swung) -> Row:
    """A row whose point is one of the path without arcs, at the same point of the path with them."""
    return row if row.point is None else replace(row, point=int(out.row[row.point]))


def _reason(setting: Setting, path: ToolPath) -> ReachError | None:
    """Reason of planning that a path is not reached: a singularity has its name, which a search that fails has not."""
    try:
        joint_angles(path, setting, enforce_limits=False)
    except ReachError as fault:
        return fault
    return None


def _unreached(fault: ReachError, stop: int, reserve: Float | None) -> Row:
    """Reason that the path ends there; the arm that is stretched before it is out of reach is said to be so."""
    text = fault.what if fault.value is None else f"{fault.what}, {fault.value}"
    if fault.limit is not None:
        text += f" (expected {fault.limit})"
    value = None
    if reserve is not None and reserve.min() < 0.0:
        value = float(reserve.min())
        if 0.0 <= reserve[stop] < _STRETCHED_M:
            text = f"the arm is stretched here; farther on the wrist centre is {-value / MM:.1f} mm beyond the arm"
        text += f"; {100 * float(np.mean(reserve < 0.0)):.0f} % of the path's points are out of reach"
    return Row("reach", "fail", value, 0.0, "m", stop, text, advice=fault.hint or "Move the part")


def _reach_row(solution: PathSolution, reserve: Float | None) -> Row:
    row = int(np.argmin(solution.sigma_min))
    if solution.sigma_min[row] < SIGMA_FLOOR and solution.wrist[row] > 0.05:
        text = f"the arm is stretched or folded: sigma_min {solution.sigma_min[row]:.2g}, expected >= {SIGMA_FLOOR:g}"
        return Row(
            "reach", "fail", point=row, what=text, advice="Move the part closer to the robot, or away from its foot"
        )
    if reserve is None:
        return Row("reach", "ok", what="every point is reached")
    row = int(np.argmin(reserve))
    return Row("reach", "ok", float(reserve[row]), 0.0, "m", row, "reserve of the wrist centre")


def _along(
    path: ToolPath, q: Float, swung_path: Swung, bounds: CheckLimits, written: AsWritten,
    turns: Sequence[ReversalEvent], cutting: Bool,
) -> AlongPath:  # fmt: skip
    """Curves along the rows that are reached."""
    # Motions by axes, and those of external axes, keep to the speeds of the axes by themselves.
    setting = swung_path.setting
    q = setting.controller_chain.axes.shown(q)
    speeds = np.where((swung_path.made[: len(path)] | moving(path))[:, None], 0.0, joint_checks.joint_speeds(path, q))
    accelerations = joint_checks.joint_accelerations(path, speeds, bounds.acceleration_m_s2)
    blocks = blocks_of(path)
    corners = corners_of(path, blocks, written.approximation_m, bounds.blending_m)
    R = setting.poses_in_part(path)[:, :3, :3]
    turned = np.zeros(len(path))
    turned[1:] = np.linalg.norm(rotation.log(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1)
    held = held_speed(path, q, turned, blocks, corners, bounds)
    return AlongPath(held, speeds, accelerations, blocks, turns, cutting)


def _joint_rows(
    path: ToolPath, solution: PathSolution, margin: Float, along: AlongPath, bounds: CheckLimits, path_name: str
) -> list[Row]:
    return [
        joint_checks.limit_row(margin, bounds.joint_margin_rad),
        joint_checks.wrist_row(solution.wrist, bounds.wrist_rad),
        *joint_checks.speed_rows(path, along.joint_speeds_rad_s, bounds),
        joint_checks.acceleration_row(path, along.joint_accelerations_rad_s2, bounds),
        speed_row(along.held, along.cutting, bounds, path_name),
        *joint_checks.cable_rows(solution.q, bounds.cables_rad),
    ]


def _loads(
    made: MadeCut, q: Float, setting: Setting, bounds: CheckLimits, machining: Machining
) -> tuple[list[ReversalEvent], list[Row]]:
    """Reversals, and the rows that need joint angles and the predicted force."""
    if made.result is None:
        return [], []
    n, chain, contact = len(q), setting.chain, made.forced[: len(q)]
    path = _first_rows(made.path, n)
    w = setting.relative_motion(made.path).rows(slice(n)).load(at_points(made.result.w_tcp_part, made.forced)[:n])
    turns = reversals(chain, q, w, contact)
    rows = [event_row(REVERSALS, turns, bounds.reversal_error_m)]
    if not np.any(chain.mass[: chain.flange_segment + 1] > 0.0):
        lacking = "no mass of a link is known, and with it no weight on the drives"
        rows.append(Row(UNLOADINGS, NOT_LOOKED_AT, what=lacking, missing="mass_kg of [[robot.elastic]]"))
    else:
        rows.append(event_row(UNLOADINGS, unloadings(chain, q, w, contact), bounds.reversal_error_m))
    return turns, [*rows, *demanded(made, path, q, setting, bounds, machining)]
