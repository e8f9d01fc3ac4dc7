"""One cell without a fault for many hours of its virtual time: what grows, what overflows, which rule does not hold.

Nothing in it waits for the computer's clock: stopped by a signal and continued hours later it goes on as if nothing
had been. Each row of the table is written when its stretch is over, and an interrupted run writes what it has seen.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import Interrupted
from counterflex.core.progress import Progress, silent
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.summary_file import write_summary
from counterflex.protocols.processes.control_array import Kept, Tally
from counterflex.protocols.system.signals import heard_when_asked
from counterflex.runtime.state_slots import LoopState
from counterflex_lab.composed.cell import KeptLog
from counterflex_lab.composed.invariants import Invariants
from counterflex_lab.composed.story import Active, Story
from counterflex_lab.composed.world import Over, World

TABLE: Final = "stretches.csv"
SUMMARY: Final = "summary.json"
LOG: Final = "log"
STRETCH_S: Final = 1800.0
MOST_S: Final = 30.0 * 86400.0
_SAID_S: Final = 2.0
"""Virtual time from one report of the progress to the next."""


class WrittenLog(KeptLog):
    """A log that is computed again and, beside that, written to a disk.

    Args:
        story: Of the cell.
        active: Faults that act.
        folder: Of the run log.
        clock_s: Virtual time.
    """

    def __init__(self, story: Story, active: Active, folder: Path, clock_s: Callable[[], float]) -> None:
        super().__init__(story, active)
        self.on_disk = RunLogWriter(folder, {"simulated": True, "mode": story.mode, "seed": story.seed})
        self._clock_s = clock_s

    def add(self, rows: Float, *, state: LoopState | None = None) -> None:
        """Take records."""
        super().add(rows, state=state)
        self.on_disk.add(rows, self._clock_s(), state=state)

    def note(self, facts: Mapping[str, Any]) -> None:
        """Note what an operator did."""
        self.on_disk.note(facts)


@dataclass(eq=False)
class Endurance:
    """What came of it.

    Attributes:
        rows: One for each stretch of virtual time.
        broken: Rules that did not hold.
        interrupted: It was ended early.
    """

    rows: list[dict[str, float]]
    broken: list[dict[str, Any]]
    interrupted: bool = False


class _Table:
    """Looks at a world like the rules do, and writes a row when a stretch is over."""

    def __init__(
        self, story: Story, out: Path, stretch_s: float, progress: Progress, asked: Callable[[], bool]
    ) -> None:
        self.looks, self.rows = Invariants(story), list[dict[str, float]]()
        self._file, self._stretch_s, self._length_s, self._progress = out / TABLE, stretch_s, story.length_s, progress
        self._asked = asked
        self._due_s, self._begun_s, self._said_s = stretch_s, time.process_time(), 0.0
        self.interrupted = False

    def __call__(self, world: World) -> None:
        self.looks(world)
        if world.now_s >= self._due_s:
            self.add(world)
            self._due_s += self._stretch_s
        if world.now_s >= self._said_s:
            self._said_s += _SAID_S
            self._tell(world)
        if self.interrupted or self._asked():  # here a cycle is over: log, replay and rules agree
            self.interrupted = True
            if world.now_s < self._length_s:
                if not self.rows or self.rows[-1]["cycles"] < world.cycles:
                    self.add(world)
                raise Over

    def _tell(self, world: World) -> None:
        try:
            self._progress(min(1.0, world.now_s / self._length_s), f"{world.now_s / 3600.0:.3g} h")
        except (KeyboardInterrupt, Interrupted):
            self.interrupted = True

    def add(self, world: World) -> None:
        """Write the row of the stretch that is over."""
        control, log = world.control, world.log
        row = {
            "hours": round(world.now_s / 3600.0, 4),
            "cycles": world.cycles,
            "counter": world.side.device.counter,
            "resident_mb": _resident_mb(),
            "open_files": _open_files(),
            "active": self.looks.states.get("ACTIVE", 0),
            "states": sum(self.looks.states.values()),
            "programs": world.people.programs,
            "incidents": sum(self.looks.incidents.values()),
            "replayed": log.replay.compared,
            "written": log.written,
            "lost": int(control[Kept.LOST]),
            **{tally.name.lower(): int(control[tally]) for tally in Tally if tally < Tally.TARES},
            "segments": log.on_disk._number if isinstance(log, WrittenLog) else 0,
            "broken": len(self.looks.broken),
            "processor_s": round(time.process_time() - self._begun_s, 1),
        }
        self.rows.append(row)
        lines = [",".join(row), *(",".join(f"{value:.12g}" for value in one.values()) for one in self.rows)]
        atomic.write_text(self._file, "\n".join(lines) + "\n")


def _open_files() -> float:
    """Open files of this process; not-a-number where the system does not say."""
    place = Path("/proc/self/fd")
    return float(len(list(place.iterdir()))) if place.is_dir() else float("nan")


def _resident_mb() -> float:
    """Resident memory of this process; not-a-number where the system does not say."""
    try:
        words = Path("/proc/self/statm").read_text(encoding="ascii").split()
        return round(int(words[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6, 3)
    except (OSError, ValueError, IndexError):
        return float("nan")


def run(
    out: str | Path,
    *,
    minutes: float,
    mode: str = "fused",
    seed: int = 1,
    counter: int | None = None,
    keep_log: bool = False,
    stretch_s: float = STRETCH_S,
    progress: Progress = silent,
) -> Endurance:
    """Let a cell work for so many hours of its virtual time; write ``stretches.csv`` as it goes, then ``summary.json``.

    Args:
        out: Folder, made when missing.
        minutes: Virtual.
        mode: One of :data:`counterflex_lab.composed.story.MODES`.
        seed: Of noise, network and truth.
        counter: First of the controller, ms; None: the one that passes 2^31 in the middle.
        keep_log: Write the run log as well, about 1 GB per hour.
        stretch_s: Virtual time of a row.
        progress: Progress callback, fraction 0 to 1; an interruption, by it or by a signal, ends the cell behind the
            cycle that it is in: the stretch that was begun becomes the last row, and all is written.

    Raises:
        OutputError: The folder cannot be written.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    length_s = min(MOST_S, minutes * 60.0)
    story = Story(seed, mode, length_s)
    with heard_when_asked() as asked:
        table = _Table(story, folder, stretch_s, progress, asked)
        world = World(story, table)
        world.restart(max(1, 2**31 - round(500.0 * length_s)) if counter is None else counter)
        if keep_log:
            world.log_of = lambda: WrittenLog(story, world.active, folder / LOG, lambda: world.now_s)
        world.run()
        table.looks.end(world)
        if isinstance(world.log, WrittenLog):
            world.log.on_disk.close()
    done = Endurance(table.rows, [], table.interrupted)
    done.broken = [{"rule": one.rule, "at_s": one.at_s, "happened": one.words} for one in table.looks.broken.values()]
    write_summary(
        folder / SUMMARY,
        {
            "job": "soak --simulated",
            "mode": mode,
            "seed": seed,
            "hours": round(world.cycles * world.period_s / 3600.0, 4),
            "interrupted": done.interrupted,
            "broken": done.broken,
            "stretches": done.rows,
        },
    )
    return done
