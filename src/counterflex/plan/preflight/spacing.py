"""Blocks of a program against the controller: time per block at feed, and how far ahead it sees.

A controller works off a block in no less than its least block time T, and never runs faster than it can stop within the
blocks that it has read. Blocks shorter than ``feed T`` (Berger2013 eq. 5) let the feed collapse to ``length / T``; n
blocks ahead, of length ``L_n`` together, allow ``sqrt(2 a L_n)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, CheckLimits, Row

LOOK_AHEAD_KEY: Final = "controller.look_ahead_blocks"
_ADVICE: Final = "Use arcs, fewer points (a larger chord tolerance in the CAM program), or a lower feed"


@dataclass(frozen=True, eq=False)
class BlockSpacing:
    """Moving blocks of a program in order."""

    point: Int  # (k,) row of the path at which each ends
    length_m: Float  # (k,) of the path
    feed_m_s: Float  # (k,) programmed
    cuts: Bool  # (k,) at feed, not a rapid
    stands: Bool  # (k,) the tool stands behind it (a dwell, the end): there it brakes anyway


def blocks_of(path: ToolPath) -> BlockSpacing:
    """Blocks of a sampled path: rows of one motion are one block.

    Args:
        path: n rows as sampled, without stops of planning.
    """
    length = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1)
    number, first = np.unique(path.motion, return_index=True)
    last = np.append(first[1:], len(path)) - 1
    total = np.add.reduceat(length, first) if len(number) else np.empty(0)
    moves = total > 0.0
    time = path.time_s[last] - path.time_s[np.maximum(first - 1, 0)]
    dwell = np.append((~moves & (time > 0.0))[1:], True) if len(moves) else moves
    return BlockSpacing(
        last[moves], total[moves], path.feed_m_s[last[moves]], path.kind[last[moves]] == FEED, dwell[moves]
    )


def reached_feed(blocks: BlockSpacing, least_block_s: float, look_ahead: int | None, acceleration_m_s2: float) -> Float:
    """Feed that the controller can hold in each block, m/s.

    Args:
        blocks: k blocks.
        least_block_s: T, s, > 0.
        look_ahead: Blocks n that it sees behind the present one; None: all.
        acceleration_m_s2: a, with which it brakes, > 0.

    Returns:
        (k,) ``min(feed, length / T, sqrt(2 a L_n))``.
    """
    feed = np.minimum(blocks.feed_m_s, blocks.length_m / least_block_s)
    if look_ahead is None or len(feed) == 0:
        return feed
    station = np.concatenate([[0.0], np.cumsum(blocks.length_m)])
    k = np.arange(len(feed))
    until = np.minimum(k + 1 + look_ahead, len(feed))
    ahead = station[until] - station[k + 1]
    stop = np.flatnonzero(blocks.stands)  # it brakes for a stop that it sees in any case
    following = stop[np.minimum(np.searchsorted(stop, k), len(stop) - 1)] if len(stop) else np.full(len(k), len(k) - 1)
    sees_stop = following < until
    out: Float = np.where(sees_stop, feed, np.minimum(feed, np.sqrt(2.0 * acceleration_m_s2 * ahead)))
    return out


def spacing_rows(path: ToolPath, bounds: CheckLimits) -> list[Row]:
    """Block time at feed, and feed left by the look-ahead.

    Args:
        bounds: Least block time, look-ahead, acceleration.
    """
    blocks = blocks_of(path)
    cut = np.flatnonzero(blocks.cuts)
    if len(cut) == 0:
        return [
            Row("block time at feed", "ok", what="no feed motions"),
            Row("look-ahead", "ok", what="no feed motions"),
        ]
    time = blocks.length_m[cut] / blocks.feed_m_s[cut]
    worst, short = int(np.argmin(time)), time < bounds.least_block_s * (1.0 - 1e-9)
    share = float(time[worst] / bounds.least_block_s)
    late = float(np.sum(bounds.least_block_s - time[short]))
    text = f"{int(short.sum())} of {len(cut)} blocks; feed falls to {100 * share:.0f} %, {late:.1f} s more"
    rows = [
        Row(
            "block time at feed",
            "warning" if np.any(short) else "ok",
            float(time[worst]),
            bounds.least_block_s,
            "s",
            int(blocks.point[cut[worst]]),
            text if np.any(short) else f"{len(cut)} blocks",
            advice=_ADVICE if np.any(short) else "",
        )
    ]
    if bounds.look_ahead is None:
        return [*rows, Row("look-ahead", NOT_LOOKED_AT, missing=LOOK_AHEAD_KEY)]
    alone = reached_feed(blocks, 1e-12, bounds.look_ahead, bounds.acceleration_m_s2)
    held = (alone / blocks.feed_m_s)[cut]
    worst = int(np.argmin(held))
    slow = held < 1.0 - 1e-9
    return [
        *rows,
        Row(
            "look-ahead",
            "warning" if np.any(slow) else "ok",
            float(held[worst]),
            1.0,
            "share",
            int(blocks.point[cut[worst]]),
            f"of the feed; {int(slow.sum())} of {len(cut)} blocks with {bounds.look_ahead} blocks ahead",
            advice=_ADVICE if np.any(slow) else "",
        ),
    ]
