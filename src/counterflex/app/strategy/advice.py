"""Advice of ``plan strategy``: ways to finish a wall, ranked by the error normal to it, before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import AS_IT_IS, Reading, read_in_plane, setting_of
from counterflex.app.lowest_mode import STATED
from counterflex.app.strategy.own_cut import Along, OwnCut
from counterflex.app.unknowns import HANDBOOK, IDENTIFIED, WORN
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.cutting import material
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.plan.inputs import Setting
from counterflex.plan.relative_motion import hand_poses, part_carried, tool_carried
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.strategy.advise import CHATTER, Choices, CutPlace, Demands, Doubt, grid, outcomes
from counterflex.plan.strategy.chatter import Swing, WallPosture, depth_used, swing_of
from counterflex.plan.strategy.side_cut import SideCuts
from counterflex.plan.strategy.zero import normal_errors, zero_width
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_path

Range = tuple[float, float]
WIDTHS: Final = 40
"""Radial widths tried over a range; other quantities are tried at :data:`STEPS`."""
STEPS: Final = 5
THINNEST: Final = 0.05
WIDEST: Final = 0.6
"""Shares of the diameter between which widths are tried where none are given. Thin cuts leave less, but roughing must
not be off by more than they take: the error that nine of ten cells stay below at the program's own cut is the least."""
_ROBOT_FOUND: Final = 0.06
"""Standard deviation of the compliance of an identified robot: what Haehn2020 left of the deflection."""


@dataclass(frozen=True)
class WallOperation:
    """Operation that is asked for; None leaves it to the program and the advisor."""

    tool: int | None = None
    ae_m: Range | None = None  # Range of the radial width of cut
    ap_m: Range | None = None
    fz_m: Range | None = None  # Range of the feed per tooth
    spindle_rad_s: Range | None = None
    at_m: tuple[float, float, float] | None = None  # Point of the wall, part frame
    # Direction of the wall's normal, out of the material, from the part's x towards its y
    normal_rad: float | None = None
    height_m: float | None = None
    material: str | None = None  # Row of the material tables instead of the cell's
    kr_over_kc: float | None = None  # Assumed ratio where that row has no radial constant
    ka_over_kc: float | None = None
    longer_share: float | None = 1.0  # The choice may take so much of the program's own time; None is any
    rows: int = 8

    def speeds(self, own: OwnCut | None) -> Float:
        """Spindle speeds to try, rad/s."""
        return _values(self.spindle_rad_s, None if own is None else own.spindle_rad_s, "--rpm", STEPS, (1.0,))


@dataclass(frozen=True, eq=False)
class Advice:
    """Advice on one wall."""

    own: OwnCut | None  # What the program does; None without a program
    before: Choices | None  # The same as a choice
    choices: Choices
    best: list[int]  # Rows of ``choices``, the best first
    place: CutPlace  # Where
    law: ForceLaw


