"""Findings of process monitoring, in shop units."""

from __future__ import annotations

from typing import Any

from counterflex.core.units import MM
from counterflex.evaluate.process_record import ProcessEvent, ProcessFigures
from counterflex.runtime.monitoring.events import Event

_SHOWN: dict[Event, tuple[float, str]] = {
    Event.MISSING_CUT: (MM, "mm without force"),
    Event.OVERLOAD: (1.0, "N"),
    Event.WEAR: (0.01, "% more force"),
    Event.BREAKAGE: (0.01, "% of the force lost"),
    Event.CHATTER: (1.0, "N of vibration"),
    Event.LOW_CHATTER: (1.0, "N of slow vibration"),
}


def shown_process(figures: ProcessFigures | None) -> dict[str, Any]:
    """Results of process monitoring in shop units."""
    if figures is None:
        return {"events": [], "event_counts": {}, "wear": None, "slowed_share": 0.0, "least_speed": 1.0}
    wear = figures.wear
    return {
        "events": [shown_event(event) for event in figures.events],
        "event_counts": {event.name.lower(): count for event, count in figures.counts.items()},
        "wear": None
        if wear is None
        else {
            "cut_m": round(wear.cut_m, 4),
            "trend_percent_per_m": round(100.0 * wear.trend_per_m, 3) if wear.known else None,
            "sigma_percent_per_m": round(100.0 * wear.sigma_per_m, 3) if wear.known else None,
            "range95_percent_per_m": round(100.0 * wear.range_per_m, 3) if wear.known else None,
        },
        "slowed_share": round(figures.slowed, 4),
        "least_speed": round(figures.least_speed, 3),
    }


def shown_event(event: ProcessEvent) -> dict[str, Any]:
    """A process event in shop units."""
    unit, what = _SHOWN[event.event]
    return {
        "event": event.event.name.lower(),
        "cycle": event.cycle,
        "time_s": round(event.time_s, 3),
        "path_mm": round(event.path_m / MM, 3),
        "value": round(event.value / unit, 3),
        "limit": round(event.limit / unit, 3),
        "unit": what,
    }
