"""All checks of a program on a cell, each with its worst place; what cannot be reached is a row, not an error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.inputs import Setting, programmed_poses
from counterflex.plan.preflight import joints as joint_checks
from counterflex.plan.preflight.bodies import Body
from counterflex.plan.preflight.collision import collision_rows
from counterflex.plan.preflight.rapids import flute_row, rapid_row, with_points_in_rapids
from counterflex.plan.preflight.reversals import event_row, reversals, unloadings
from counterflex.plan.preflight.row import Bounds, Row
from counterflex.plan.preflight.spacing import spacing_rows
from counterflex.robot.kinematics.inverse import SIGMA_FLOOR, PathSolution, inverse_path
from counterflex.robot.kinematics.inverse_seeds import extension

JOINTS, CUTTING, COLLISION = "joint angles", "cut", "collisions"
REVERSALS: Final = "reversals in the cut"
UNLOADINGS: Final = "unloadings in the cut"
_CONTACT_M3: Final = 1e-12
_STRETCHED_M: Final = 20.0 * MM
_NEEDS_REACH: Final = (
    "joint limits",
    "wrist singularity",
    "joint speed at feed",
    "joint speed in rapids",
    "joint acceleration at feed",
    *(f"cable wind-up, axis {axis + 1}" for axis in joint_checks.CABLE_AXES),
    "robot and spindle to surroundings",
    "tool to surroundings",
    "spindle to arm",
    REVERSALS,
    UNLOADINGS,
)


@dataclass(frozen=True, eq=False)
class Preflight:
    """What was found.

    Attributes:
        rows: The table.
        path: The path that was looked at: rapids have points between.
        q: (m, 6) rad, controller angles of its first m rows: all of them where everything is reached.
        margin_rad: (m, 6) distance of each axis to its nearer limit.
        bodies: Coarse bodies.
    """

    rows: tuple[Row, ...]
    path: ToolPath
    q: Float
    margin_rad: Float
    bodies: tuple[Body, ...]

    @property
    def failed(self) -> bool:
        """A hard check failed."""
        return any(row.verdict == "fail" for row in self.rows)


def preflight(
    path: ToolPath,
    stock: HeightMap,
    setting: Setting,
    bounds: Bounds,
    bodies: Sequence[Body],
    progress: Progress = silent,
) -> Preflight:
    """Check a program.

    Args:
        path: As a machine runs it, without stops of planning.
        stock: The blank; left as it is.
        setting: Cell.
        bounds: What the checks compare with.
        bodies: Coarse bodies of the cell.
        progress: Progress callback, fraction 0 to 1.
    """
    parts = in_parts(progress, {JOINTS: 1.0, CUTTING: 4.0, COLLISION: 3.0})
    fine = with_points_in_rapids(path)
    solution, reached, rows = _reach(fine, setting)
    parts[JOINTS](1.0)
    result, cut_rows = _cut(fine, stock, setting, parts[CUTTING])
    rows += cut_rows
    q, margin = np.empty((0, 6)), np.empty((0, 6))
    if solution is None:
        rows += [Row(name, "unknown", what="not reached") for name in _NEEDS_REACH]
    else:
        q = solution.q
        margin = joint_checks.margins(q, setting.controller_chain.joint_limits_rad)
        rows += _along_joints(_first_rows(fine, reached), solution, margin, bounds)
        rows += collision_rows(
            setting.controller_chain, bodies, q, fine.tool[:reached], setting.T_base_part, bounds.clearance_m,
            parts[COLLISION],
        )  # fmt: skip
        rows += _loads(result, fine, q, setting)
    rows += spacing_rows(fine, bounds)
    parts[COLLISION](1.0)
    return Preflight(tuple(rows), fine, q, margin, tuple(bodies))


def _first_rows(path: ToolPath, count: int) -> ToolPath:
    return ToolPath(**{item.name: getattr(path, item.name)[:count] for item in fields(path)})


def _solved(setting: Setting, Ts_base_tcp: Float) -> PathSolution:
    """The solution that planning takes; where that leaves the joint limits, one that says by how much."""
    chain = setting.controller_chain
    try:
        return inverse_path(chain, Ts_base_tcp, setting.branch, sigma_floor=0.0)
    except ReachError:
        return inverse_path(chain, Ts_base_tcp, setting.branch, enforce_limits=False, sigma_floor=0.0)


def _reach(path: ToolPath, setting: Setting) -> tuple[PathSolution | None, int, list[Row]]:
    """Joint angles of the rows that are reached, how many, and the row of reach."""
    Ts_base_tcp = programmed_poses(path, setting)
    reserve = extension(setting.controller_chain, Ts_base_tcp, setting.branch)
    try:
        solution = _solved(setting, Ts_base_tcp)
    except ReachError as fault:
        stop = int(fault.data.get("point", 0))
        before = _solved(setting, Ts_base_tcp[:stop]) if stop > 0 else None
        return before, stop, [_unreached(_reason(setting, Ts_base_tcp) or fault, stop, reserve)]
    return solution, len(path), [_reach_row(solution, reserve)]


def _reason(setting: Setting, Ts_base_tcp: Float) -> ReachError | None:
    """Why a path is not reached, as planning says it: a singularity has its name, which a search that fails has not."""
    try:
        inverse_path(setting.controller_chain, Ts_base_tcp, setting.branch, enforce_limits=False)
    except ReachError as fault:
        return fault
    return None


def _unreached(fault: ReachError, stop: int, reserve: Float | None) -> Row:
    """Why the path ends there; the arm that is stretched before it is out of reach is said to be so."""
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


def _along_joints(path: ToolPath, solution: PathSolution, margin: Float, bounds: Bounds) -> list[Row]:
    speeds = joint_checks.joint_speeds(path, solution.q)
    accelerations = joint_checks.joint_accelerations(path, speeds, bounds.acceleration_m_s2)
    return [
        joint_checks.limit_row(margin, bounds.joint_margin_rad),
        joint_checks.wrist_row(solution.wrist, bounds.wrist_rad),
        *joint_checks.speed_rows(path, speeds, bounds),
        joint_checks.acceleration_row(path, accelerations, bounds),
        *joint_checks.cable_rows(solution.q, bounds.cables_rad),
    ]


def _cut(path: ToolPath, stock: HeightMap, setting: Setting, progress: Progress) -> tuple[Cut | None, list[Row]]:
    """The cut of the tool that does not yield, and what it says of rapids."""
    try:
        result = cut(path, path.p_part_tcp, stock.copy(), setting.cutter_of, setting.law, progress=progress)
    except CounterflexError as fault:
        motion = fault.data.get("motion")
        point = None if motion is None else int(np.searchsorted(path.motion, int(motion), side="right") - 1)
        return None, [
            Row("rapids into the stock", "unknown", what="the cut cannot be computed"),
            Row("cut", "fail", point=point, what=fault.what, advice=fault.hint or ""),
        ]
    cutters = {n: setting.cutter_of(n) for n in np.unique(path.tool[path.kind == FEED]).tolist()}
    return result, [rapid_row(path, result.volume_m3), flute_row(path, result.volume_m3, cutters)]


def _loads(result: Cut | None, path: ToolPath, q: Float, setting: Setting) -> list[Row]:
    """Reversals and unloadings under the predicted force."""
    if result is None:
        return [Row(name, "unknown", what="the cut cannot be computed") for name in (REVERSALS, UNLOADINGS)]
    n, chain = len(q), setting.chain
    contact = (path.kind == FEED) & (result.volume_m3 > _CONTACT_M3)
    w = setting.relative_motion(path).rows(slice(n)).load(at_points(result.w_tcp_part, contact)[:n])
    contact = contact[:n]
    turns = event_row(REVERSALS, reversals(chain, q, w, contact))
    if not np.any(chain.mass[: chain.flange_segment + 1] > 0.0):
        lacking = "no mass of a link is known, and with it no weight on the drives"
        return [turns, Row(UNLOADINGS, "unknown", what=lacking, missing="mass_kg of [[robot.elastic]]")]
    return [turns, event_row(UNLOADINGS, unloadings(chain, q, w, contact))]
