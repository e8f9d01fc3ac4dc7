"""Feeds for a tolerance, and what became of them in shop units."""

from __future__ import annotations

from typing import Any

from counterflex.app.inputs import Job
from counterflex.core.progress import Progress
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.feed_for_tolerance import ROUNDS, FeedTolerance, LoweredFeed, lower_feed
from counterflex.plan.inputs import Setting
from counterflex.plan.plan import Plan


def lowered_plan(job: Job, cell: Cell, setting: Setting, wish: FeedTolerance, progress: Progress) -> LoweredFeed:
    """Plan a program at feeds for a tolerance, see :func:`counterflex.plan.feed_for_tolerance.lower_feed`.

    Args:
        job: The program.
        cell: Its cell.
        setting: What planning stands on.
        wish: Tolerance and limits.
        progress: Progress callback, fraction 0 to 1, a share for each round that may come.
    """
    rounds = iter(range(ROUNDS + 1))

    def make(path: ToolPath) -> Plan:
        done = next(rounds)

        def report(fraction: float, what: str = "") -> None:
            progress((done + fraction) / (ROUNDS + 1.0), f"round {done + 1}: {what}" if what else "")

        return make_plan(
            path, job.line_of_motion, cell.stock(), setting, feeds=job.feeds, predict=True, progress=report
        )

    return lower_feed(job.path, job.feeds, wish, make)


def shown_feed(lowered: LoweredFeed, wish: FeedTolerance) -> dict[str, Any]:
    """What became of the feed, in shop units."""
    return {
        "tolerance_um": round(wish.tolerance_m / UM, 3),
        "least_percent": round(100.0 * wish.least, 3),
        "least_chip_um": round(wish.least_chip_m / UM, 3),
        "extra_s": round(lowered.extra_s, 3),
        "time_s": round(float(lowered.plan.path.time_s[-1]), 3),
        "worst_before_um": round(lowered.before_m / UM, 1),
        "worst_after_um": round(lowered.after_m / UM, 1),
        "reached": bool(lowered.after_m <= wish.tolerance_m),
        "rounds": lowered.rounds,
        "lines": [
            {
                "line": line.line,
                "feed_percent": round(100.0 * line.share, 1),
                "before_um": round(line.before_m / UM, 1),
                "after_um": round(line.after_m / UM, 1),
                "why": line.why,
            }
            for line in lowered.lines
        ],
    }
