"""Rows that stand on the predicted cut: what is removed, by which tool, and what that asks of spindle and robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import CounterflexError
from counterflex.core.progress import Progress
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.feed_limits import cut_demand
from counterflex.plan.inputs import CompensationInputs, Setting
from counterflex.plan.preflight.process import demands, moves, spindle, tool_use
from counterflex.plan.preflight.process.tool_bounds import ToolBounds
from counterflex.plan.preflight.rapids import flute_row, rapid_row
from counterflex.plan.preflight.row import NOT_LOOKED_AT, CheckLimits, Row, Verdict
from counterflex.plan.preflight.size import ProgramSize
from counterflex.plan.process_limits import ProcessLimits
from counterflex.plan.undisturbed_cut import UndisturbedCut
from counterflex.programs.robot_text.program import Stated as StatedPosture
from counterflex.programs.stated.offsets import NONE, OWN, UNSAID
from counterflex.programs.stated.remarks import Stated
from counterflex.runtime.monitoring.hidden_tooth import hidden_tooth

LENGTH: Final = "tool length offset"
WORK: Final = "work offset"
DIAMETER: Final = "tool of the program"
READING: Final = "words with two readings"
_SAME: Final = 0.02
"""Share by which a reground tool may be smaller than the one in a comment."""


def length_row(path: ToolPath, stated: Stated) -> Row:
    """Return the first motion that runs with no tool length offset, or with that of another tool.

    Motions at feed and rapids that go down count.
    """
    number = stated.length_offset[path.motion]
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    down = np.sum(step * path.axis_part, axis=1) < 0.0
    counts = ((path.kind == FEED) | down) & (path.tool != 0)
    if not np.any(counts):
        return Row(LENGTH, "ok", what="no motion at feed")
    if np.any(number[counts] == UNSAID):
        if stated.robot:
            return Row(LENGTH, "ok", what="the program's tool frame is that of the cell")
        return Row(LENGTH, NOT_LOOKED_AT, what="the post-processor writes the offset; check its G-code")
    fed = counts & (path.kind == FEED)
    none, other = counts & (number == NONE), counts & (number > 0) & (number != path.tool)
    if np.any(none & fed) or np.any(none & down):
        row = int(np.argmax(none & fed if np.any(none & fed) else none))
        return Row(LENGTH, "warning", point=row, what=f"no tool length offset is active with T{int(path.tool[row])}",
                   advice="G43 H with the number of the tool, behind its change")  # fmt: skip
    if np.any(other):
        row = int(np.argmax(other))
        tool, given = int(path.tool[row]), int(number[row])
        return Row(LENGTH, "warning", float(given), float(tool), "", row, f"H{given} is active with tool T{tool}",
                   advice=f"G43 H{tool}, if the controller keeps the length of T{tool} there")  # fmt: skip
    own = np.all(number[counts] == OWN)
    return Row(LENGTH, "ok", what="that of the tool itself" if own else "H is the number of the tool")


def work_row(path: ToolPath, stated: Stated) -> Row:
    """Return the first motion in a work offset whose place is not known."""
    used = stated.work_offset[path.motion]
    unknown = [k for k, name in enumerate(stated.offsets) if name not in stated.defined and np.any(used == k)]
    if not unknown:
        names = [name for k, name in enumerate(stated.offsets) if name and np.any(used == k)]
        return Row(WORK, "ok", what=", ".join(names) or "the program names none")
    name = stated.offsets[unknown[0]]
    row = int(np.argmax(used == unknown[0]))
    text = f"{name} is taken as the zero of the part; where it lies is not known"
    return Row(
        WORK, NOT_LOOKED_AT, point=row, what=text, missing=f"part.work_offsets_mm, --parameters or G10 L2 with {name}"
    )


def diameter_row(path: ToolPath, stated: Stated, cutter_of: Callable[[int], Cutter | None]) -> Row:
    """Return the tool whose diameter in the program's comments is farthest from that of the cell.

    ``cutter_of``: gives the cutter of a tool number, None for one that the cell does not have.
    """
    used = np.unique(path.tool[(path.kind == FEED) & (path.tool != 0)]).tolist()
    cutters = {n: cutter for n in used if (cutter := cutter_of(n)) is not None}
    named = {n: (cutters[n].diameter_m, *stated.diameters_m[n]) for n in cutters if n in stated.diameters_m}
    if not named:
        return Row(DIAMETER, NOT_LOOKED_AT, what="no comment of the program names the diameter of a tool")
    worst = max(named, key=lambda n: abs(named[n][1] / named[n][0] - 1.0))
    ours, theirs, line = named[worst]
    row = int(np.argmax((path.tool == worst) & (path.kind == FEED)))
    if abs(theirs / ours - 1.0) > _SAME:
        text = f"line {line} names {theirs / MM:g} mm for T{worst}, the cell {ours / MM:g} mm"
        return Row(DIAMETER, "warning", theirs, ours, "m", row, text, advice="Use the tool that the program is for")
    lacking = [f"T{n}" for n in cutters if n not in named]
    if lacking:
        return Row(DIAMETER, NOT_LOOKED_AT, what=f"no comment names the diameter of {', '.join(lacking)}")
    return Row(DIAMETER, "ok", theirs, ours, "m", row, f"diameter of T{worst} by a comment of the program")


def reading_row(stated: Stated) -> Row:
    """Return the words of the program that controllers read in two ways, and the reading that was checked."""
    if stated.doubts:
        return Row(READING, NOT_LOOKED_AT, what="; ".join(stated.doubts))
    return Row(READING, "ok", what="none")


BROKEN_TOOTH: Final = "broken tooth in the force signal"
KEY: Final = "monitor"


def tooth_row(path: ToolPath, cuts: Bool, cutter_of: Callable[[int], Cutter], sample_s: float | None) -> Row:
    """Return the cut in which one broken tooth shows least: speed, teeth and sampling rate say it before the cut.

    Args:
        path: n rows.
        cuts: (n,) segments that remove material with the spindle on.
        cutter_of: Cutter of a tool number.
        sample_s: Period of the force sensor; None where the process is not monitored.
    """
    if sample_s is None:
        return Row(BROKEN_TOOTH, NOT_LOOKED_AT, missing=KEY)
    rows = np.flatnonzero(cuts)
    pairs, first = np.unique(np.stack([path.spindle_rad_s[rows], path.tool[rows]], axis=1), axis=0, return_index=True)
    hidden = [
        (one, int(rows[at]))
        for (speed_rad_s, tool), at in zip(pairs.tolist(), first.tolist(), strict=True)
        if (one := hidden_tooth(speed_rad_s / (2.0 * np.pi), cutter_of(int(tool)).flutes, sample_s)) is not None
    ]
    if not hidden:
        return Row(BROKEN_TOOTH, "ok", what="it shows at every spindle speed of the cut" if len(rows) else "no cut")
    worst, row = max(hidden, key=lambda pair: len(pair[0].slips))
    verdict: Verdict = NOT_LOOKED_AT if worst.mostly else "warning"
    text = "it does not show" if worst.mostly else "it shows, but not"
    return Row(
        BROKEN_TOOTH,
        verdict,
        point=row,
        what=f"{text} {worst.where}; it does with {worst.remedy}",
        advice=f"Cut with {worst.remedy}",
    )


_CONTACT_M3: Final = 1e-12
_STANDING_RAD_S: Final = 1000.0
"""Spindle speed with which a cut is computed where the program states none: only its volumes count then."""
_OF_VOLUME: Final = (
    "rapids into the stock", tool_use.REMOVED, "depth of cut to flutes", spindle.IN_CUT, spindle.RUN_UP,
    spindle.STANDS,
    tool_use.PLUNGING, tool_use.COOLANT, moves.END,
)  # fmt: skip
OF_LOAD: Final = tuple(limit.check for limit in demands.LIMITS)
"""Checks that stand on the predicted force and the joint angles."""
_OF_FORCE: Final = (
    *OF_LOAD, demands.CORRECTION, demands.CHIP, tool_use.FEED_PER_TOOTH,
    tool_use.CUTTING_SPEED, BROKEN_TOOTH,
)  # fmt: skip
NEEDS_CUT: Final = (*_OF_VOLUME, *_OF_FORCE)
"""Checks that stand on the predicted cut."""


@dataclass(frozen=True, eq=False)
class AsWritten:
    """Statements of the program about its run on the controller."""

    # (motions,) distance at which the rounding of the corner at its end begins, 0 for an exact stop, NaN where it names
    # none, see counterflex.programs.approximation.approximation_m
    approximation_m: Float
    size: ProgramSize  # how large it is
    stated: Stated  # offsets, coolant and end
    height_known: bool = True  # the program has named the height of the tool with or before its first motion
    spindle_by_person: bool = False  # it says nothing of the spindle, and the cell wires no statement to it
    arrival: int = 0  # motion at whose end the program has named X, Y and Z: up to there the way is not known
    # file and line of each motion by axes before the first target and behind the last one
    left_out: tuple[str, ...] = ()
    # posture that motions of a robot program ask for; None of other languages
    postures: dict[int, StatedPosture] | None = None
    # no statement of the cell's table starts the spindle: the program asks a person for it
    started_by_person: bool = False


@dataclass(frozen=True, eq=False)
class Machining:
    """Tools, spindle and cutting constants as the cell file states them."""

    limits_of: Callable[[int], ProcessLimits]  # gives the limits of the process for a tool number
    tools: Mapping[int, ToolBounds]  # by number
    rigid: str = ""  # axes whose stiffness is not known, as text; empty: none
    sample_s: float | None = None  # period of the force sensor; None where the process is not monitored


@dataclass(frozen=True, eq=False)
class MadeCut:
    """The cut of the tool that does not yield, along a path of n rows."""

    path: ToolPath
    blank: HeightMap  # the stock before the cut
    result: Cut | None  # None where it cannot be computed
    fault: str  # why
    contact: Bool  # (n,) segments at feed that remove material
    forced: Bool  # (n,) of these, those with the spindle on, clockwise

    @property
    def volume_m3(self) -> Float:
        """(n,) removed on the way to each row; 0 where the cut cannot be computed."""
        return np.zeros(len(self.path)) if self.result is None else self.result.volume_m3

    @property
    def turning(self) -> ToolPath:
        """The path with the spindle turning everywhere."""
        return replace(self.path, spindle_rad_s=spindle.turning(self.path, _STANDING_RAD_S))


def made_cut(path: ToolPath, stock: HeightMap, setting: Setting, progress: Progress) -> MadeCut:
    """Cut the stock along a path, also where the spindle stands or turns backwards.

    ``stock``: the blank; left as it is.
    """
    none = np.zeros(len(path), dtype=np.bool_)
    try:
        turning = replace(path, spindle_rad_s=spindle.turning(path, _STANDING_RAD_S))
        result = cut(turning, path.p_part_tcp, stock.copy(), setting.cutter_of, setting.law, progress=progress)
    except CounterflexError as fault:
        return MadeCut(path, stock, None, fault.what, none, none)
    contact = (path.kind == FEED) & (result.volume_m3 > _CONTACT_M3)
    return MadeCut(path, stock, result, "", contact, contact & (path.spindle_rad_s > 0.0))


def cut_rows(made: MadeCut, setting: Setting, machining: Machining, written: AsWritten) -> list[Row]:
    """Rows of what the program cuts and states; they need no robot.

    ``machining``: what the cell says of tools and spindle; ``written``: what the program says.
    """
    path, blank, tools = made.path, made.blank, machining.tools
    cutter_of, contact = setting.cutter_of, made.contact
    maybe = cutter_or_none(cutter_of)
    by_person = written.spindle_by_person
    rows = [
        moves.first_row(path, blank, maybe, written.height_known, written.arrival),
        moves.change_row(path, blank, maybe),
        length_row(path, written.stated),
        work_row(path, written.stated),
        diameter_row(path, written.stated, maybe),
        reading_row(written.stated),
        spindle.speed_row(path, machining.limits_of, tools, by_person),
    ]
    if made.result is None:
        return rows
    volume = made.result.volume_m3
    used = np.unique(path.tool[path.kind == FEED]).tolist()
    radius = max((cutter_of(n).radius_m for n in used), default=0.0)
    rows += [
        rapid_row(path, volume),
        moves.end_row(path, made.result.volume_m3 > _CONTACT_M3, blank, maybe, written.stated.spindle_on_at_end),
        tool_use.removed_row(path, volume, moves.gap(blank, path.p_part_tcp[path.kind == FEED], radius)),
        spindle.in_cut_row(path, contact, by_person),
        _run_up(made, written, machining),
        spindle.standing_row(path, contact, written.stated.stops),
        flute_row(path, volume, made.result.axial_depth_m, {n: cutter_of(n) for n in used}, blank.cell_m),
        tool_use.plunge_row(path, volume, contact, cutter_of, tools),
        tool_use.coolant_row(path, contact, written.stated.coolant[path.motion], tools),
    ]
    if np.any(contact) and not np.any(made.forced):
        text = "the program states no speed of the spindle"
        forced = [Row(check, NOT_LOOKED_AT, what=text, missing=spindle.SPEED_KEY) for check in _OF_FORCE]
        return rows + forced
    return [
        *rows,
        tool_use.feed_row(path, made.result.feed_per_tooth_m, made.forced, cutter_of, tools),
        tool_use.speed_row(path, made.forced, cutter_of, tools),
        tooth_row(path, made.forced, cutter_of, machining.sample_s),
        demands.chip_row(made.result, made.forced, path.time_s, setting.law,
                         setting.allow_extrapolation),
    ]  # fmt: skip


def demanded(
    made: MadeCut, path: ToolPath, q: Float, setting: Setting, bounds: CheckLimits, machining: Machining
) -> list[Row]:
    """Rows of what the cut asks of spindle, tool and robot.

    ``path``: its first m rows: those that are reached; ``q``: (m, 6) rad; ``machining``: limits of the process.
    """
    if made.result is None or (np.any(made.contact) and not np.any(made.forced)):
        return []
    contact = made.forced[: len(q)]
    wrench = at_points(made.result.w_tcp_part, made.forced)[: len(q)]
    inputs = CompensationInputs(path, path.motion, made.blank, setting, q)
    demand = cut_demand(inputs, UndisturbedCut(made.result, contact, contact, wrench), machining.limits_of)
    rows = demands.demand_rows(demand, path.tool, path.spindle_rad_s, machining.limits_of, machining.rigid)
    return [*rows, demands.correction_row(demand, bounds, machining.rigid)]


def _run_up(made: MadeCut, written: AsWritten, machining: Machining) -> Row:
    if written.started_by_person:
        return Row(spindle.RUN_UP, "ok", what="a person starts the spindle")
    stated = written.stated
    return spindle.run_up_row(made.path, made.forced, stated.stops, stated.waits_first, machining.limits_of)


def cutter_or_none(cutter_of: Callable[[int], Cutter]) -> Callable[[int], Cutter | None]:
    """The cutter of a tool number, or None for one that the cell does not have."""

    def find(number: int) -> Cutter | None:
        try:
            return cutter_of(number)
        except CounterflexError:
            return None

    return find
