"""Inputs of planning: robot, part, tools, force law, bounds; path with planned stops, joint angles, work."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose
from counterflex.path.external_axes import ExternalPlaces
from counterflex.path.tool_rotation import ToolRotation
from counterflex.path.toolpath import FEED, RAPID, ToolPath, tool_orientation
from counterflex.plan.lowest_mode import Damping
from counterflex.plan.relative_motion import RelativeMotion, hand_poses, part_carried, tool_carried
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.drive_error import DriveErrors
from counterflex.robot.kinematics.inverse import SIGMA_FLOOR, PathSolution, inverse_path
from counterflex.robot.kinematics.joint_path import ByAxes, JointPieces, solve_pieces
from counterflex.signals.preview import Mode, Shaping

_NO_ERRORS, _ASSUMED, _ALL_LINES = DriveErrors(), Damping.of(None), ByAxes()


@dataclass(frozen=True)
class CorrectionLimits:
    """Bounds on what compensation may do; a plan that needs more is refused, never clipped."""

    correction_m: float = 3.0 * MM  # largest correction
    rotation_rad: float = 1.0 * DEG  # largest correction of the orientation
    joint_margin_rad: float = 2.0 * DEG  # smallest distance to a joint limit
    wrist_rad: float = 5.0 * DEG  # smallest angle between axes 4 and 6


@dataclass(frozen=True, eq=False)
class Setting:
    """All that planning stands on."""

    chain: ElasticChain  # robot and end effector as they are known to be (elastic, perhaps with calibrated geometry)
    # robot and end effector as the controller has them; its joint angles are what is commanded
    controller_chain: ElasticChain
    T_base_part: Float  # (4, 4) part frame as the controller knows it
    # (k, 3) m where the robot touched the part to measure that frame, or None when it was measured from outside
    datum_points_part: Float | None
    branch: str  # posture of the arm, for example `front up noflip`
    rotation_about_tool_rad: float  # free rotation, see counterflex.path.toolpath.tool_orientation
    law: ForceLaw  # force law
    cutter_of: Callable[[int], Cutter]  # gives the cutter of a tool number
    mode: Mode | None  # lowest structural mode of a tap test, or None; see counterflex.plan.lowest_mode.mode_of
    shaping: Shaping  # how corrections are shaped in time
    limits: CorrectionLimits  # bounds
    # largest swing of the arm that one change of motion or force may start, see counterflex.plan.feed_schedule; 0
    # leaves the feed as it is
    swing_m: float = 0.0
    # with which the controller changes the speed of the tool where the path turns or the feed changes
    acceleration_m_s2: float = 1.0
    blending_m: float = 0.0  # from which distance it rounds corners; 0 stops exactly
    normal_only: bool = False  # correct square to the feed only (Haehn2020 eq. 10)
    orientation: bool = False  # correct the orientation too
    allow_extrapolation: bool = False  # accept force from chips outside the law's range
    # periodic errors and sag of the drives: what the links of `chain` truly do at commanded angles
    drive_errors: DriveErrors = _NO_ERRORS
    damping: Damping = _ASSUMED  # damping ratio of the robot's modes, against chatter
    # how the free rotation changes along the program; `rotation_about_tool_rad` is that of its beginning
    turning: ToolRotation | None = None
    # (4, 4) tool frame of a spindle that stands, against which the robot holds the part; the last frame of both chains
    # is the part frame then, and `T_base_part` says nothing. None: the robot holds the tool
    T_base_tcp: Float | None = None
    by_axes: ByAxes = _ALL_LINES  # motions of the program that the controller makes by axes
    # places that external axes take along the program; `T_base_part` is that of the first. None: they stand in one
    # place
    places: ExternalPlaces | None = None

    def rotations_rad(self, p_part_tcp: Float) -> float | Float:
        """Free rotation at all points (n, 3) m of a program, in their order: one angle, or (n,) where it turns."""
        return self.rotation_about_tool_rad if self.turning is None else self.turning.along(p_part_tcp)

    def Ts_base_part(self, path: ToolPath) -> Float:
        """Part frame as the controller knows it along a path: (n, 4, 4), or (4, 4) where nothing carries it away."""
        return self.T_base_part if self.places is None else self.places.Ts_base_part(path.place)

    def Ts_base_before(self, path: ToolPath) -> Float | None:
        """(n, 4, 4) robot base at the begin of the program in that along a path; None where it stands."""
        if self.places is None:
            return None
        first = pose.inverse(self.places.Ts_base_floor(np.zeros(1))[0])
        out: Float = self.places.Ts_base_floor(path.place) @ first
        return out

    def poses_in_part(self, path: ToolPath) -> Float:
        """(n, 4, 4) poses of the tool frame in the part along a path of n rows."""
        Rs_part_tcp = tool_orientation(path.axis_part, self.rotations_rad(path.p_part_tcp))
        return pose.make(Rs_part_tcp, path.p_part_tcp)

    def relative_motion(self, path: ToolPath) -> RelativeMotion:
        """Motion of the tool relative to the part in the rows of a path per motion of the robot's hand."""
        if self.T_base_tcp is None:
            return tool_carried(self.T_base_part, None if self.places is None else self.Ts_base_part(path))
        return part_carried(self.T_base_tcp, self.poses_in_part(path))


