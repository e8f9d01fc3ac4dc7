"""Jobs on a run log: show it, replay it through the loop, export it, repair its cut segments."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars

from counterflex import __version__
from counterflex.app.environment import environment
from counterflex.app.run.incidents import numbered, shown_process
from counterflex.app.run.job_check import cell_of_run
from counterflex.app.run.log_summary import LogSummary
from counterflex.app.run.loop import loop_plan, online_loop
from counterflex.app.run.missing import LogMissing
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Int
from counterflex.core.progress import Progress, silent
from counterflex.core.units import NS, UM, plain
from counterflex.evaluate.incidents import IncidentFinder
from counterflex.evaluate.loop_timing import Percentiles
from counterflex.evaluate.run_record import RunFigures, RunRecord
from counterflex.files.logs.repair import Repaired, repair_segment
from counterflex.files.logs.run_log import LAYOUT, UNKNOWN
from counterflex.files.logs.segment import require_all
from counterflex.files.logs.segments import LogSegment, segments
from counterflex.files.plan_file import read_plan
from counterflex.runtime.estimator.fusion import level
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import COLUMNS, CYCLE, is_whole
from counterflex.runtime.replay import Difference, Gap, Replay
from counterflex.runtime.state.memory_layout import words_of

FORCE_SENSORS: Final = ("none", "flange sensor", "holder", "both")
"""What of two force sensors is used, by its bits."""


def show(folder: str | Path, *, brief: bool = False) -> LogSummary:
    """Summary of a run log.

    Args:
        brief: Take digests of segments in place of their records; damage within their chunks is not looked for.

    Raises:
        FileFormatError: There is none, or it cannot be read.
    """
    runs: dict[int, RunRecord] = {}
    finders: dict[int, IncidentFinder] = {}
    about: dict[int, dict[str, Any]] = {}
    actions: dict[int, list[dict[str, Any]]] = {}
    begins: dict[int, int] = {}
    missing = LogMissing()
    names: list[str] = []
    older: list[str] = []
    unread: list[str] = []
    for segment in segments(folder, brief=brief):
        names.append(segment.name)
        if segment.digest is not None:
            unread.append(segment.name)
        if segment.absent and not older:
            older = [_older(segment)]
        missing.add(segment)
        if segment.about:
            about.setdefault(segment.run, segment.about)
            record = runs.setdefault(segment.run, RunRecord())
            if segment.digest is None:
                record.add(segment.rows)
            else:
                record.join(segment.digest.sums, segment.rows)
            finders.setdefault(segment.run, IncidentFinder()).add(segment.rows)
            actions.setdefault(segment.run, []).extend(segment.actions)
            if len(segment.rows):
                begins.setdefault(segment.run, int(segment.rows[0, 1]))
    for number, lost in missing.end(folder).at_end.items():
        runs[number].end(lost)
    incidents = numbered(finders)
    answer = {
        "segments": names,
        **missing.shown(),
        "incomplete": missing.incomplete,
        "older": older,
        "unread": unread,
        "lines": [*missing.lines(), *older],
        "runs": [
            {
                "run": k,
                **_facts(about[k]),
                **_shown(runs[k].figures()),
                "incidents": [one.shown() for one in incidents if one.run == k],
                "incidents_total": finders[k].total,
                "operator_actions": [_action(one, begins.get(k)) for one in actions[k]],
            }
            for k in sorted(runs)
        ],
        "counterflex": __version__,
    }
    return LogSummary(folder, answer)


def _action(facts: dict[str, Any], begin_ns: int | None) -> dict[str, Any]:
    """Name an act of an operator, by the time since the first record of the run; None without one."""
    rest = {key: value for key, value in facts.items() if key != "time_ns"}
    time_s = None if begin_ns is None else round((int(facts["time_ns"]) - begin_ns) * NS, 3)
    return {"time_s": time_s, **rest}


def _older(segment: LogSegment) -> str:
    shown = ", ".join(segment.absent[:6]) + (", ..." if len(segment.absent) > 6 else "")
    return (
        f"written by older code (counterflex {segment.about.get('counterflex', UNKNOWN)}): {len(segment.absent)} of "
        f"{len(COLUMNS)} columns were not recorded then ({shown}) and count as none; log replay needs the version that "
        "wrote it"
    )


def _facts(about: dict[str, Any]) -> dict[str, Any]:
    return {
        "made_with": about.get("counterflex", ""),
        "files": about.get("files", {}),
        "sha256": about.get("sha256", {}),
        "compensated": bool(about.get("compensated", True)),
        "not_looked_at": about.get("not_looked_at", []),
        "not_closed": about.get("not_closed"),
    }


def _shown(figures: RunFigures) -> dict[str, Any]:
    return {
        **figures.shown(),
        "states": {
            s.name.lower(): {"cycles": cycles, "seconds": round(t, 3)} for s, (cycles, t) in figures.states.items()
        },
        "causes": {cause.name.lower(): count for cause, count in figures.causes.items()},
        "changes": [change.shown() for change in figures.changes],
        "sources": {level(s): cycles for s, cycles in figures.sources.items()},
        "sources_changes": [
            change.shown() | {"from": level(change.before), "to": level(change.after)}
            for change in figures.sources_changes
        ],
        "force_sensors": {FORCE_SENSORS[k]: cycles for k, cycles in figures.pair.items()},
        "force_sensors_changes": [
            {
                "cycle": change.cycle,
                "time_s": round(change.time_s, 3),
                "from": FORCE_SENSORS[change.before],
                "to": FORCE_SENSORS[change.after],
                "cause": "force_stale" if change.after < change.before else "none",
            }
            for change in figures.pair_changes
        ],
        **shown_process(figures.process),
        "reply_us": None if figures.reply is None else micro(figures.reply),
        **plain(figures, "largest_correction_um=largest_m:2 largest_step_um:3"),
    }


def micro(percentiles: Percentiles) -> dict[str, float | None]:
    """Percentiles in microseconds; None where the time is not finite."""
    values = {"p50": percentiles.p50_s, "p99": percentiles.p99_s, "p99.9": percentiles.p999_s, "max": percentiles.max_s}
    return {name: round(value / UM, 1) if value < float("inf") else None for name, value in values.items()}


@dataclass
class Replayed:
    """Result of a replay over all runs of a folder.

    Attributes:
        records: In the log.
        compared: Cycles computed again and compared.
        skipped: Records after a gap.
        missing: Cycles without a record: in the gaps, and at the end as far as it is known.
        difference: The first one, or None.
        run: Number of the run with the difference.
        gaps: Where records are missing.
        lost: What is missing of the log.
        notes: What is not as it was when the log was written: files, versions, choices.
        begun: Cycles from whose recorded state it began.
    """

    records: int = 0
    compared: int = 0
    skipped: int = 0
    missing: int = 0
    difference: Difference | None = None
    run: int = 0
    gaps: list[Gap] = field(default_factory=list)
    lost: LogMissing = field(default_factory=LogMissing)
    notes: list[str] = field(default_factory=list)
    begun: list[int] = field(default_factory=list)

    @property
    def proved(self) -> bool:
        """Every cycle was computed again and is the same; none is missing."""
        return self.difference is None and self.compared == self.records and self.missing == 0


def replay(
    folder: str | Path,
    cell: str | Path,
    plan: str | Path | None = None,
    *,
    compensated: bool = True,
    from_s: float = 0.0,
    progress: Progress = silent,
) -> Replayed:
    """Feed the logged inputs through a loop made of these files and compare corrections, states and all else.

    Args:
        plan: Plan file, where the run had one.
        compensated: The robot ran the compensated program.
        from_s: Time of each run, from its first record there is: what is before is passed over, up to the last
            recorded state before it.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        FileFormatError: A file cannot be used.
        InputError: The cell's settings need a plan and there is none, or the log holds another loop's state.
    """
    files = {"cell": Path(cell)} | ({} if plan is None else {"plan": Path(plan)})
    loop = _loop_of(files, compensated=compensated)
    answer = Replayed()
    after = _last_states(folder, from_s) if from_s > 0.0 else {}
    current: Replay | None = None
    replays: dict[int, Replay] = {}
    suspended: dict[int, Int] = {}  # what the one loop remembered when another run's segment came between
    number = -1
    total = len(list(Path(folder).glob("run-*.mcap")))
    for k, segment in enumerate(segments(folder)):
        progress(k / max(1, total), segment.name)
        passed = after.get(segment.run, 0) if segment.about else 0
        answer.records += int(np.count_nonzero(segment.rows[:, CYCLE] > passed))
        answer.lost.add(segment)
        require_all(segment.absent, segment.about, str(Path(folder) / segment.name), "computed again")
        if not segment.about or answer.difference is not None:
            continue
        if current is None or segment.run != number:
            if current is not None:
                suspended[number] = words_of(loop.memory)
            number = segment.run
            current = replays[number] if number in replays else replays.setdefault(number, Replay(loop, after=passed))
            if number in suspended:
                loop.restore(suspended.pop(number), loop.layout)
            notes = _notes(segment.about, files, loop.sha256(), compensated=compensated)
            answer.notes = list(dict.fromkeys([*answer.notes, *notes]))
        current(segment.rows, segment.states)
        if current.difference is not None:
            answer.difference, answer.run = current.difference, number
    for done in replays.values():
        _collect(answer, done)
    answer.missing += sum(answer.lost.end(folder).at_end.values())
    return answer


def _loop_of(files: dict[str, Path], *, compensated: bool) -> Loop:
    """The loop that cell and plan make."""
    plan = files.get("plan")
    planned = None if plan is None else read_plan(plan)
    model = cell_of_run(files["cell"], planned, plan)
    loaded = None if planned is None else loop_plan(planned[0], model, compensated=compensated)
    return online_loop(model, loaded, compensated=compensated and loaded is not None)


def _last_states(folder: str | Path, from_s: float) -> dict[int, int]:
    """Cycle of the last state of each run that was recorded before a time; runs without one are not there."""
    begin: dict[int, int] = {}
    states: dict[int, int] = {}
    for segment in segments(folder):
        if not segment.about or not len(segment.rows):
            continue
        zero = begin.setdefault(segment.run, int(segment.rows[0, 1]))
        for state in segment.states:
            if state.time_ns <= zero + round(from_s / NS):
                states[segment.run] = state.cycle
    return states


def _collect(answer: Replayed, done: Replay) -> None:
    answer.compared += done.compared
    answer.skipped += done.skipped
    answer.gaps += done.gaps
    answer.missing += sum(gap.missing for gap in done.gaps)
    answer.begun += done.begun


def _file_notes(about: dict[str, Any], files: dict[str, Path]) -> Iterator[str]:
    """Files that are not those of the run."""
    logged = about.get("sha256", {})
    for name in ("cell", "plan"):
        if name in logged and name not in files:
            yield f"the run had a {name} file ({about.get('files', {}).get(name, '?')}) and none is given"
        elif name in files and name not in logged:
            yield f"the run had no {name} file and one is given"
        elif name in files and hashlib.sha256(file_content.content(files[name])).hexdigest() != logged[name]:
            yield f"the {name} file is not the one of the run: another SHA-256"


def _notes(about: dict[str, Any], files: dict[str, Path], sha256: str, *, compensated: bool) -> list[str]:
    """Name the differences from when the log was written."""
    if about.get(UNKNOWN):
        return ["what the run was made of can no longer be read in the log"]
    notes = [*_file_notes(about, files)]
    if bool(about.get("compensated", True)) != compensated:
        ran = "compensated" if about.get("compensated", True) else "original"
        notes.append(f"in the run the robot ran the {ran} program")
    if about.get("counterflex", __version__) != __version__:
        notes.append(f"the log was written by counterflex {about['counterflex']}, this is {__version__}")
    if about.get("loop_sha256") not in (None, sha256):
        notes.append(
            "the loop made of these files has other numbers than the one of the run"
            if LAYOUT in about
            else "the log is older than the layout of states that logs state now: whether the loop made of these files "
            "has the numbers of the run is not known beforehand"
        )
    for name, value in environment().items():
        if about.get("machine", {}).get(name, value) != value:
            notes.append(f"{name}: {about['machine'][name]} in the run, {value} now")
    return notes


def export(folder: str | Path, csv: str | Path, progress: Progress = silent) -> tuple[int, LogMissing]:
    """Write all records as CSV: run, then the record's columns (SI, part axes); numbers read back bit for bit.

    Returns:
        Number of records, and what is missing.

    Raises:
        FileFormatError: There is no run log, or it cannot be read.
        OutputError: The file cannot be written.
    """
    count, missing = 0, LogMissing()
    total = len(list(Path(folder).glob("run-*.mcap")))
    whole = [c for c in COLUMNS if is_whole(c)]
    with atomic.atomic_path(csv) as part, part.open("wb") as stream:
        for k, segment in enumerate(segments(folder)):
            progress(k / max(1, total), segment.name)
            missing.add(segment)
            table = polars.DataFrame(segment.rows, schema=list(COLUMNS), orient="row")
            table = table.with_columns(polars.col(whole).cast(polars.Int64))
            table = table.with_columns(polars.lit(None).cast(table.schema[name]).alias(name) for name in segment.absent)
            table = table.select(polars.lit(segment.run, dtype=polars.Int64).alias("run"), polars.all())
            stream.write(table.write_csv(include_header=k == 0).encode())
            count += len(segment.rows)
    return count, missing.end(folder)


def repair(folder: str | Path) -> tuple[list[Repaired], LogMissing]:
    """Repair every segment of a folder that was cut short or is damaged.

    Returns:
        What was done, and what is missing of the log all the same.

    Raises:
        FileFormatError: There is no run log, or one is of a newer version.
        InputError: One is being written.
        OutputError: The folder cannot be written.
    """
    done, missing = [], LogMissing()
    accounted: dict[int, int] = {}  # last cycle of each run that is there, or counted as missing
    for segment in segments(folder):
        missing.add(segment)
        if not segment.whole:
            before = accounted.get(segment.run, 0)
            repaired = repair_segment(Path(folder) / segment.name, about=segment.about, cycle=before)
            if repaired is not None:
                done.append(repaired)
        if len(segment.rows):
            accounted[segment.run] = int(segment.rows[-1, CYCLE]) + segment.lost_at_end
    return done, missing.end(folder)
