"""Run logs as production identification reads them: the right plan, nothing missing, one run after the other."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.run.missing import LogMissing
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MS
from counterflex.files.logs.segments import segments
from counterflex.identify.production.planned import RunRecord
from counterflex.runtime.record_ring import COLUMNS, column
from counterflex.runtime.state.states import Cause

_WRENCH: Final = [column(f"wrench_{a}") for a in ("fx", "fy", "fz", "mx", "my", "mz")]
_PLACE: Final = [column(f"nominal_{a}") for a in "xyz"]
_SENT: Final = [column(f"correction_{a}") for a in "xyz"]
_Q: Final = [column(f"q{i}") for i in range(1, 7)]
_NEEDED: Final = (*_WRENCH, *_PLACE, *_SENT, *_Q)
_SATURATED: Final = int(Cause.FORCE_SATURATED)
_LEAST_CYCLES: Final = 250
_STALE_CYCLES: Final = 25


@dataclass(frozen=True, eq=False)
class LoggedRun:
    """A run of a log.

    Attributes:
        folder: Of the log.
        number: Of the run in it.
        sha256: Over its records.
        plan_sha256: Of the plan that it was made with, or empty.
        cell_sha256: Of its cell file.
        compensated: The robot ran the compensated program.
        begun_s: When it began, seconds since 1970, 0 where the log does not say.
    """

    record: RunRecord
    folder: Path
    number: int
    sha256: str
    plan_sha256: str
    cell_sha256: str
    compensated: bool
    begun_s: float


def read_runs(folder: Path) -> list[LoggedRun]:
    """Read all runs of a folder.

    Raises:
        FileFormatError: There is no run log, it cannot be read, or it is of a version that recorded less.
        InputError: Stretches are missing, or it has no force.
    """
    rows: dict[int, list[Float]] = {}
    about: dict[int, Mapping[str, Any]] = {}
    missing = LogMissing()
    for segment in segments(folder):
        missing.add(segment)
        if segment.about:
            rows.setdefault(segment.run, []).append(segment.rows)
            about.setdefault(segment.run, segment.about)
            absent = [name for name in segment.absent if column(name) in _NEEDED]
            if absent:
                raise FileFormatError(
                    "the run log is of a version that did not record what is needed",
                    where=str(folder / segment.name),
                    value=", ".join(absent[:4]),
                    limit=f"{len(_NEEDED)} of {len(COLUMNS)} columns",
                )
    missing.end(folder)
    if missing.incomplete:
        raise InputError(
            "stretches of the run log are missing",
            where=str(folder),
            value=f"{missing.missing} cycles; {missing.lines()[0]}",
            limit="a complete log",
            hint="log show lists them; a force that is averaged over a gap would be another one",
        )
    return [_logged(folder, number, np.concatenate(parts), about[number]) for number, parts in sorted(rows.items())]


def _logged(folder: Path, number: int, rows: Float, about: Mapping[str, Any]) -> LoggedRun:
    name = folder.name if number == 0 else f"{folder.name}, run {number}"
    received = rows[:, column("elapsed")] > 0
    rows = rows[received]
    if len(rows) < _LEAST_CYCLES:
        raise InputError(
            "the run is too short", where=str(folder), value=f"{len(rows)} cycles", limit=f">= {_LEAST_CYCLES}"
        )
    if not np.any(rows[:, _WRENCH]):
        raise InputError(
            "the run has no force: it was made without a force sensor",
            where=str(folder),
            hint="A run whose loop has a force sensor logs its readings, also where it only watches",
        )
    counter = rows[:, column("counter_ms")]
    time = np.cumsum(np.concatenate([[0.0], np.diff(counter)])) * MS
    if np.any(np.diff(time) <= 0.0):
        raise InputError(
            "the controller's clock runs backwards within the run",
            where=str(folder),
            value=f"cycle {int(rows[1 + int(np.argmin(np.diff(time))), column('cycle')])}",
            hint="The controller was started again: give each run a folder of its own",
        )
    soft = rows[:, column("flag_soft")].astype(np.int64)
    record = RunRecord(
        name=name,
        time_s=time,
        p_part=np.ascontiguousarray(rows[:, _PLACE]),
        w_part=np.ascontiguousarray(rows[:, _WRENCH]),
        q=np.ascontiguousarray(rows[:, _Q]),
        online_part=np.ascontiguousarray(rows[:, _SENT]),
        good=_fresh(rows) & np.all(np.isfinite(rows[:, _WRENCH]), axis=1),
        saturated=soft == _SATURATED,
        period_s=float(np.median(np.diff(time))),
    )
    hashes = about.get("sha256", {})
    return LoggedRun(
        record,
        folder,
        number,
        hashlib.sha256(np.ascontiguousarray(rows[:, list(_NEEDED)]).tobytes()).hexdigest(),
        str(hashes.get("plan", "")),
        str(hashes.get("cell", "")),
        bool(about.get("compensated", True)),
        (float(rows[0, column("received_ns")]) + float(about.get("wall_minus_monotonic_ns", 0))) * 1e-9,
    )


def _fresh(rows: Float) -> Bool:
    """(m,) cycles with a reading that is new, or next to new: a loop that needs no force does not count its age."""
    fresh = rows[:, column("flag_force_age")] == 0
    samples = rows[:, column("w_good")] > 0
    if np.any(samples):
        cycle = np.arange(len(rows))
        last = np.maximum.accumulate(np.where(samples, cycle, -_STALE_CYCLES - 1))
        fresh &= cycle - last <= _STALE_CYCLES
    return np.array(fresh, dtype=np.bool_)


def plan_of(run: LoggedRun, plans: Sequence[Path], digests: Mapping[Path, str]) -> Path:
    """The plan of a run among those given.

    Raises:
        InputError: The run had none, or it is not among them.
    """
    if not run.plan_sha256:
        raise InputError(
            "the run was made without a plan", where=run.record.name, hint="Give run --plan, also where it only watches"
        )
    for plan in plans:
        if digests[plan] == run.plan_sha256:
            return plan
    raise InputError(
        "the run was made with another plan",
        where=run.record.name,
        value=", ".join(f"{p.name} {digests[p][:12]}" for p in plans),
        limit=f"SHA-256 {run.plan_sha256[:12]}...",
        hint="Give the plan of that run with a --plan of its own",
    )
