"""The line that says how a run is: state, correction, place, force, ages, and every danger in capitals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import typer

from counterflex.app.run.incidents import shown_event
from counterflex.app.run.status import Status
from counterflex.protocols.session.comparison import answer_line, comparison_lines, frame_line
from counterflex.protocols.session.session import SessionChecks
from counterflex.runtime.estimator.fusion import level
from counterflex.runtime.state.states import Cause, State

_STILL_S: Final = 0.5


class Preparing:
    """Prints now and then how long the loop has got ready, on standard error.

    Args:
        period_s: From one line to the next; 0: none.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s, self._due_s = period_s, period_s

    def __call__(self, waited_s: float, compiled: int) -> None:
        """Print a line where one is due."""
        if self._period_s <= 0.0 or waited_s < self._due_s:
            return
        self._due_s = waited_s + self._period_s
        what = f"{compiled} kernels compiled so far" if compiled else "waiting for its files, sensors or the compiler"
        typer.echo(f"preparing the loop for {waited_s:.0f} s: {what}; the first start compiles for minutes", err=True)


class StatusLines:
    """Prints what process monitoring has found, and how the run is, on standard error."""

    def __init__(self) -> None:
        self._armed = False

    def __call__(self, status: Status) -> None:
        """Print the lines of a status; what was compared before arming once."""
        lines = [*process_lines(status), status_line(status)]
        if status.state >= State.ARMED and not self._armed and status.compared:
            self._armed = True
            lines[:0] = [frame_line(status.compared), answer_line(status.compared)]
        for line in lines:
            typer.echo(line, err=True)


def status_line(status: Status) -> str:
    """One line for people."""
    x, y, z = status.correction_um
    cause = f" ({status.cause.name.lower().replace('_', ' ')})" if status.cause else ""
    speed = f"  speed {100.0 * status.speed:.0f} %" if status.speed < 1.0 else ""
    return (
        f"{status.state.name.lower():9s}{cause} {status.cycles:7d} cycles  "
        f"correction {x:+6.0f} {y:+6.0f} {z:+6.0f} um  {status.compute_us:4.0f} us"
        f"{_whereabouts(status)}{_sources(status)}{speed}{_dangers(status)}"
    )


def process_lines(status: Status) -> Iterator[str]:
    """A line for each thing that process monitoring has found."""
    for event in status.events:
        shown = shown_event(event)
        yield (
            f"PROCESS: {shown['event'].replace('_', ' ')} at {shown['path_mm']:.1f} mm of the path:"
            f" {shown['value']:g} {shown['unit']}, limit {shown['limit']:g}"
        )


def _sources(status: Status) -> str:
    """From which sources the correction is, and what became of the tracker's samples."""
    text = f"  from {level(status.sources)}" if status.sources else ""
    if status.rejected:
        text += f"  {status.rejected} tracker samples rejected"
    if status.set_back:
        text += f"  tracker's clock set back, {status.set_back} times"
    return text + (f" ({status.degraded.name.lower().replace('_', ' ')})" if status.degraded else "")


def _dangers(status: Status) -> str:
    text = "  feed held" if status.feed_hold else ""
    if status.log_trouble or status.records_lost:
        text += f"  LOGGING STOPPED: {status.log_trouble or 'it goes on'}, {status.records_lost} records lost"
    if status.still_s > _STILL_S:
        text += f"  THE LOOP STANDS STILL: no sign of life for {status.still_s:.1f} s; stop the robot"
    if status.state <= State.READY and status.cause == Cause.TELEGRAMS_LATE:
        text += (
            "  NOT READY: the controller has used none of the last answers, by its own count; compare SENTYPE, the tags"
            " and the cycle of its configuration with those given here, and the load of this computer"
        )
    if status.tracker_off:
        text += f"  NOT READY: {status.tracker_off}"
    if status.tares:
        text += (
            f"  TARE FAILED: {status.idle_n:.1f} N and {status.idle_nm:.1f} N m without a cut, limits"
            f" {SessionChecks.force_n:g} N and {SessionChecks.moment_nm:g} N m; tried again ({status.tares}):"
            " take the tool off the part, or identify the payload"
        )
    if status.compared:
        text += "".join(f"  {line}" for line in comparison_lines(status.compared, status.cause, status.degraded))
    text += status.force_message()
    if status.trouble:
        text += f"  INTERNAL: {status.trouble}"
    text += f"  UNREADABLE TELEGRAMS: {status.malformed}" if status.malformed else ""
    return text + (f"  UNKNOWN SENDER: {status.foreign}" if status.foreign else "")


def _whereabouts(status: Status) -> str:
    """Place, force and the ages of the sources, as far as they are known."""
    text = "" if status.place is None else f"  at {100.0 * status.place:.1f} %"
    if status.force_n is not None:
        text += f"  {status.force_n:.0f} N"
        text += "" if status.planned_n is None else f" of {status.planned_n:.0f} planned"
    ages = [f"{name} {'-' if age is None else f'{1e3 * age:.0f}'}" for name, age in status.ages_s]
    return text + (f"  age ms: {' '.join(ages)}" if ages else "")
