"""Time that ``counterflex log show --brief`` takes on the log of a day, and the bytes that it reads.

The records of a run are repeated, their cycles and times go on, and all are written by the recorder's own writer,
five at a time with a state of the loop every 4 s, as the recorder does. The first reading after writing is timed; the
files may still be in the memory of the system. ``--whole`` times the reading of all records as well.

    python benchmarks/day_log.py --hours 24 --whole
    python benchmarks/day_log.py --log DIR --json benchmarks/results/day_log.json
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from counterflex.app.environment import environment
from counterflex.app.run.log import show
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segments import LogSegment, read_brief, read_segment
from counterflex.runtime.record_ring import column
from counterflex_lab.composed import endurance

PERIOD_S: Final = 4e-3
AT_ONCE: Final = 5
STATE_EVERY: Final = 1000
GOAL_S: Final = 10.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--log", type=Path, help="the log: read where there is one, else written there and kept")
    parser.add_argument("--whole", action="store_true", help="read all records as well")
    parser.add_argument("--quick", action="store_true", help="a minute: does it work at all?")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        folder = given.log or Path(work) / "log"
        if not folder.exists():
            write(folder, 1.0 / 60.0 if given.quick else given.hours, source(Path(work) / "source"))
        found = measured(folder, whole=given.whole or given.quick)
    for name, value in found.items():
        print(f"{name.replace('_', ' ')}: {value:g}")
    if given.json is not None:
        given.json.write_text(json.dumps({**found, "machine": environment()}, indent=1) + "\n", encoding="utf-8")


def source(folder: Path) -> LogSegment:
    """Records of a cell that corrects for 20 s of its virtual time."""
    endurance.run(folder, minutes=20.0 / 60.0, keep_log=True)
    return read_segment(folder / endurance.LOG / "run-000.mcap")


def write(folder: Path, hours: float, source: LogSegment) -> None:
    """Write so many hours of the records of a segment, again and again."""
    cycle, times = column("cycle"), [column("received_ns"), column("sent_ns")]
    log = RunLogWriter(folder, {"repeated": source.name})
    total, done, lap = round(hours * 3600.0 / PERIOD_S), 0, 0
    while done < total:
        rows = source.rows[: total - done].copy()
        rows[:, cycle] += done + 1 - rows[0, cycle]
        rows[:, times] += lap * len(source.rows) * PERIOD_S * 1e9
        for k in range(0, len(rows), AT_ONCE):
            piece, state = rows[k : k + AT_ONCE], None
            if (done + k) % STATE_EVERY == 0 and source.states:
                first = source.states[((done + k) // STATE_EVERY) % len(source.states)]
                state = replace(first, cycle=int(piece[-1, cycle]), time_ns=int(piece[-1, times[0]]))
            log.add(piece, (done + k) * PERIOD_S, state=state)
        done += len(rows)
        lap += 1
    log.close()


def measured(folder: Path, *, whole: bool) -> dict[str, Any]:
    """Times, bytes and memory of the overview."""
    files = sorted(folder.glob("run-*.mcap"))
    begin, computing = time.perf_counter(), time.process_time()
    brief = show(folder, brief=True)
    out: dict[str, Any] = {
        "brief_s": round(time.perf_counter() - begin, 3),
        "brief_processor_s": round(time.process_time() - computing, 3),
        "goal_s": GOAL_S,
        "cycles": sum(run["records"] for run in brief["runs"]),
        "hours": round(sum(run["seconds"] for run in brief["runs"]) / 3600.0, 3),
        "segments": len(files),
        "by_digest": len(brief["unread"]),
        "log_mb": round(sum(file.stat().st_size for file in files) / 1e6, 1),
    }
    read: list[int] = []
    for file in files:
        read_brief(file, read.append)
    out["read_mb"] = round(sum(read) / 1e6, 3)
    out["largest_memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, 1)
    if whole:
        computing = time.process_time()
        all_of_it = show(folder)
        out["whole_processor_s"] = round(time.process_time() - computing, 3)
        same = all(
            {**a, "reply_us": None} == {**b, "reply_us": None}
            for a, b in zip(brief["runs"], all_of_it["runs"], strict=True)
        )
        out["same_figures"] = float(same)
    return out


if __name__ == "__main__":
    main()
