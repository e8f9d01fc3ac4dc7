"""Checks of how each tool is used: material that it removes, feed per tooth, cutting speed, plunging, coolant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.feed_schedule import LEAST_CHIP_M
from counterflex.plan.preflight.process.tool_bounds import ToolBounds
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row

REMOVED: Final = "removed material"
FEED_PER_TOOTH: Final = "feed per tooth"
CUTTING_SPEED: Final = "cutting speed"
PLUNGING: Final = "plunging"
COOLANT: Final = "coolant"
LARGEST_CHIP_SHARE: Final = 0.025
"""Assumed largest feed per tooth of a mill by its diameter: makers of end mills recommend 0.3 to 1.5 %; feeds beyond
2.5 % are those of high-feed mills and soft materials, whose range the cell file can state."""
RAMP_RAD: Final = 10.0 * DEG
"""Assumed steepest ramp of a mill that does not cut at its centre: indexable mills are given 2 to 10 deg."""
_LEVEL: Final = 0.5
"""Share of the way that a row goes along the tool axis, below which its feed per tooth counts."""
_HALF: Final = 0.5
"""Share of the disc of a mill that a straight edge of material through its centre covers."""
_MADE: Final = 1.02
"""Feeds within 2 % are those of the limit: they are rounded in programs."""
_LEAST_M3: Final = 1e-2 * MM**3
"""Less is the grain of the stock."""


def removed_row(path: ToolPath, volume_m3: Float, gap_m: float) -> Row:
    """Return the tool that removes least at feed; one that removes nothing is a warning.

    Args:
        path: n rows.
        volume_m3: (n,) removed on the way to each row.
        gap_m: Distance of the tool from the blank where it comes nearest, for a program that cuts nothing.
    """
    feed = path.kind == FEED
    moves = feed & (np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) > 0.0)
    advice = "Check the zero of the part, the blank in [part.stock] and the tool"
    if not np.any(moves):
        return Row(REMOVED, "warning", 0.0, 0.0, "m3", what="the program has no motion at feed", advice=advice)
    volumes = {n: float(volume_m3[feed & (path.tool == n)].sum()) for n in np.unique(path.tool[moves]).tolist()}
    first = int(np.argmax(moves))
    if max(volumes.values()) <= _LEAST_M3:
        text = f"the program cuts nothing: the tool stays {gap_m / MM:.1f} mm away from the blank"
        return Row(REMOVED, "warning", 0.0, 0.0, "m3", first, text, advice=advice)
    least = min(volumes, key=lambda n: volumes[n])
    row = int(np.argmax(moves & (path.tool == least)))
    if volumes[least] <= _LEAST_M3:
        return Row(REMOVED, "warning", 0.0, 0.0, "m3", row, f"tool T{least} cuts nothing", advice=advice)
    return Row(REMOVED, "ok", sum(volumes.values()), 0.0, "m3", what=", ".join(f"T{n}" for n in volumes))


def feed_row(
    path: ToolPath, feed_per_tooth_m: Float, contact: Bool, cutter_of: Callable[[int], Cutter],
    tools: Mapping[int, ToolBounds],
) -> Row:  # fmt: skip
    """Return the feed per tooth that is farthest beyond the range of its tool, or nearest to its end.

    Args:
        path: n rows.
        feed_per_tooth_m: (n,).
        contact: (n,) segments at feed that remove material with the spindle on.
        cutter_of: Gives the cutter of a tool number.
    """
    rows = np.flatnonzero(contact & _level(path) & np.isfinite(feed_per_tooth_m))
    if len(rows) == 0:
        return Row(FEED_PER_TOOTH, "ok", what="nothing is cut sideways")
    low, high = np.full(len(path), LEAST_CHIP_M), np.full(len(path), np.inf)
    stated = np.zeros(len(path), dtype=np.bool_)
    for n in np.unique(path.tool[rows]).tolist():
        given, of = tools.get(n, ToolBounds()).feed_per_tooth_m, path.tool == n
        stated[of] = given is not None
        low[of], high[of] = (LEAST_CHIP_M, LARGEST_CHIP_SHARE * cutter_of(n).diameter_m) if given is None else given
    fz = feed_per_tooth_m
    over, under = fz / high, low / np.maximum(fz, 1e-12)
    # Beyond a stated range is a fail, beyond an assumed one a warning: the fail is told, however far the other is off.
    refused = rows[stated[rows] & (over[rows] > _MADE)]
    among = refused if len(refused) else rows
    top, bottom = int(among[np.argmax(over[among])]), int(rows[np.argmax(under[rows])])
    if over[top] > _MADE:
        text = f"tool T{int(path.tool[top])}, above the largest" + ("" if stated[top] else ", assumed")
        advice = "Lower the feed or raise S" + ("" if stated[top] else "; or state tools.feed_per_tooth_mm")
        return Row(FEED_PER_TOOTH, "fail" if stated[top] else "warning", float(fz[top]), float(high[top]), "m", top,
                   text, advice=advice)  # fmt: skip
    if under[bottom] > _MADE:
        text = f"tool T{int(path.tool[bottom])}, below the least: the edge rubs" + (
            "" if stated[bottom] else ", assumed"
        )
        advice = "Raise the feed or lower S" + ("" if stated[bottom] else "; or state tools.feed_per_tooth_mm")
        return Row(FEED_PER_TOOTH, "warning", float(fz[bottom]), float(low[bottom]), "m", bottom, text, advice=advice)
    text = f"tool T{int(path.tool[top])}" + ("" if stated[top] else "; range assumed")
    return Row(FEED_PER_TOOTH, "ok", float(fz[top]), float(high[top]), "m", top, text)


def speed_row(
    path: ToolPath, contact: Bool, cutter_of: Callable[[int], Cutter], tools: Mapping[int, ToolBounds]
) -> Row:
    """Return the cutting speed at the diameter that is farthest beyond the range of its tool.

    ``contact``: (n,) segments at feed that remove material with the spindle on; ``tools``: by number.
    """
    rows = np.flatnonzero(contact)
    if len(rows) == 0:
        return Row(CUTTING_SPEED, "ok", what="nothing is cut")
    numbers = np.unique(path.tool[rows]).tolist()
    radius = {n: cutter_of(n).radius_m for n in numbers}
    speed = np.abs(path.spindle_rad_s) * np.array([radius.get(n, 0.0) for n in path.tool.tolist()])
    beyond = np.zeros(len(path))
    limit = np.zeros(len(path))
    lacking = []
    for n in numbers:
        given = tools.get(n, ToolBounds()).cutting_speed_m_s
        of = contact & (path.tool == n)
        if given is None:
            lacking.append(n)
            continue
        limit[of] = np.where(speed[of] < given[0], given[0], given[1])
        beyond[of] = np.maximum(speed[of] / given[1], given[0] / np.maximum(speed[of], 1e-12))
    row = int(np.argmax(beyond))
    over = beyond[row] > _MADE
    if lacking and not over:  # a tool whose range is not known hides none that is beyond its own
        row = int(np.argmax(np.where(contact & (path.tool == lacking[0]), speed, -1.0)))
        return Row(CUTTING_SPEED, NOT_LOOKED_AT, float(speed[row]) * 60.0, None, "m/min", row, f"tool T{lacking[0]}",
                   "tools.cutting_speed_m_min")  # fmt: skip
    value, bound, what = float(speed[row]) * 60.0, float(limit[row]) * 60.0, f"tool T{int(path.tool[row])}"
    advice = "Change S to the range of the tool" if over else ""
    return Row(CUTTING_SPEED, "warning" if over else "ok", value, bound, "m/min", row, what, advice=advice)


def plunge_row(
    path: ToolPath, volume_m3: Float, contact: Bool, cutter_of: Callable[[int], Cutter],
    tools: Mapping[int, ToolBounds],
) -> Row:  # fmt: skip
    """Return the steepest descent into material under the centre of a mill, by tools that may not plunge.

    A row that descends by dz and removes more than half of its disc times dz has material under its centre.

    Args:
        path: n rows.
        volume_m3: (n,) removed on the way to each row.
        contact: (n,) segments at feed that remove material.
        cutter_of: Gives the cutter of a tool number.
    """
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    down = -np.sum(step * path.axis_part, axis=1)
    length = np.linalg.norm(step, axis=1)
    steep = np.arcsin(np.clip(down / np.maximum(length, 1e-12), -1.0, 1.0))
    worst: dict[int, int] = {}
    for n in np.unique(path.tool[contact]).tolist():
        disc = np.pi * cutter_of(n).radius_m ** 2
        under = contact & (path.tool == n) & (down > 0.0) & (volume_m3 > _HALF * disc * down)
        if np.any(under):
            worst[n] = int(np.argmax(np.where(under, steep, -1.0)))
    if not worst:
        return Row(PLUNGING, "ok", what="no tool descends into material")
    refused: list[tuple[int, int, float]] = []
    unknown: list[tuple[int, int, float]] = []
    for n, row in worst.items():
        tool, limit = tools.get(n, ToolBounds()), RAMP_RAD
        limit = limit if tool.ramp_rad is None else tool.ramp_rad
        if tool.centre_cutting is not True and steep[row] > limit * _MADE and not cutter_of(n).is_ball:
            (unknown if tool.centre_cutting is None and tool.ramp_rad is None else refused).append((n, row, limit))
    if refused:
        n, row, limit = max(refused, key=lambda entry: steep[entry[1]])
        text = f"tool T{n} descends steeper than a mill that does not cut at its centre may"
        advice = "Enter by a ramp, a helix or from the side, or use a mill that cuts at its centre"
        return Row(PLUNGING, "fail", float(steep[row]), limit, "rad", row, text, advice=advice)  # fmt: skip
    if unknown:
        n, row, limit = max(unknown, key=lambda entry: steep[entry[1]])
        text = f"tool T{n} descends into material"
        return Row(PLUNGING, NOT_LOOKED_AT, float(steep[row]), None, "rad", row, text, "tools.centre_cutting")
    row = max(worst.values(), key=lambda row: float(steep[row]))
    return Row(PLUNGING, "ok", float(steep[row]), None, "rad", row, f"tool T{int(path.tool[row])}")


def coolant_row(path: ToolPath, contact: Bool, coolant: Int, tools: Mapping[int, ToolBounds]) -> Row:
    """Return the first cut whose coolant is not as its tool needs it.

    Args:
        path: n rows.
        contact: (n,) segments at feed that remove material.
        coolant: (n,) 1 on, 0 off, below 0 where the program does not say.
    """
    numbers = np.unique(path.tool[contact]).tolist()
    required = {n: tools.get(n, ToolBounds()).coolant for n in numbers}
    lacking = [f"T{n}" for n, want in required.items() if want is None]
    if not numbers:
        return Row(COOLANT, "ok", what="nothing is cut")
    want = np.array([int(bool(required.get(n))) for n in path.tool.tolist()])
    stated = np.array([required.get(n) is not None for n in path.tool.tolist()])
    wrong = contact & stated & (np.maximum(coolant, 0) != want)
    if lacking and not np.any(wrong):  # a tool of which nothing is said hides none that is cut the wrong way
        return Row(COOLANT, NOT_LOOKED_AT, what=", ".join(lacking), missing="tools.coolant")
    if not np.any(wrong):
        return Row(COOLANT, "ok", 0.0, 0.0, what="as the tools need it")
    row = int(np.argmax(wrong))
    text = f"tool T{int(path.tool[row])} cuts {'without' if want[row] else 'with'} coolant"
    return Row(
        COOLANT, "warning", point=row, what=text, advice="M8 before the cut" if want[row] else "M9 before the cut"
    )


def _level(path: ToolPath) -> Bool:
    """(n,) segments that go across the tool axis rather than along it."""
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    along = np.abs(np.sum(step * path.axis_part, axis=1))
    out: Bool = along < _LEVEL * np.linalg.norm(step, axis=1)
    return out