SETTLING_S: Final = 0.05
"""Time the tool is given at the end of a cut to come back to its programmed place before it lifts."""


def with_settling(path: ToolPath) -> ToolPath:
    """Give the tool a stop at the end of every feed run that is followed by a rapid.

    There the feed ends and with it the force, while the tool still stands in the cut. A correction of deflection that
    stayed until the tool has left would push the relieved tool into the wall; the stop is the row at which it is taken
    back. Only planning knows it: no stop is written, and what is machined has none.
    """
    last = np.flatnonzero((path.kind[:-1] == FEED) & (path.kind[1:] == RAPID))
    if len(last) == 0:
        return path
    columns = {}
    for field in dataclasses.fields(ToolPath):
        values = getattr(path, field.name)
        columns[field.name] = np.insert(values, last + 1, values[last], axis=0)
    stops = last + 1 + np.arange(len(last))
    delay = np.zeros(len(columns["time_s"]))
    delay[stops] = SETTLING_S
    columns["time_s"] = columns["time_s"] + np.cumsum(delay)
    return ToolPath(**columns)


def settling_rows(path: ToolPath) -> Bool:
    """(n,) True at the stops of :func:`with_settling`."""
    out = np.zeros(len(path), dtype=np.bool_)
    stands = np.all(path.p_part_tcp[1:] == path.p_part_tcp[:-1], axis=1)
    feed = path.kind == FEED
    out[1:-1] = (stands & feed[1:] & feed[:-1])[:-1] & (path.kind[2:] == RAPID)
    return out


JOINTS: Final = "joint angles"
UNDISTURBED: Final = "undisturbed cut"
CORRECTION: Final = "correction"
TRIAL: Final = "compensated program"
MENDED: Final = "compensated program, mended"
UNCOMPENSATED: Final = "uncompensated program"
"""Parts of the work, as the progress names them."""


def work_of(points: int, duration_s: float, *, moves: bool, mends: bool, predicts: bool) -> dict[str, float]:
    """Work of each part: what it costs to load, and then by points and by seconds of the program.

    A trial with the robot in motion steps through time, whatever the number of points; everything else goes by
    points. The units are processor seconds of programs of 374 to 30 000 points and of 4 to 450 s, at loads of 4 to 8.

    Args:
        duration_s: Of the path, s.
        moves: Trials have the robot in motion.
        mends: The correction is tried and mended, see :func:`counterflex.plan.compensate.plan`.
        predicts: The uncompensated program is predicted, too.

    Returns:
        By name, in the order in which the parts are done.
    """
    trial = 0.05 + 3e-5 * points + (0.024 * duration_s if moves else 0.0)
    work = {JOINTS: 0.01 + 1e-5 * points, UNDISTURBED: 0.05 + 4e-5 * points, CORRECTION: 0.25 + 7e-5 * points}
    work |= {TRIAL: trial} if predicts or mends else {}
    work |= {MENDED: trial} if mends else {}
    return work | ({UNCOMPENSATED: trial} if predicts else {})


@dataclass(frozen=True, eq=False)
class CompensationInputs:
    """A path of n rows that is to be compensated, checked for reach."""

    path: ToolPath  # the nominal path
    line: Int  # (n,) source line of each row
    stock: HeightMap  # the blank; left as it is
    setting: Setting  # robot, part, tools, law, bounds
    q: Float  # (n, 6) rad, angles that the controller shows along the nominal path

    @property
    def duration_s(self) -> float:
        """Duration of the path, s."""
        return float(self.path.time_s[-1] - self.path.time_s[0]) if len(self.path) else 0.0


def programmed_poses(path: ToolPath, setting: Setting) -> Float:
    """(n, 4, 4) m, poses of the hand (tool frame, or the part frame it holds) that a path of n rows asks for."""
    return hand_poses(setting.Ts_base_part(path), setting.T_base_tcp, setting.poses_in_part(path))


