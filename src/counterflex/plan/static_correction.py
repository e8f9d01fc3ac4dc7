"""The correction at rest: against deflection, own weight and lost motion, shaped in time.

Inside a hole there is no sideways correction: what a plunge ended with stays until the tool has left along its axis.
While a tool plunges, its force bends the arm sideways too, and the correction follows the force so that the tool runs
straight. When the tool stops at the bottom, dwells, breaks through or backs out to clear chips, the force is gone; a
correction that went with it would be a sideways move of a tool that stands in a hole, and would come again with every
peck. So the sideways part and the tilt are held from the end of the first plunge until the tool is out. The part along
the axis is free: it moves the tool where it may move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, batches
from counterflex.core.errors import ModelError
from counterflex.core.progress import Progress
from counterflex.core.units import DEG, MM
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.inputs import CompensationInputs, CorrectionLimits, feed_runs, part_compliance, settling_rows
from counterflex.plan.lowest_mode import mode_of
from counterflex.plan.plan import across
from counterflex.plan.sag_and_play import corrected_joints, residual_sag, touched_points
from counterflex.plan.tool_deviation import PlannedRobot, lost_motion
from counterflex.plan.undisturbed_cut import UndisturbedCut
from counterflex.robot.elasticity import compliance
from counterflex.signals.preview import by_group

_SIDEWAYS_M: Final = 1e-9
"""A step shorter than this across the tool axis is none."""
_RELEASE_S: Final = 0.1
"""Where the feed goes on behind the last cut (through, or back up), the shaped correction fades before it: what is held
is that of so long before."""


def held_in_holes(path: ToolPath, contact: Bool, correction: Float, turn: Float) -> tuple[Float, Float]:
    """Corrections with the sideways part held while the tool is in a hole.

    A hole is a stretch of rows without a step across the tool axis in which material is cut. It begins at the height
    of the tip before the first cut; the first plunge ends with its last row that goes down and cuts. Every later row
    that begins or ends below that height gets, across the axis, the correction of the end of that plunge.

    Args:
        path: The nominal path, n rows.
        contact: (n,) True where the segment that ends here cuts.
        correction: (n, 3) m, part axes.
        turn: (n, 3) rad, rotation vectors, part axes.

    Returns:
        (n, 3) m and (n, 3) rad; the same arrays where there is no hole.
    """
    axis = path.axis_part
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    along = np.sum(step * axis, axis=1)
    sideways = np.linalg.norm(step - along[:, None] * axis, axis=1) > _SIDEWAYS_M
    begins = np.flatnonzero(np.concatenate([[True], sideways[1:]])) if len(path) else np.zeros(0, dtype=np.int64)
    ends = np.append(begins[1:], len(path))
    cutting = np.concatenate([[0], np.cumsum(contact & ~sideways)])
    holes = (cutting[ends] > cutting[np.minimum(begins + 1, ends)]) & (ends - begins > 2)
    if not holes.any():
        return correction, turn
    correction, turn = correction.copy(), turn.copy()
    for begin, end in zip(begins[holes].tolist(), ends[holes].tolist(), strict=True):
        height = np.cumsum(along[begin:end]) - along[begin]
        rows = np.arange(begin, end)
        first = int(np.flatnonzero(contact[begin:end] & (rows > begin))[0])
        last = _plunged(path, contact, along, begin + first, end) - begin
        lowest = np.minimum(height, np.concatenate([height[:1], height[:-1]]))
        inside = rows[(lowest < height[first - 1] - _SIDEWAYS_M) & (rows > begin + last)]
        here = axis[inside]
        bottom = correction[begin + last]
        own = np.sum(correction[inside] * here, axis=1) - here @ bottom
        correction[inside] = bottom + own[:, None] * here
        turn[inside] = turn[begin + last]
    return correction, turn


def _plunged(path: ToolPath, contact: Bool, along: Float, first: int, end: int) -> int:
    """Row at which the first plunge of a hole ends, or begins to break through."""
    last = run = first
    while run + 1 < end and path.kind[run + 1] == FEED and along[run + 1] < 0.0:
        run += 1
        if contact[run]:
            last = run
    if last + 1 < end and path.kind[last + 1] == FEED and along[last + 1] != 0.0:  # the feed goes on without a stop
        at = int(np.searchsorted(path.time_s, path.time_s[last] - _RELEASE_S, side="right")) - 1
        last = max(first, at)
    return last


_PLAY_ROUNDS = 4
"""How often the correction is made again for what the axes lose at rest: a correction moves them."""
FIRST_SHARE: Final = 0.5
"""Share of what the axes lose without a correction that is taken back at first: the play is then passed, but not
twice."""
_WINDOW_S: Final = 0.4
"""About each place, to compare two commands: what a turning axis or a corner leaves is over within it. A command that
is better at one corner of a contour and worse at another is taken at the first alone."""
APPROACH_S = 0.3
"""So long before and after contact the path is freed of sag and lost motion too: cuts begin in the right place."""
_CLEAR_M: Final = 1.0 * MM
"""A tool that has cut its way out of the part still stands between the walls it made, until its back half has left
them too. So long, and this much longer, it is kept in place: a correction that ended with the force would cut them."""
_FADE_S = 0.2
"""Beyond that, corrections that are left over from shaping are taken for zero."""


@dataclass(frozen=True, eq=False)
class LoadedRobot:
    """The robot under the force of the undisturbed cut, at rest in every row."""

    inputs: CompensationInputs  # path and setting
    cut: UndisturbedCut  # the undisturbed cut
    robot: PlannedRobot  # the robot along the path; its mode is that of the posture with the largest force
    deflection_part: Float  # (n, 6) m, rad under the force
    swinging_part: Float  # (n, 6) the part of it that the arm makes, which follows a force as a mode does
    feed_run: Int  # (n,) number of the run of even motion
    near: Bool  # (n,) rows in contact, within APPROACH_S of it, or whose tool stands between walls: corrected
    reach: Bool  # (n,) rows where shaping may leave a correction
    held: Int  # (k,) rows of stops of planning that keep the correction of the row before

    def shaped(self, displacement: Float, swinging: Float) -> Float:
        """A displacement (n, 6) as the controller has to be told it in time, zero away from the cut.

        Args:
            displacement: (n, 6) m, rad that follow the command at once.
            swinging: (n, 6) that follow it as the mode does.
        """
        time_s, robot = self.inputs.path.time_s, self.robot
        requested = np.where(self.near[:, None], displacement, 0.0)
        out = by_group(requested, swinging, time_s, self.feed_run, (robot.mode,), robot.setting.shaping)
        out[~self.reach] = 0.0
        # A stop that is left out keeps the correction with which the cut ended.
        out[self.held] = out[self.held - 1]
        return out

    def command_against(self, displacement: Float) -> Command:
        """The command that takes back a displacement (n, 6), as far as the setting lets it."""
        inputs, setting = self.inputs, self.inputs.setting
        correction = 0.0 - displacement[:, :3]
        if setting.normal_only:
            correction = across(correction, inputs.path.p_part_tcp)
        turn = 0.0 - displacement[:, 3:] if setting.orientation else np.zeros_like(correction)
        correction, turn = held_in_holes(inputs.path, self.cut.contact, correction, turn)
        q = corrected_joints(setting.controller_chain, self.robot.relative, inputs.q, correction, turn)
        return Command(correction, turn, q)

    def size_about(self, deviation: Float) -> Float:
        """(n,) m^4, mean fourth power of a deviation across the path in contact, :data:`_WINDOW_S` about each row."""
        path = self.inputs.path
        square = np.sum(across(deviation[:, :3], path.p_part_tcp) ** 2, axis=1)
        return lasting(np.where(self.cut.contact, square**2, 0.0)[:, None], path.time_s, _WINDOW_S)[:, 0]


@dataclass(frozen=True, eq=False)
class Command:
    """A correction as it is commanded."""

    correction_part: Float  # (n, 3) m
    rotvec_part: Float  # (n, 3) rad
    q: Float  # (n, 6) rad, joint angles with both


def loaded_robot(inputs: CompensationInputs, cut: UndisturbedCut) -> LoadedRobot:
    """Deflection under the force of the undisturbed cut, own weight, and where corrections are wanted."""
    path, setting, q, w = inputs.path, inputs.setting, inputs.q, cut.w_tcp_part
    relative = setting.relative_motion(path)
    load = relative.load(w)
    deflection = relative.displacement(compliance.deflection(setting.chain, q, load))
    hardest = q[int(np.argmax(np.linalg.norm(w[:, :3], axis=1)))]
    robot = PlannedRobot(
        setting,
        path,
        q,
        relative,
        part_compliance(setting, relative, q, load),
        residual_sag(path.p_part_tcp, q, setting, relative),
        touched_points(setting),
        mode_of(setting.chain, hardest, setting.mode),
        load,
    )
    feed_run = feed_runs(path)
    near = within(cut.contact, path.time_s, feed_run, APPROACH_S) | between_walls(inputs, cut.contact, feed_run)
    if setting.datum_points_part is None:  # the whole sag is in the correction: too much to begin and end beside a cut
        near |= np.isin(feed_run, feed_run[cut.contact])
    reach = within(near, path.time_s, feed_run, _FADE_S)
    swinging = _through_arm(robot, w, deflection)
    return LoadedRobot(inputs, cut, robot, deflection, swinging, feed_run, near, reach, _held(inputs, deflection, near))


def _held(inputs: CompensationInputs, deflection_part: Float, near: Bool) -> Int:
    """(k,) stops of planning that are left out: to stop would make the arm swing by more than there is to take back."""
    # The rapid then starts from the corrected end of the cut.
    stop = np.flatnonzero(settling_rows(inputs.path))
    bent = np.linalg.norm(deflection_part[stop - 1, :3], axis=1)
    out: Int = stop[near[stop - 1] & (bent <= inputs.setting.swing_m)]
    return out


def static_correction(loaded: LoadedRobot, progress: Progress) -> tuple[Float, Command]:
    """The correction of a robot that comes to rest in every row.

    ``correction = -shaped(deflection + sag + lost motion)``. Lost motion depends on the commanded angles, so it is
    found again for each command, :data:`_PLAY_ROUNDS` times. A correction that reverses an axis changes what that axis
    loses, which may reverse it back, further each time: as in :mod:`counterflex.plan.play_compensation`, half is taken
    first and each round takes a smaller share of the change, or all of it where it goes on in the direction of the one
    before; at each place the round is kept that changed least.

    Returns:
        The displacement (n, 6) m, rad that is taken back, and the command that does it.
    """
    w, robot, deflection = loaded.cut.w_tcp_part, loaded.robot, loaded.deflection_part
    static = np.concatenate([deflection[:, :3] + robot.sag_part, deflection[:, 3:]], axis=1) - loaded.swinging_part
    no_turn = ((0, 0), (0, 3))
    lost = kept = FIRST_SHARE * np.pad(lost_motion(robot, loaded.inputs.q, w), no_turn)
    least, before = np.full(len(lost), np.inf), np.zeros_like(lost)
    for done in range(_PLAY_ROUNDS):
        progress((done + 1.0) / (_PLAY_ROUNDS + 1.0))
        command = loaded.command_against(loaded.shaped(static + lost, loaded.swinging_part))
        change = np.pad(lost_motion(robot, command.q, w), no_turn) - lost
        size = loaded.size_about(change)
        onward = np.sum(change * before, axis=1, keepdims=True) > 0.0
        estimate = np.where(onward, lost + change, lost)
        kept, least = np.where((size < least)[:, None], estimate, kept), np.minimum(size, least)
        lost, before = lost + np.where(onward, 1.0, share_of_round(done)) * change, change
    displacement = loaded.shaped(static + kept, loaded.swinging_part)
    command = loaded.command_against(displacement)
    progress(1.0)
    return displacement, command


def share_of_round(done: int) -> float:
    """Share of the change in what the axes lose that is taken after ``done`` rounds: averaged steps, which converge."""
    return 1.0 / (1.5 + 0.5 * done)


def lasting(values: Float, time_s: Float, window_s: float) -> Float:
    """Mean of a signal over a window about each row, less at the ends.

    Args:
        values: (n, k).
        time_s: (n,) s, not decreasing, longer than nothing.

    Returns:
        (n, k).
    """
    if len(time_s) < 2 or time_s[-1] <= time_s[0]:
        return values.copy()
    step = np.diff(time_s, prepend=time_s[0])[:, None]
    middle = 0.5 * (values + np.concatenate([values[:1], values[:-1]]))
    total = np.cumsum(middle * step, axis=0)
    late, early = time_s + 0.5 * window_s, time_s - 0.5 * window_s
    width = np.minimum(late, time_s[-1]) - np.maximum(early, time_s[0])
    out = [(np.interp(late, time_s, c) - np.interp(early, time_s, c)) / width for c in total.T]
    return np.stack(out, axis=1)


def check_corrections(command: Command, line: Int, limits: CorrectionLimits) -> None:
    """Refuse a correction that is beyond its bound.

    Raises:
        ModelError: Names the source line, the size and the key of the bound.
    """
    for values, limit, unit, name, key in (
        (command.correction_part, limits.correction_m, MM, "mm", "correction_mm"),
        (command.rotvec_part, limits.rotation_rad, DEG, "deg", "correction_deg"),
    ):
        size = np.linalg.norm(values, axis=1)
        row = int(np.argmax(size)) if len(size) else 0
        if len(size) and not size[row] <= limit:  # NaN is beyond every bound, and argmax finds it first
            raise ModelError(
                "the correction needed is beyond its bound",
                where=f"line {int(line[row])}",
                value=f"{size[row] / unit:.3f} {name}",
                limit=f"<= {limit / unit:g} {name} (limits.{key})",
                hint="Cut less at a time, place the part better, or raise the bound if it is safe",
            )


def _through_arm(robot: PlannedRobot, w_part: Float, deflection_part: Float) -> Float:
    """The part of the deflection that the arm makes, swinging; sensor, spindle and tool follow a force at once."""
    chain, q = robot.setting.chain, robot.q
    rows = np.flatnonzero(np.any(w_part != 0.0, axis=1))
    out = np.zeros_like(deflection_part)
    if len(rows):
        relative = robot.relative.rows(rows)
        w_base, at_once = relative.load(w_part[rows]), np.empty((len(rows), 6))
        for some in batches(len(rows)):
            own = compliance.shares(chain, q[rows[some]], w_base[some])
            at_once[some] = np.sum(own[:, chain.flange_segment + 1 :], axis=1)
        out[rows] = deflection_part[rows] - relative.displacement(at_once)
    return out


def between_walls(inputs: CompensationInputs, contact: Bool, feed_run: Int) -> Bool:
    """(n,) rows nearer along the path to one that cuts than the radius of the tool and :data:`_CLEAR_M`."""
    path = inputs.path
    station = np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1))
    out = np.zeros(len(path), dtype=np.bool_)
    for number in np.unique(path.tool[contact]):
        radius = inputs.setting.cutter_of(int(number)).radius_m
        out |= within(contact & (path.tool == number), station, feed_run, radius + _CLEAR_M)
    return out


def within(active: Bool, time_s: Float, group: Int, reach_s: float) -> Bool:
    """Rows within a time of an active row of their group; or within a length, with stations for times.

    Args:
        active: (n,).
        time_s: (n,) s.
        group: (n,) rows that follow each other without interruption have one number.
        reach_s: The time.

    Returns:
        (n,).
    """
    out = active.copy()
    for rows in _slices(group):
        t, on = time_s[rows], time_s[rows][active[rows]]
        if len(on):
            at = np.searchsorted(on, t)
            before = np.abs(t - on[np.maximum(at - 1, 0)])
            behind = np.abs(t - on[np.minimum(at, len(on) - 1)])
            out[rows] = np.minimum(before, behind) <= reach_s
    return out


def _slices(group: Int) -> list[slice]:
    edges = np.flatnonzero(np.diff(group)) + 1
    return [slice(int(a), int(b)) for a, b in zip([0, *edges], [*edges, len(group)], strict=True)]
