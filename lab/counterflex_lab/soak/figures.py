"""Figures of a long run of the online loop: counts, percentiles, growth per hour; of a minute, and of all of it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import compress
from operator import attrgetter
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex_lab.soak.replay_figures import active, in_standstill, micro
from counterflex_lab.soak.timed_block import Block

_GROW = ("_mb", "_files", "_threads")
"""Ends of the names of what must not grow."""
_COUNTS = ("cycles", "missed", "without_session", "active", "held")


@dataclass(frozen=True)
class Growth:
    """A straight line through values."""

    slope: float  # change per unit of time
    # of the slope, from the scatter about the line; values that come one after the other are taken as independent, so
    # slow waves make it too small
    standard_error: float


def growth(time: Float, values: Float) -> Growth | None:
    """Least squares: ``slope = sum (t - mean t) (x - mean x) / sum (t - mean t)^2``, ``s^2 / sum (t - mean t)^2``.

    Args:
        time: (n,) of any unit.
        values: (n,); those not finite are left out.

    Returns:
        None where fewer than three values at different times are left.

    Raises:
        InputError: The shapes differ.
    """
    time, values = as_float("time", time, (None,)), np.asarray(values, dtype=np.float64)
    if time.shape != values.shape:
        raise InputError("times and values", value=(time.shape, values.shape), limit="of the same length")
    good = np.isfinite(values)
    t, x = time[good], values[good]
    if len(t) < 3 or np.ptp(t) <= 0.0:
        return None
    t = t - np.mean(t)
    spread = float(np.sum(t**2))
    slope = float(np.sum(t * (x - np.mean(x)))) / spread
    residual = x - np.mean(x) - slope * t
    return Growth(slope, math.sqrt(float(np.sum(residual**2)) / (len(t) - 2) / spread))


def minute(k: int, block: Block) -> dict[str, float]:
    """Row of a minute for ``minutes.csv``.

    Args:
        k: Its number, 0 is the first.
        block: What was timed in it.
    """
    n = len(block.reply_s)
    reply, echo, late = (micro(times) for times in (block.reply_s, block.echo_s, block.late_s))
    unanswered, stood = np.isnan(block.reply_s), in_standstill(block)
    return {
        "minute": k + 1,
        "cycles": n,
        "active": int(np.sum(active(block))),
        "held": block.held_cycles,
        "missed": block.missed,
        "without_session": block.paused,
        "programs_ended": len(block.ended),
        "unanswered": int(np.sum(unanswered)),
        "unanswered_active": int(np.sum(unanswered & active(block))),
        "in_standstill": int(np.sum(stood)),
        "unanswered_in_standstill": int(np.sum(unanswered & stood)),
        **{f"reply_{name}_us": value for name, value in reply.items() if name != "n"},
        **{f"echo_{name}_us": value for name, value in echo.items() if name != "n"},
        "cell_late_p999_us": late["p999"],
        "largest_correction_um": round(block.largest_m / MM * 1e3, 1),
    }


def figures(blocks: list[Block], minutes: list[dict[str, float]], samples: list[dict[str, float]]) -> dict[str, Any]:
    """Figures of the whole run.

    Args:
        blocks: All minutes.
        minutes: Their rows.
        samples: Rows of memory and load.

    Returns:
        Counts of cycles; percentiles of reply and echo over all telegrams, over those while the correction acted, and
        over those of them outside of standstills of the machine; growth per hour.
    """
    every = (attrgetter("reply_s"), attrgetter("echo_s"), active, in_standstill)
    reply, echo, acting, stood = (np.concatenate(list(map(select, blocks))) for select in every)
    unanswered = np.isnan(reply)
    hours = np.array([s["seconds"] for s in samples]) / 3600.0
    settled = hours >= 0.1 * hours[-1]
    must_not_grow = [name for name in samples[0] if name.endswith(_GROW)]
    times = ("reply_p50_us", "reply_p99_us", "echo_p50_us", "echo_p99_us")
    total = {column: int(sum(m[column] for m in minutes)) for column in _COUNTS}
    of_all, of_echo = micro(reply), micro(echo)
    cycles = total["cycles"] + total["missed"] + total["without_session"]
    return {
        "cycles": cycles,
        "telegrams": total["cycles"],
        "active": total["active"],
        "active_share": round(total["active"] / cycles, 4),
        "held": total["held"],
        "without_session": total["without_session"],
        "programs_ended": dict(Counter(why for block in blocks for _, why in block.ended).most_common()),
        "unanswered": int(np.sum(unanswered)),
        "unanswered_active": int(np.sum(unanswered & acting)),
        "refused": blocks[-1].refused,
        "standstill": {
            "cycles": int(np.sum(stood)),
            "missed": total["missed"],
            "unanswered": int(np.sum(unanswered & stood)),
            "unanswered_active": int(np.sum(unanswered & stood & acting)),
            "longest_ms": round(float(max(np.max(b.woken_s, initial=0.0) for b in blocks)) * 1e3, 1),
        },
        "reply_us": of_all,
        "reply_active_us": micro(reply[acting]),
        "reply_active_outside_us": micro(reply[acting & ~stood]),
        "echo_us": of_echo,
        "echo_outside_us": micro(echo[~stood]),
        "ratio_p50": round(of_all["p50"] / of_echo["p50"], 2),
        "growth_per_hour": {
            **_growth(hours[settled], list(compress(samples, settled)), [n for n in must_not_grow if n != "log_mb"]),
            **_growth(np.arange(len(minutes)) / 60.0, minutes, times),
        },
        "most": {name: max(s[name] for s in samples) for name in must_not_grow},
    }


def _growth(hours: Float, rows: list[dict[str, float]], columns: Iterable[str]) -> dict[str, dict[str, float] | None]:
    """Growth per hour of columns of a table."""
    lines = {name: growth(hours, np.array([row[name] for row in rows])) for name in columns}
    return {
        name: None if line is None else {key: round(value, 4) for key, value in vars(line).items()}
        for name, line in lines.items()
    }
