"""Rows that stand on the predicted cut: what is removed, by which tool, and what that asks of spindle and robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import CounterflexError
from counterflex.core.progress import Progress
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.feed_limits import cut_demand
from counterflex.plan.inputs import Inputs, Setting
from counterflex.plan.preflight.process import demands, moves, spindle, tool_use
from counterflex.plan.preflight.process.offsets import diameter_row, length_row, reading_row, work_row
from counterflex.plan.preflight.process.tool_bounds import ToolBounds
from counterflex.plan.preflight.rapids import flute_row, rapid_row
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Bounds, Row
from counterflex.plan.preflight.size import ProgramSize
from counterflex.plan.process_limits import ProcessLimits
from counterflex.plan.undisturbed_cut import UndisturbedCut
from counterflex.programs.robot_text.stated import Stated as StatedPosture
from counterflex.programs.stated.remarks import Stated

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
    tool_use.CUTTING_SPEED,
)  # fmt: skip
NEEDS_CUT: Final = (*_OF_VOLUME, *_OF_FORCE)
"""Checks that stand on the predicted cut."""


@dataclass(frozen=True, eq=False)
class AsWritten:
    """Statements of the program about its run on the controller.

    Attributes:
        approximation_m: (motions,) distance at which the rounding of the corner at its end begins, 0 for an exact stop,
            NaN where it names none, see :func:`counterflex.programs.approximation.approximation_m`.
        size: How large it is.
        stated: Offsets, coolant and end.
        height_known: The program has named the height of the tool with or before its first motion.
        spindle_by_person: It says nothing of the spindle, and the cell wires no statement to it.
        postures: Posture that motions of a robot program ask for; None of other languages.
        started_by_person: No statement of the cell's table starts the spindle: the program asks a person for it.
        arrival: Motion at whose end the program has named X, Y and Z: up to there the way is not known.
        left_out: File and line of each motion by axes before the first target and behind the last one.
    """

    approximation_m: Float
    size: ProgramSize
    stated: Stated
    height_known: bool = True
    spindle_by_person: bool = False
    arrival: int = 0
    left_out: tuple[str, ...] = ()
    postures: dict[int, StatedPosture] | None = None
    started_by_person: bool = False


@dataclass(frozen=True, eq=False)
class Machining:
    """Tools, spindle and cutting constants as the cell file states them.

    Attributes:
        limits_of: Gives the limits of the process for a tool number.
        tools: By number.
        rigid: Axes whose stiffness is not known, as text; empty: none.
    """

    limits_of: Callable[[int], ProcessLimits]
    tools: Mapping[int, ToolBounds]
    rigid: str = ""


@dataclass(frozen=True, eq=False)
class MadeCut:
    """The cut of the tool that does not yield, along a path of n rows.

    Attributes:
        path: The path.
        blank: The stock before the cut.
        result: None where it cannot be computed.
        fault: Why.
        contact: (n,) segments at feed that remove material.
        forced: (n,) of these, those with the spindle on, clockwise.
    """

    path: ToolPath
    blank: HeightMap
    result: Cut | None
    fault: str
    contact: Bool
    forced: Bool

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

    Args:
        path: n rows.
        stock: The blank; left as it is.
        setting: Cell.
        progress: Progress callback, fraction 0 to 1.
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

    Args:
        made: The cut.
        setting: Cell.
        machining: What the cell says of tools and spindle.
        written: What the program says.
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
        demands.chip_row(made.result, made.forced, path.time_s, setting.law,
                         setting.allow_extrapolation),
    ]  # fmt: skip


def demanded(
    made: MadeCut, path: ToolPath, q: Float, setting: Setting, bounds: Bounds, machining: Machining
) -> list[Row]:
    """Rows of what the cut asks of spindle, tool and robot.

    Args:
        made: The cut.
        path: Its first m rows: those that are reached.
        q: (m, 6) rad.
        setting: Cell.
        bounds: Of corrections.
        machining: Limits of the process.
    """
    if made.result is None or (np.any(made.contact) and not np.any(made.forced)):
        return []
    contact = made.forced[: len(q)]
    wrench = at_points(made.result.w_tcp_part, made.forced)[: len(q)]
    inputs = Inputs(path, path.motion, made.blank, setting, q)
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
