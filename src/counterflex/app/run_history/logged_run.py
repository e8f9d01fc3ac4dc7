"""A run that has ended, read from its log: figures in shop units and curves along the path."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.run.incidents import Numbered, numbered, shown_process
from counterflex.app.run.log import micro
from counterflex.app.run.missing import LogMissing
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.units import NS, PERCENT, UM
from counterflex.evaluate.incidents import IncidentFinder
from counterflex.evaluate.run_curves import RunCurves, curves_of, figures, needed_of
from counterflex.evaluate.run_record import RunRecord
from counterflex.files.logs.segments import segments
from counterflex.files.plan_file import read_plan


def file_of_run(about: Mapping[str, Any], kind: str, folder: Path) -> Path | None:
    """A file of a run where it still is, unchanged by its SHA-256; None where it is not.

    Its path was relative to where the run was started: often the folder that the log lies in.

    Args:
        kind: ``cell``, ``plan``, ``program`` or ``rsi``.
    """
    name, sha256 = about.get("files", {}).get(kind), about.get("sha256", {}).get(kind)
    for place in () if name is None else (Path(name), folder.absolute().parent / name):
        with contextlib.suppress(OSError):
            if hashlib.sha256(place.read_bytes()).hexdigest() == sha256:
                return place
    return None


@dataclass(frozen=True, eq=False)
class RunOfHistory:
    """A run."""

    row: dict[str, Any]  # Plain values in shop units, see :func:`read_runs`
    curves: RunCurves
    # (n, 2) m, correction that the program contains, across the feed and along the tool; None where the plan file of
    # the run is not there to say it
    contained_m: Float | None
    incidents: tuple[Numbered, ...]
    actions: tuple[dict[str, Any], ...]  # What operators did, with ``time_s`` since the first record
    about: dict[str, Any]  # What the run was made of, as its log says

    @classmethod
    def of(cls, folder: Path, number: int | None, option: str = "--run") -> RunOfHistory:
        """A run of a folder by its number; None is the last one.

        Args:
            number: As ``log show`` says it.
            option: Name of the option that says it, for the message.

        Raises:
            InputError: No such run, or none with a record.
        """
        runs = read_runs(folder)
        numbers = [one.row["run"] for one in runs]
        if not runs:
            raise InputError("no run in this folder has a record", where=str(folder), hint="Give a log with records")
        if number is None:
            return runs[-1]
        if number not in numbers:
            raise InputError(
                "the folder has no run of this number",
                where=f"{option} {number}",
                value=str(folder),
                limit=", ".join(str(n) for n in numbers),
            )
        return runs[numbers.index(number)]


@dataclass
class _Open:
    """A run while its segments are read."""

    about: dict[str, Any]
    record: RunRecord
    finder: IncidentFinder
    parts: list[Float]
    actions: list[dict[str, Any]]


def read_runs(folder: Path) -> list[RunOfHistory]:
    """Runs of a folder in the order of their numbers.

    Each ``row`` has: ``folder``, ``run``, ``begun`` (ISO 8601, UTC, or None), ``program`` (its name) and
    ``program_sha256`` (None: not known), ``seconds``, ``share_percent`` of the path (None without the plan file),
    :data:`FIGURES` (99.7 % of the cut; None: not known), ``mean_correction_um`` across the feed and along the tool,
    ``incidents``, ``reply_us`` percentiles, ``telegrams_lost``, ``records_lost``, ``wear`` of process monitoring, and
    ``incomplete``: cycles of the folder are missing.
    """
    open_runs: dict[int, _Open] = {}
    missing = LogMissing()
    for segment in segments(folder):
        missing.add(segment)
        if not segment.about:
            continue
        if segment.run not in open_runs:
            open_runs[segment.run] = _Open(segment.about, RunRecord(), IncidentFinder(), [], [])
        one = open_runs[segment.run]
        one.record.add(segment.rows)
        one.finder.add(segment.rows)
        one.actions.extend(segment.actions)
        if len(segment.rows):
            one.parts.append(needed_of(segment.rows))
    for number, lost in missing.end(folder).at_end.items():
        open_runs[number].record.end(lost)
    incidents = numbered({number: one.finder for number, one in open_runs.items()})
    return [
        _logged(folder, number, one, [i for i in incidents if i.run == number], incomplete=missing.incomplete)
        for number, one in sorted(open_runs.items())
        if one.parts
    ]


def _logged(folder: Path, number: int, one: _Open, incidents: list[Numbered], *, incomplete: bool) -> RunOfHistory:
    record, about = one.record.figures(), one.about
    curves = curves_of(one.parts, planned="plan" in about.get("files", {}))
    begin_ns = int(curves.time_ns[0])
    plan = _plan_of(about, folder)
    compensated = "plan" in about.get("files", {}) and bool(about.get("compensated", True))
    contained = np.zeros_like(curves.sent_m) if not compensated else None if plan is None else _contained(plan, curves)
    values = figures(curves, contained)
    files = {str(kind): str(name) for kind, name in about.get("files", {}).items()}
    hashes = about.get("sha256", {})
    row = {
        "folder": str(folder),
        "run": number,
        "begun": _begun(about, begin_ns),
        "program": Path(files.get("program", files.get("plan", ""))).name,
        "program_sha256": hashes.get("program", hashes.get("plan")),
        "seconds": round(record.time_s, 3),
        "share_percent": None if plan is None else _share(curves, plan[0][-1]),
        "predicted_um": _um(values["predicted_m"]),
        "corrected_um": _um(values["corrected_m"]),
        "remaining_um": _um(values["remaining_m"]),
        "measured_um": _um(values["measured_m"]),
        "mean_correction_um": None
        if values["mean_sent_m"] is None
        else [round(float(v) / UM, 2) for v in values["mean_sent_m"]],
        "force_peak_n": None if values["force_peak_n"] is None else round(values["force_peak_n"], 1),
        "force_ratio": None if values["ratio"] is None else round(values["ratio"], 4),
        "incidents": len(incidents),
        "reply_us": None if record.reply is None else micro(record.reply),
        "telegrams_lost": record.telegrams_lost,
        "records_lost": record.records_lost,
        "wear": shown_process(record.process)["wear"],
        "incomplete": incomplete,
    }
    actions = tuple(
        {"time_s": round((int(a["time_ns"]) - begin_ns) * NS, 3), **{k: v for k, v in a.items() if k != "time_ns"}}
        for a in one.actions
    )
    return RunOfHistory(row, curves, contained, tuple(incidents), actions, about)


def _um(value_m: float | None) -> float | None:
    return None if value_m is None else round(value_m / UM, 1)


def _begun(about: Mapping[str, Any], begin_ns: int) -> str | None:
    if "wall_minus_monotonic_ns" not in about:
        return None
    wall_s = (begin_ns + int(about["wall_minus_monotonic_ns"])) * NS
    return datetime.fromtimestamp(wall_s, UTC).isoformat(timespec="seconds")


def _share(curves: RunCurves, length_m: float) -> float | None:
    """Percent of the path that was reached; None where the loop followed none."""
    reached = float(np.max(curves.length_m))
    return round(reached / length_m / PERCENT, 2) if reached > 0.0 else None


def _plan_of(about: Mapping[str, Any], folder: Path) -> tuple[Float, Float] | None:
    """Place along the program and correction contained in it, m; None where the plan of the run is not there any more.

    As the loop reads it: places count along the program as it is sent; what was measured on parts moves the nominal.
    """
    file = file_of_run(about, "plan", folder)
    try:
        plan, _ = (None, None) if file is None else read_plan(file)
    except CounterflexError:
        return None
    if plan is None:
        return None
    compensated = bool(about.get("compensated", True))
    sent = plan.correction_part if compensated else np.zeros_like(plan.correction_part)
    contained = sent if plan.measured_part is None or not compensated else sent - plan.measured_part
    points = plan.path.p_part_tcp + sent
    length = np.cumsum(np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1))
    return (length, contained) if len(length) > 1 and length[-1] > 0.0 else None


def _contained(plan: tuple[Float, Float], curves: RunCurves) -> Float:
    """(n, 2) m, what the program contains at each record, across the feed and along the tool."""
    length, contained = plan
    rows = np.stack([np.interp(curves.length_m, length, contained[:, k]) for k in range(3)], axis=1)
    out: Float = np.einsum("nij,nj->ni", curves.sides, rows)
    return out
