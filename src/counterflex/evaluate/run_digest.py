"""Digest of a stretch of records: its figures, and the few records at which something changed; digests join exactly.

A day of a run is 21.6 million records. What is counted, summed or a largest value of it follows from the digests of its
segments; changes, incidents and events follow from the records around them, which a digest keeps::

    records  r0 . . . r7 r8 . . . r41 r42 . . . r99
    kept     r0       r7 r8       r41 r42       r99     state, sources or sensors change at r8 and r42

Only percentiles differ: those of digests are at most one percent above a time that was met.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.run_record import RunRecord
from counterflex.runtime import record_ring as record
from counterflex.runtime.monitoring.events import Event

MOST_KEPT: Final = 4000
"""Records that a digest keeps at most; a stretch of more changes has none and is read as a whole."""
_BATCH: Final = 250
_STATES: Final = ("out_state", "out_sources", "pair_used")
_KEPT: Final = (
    *("cycle", "received_ns", "elapsed", "path_distance", "path_m", "event_new", "out_cause", "out_degraded"),
    *_STATES,
    *(record.COLUMNS[record.RESULTS + k] for k in range(3)),
    *(f"{what}_{event.name.lower()}" for event in Event for what in ("value", "limit")),
    *("cut_m", "wear_trend", "wear_trend_sigma", "wear_degrees"),
)
_CHANGING: Final = [record.column(name) for name in _STATES]
_PLACES: Final = [record.column(name) for name in _KEPT]


@dataclass(frozen=True, eq=False)
class Digest:
    """Figures of a stretch of records, kept in place of the records."""

    sums: dict[str, Any]  # figures as counterflex.evaluate.run_record.RunRecord.sums gives them
    rows: Float  # (k, WIDTH) its first and last record and those at changes; columns that no figure is taken from are 0

    def plain(self) -> dict[str, Any]:
        """Plain values, bit for bit."""
        data = np.ascontiguousarray(self.rows[:, _PLACES], dtype="<f8").tobytes()
        return {"sums": self.sums, "columns": list(_KEPT), "kept": base64.b64encode(zlib.compress(data)).decode()}


def read_digest(table: Mapping[str, Any]) -> Digest | None:
    """Digest of plain values; None where another version with other columns wrote them, or they are none."""
    try:
        if tuple(table["columns"]) != _KEPT:
            return None
        values = np.frombuffer(zlib.decompress(base64.b64decode(table["kept"])), dtype="<f8").reshape(-1, len(_KEPT))
        kept: Float = np.zeros((len(values), record.WIDTH))
        kept[:, _PLACES] = values
        return Digest(dict(table["sums"]), kept)
    except (KeyError, TypeError, ValueError, zlib.error):
        return None


class DigestMaker:
    """Takes the records of a stretch piece by piece, in order."""

    def __init__(self) -> None:
        self._record = RunRecord(begun=False)
        self._waiting: list[Float] = []
        self._count = self._kept_count = 0
        self._kept: list[Float] = []
        self._last: Float | None = None
        self._last_kept = self._bad = False

    def add(self, rows: Float) -> None:
        """Take records (n, WIDTH)."""
        if self._bad or not len(rows):
            return
        self._waiting.append(rows.copy())
        self._count += len(rows)
        if self._count >= _BATCH:
            self._work()

    def _work(self) -> None:
        rows, self._waiting, self._count = np.concatenate(self._waiting), [], 0
        try:
            self._record.add(rows)
        except InputError:  # a record with a state that there is not: who reads it says so
            self._bad = True
            return
        joined = rows if self._last is None else np.concatenate([self._last[None], rows])
        changed = np.r_[False, np.any(np.diff(joined[:, _CHANGING], axis=0) != 0.0, axis=1)]
        keep = changed | np.r_[changed[1:], False] | (joined[:, record.column("event_new")] != 0.0)
        keep[0] = self._last is None or (keep[0] and not self._last_kept)
        self._kept.append(joined[keep])
        self._kept_count += int(keep.sum())
        self._last, self._last_kept = rows[-1].copy(), bool(keep[-1])
        self._bad = self._kept_count > MOST_KEPT

    def digest(self) -> Digest | None:
        """Digest of what was taken; None for nothing, too many changes, or a record that no figure is taken from."""
        if self._waiting and not self._bad:
            self._work()
        if self._bad or self._last is None:
            return None
        end = [] if self._last_kept else [self._last[None]]
        try:
            return Digest(self._record.sums(), np.concatenate([*self._kept, *end]))
        except InputError:  # a time to answer below zero
            return None