def advise(
    cell: Cell,
    operation: WallOperation,
    program: str | Path | None = None,
    *,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> Advice:
    """Advise on the wall finish of a program, or on one that is stated.

    Args:
        program: G-code file, or None.

    Raises:
        CounterflexError: The program finishes no wall, or the operation is not stated in full.
    """
    cell.require_milling()
    own = None
    if program is not None:
        cell, job = read_in_plane(program, cell, reading=reading)
        own = OwnCut.of(job, cell, operation.tool, progress)
    law, setting = _law(cell, operation), setting_of(cell, part_may_be_held=True)
    cutter, tool = _cutter(cell, operation, own)
    place = _place(cell, setting, operation, own)
    limits = cell.process_limits(tool)
    doubt = doubt_of(cell, operation)
    in_range = not cell.material.allow_extrapolation
    before = None
    demands = Demands(chips_in_range=in_range)
    if own is not None:
        before = outcomes(own.cuts, np.array([own.spindle_rad_s]), law, place, limits, doubt, demands)
        slowest = (
            None if operation.longer_share is None else float(before.time_s_per_m[0]) * operation.longer_share * 1.001
        )
        allowance = float(before.high_m[0]) if operation.ae_m is None else None
        demands = Demands(slowest, allowance, in_range, before)
    cuts, speeds = grid(_cuts(cutter, law, place, operation, own), operation.speeds(own))
    choices = outcomes(cuts, speeds, law, _softest(place, own, law), limits, doubt, demands)
    choices, best = _steady_along(choices, operation.rows, place, law, before)
    progress(1.0)
    return Advice(own, before, choices, best, place, law)


def _softest(place: CutPlace, own: OwnCut | None, law: ForceLaw) -> CutPlace:
    """The place with the one posture in which the program's own cut is nearest to chatter."""
    if own is None or len(place.standings) < 2:
        return place
    used = depth_used(own.cuts, law, np.array([own.spindle_rad_s]), place.standings)[0]
    return replace(place, standings=(place.standings[int(np.argmax(used))],))


def _steady_along(
    choices: Choices, rows: int, place: CutPlace, law: ForceLaw, before: Choices | None
) -> tuple[Choices, list[int]]:
    """Hold the best choices against chatter in every posture along the cut, until none of them chatters in one."""
    own = 1.0 if before is None else max(1.0, float(before.use.get(CHATTER, np.zeros(1))[0]))
    looked: set[int] = set()
    while True:
        best = choices.best(rows)
        new = [row for row in best if row not in looked]
        if not new or len(place.standings) < 2:
            return choices, best
        looked |= set(new)
        used = depth_used(choices.cuts.some(new), law, choices.spindle_rad_s[new], place.standings).max(axis=1)
        use = choices.use[CHATTER].copy()
        use[new] = np.maximum(use[new], used / own)
        choices = replace(choices, use=choices.use | {CHATTER: use})


def doubt_of(cell: Cell, operation: WallOperation) -> Doubt:
    """Return what is not known of force and stiffness, as :mod:`counterflex.app.unknowns` has it."""
    recipes = {entry.recipe for entry in cell.tables.identified}
    stiff = _ROBOT_FOUND if "stiffness" in recipes else STATED
    if "cutting" in recipes and operation.material is None:
        return Doubt(IDENTIFIED, IDENTIFIED, 0.0, stiff)
    return Doubt(HANDBOOK, HANDBOOK, WORN, stiff)


def _law(cell: Cell, operation: WallOperation) -> ForceLaw:
    if operation.material is None:
        return cell.force_law
    row = material.load(operation.material)
    return row.with_ratios(kr_over_kc=operation.kr_over_kc, ka_over_kc=operation.ka_over_kc)


def _cutter(cell: Cell, operation: WallOperation, own: OwnCut | None) -> tuple[Cutter, int]:
    if own is not None:
        return own.cuts.cutter, own.tool
    number = cell.tables.tools[0].number if operation.tool is None else operation.tool
    cutter = cell.cutter(number)
    if cutter.is_ball:
        raise InputError(
            "a ball end mill finishes no wall with its side alone",
            value=f"T{number}",
            hint="Choose a flat or bull-nose end mill with --tool",
        )
    return cutter, number


def _place(cell: Cell, setting: Setting, operation: WallOperation, own: OwnCut | None) -> CutPlace:
    here = _there(cell, setting, operation, own)
    height = operation.height_m
    if height is None:
        height = float(own.cuts.ap_m[0]) if own is not None else max(_required(operation.ap_m, "--ap-mm"))
    along: tuple[Along, ...] = (here,)
    if own is not None and operation.at_m is None and operation.normal_rad is None:
        along = own.along
    turned, normal = here.upright()
    return CutPlace(
        setting.chain,
        here.q,
        _compliance(setting, here.q, turned),
        turned,
        normal,
        height,
        tuple(_standing(setting, there) for there in along),
        tuple(_swing(setting, there) for there in along),
    )


def _there(cell: Cell, setting: Setting, operation: WallOperation, own: OwnCut | None) -> Along:
    """Posture, wall and tool axis where the operation is: of the program, or of a stated point."""
    axis = np.array([0.0, 0.0, 1.0]) if own is None else own.axis_part
    if own is not None and operation.at_m is None:
        q, to_part = own.q, own.to_part
    else:
        point = operation.at_m
        if point is None:
            stock = cell.stock()
            point = (float(stock.x_m().mean()), float(stock.y_m().mean()), float(stock.z.max()))
        T = pose.make(tool_orientation(axis[None], setting.rotation_about_tool_rad), np.array([point]))
        poses = hand_poses(setting.T_base_part, setting.T_base_tcp, T)
        q = inverse_path(setting.controller_chain, poses, setting.branch).q[0]
        relative = (
            tool_carried(setting.T_base_part) if setting.T_base_tcp is None else part_carried(setting.T_base_tcp, T)
        )
        to_part = relative.to_part[0]
    normal = np.array([0.0, 1.0, 0.0]) if own is None else own.normal_part
    if operation.normal_rad is not None:
        normal = np.array([math.cos(operation.normal_rad), math.sin(operation.normal_rad), 0.0])
        normal -= float(normal @ axis) * axis
        normal /= np.linalg.norm(normal)
    return Along(q, normal, axis, to_part, 0 if own is None else own.line)


def _compliance(setting: Setting, q: Float, to_part: Float) -> Float:
    out: Float = to_part @ cartesian_compliance(setting.chain, q) @ to_part.T
    return out


def _standing(setting: Setting, there: Along) -> WallPosture:
    to_part, normal = there.upright()
    return WallPosture(robot_modes(setting.chain, there.q, to_part, setting.mode, setting.damping.ratio), normal)


def _swing(setting: Setting, there: Along) -> Swing:
    to_part, normal = there.upright()
    compliance = _compliance(setting, there.q, to_part)
    return swing_of(
        setting.chain, there.q, to_part, compliance, normal, setting.damping.ratio, setting.mode, there.line
    )


def _required(given: Range | None, option: str) -> Range:
    if given is None:
        raise InputError("the operation is not stated in full", where=option, hint="Give it, or give a program")
    return given


def _values(given: Range | None, own: float | None, option: str, steps: int, spread: Sequence[float]) -> Float:
    """Values of a range; without one, the program's own value times some factors."""
    if given is None and own is not None:
        return own * np.array(spread)
    low, high = _required(given, option)
    if low == high:
        return np.array([low])
    out: Float = np.geomspace(low, high, steps)
    out[0], out[-1] = low, high
    return out


def _cuts(
    cutter: Cutter, law: ForceLaw, place: CutPlace, operation: WallOperation, own: OwnCut | None
) -> list[SideCuts]:
    """Both sides of every width, depth and chip; widths at which the tool stays on the wall among them."""
    own_of = {} if own is None else {name: float(getattr(own.cuts, name)[0]) for name in ("ae_m", "ap_m", "fz_m")}
    ap = _values(operation.ap_m, own_of.get("ap_m"), "--ap-mm", STEPS, (1.0, 1.0 / 2.0, 1.0 / 3.0))
    fz = _values(operation.fz_m, own_of.get("fz_m"), "--fz-mm", STEPS, (0.7, 0.85, 1.0, 1.2, 1.4))
    d = cutter.diameter_m
    given = operation.ae_m
    if given is None and own is not None:
        given = min(own_of["ae_m"], THINNEST * d), max(own_of["ae_m"], WIDEST * d)
    widths = _values(given, None, "--ae-mm", WIDTHS, ())
    for name, values, most in (("--ap-mm", ap, cutter.flute_length_m), ("--ae-mm", widths, d)):
        if float(values.max()) > most * (1.0 + 1e-9):
            raise InputError(
                "a cut is larger than the tool can make",
                where=name,
                value=f"{float(values.max()) / MM:g} mm",
                limit=f"at most {most / MM:g} mm",
            )
    out = []
    for depth in ap.tolist():
        for chip in fz.tolist():
            zero = zero_width(
                cutter, depth, chip, lambda c: normal_errors(c, law, place.compliance_part, place.normal_part).sum(1)
            )
            more = [zero] if zero is not None and widths.min() <= zero <= widths.max() else []
            both = np.tile(np.append(widths, more), 2)
            one = np.ones(len(both))
            up = np.arange(len(both)) < len(both) // 2
            out.append(SideCuts(cutter, up, both, depth * one, chip * one))
    return out