def joint_angles(
    path: ToolPath, setting: Setting, *, enforce_limits: bool = True, sigma_floor: float = SIGMA_FLOOR
) -> PathSolution:
    """Joint angles along a path: of lines, and of motions by axes between them, which pass no singularity.

    ``setting``: robot, part and posture; ``enforce_limits``: as
    :func:`~counterflex.robot.kinematics.inverse.inverse_path`.

    Raises:
        ReachError: Names the first row that fails.
    """
    chain, Ts = setting.controller_chain, programmed_poses(path, setting)
    begins, between = setting.by_axes.rows(path.motion)
    begins[:1] |= path.motion[:1] == 0 if 0 in setting.by_axes.turns else False
    if not np.any(begins):
        return inverse_path(chain, Ts, setting.branch, enforce_limits=enforce_limits, sigma_floor=sigma_floor)
    # Points between the ends of a motion by axes are no way of the arm: the solver sees the ends alone.
    kept = np.flatnonzero(~between)
    motion_of = {row: motion for row, motion in enumerate(path.motion[kept].tolist()) if begins[kept[row]]}
    by_axes = setting.by_axes
    stated = {row: by_axes.stated_rad[motion] for row, motion in motion_of.items() if motion in by_axes.stated_rad}
    turns = {row: by_axes.turns[motion] for row, motion in motion_of.items() if motion in by_axes.turns}
    try:
        out = solve_pieces(
            chain, Ts[kept], setting.branch, JointPieces(begins[kept], stated, turns),
            enforce_limits=enforce_limits, sigma_floor=sigma_floor,
        )  # fmt: skip
    except ReachError as fault:
        # The solver counts the rows that it was given: the message is to name the row of the path.
        fault.data["point"] = int(kept[int(fault.data.get("point", 0))])
        raise
    return out if len(kept) == len(path) else _between(out, kept, len(path))


def _between(solution: PathSolution, kept: Int, n: int) -> PathSolution:
    """The solution of some rows with the rows between them, in joint space."""
    rows = np.arange(n)
    at = np.searchsorted(kept, rows)
    q = np.stack([np.interp(rows, kept, column) for column in solution.q.T], axis=1)
    here = kept[at] == rows
    wrist, sigma_min = np.where(here, solution.wrist[at], 1.0), np.where(here, solution.sigma_min[at], np.inf)
    extension_m = None if solution.extension_m is None else solution.extension_m[at]
    return PathSolution(
        q, solution.branch, solution.limit_margin_rad[at], solution.limit_axis[at], wrist, sigma_min, extension_m
    )


def solve_joints(path: ToolPath, line: Int, setting: Setting) -> PathSolution:
    """Joint angles along the path, with the margins that the limits ask for.

    Raises:
        ReachError: Out of reach, out of limits, too near a limit or a singularity; names the source line.
    """
    try:
        joints = joint_angles(path, setting)
    except ReachError as fault:
        row = int(fault.data.get("point", 0))
        raise ReachError(
            fault.what,
            where=place(path, line, row),
            value=fault.value,
            limit=fault.limit,
            hint=fault.hint,
            **fault.data,
        ) from fault
    limits = setting.limits
    # Margins behind the solution: so the error says how much is left, not only that it is too little.
    row = int(np.argmin(joints.limit_margin_rad))
    if joints.limit_margin_rad[row] < limits.joint_margin_rad:
        raise ReachError(
            f"axis {int(joints.limit_axis[row]) + 1} comes too close to its limit",
            where=place(path, line, row),
            value=f"{joints.limit_margin_rad[row] / DEG:.2f} deg left",
            limit=f">= {limits.joint_margin_rad / DEG:g} deg (limits.joint_margin_deg)",
            hint="Move the part, or turn the tool about its axis",
        )
    row = int(np.argmin(joints.wrist))
    if joints.wrist[row] < np.sin(limits.wrist_rad):
        raise ReachError(
            "the wrist comes too close to its singularity",
            where=place(path, line, row),
            value=f"axis 5 at {float(np.arcsin(joints.wrist[row])) / DEG:.2f} deg from it",
            limit=f">= {limits.wrist_rad / DEG:g} deg (limits.wrist_singularity_deg)",
            hint="Move the part, or turn the tool about its axis",
        )
    return joints


def part_compliance(setting: Setting, relative: RelativeMotion, q: Float, w_tcp_base: Float | None = None) -> Float:
    """(n, 6, 6) compliance between tool and part at the tip in part axes, at angles (n, 6) rad of the path's rows.

    ``w_tcp_base``: (n, 6) N, N m, the load that compliance curves are taken at; None takes the cell's compliances.
    """
    return relative.compliance(compliance.cartesian_compliance(setting.chain, q, w_tcp_base))


def feed_runs(path: ToolPath) -> Int:
    """Number of the uninterrupted run each row belongs to: it changes where the kind of motion does and at stops."""
    still = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) == 0.0
    still[:1] = False
    change = (np.diff(path.kind, prepend=path.kind[:1]) != 0) | (np.diff(still.astype(np.int64), prepend=0) != 0)
    out: Int = np.cumsum(change)
    return out


def place(path: ToolPath, line: Int, row: int) -> str:
    """Place of a row of the path, for messages: source line and point."""
    at = ", ".join(f"{value:.3f}" for value in path.p_part_tcp[row] / MM)
    return f"line {int(line[row])}, at ({at}) mm"
