"""Figures of a loop on a panel, in shop units, from its snapshots. Pure: no clock, no socket, no browser."""

from __future__ import annotations

import math
import socket
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.records import Records
from counterflex.core.units import DEG, MM, MS, NS, UM
from counterflex.files.logs.place import trouble_message
from counterflex.protocols.processes.control_array import Kept, Tally
from counterflex.protocols.session.snapshot_kernel import LOST, NO_PANEL, THERE
from counterflex.runtime.monitoring.events import Event, Slowed
from counterflex.runtime.state.states import Cause, State

_PANEL: Final = {NO_PANEL: "none", THERE: "there", LOST: "lost"}
_STANDS_M_S: Final = 1e-3  # Below this speed of the commanded point the feed direction is the last one
_LEAST_N: Final = 50.0  # Force that counts as a cut where no plan tells
_AROUND: Final = 64  # Snapshots over which times of answers are judged


def words(name: str) -> str:
    """A name of the program in words."""
    return name.lower().replace("_", " ")


def cause_words(number: int) -> str:
    """A cause in words; empty for none, and its number where this program does not know it."""
    if number == 0:
        return ""
    try:
        return words(Cause(number).name)
    except ValueError:
        return f"cause {number}"


class FeedFrame:
    """Directions along the feed, across it to its left seen from the spindle, and along the tool, as it moves."""

    def __init__(self) -> None:
        self._place: Float | None = None
        self._time_ns = 0
        self._feed = np.array([1.0, 0.0, 0.0])

    def rows(self, shots: Records) -> Float:
        """(n, 3, 3) the three directions as rows for each snapshot, part axes; the tool's points out of the spindle."""
        out = np.empty((len(shots), 3, 3))
        for k, (nominal, time_ns) in enumerate(zip(shots["nominal"], shots["received_ns"], strict=True)):
            tool, place = nominal[[2, 5, 8]], nominal[9:]
            if self._place is None:
                self._place, self._time_ns = place.copy(), int(time_ns)
            step, span = place - self._place, (int(time_ns) - self._time_ns) * NS
            size = float(np.linalg.norm(step))
            if span > 0.0 and size > _STANDS_M_S * span and size > 1e-6:
                self._feed, self._place, self._time_ns = step / size, place.copy(), int(time_ns)
            elif span > 0.5:
                self._place, self._time_ns = place.copy(), int(time_ns)
            across = np.cross(-tool, self._feed)
            length = float(np.linalg.norm(across))
            out[k] = self._feed, across / length if length > 1e-9 else across, tool
        return out


def deviations(shots: Records) -> dict[str, Float]:
    """(n, 3) m, part axes: where the tool stands against the original program, as the loop computes it.

    ``predicted``: deflection under the force that the correction is computed from, and the planned deflection that the
    program takes back. ``corrected``: what the program contains and what is in effect of the correction sent.
    ``remaining``: their sum. With a compensated program the loop computes the deflection by which the planned one is
    missed: what the program contains stands for the planned one with the other sign.
    """
    contained, effect = shots["contained"][:, :3], shots["in_effect"][:, :3]
    missed = shots["deflection"][:, :3]
    return {"predicted": missed - contained, "corrected": contained + effect, "remaining": missed + effect}


def _number(value: float, digits: int = 1) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _pair(rows: Float, frames: Float) -> list[float | None]:
    """Across the feed and along the tool, um, of the row in which they are largest."""
    both = np.einsum("nij,nj->ni", frames[:, 1:], rows)
    k = int(np.argmax(np.abs(both).sum(axis=1)))
    return [_number(both[k, 0] / UM), _number(both[k, 1] / UM)]


