"""Feeds within the limits of spindle, tool and robot, and what became of them in shop units."""

from __future__ import annotations

from typing import Any

from counterflex.app.inputs import Job
from counterflex.files.cell.cell import Cell
from counterflex.plan.feed_limits import LimitedFeed, known, limit_feed
from counterflex.plan.inputs import CompensationInputs, Setting, solve_joints


def limited_feed(job: Job, cell: Cell, setting: Setting) -> LimitedFeed | None:
    """The program at feeds within ``[process_limits]``; None where the cell file has no limit that a feed keeps."""
    if not any(known(cell.process_limits(tool.number)) for tool in cell.tables.tools):
        return None
    line = job.line_of_motion[job.path.motion]
    inputs = CompensationInputs(job.path, line, cell.stock(), setting, solve_joints(job.path, line, setting).q)
    return limit_feed(inputs, job.feeds, cell.process_limits)


def shown_limits(limited: LimitedFeed) -> dict[str, Any]:
    """Return what became of the feed, in shop units."""
    return {
        "extra_s": round(limited.extra_s, 3),
        "kept": all(line.after_share <= 1.001 for line in limited.lines),
        "lines": [
            {
                "line": line.line,
                "feed_percent": round(100.0 * line.share, 1),
                "limit": line.limit,
                "before_percent": round(100.0 * line.before, 1),
                "after_percent": round(100.0 * line.after_share, 1),
                "kept": bool(line.after_share <= 1.001),
            }
            for line in limited.lines
        ],
    }
