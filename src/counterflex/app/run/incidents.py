"""Holds and faults of a run log: which there were, and the cycles around one of them as a table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars

from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.evaluate.incidents import Incident, IncidentFinder
from counterflex.evaluate.process_record import ProcessEvent, ProcessFigures
from counterflex.files.logs.segment import headings
from counterflex.files.logs.segments import segments
from counterflex.runtime import record_ring as record
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.state.supervisor import Cause, State

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
        **figures.shown(),
    }


def shown_event(event: ProcessEvent) -> dict[str, Any]:
    """A process event in shop units."""
    unit, what = _SHOWN[event.event]
    return {
        **event.shown(),
        "value": round(event.value / unit, 3),
        "limit": round(event.limit / unit, 3),
        "unit": what,
    }


AROUND: Final = 250
"""Cycles before and behind its beginning that are written of an incident: a second at 250 Hz."""
MOST_AROUND: Final = 1_000_000


@dataclass(frozen=True)
class Numbered:
    """An incident of a folder.

    Attributes:
        number: 1 is the first of the folder.
        run: Number of the run's first segment.
        incident: What it was.
    """

    number: int
    run: int
    incident: Incident

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        incident = self.incident
        return {
            "number": self.number,
            **incident.shown(),
            "before": "" if incident.before is None else incident.before.name.lower(),
        }


@dataclass(frozen=True)
class Exported:
    """Files of an incident.

    Attributes:
        cycles: Written.
        missing: Cycles in between without a record.
    """

    of: Numbered
    cycles: int
    missing: int


def numbered(finders: dict[int, IncidentFinder]) -> list[Numbered]:
    """Incidents of the runs of a folder, in order.

    Args:
        finders: By run; each has taken all records of its run.
    """
    all_incidents = [(run, incident) for run in sorted(finders) for incident in finders[run].incidents]
    return [Numbered(k, run, incident) for k, (run, incident) in enumerate(all_incidents, start=1)]


def incidents(folder: str | Path) -> list[Numbered]:
    """Holds and faults of all runs in a folder. Raises FileFormatError: there is no run log, or it cannot be read."""
    finders: dict[int, IncidentFinder] = {}
    for segment in segments(folder):
        if segment.about:
            finders.setdefault(segment.run, IncidentFinder()).add(segment.rows)
    return numbered(finders)


def export_incident(
    folder: str | Path,
    number: int,
    csv: str | Path,
    *,
    before: int = AROUND,
    after: int = AROUND,
    progress: Progress = silent,
) -> Exported:
    """Write the cycles around the beginning of a hold or fault as CSV, wherever the segments of the run end.

    The columns are those of the record with their units in the headings (SI, part axes, numbers bit for bit), behind
    the cycle and time counted from the beginning of the incident, and state and cause in words.

    Args:
        number: 1 is the first incident of the folder.
        csv: File to write.
        before: Cycles before its first one, 0 or more.
        after: Cycles behind its first one, 0 or more.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The incident and what was written; fewer cycles where the run begins or ends within them.

    Raises:
        FileFormatError: There is no run log, or it cannot be read.
        InputError: There is no such incident, or the numbers of cycles are out of range.
        OutputError: The file cannot be written.
    """
    for name, value in (("--before", before), ("--after", after)):
        if not 0 <= value <= MOST_AROUND:
            raise InputError("the number of cycles is out of range", where=name, value=value, limit=(0, MOST_AROUND))
    known = incidents(folder)
    if not 1 <= number <= len(known):
        raise InputError(
            "no incident of this number",
            where=str(folder),
            value=number,
            limit=f"1 to {len(known)}" if known else "no hold and no fault in this log",
            hint="counterflex log show lists them",
        )
    one = known[number - 1]
    first = one.incident.cycle
    parts: list[Float] = []
    total = len(list(Path(folder).glob("run-*.mcap")))
    for k, segment in enumerate(segments(folder)):
        progress(k / max(1, total), segment.name)
        if segment.about and segment.run == one.run:
            cycle = segment.rows[:, record.CYCLE]
            parts.append(segment.rows[(cycle >= first - before) & (cycle <= first + after)])
    rows = np.concatenate(parts)
    atomic.write_text(csv, _table(rows, first).write_csv())
    cycles = rows[:, record.CYCLE]
    return Exported(one, len(rows), int(cycles[-1] - cycles[0]) + 1 - len(rows))


def _table(rows: Float, first: int) -> polars.DataFrame:
    cycles = rows[:, record.CYCLE].astype(np.int64)
    begin_ns = rows[np.flatnonzero(cycles == first)[0], 1]
    lead = polars.DataFrame(
        {
            "from_incident [cycles]": cycles - first,
            "from_incident [s]": (rows[:, 1] - begin_ns) * 1e-9,
            "state": [State(int(v)).name.lower() for v in rows[:, record.column("out_state")]],
            "cause": [Cause(int(v)).name.lower() for v in rows[:, record.column("out_cause")]],
        }
    )
    values = polars.DataFrame(rows, schema=headings(), orient="row")
    whole = [heading for heading, name in zip(headings(), record.COLUMNS, strict=True) if record.is_whole(name)]
    return lead.hstack(values.with_columns(polars.col(whole).cast(polars.Int64)))