class Figures:
    """Figures of a run, from all snapshots since the last call."""

    def __init__(self, about: Mapping[str, Any]) -> None:
        self._about = about
        self._limits = about["limits"]
        self._frame = FeedFrame()
        self._measured: list[float | None] | None = None
        self._compute: Float = np.zeros(0)
        self._gaps: Float = np.zeros(0)
        self.frames: Float = np.zeros((0, 3, 3))

    def of(self, shots: Records, now_ns: int, missed: int) -> dict[str, Any]:
        """Return what is to be shown.

        Args:
            shots: (n >= 1,) SNAPSHOT that came since the last call, in order.
            missed: Snapshots that were written over before they were read.

        Returns:
            Plain values, finite or None.
        """
        last = shots[-1]
        frames = self.frames = self._frame.rows(shots)
        self._keep_times(shots)
        size = float(np.max(np.linalg.norm(shots["correction"][:, :3], axis=1)))
        turn = float(np.max(np.linalg.norm(shots["correction"][:, 3:], axis=1)))
        return {
            "state": State(int(last.state)).name,
            "cause": cause_words(int(last.cause)),
            "not_ready": cause_words(int(last.soft or last.hard)),
            "incident": self._incident(last, now_ns),
            "incidents": int(last.incidents),
            "feed_hold": bool(last.feed_hold),
            "stop": bool(last.stop),
            "enable": bool(last.enable),
            "may_arm": bool(last.may_arm),
            "correction_um": _number(size / UM),
            "limit_um": _number(self._limits["correction_m"] / UM),
            "turn_mdeg": _number(turn / DEG * 1e3),
            "turn_limit_mdeg": _number(self._limits["correction_rad"] / DEG * 1e3),
            "limited": bool(last.limits),
            **self._deviations(shots, frames),
            **self._force(last),
            "share": None if last.share < 0.0 else _number(100.0 * last.share, 2),
            "speed": _number(100.0 * last.speed),
            "slowed": "" if last.speed >= 1.0 else words(Slowed(int(last.slowed)).name),
            "tool": int(last.tool),
            **self._link(last, now_ns, missed),
            "log": trouble_message(int(last.kept[Kept.TROUBLE - Kept.TAKEN])),
            "records_lost": int(last.kept[Kept.LOST - Kept.TAKEN]),
            "trouble": bool(last.trouble),
            "degraded": cause_words(int(last.degraded)),
            "panel": _PANEL[int(last.panel)],
            "events": self._events(last),
            "cycle": int(last.cycle),
        }

    def _incident(self, last: Any, now_ns: int) -> dict[str, Any] | None:
        if not last.incident_cause:
            return None
        begin = int(last.incident_ns)
        return {
            "cause": cause_words(int(last.incident_cause)),
            "state": State(int(last.incident_state)).name,
            "ago_s": _number((now_ns - begin) * NS),
            "time_s": _number((begin + int(self._about["wall_minus_monotonic_ns"])) * NS, 0),
            "over": bool(last.incident_end_ns),
        }

    def _deviations(self, shots: Records, frames: Float) -> dict[str, Any]:
        rows = deviations(shots)
        seen = np.flatnonzero(np.any(shots["deviation"] != 0.0, axis=1))
        if len(seen):
            self._measured = _pair(shots["deviation"][seen, :3], frames[seen])
        return {
            **{f"{name}_um": _pair(values, frames) for name, values in rows.items()},
            "measured_um": self._measured if self._about["sources"]["tracker"] else None,
        }

    def _force(self, last: Any) -> dict[str, Any]:
        has, planned = last.force_ns != -1, self._about["planned"]
        return {
            "force_n": [_number(v, 0) for v in last.force] if has else None,
            "planned_n": [_number(v, 0) for v in last.expected] if planned else None,
            "force_size_n": _number(float(np.linalg.norm(last.measured[:3])), 0) if has else None,
            "planned_size_n": _number(float(np.linalg.norm(last.planned[:3])), 0) if planned else None,
            "factor": [_number(v, 2) for v in last.factor],
        }

    def _keep_times(self, shots: Records) -> None:
        self._compute = np.concatenate([self._compute, shots["compute_ns"]])[-_AROUND:]
        gaps = np.diff(shots["received_ns"])
        self._gaps = np.concatenate([self._gaps, gaps])[-_AROUND:]

    def _link(self, last: Any, now_ns: int, missed: int) -> dict[str, Any]:
        tally = {one.name.lower(): int(last.tally[one - Tally.FOREIGN]) for one in Tally}
        ages = {
            name: None if last[f"{name}_ns"] == 0 else _number((now_ns - int(last[f"{name}_ns"])) * NS / MS)
            for name in ("robot", "force", "tracker")
            if last[f"{name}_ns"] != -1
        }
        peer = int(last.peer)
        gap = float(np.mean(self._gaps)) * NS if len(self._gaps) else self._about["period_s"]
        return {
            "ages_ms": ages,
            "peer": "" if peer < 0 else f"{socket.inet_ntoa((peer >> 16).to_bytes(4, 'big'))}:{peer & 0xFFFF}",
            "rate_hz": _number(1.0 / gap) if gap > 0.0 else None,
            "answer_us": [_number(v * 1e-3, 0) for v in np.quantile(self._compute, [0.5, 1.0])],
            "gap_ms": _number(float(np.max(self._gaps)) * NS / MS) if len(self._gaps) else None,
            "tally": tally,
            "telegrams": int(last.telegrams),
            "missed": missed,
        }

    def _events(self, last: Any) -> list[dict[str, Any]]:
        return [
            {
                "event": words(event.name),
                "on": bool(int(last.events) >> event & 1),
                "watched": bool(last.limit[event] > 0.0),
                "share": _number(float(last.value[event] / last.limit[event]), 3) if last.limit[event] > 0.0 else None,
            }
            for event in Event
        ]


class Trail:
    """The part as it is cut: places of the tool tip with the deviation that remained there.

    Args:
        spacing_m: Least distance of two places.
        most: Places that are kept; beyond it every second one goes.
    """

    def __init__(self, spacing_m: float = 0.5 * MM, most: int = 20_000) -> None:
        self._spacing, self._most = spacing_m, most
        self._points: list[list[float]] = []
        self._last: Float | None = None
        self._new = True
        self.generation = 0  # Raised when places were taken away, so that whoever has them draws anew

    def add(self, shots: Records, axes: Float, *, planned: bool) -> None:
        """Add what was cut.

        Args:
            shots: In order.
            axes: (n, 3, 3) of :class:`FeedFrame`.
            planned: The plan says where it cuts; else the force does.
        """
        rest = np.einsum("nij,nj->ni", axes[:, 1:], deviations(shots)["remaining"])
        for shot, (across, along), tool in zip(shots, rest, axes[:, 2], strict=True):
            cuts = shot.cuts == 1 if planned else float(np.linalg.norm(shot.measured[:3])) > _LEAST_N
            place = shot.nominal[9:] - shot.contained[:3]
            if not cuts or not np.all(np.isfinite([*place, across, along])):
                self._last, self._new = None, True
                continue
            if self._last is not None and float(np.linalg.norm(place - self._last)) < self._spacing:
                continue
            self._last = place.copy()
            size = math.copysign(math.hypot(across, along), across)
            mm = [round(float(v / MM), 2) for v in place]
            self._points.append([*mm, round(size / UM, 1), float(self._new), *(round(float(v), 3) for v in tool)])
            self._new = False
        if len(self._points) > self._most:
            self._points = self._points[::2]
            self._spacing *= 2.0
            self.generation += 1

    def after(self, count: int, most: int = 2000) -> list[list[float]]:
        """Places behind the first ``count``: x, y, z mm, deviation um, 1 where a cut begins, direction of the tool."""
        return self._points[count : count + most]

    def __len__(self) -> int:
        """Places."""
        return len(self._points)
