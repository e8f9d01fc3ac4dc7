"""Checks of what a program takes for granted: tool length and work offsets, the diameter of its tools, one reading."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row
from counterflex.programs.stated.offsets import NONE, OWN, UNSAID
from counterflex.programs.stated.remarks import Stated

LENGTH: Final = "tool length offset"
WORK: Final = "work offset"
DIAMETER: Final = "tool of the program"
READING: Final = "words with two readings"
_SAME: Final = 0.02
"""Share by which a reground tool may be smaller than the one in a comment."""


def length_row(path: ToolPath, stated: Stated) -> Row:
    """Return the first motion that runs with no tool length offset, or with that of another tool.

    Motions at feed and rapids that go down count.

    Args:
        path: n rows.
        stated: By the program.
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
    """Return the first motion in a work offset whose place is not known.

    Args:
        path: n rows.
        stated: By the program.
    """
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

    Args:
        path: n rows.
        stated: By the program.
        cutter_of: Gives the cutter of a tool number, None for one that the cell does not have.
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
    """Return the words of the program that controllers read in two ways, and the reading that was checked.

    Args:
        stated: By the program.
    """
    if stated.doubts:
        return Row(READING, NOT_LOOKED_AT, what="; ".join(stated.doubts))
    return Row(READING, "ok", what="none")
