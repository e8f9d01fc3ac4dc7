"""No sideways correction inside a hole: what a plunge ended with stays until the tool has left along its axis.

While a tool plunges, its force bends the arm sideways too, and the correction follows the force so that the tool runs
straight. When the tool stops at the bottom, dwells, breaks through or backs out to clear chips, the force is gone; a
correction that went with it would be a sideways move of a tool that stands in a hole, and would come again with every
peck. So the sideways part and the tilt are held from the end of the first plunge until the tool is out. The part along
the axis is free: it moves the tool where it may move.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.path.toolpath import FEED, ToolPath

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
        held = correction[begin + last]
        own = np.sum(correction[inside] * here, axis=1) - here @ held
        correction[inside] = held + own[:, None] * here
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
