"""Many stories from one seed: told, counted, and those that break a rule made short and kept.

A campaign that is interrupted, or killed, goes on behind the last story that stands in its file: a row of JSON for
each, below a row that says what they were told with. Where that is another program, the file begins anew.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, NoReturn, Self

from counterflex.app.long_jobs.step_cache import program_files
from counterflex.app.long_jobs.workers import count_of, done_one_by_one, interrupts_deferred, pool_of
from counterflex.core import atomic
from counterflex.core.errors import Interrupted, OutputError
from counterflex.core.progress import Progress, silent
from counterflex.files.summary_file import write_summary
from counterflex_lab.composed.invariants import Broken
from counterflex_lab.composed.play import Outcome, shrunk, tell
from counterflex_lab.composed.story import Story, as_text, draw, stories_in

STORIES: Final = "stories.json"
SUMMARY: Final = "summary.json"
TOLD: Final = "told.jsonl"
_AHEAD: Final = 2
"""Stories handed out for each process before those that come first are taken."""


@dataclass(frozen=True)
class Told:
    """A story with what came of it.

    Attributes:
        outcome: What came of it.
        kept: Rule in words and shortened story, of each rule that did not hold.
        computing_s: Time of the processor, without that of making it shorter.
    """

    outcome: Outcome
    kept: tuple[tuple[str, Story], ...]
    computing_s: float


Teller = Callable[[Story], Outcome]
Shortener = Callable[[Story, str], Story]


def tell_one(story: Story, tell: Teller, shorten: Shortener) -> Told:
    """Tell a story, and make it short where it breaks a rule.

    Args:
        story: The story.
        tell: Tells it.
        shorten: Makes it shorter.
    """
    begin = time.process_time()
    outcome = tell(story)
    computing_s = time.process_time() - begin
    kept = tuple((f"{one.rule}: {one.words}", shorten(story, one.rule)) for one in outcome.broken)
    return Told(outcome, kept, computing_s)


def _tell_in_worker(story: Story, tell: Teller, shorten: Shortener) -> Told:
    """As :func:`tell_one`, in a process that may be told to end meanwhile: it frees its shared memory and files."""
    signal.signal(signal.SIGTERM, _leave)
    try:
        return tell_one(story, tell, shorten)
    except SystemExit:
        os._exit(1)  # the pool would hand it the next story


def _no_report() -> None:
    """Nothing is said between two stories."""


def _leave(*_: object) -> NoReturn:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(1)


def in_order(stories: Iterator[Story], tell: Teller, shorten: Shortener, workers: int) -> Generator[Told, None, None]:
    """Tell stories, one behind the other or by several processes at a time; they come in their order.

    Args:
        stories: Without end.
        tell: Tells one.
        shorten: Makes one shorter.
        workers: Processes; 0: this one.
    """
    if workers == 0:
        for story in stories:
            yield tell_one(story, tell, shorten)
        return
    with pool_of(workers) as pool:  # which ends those that are being told, once there are enough
        waiting: deque[Any] = deque()
        for story in stories:
            with interrupts_deferred():
                waiting.append(pool.submit(_tell_in_worker, story, tell, shorten))
            if len(waiting) == _AHEAD * workers:
                first = [waiting.popleft()]
                yield next(done_one_by_one(first, _no_report)).result()  # which looks for Ctrl-C meanwhile


class ToldFile:
    """Outcomes of a campaign in its folder; whoever enters it makes the folder where there is none.

    Args:
        folder: Of the campaign.
        facts: What they depend on beside the program.

    Attributes:
        before: What stands in the file already.

    Raises:
        OutputError: The folder cannot be written.
    """

    def __init__(self, folder: Path, **facts: Any) -> None:
        head = json.dumps({"facts": facts, "program": [*program_files(), *program_files("counterflex_lab")]}) + "\n"
        self._path, self._whole = folder / TOLD, [head]
        self.before: list[Told] = []
        try:
            folder.mkdir(parents=True, exist_ok=True)
            rows = self._path.read_text(encoding="utf-8").splitlines(keepends=True) if self._path.is_file() else []
        except OSError as fault:
            raise OutputError(f"cannot write: {fault.strerror or fault}", where=str(self._path)) from fault
        if rows and rows[0] == head:
            self._whole = list(itertools.takewhile(lambda row: row.endswith("\n"), rows))  # the last one may be cut
            self.before = [_of_row(row) for row in self._whole[1:]]

    def __enter__(self) -> Self:
        """Open it behind what stands there already."""
        with contextlib.ExitStack() as stack:
            self._file = stack.enter_context(atomic.open_record(self._path))
            self._file.write("".join(self._whole))
            self._file.flush()
            self._closed = stack.pop_all()
        return self

    def __exit__(self, *fault: Any) -> None:
        """Close the file."""
        self._closed.__exit__(*fault)

    def add(self, told: Told) -> None:
        """Write a story's outcome."""
        outcome = told.outcome
        row = {
            "story": asdict(outcome.story),
            "broken": [[one.rule, one.at_s, one.words] for one in outcome.broken],
            "cycles": outcome.cycles,
            "compared": outcome.compared,
            "states": outcome.states,
            "incidents": outcome.incidents,
            "kept": [{"why": why, **asdict(story)} for why, story in told.kept],
            "computing_s": told.computing_s,
        }
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()


def _of_row(row: str) -> Told:
    table = json.loads(row)
    ((_, story),) = stories_in([{"why": "", **table["story"]}], TOLD)
    broken = tuple(Broken(*one) for one in table["broken"])
    counts = table["cycles"], table["compared"], table["states"], table["incidents"]
    return Told(Outcome(story, broken, *counts), tuple(stories_in(table["kept"], TOLD)), table["computing_s"])


@dataclass(eq=False)
class Campaign:
    """What came of many stories.

    Attributes:
        seed: Of the first; each has the next.
        stories: Told so far.
        cycles: Of the controllers.
        simulated_s: Time of all cells.
        compared: Records that were computed again.
        computing_s: Time of the processor.
        kinds: Faults that were injected, by kind.
        incidents: Cause by which a correction ended, how often.
        states: Cycles in each state of the loop.
        broken: Seed, rule and words of each rule that did not hold.
        kept: Rule and shortened story of each.
        interrupted: It was ended early.
    """

    seed: int
    stories: int = 0
    cycles: int = 0
    simulated_s: float = 0.0
    compared: int = 0
    computing_s: float = 0.0
    kinds: Counter[str] = field(default_factory=Counter)
    incidents: Counter[str] = field(default_factory=Counter)
    states: Counter[str] = field(default_factory=Counter)
    broken: list[tuple[int, str, str]] = field(default_factory=list)
    kept: list[tuple[str, Story]] = field(default_factory=list)
    interrupted: bool = False

    @property
    def minutes(self) -> float:
        """Simulated, of all cells."""
        return self.simulated_s / 60.0

    @property
    def per_real(self) -> float:
        """Simulated time by the processor's."""
        return self.simulated_s / self.computing_s if self.computing_s else 0.0

    def add(self, told: Told) -> None:
        """Count a story."""
        outcome = told.outcome
        self.stories += 1
        self.computing_s += told.computing_s
        self.kept += told.kept
        self.cycles += outcome.cycles
        self.simulated_s += outcome.cycles * outcome.story.period_s
        self.compared += outcome.compared
        self.kinds.update(fault.kind for fault in outcome.story.faults)
        self.incidents.update(outcome.incidents)
        self.states.update(outcome.states)
        self.broken += [(outcome.story.seed, one.rule, f"at {one.at_s:g} s: {one.words}") for one in outcome.broken]

    def summary(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "job": "faults --random",
            "seed": self.seed,
            "passed": not self.broken,
            "interrupted": self.interrupted,
            "stories": self.stories,
            "cell_minutes": round(self.minutes, 2),
            "cycles": self.cycles,
            "records_replayed": self.compared,
            "simulated_by_processor_time": round(self.per_real, 2),
            "faults": dict(self.kinds.most_common()),
            "corrections_ended_by": dict(self.incidents.most_common()),
            "cycles_in_state": {name.lower(): count for name, count in self.states.most_common()},
            "broken": [{"seed": seed, "rule": rule, "happened": words} for seed, rule, words in self.broken],
        }


def run(
    out: str | Path,
    *,
    minutes: float,
    seed: int = 0,
    shrink: bool = True,
    workers: int | None = 0,
    progress: Progress = silent,
) -> Campaign:
    """Tell stories until so many minutes of cells are simulated; write what came of them.

    The result is the same for any number of processes. One that was interrupted goes on where it ended.

    Args:
        out: Folder: ``summary.json``, ``stories.json`` with the shortened stories that broke a rule, and ``told.jsonl``
            with the outcome of each story, written when it is told.
        minutes: Simulated, at least one story.
        seed: Of the first story; the next one has the next.
        shrink: Make stories that break a rule shorter.
        workers: Processes that tell them, one thread each, never more than minutes. None: one for each core; 0: this
            process.
        progress: Progress callback, fraction 0 to 1; an interruption ends the campaign with what was told.

    Raises:
        OutputError: The folder cannot be written.
    """
    campaign = Campaign(seed)
    try:
        with ToldFile(Path(out), seed=seed, shrink=shrink) as file:
            count = 0 if workers == 0 else count_of(workers, math.ceil(minutes))
            _tell_on(campaign, file, minutes, shrink, count, progress)
    except (KeyboardInterrupt, Interrupted):
        campaign.interrupted = True
    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / STORIES, as_text(campaign.kept))
        write_summary(staging / SUMMARY, campaign.summary())
    return campaign


def _tell_on(
    campaign: Campaign, file: ToldFile, minutes: float, shrink: bool, workers: int, progress: Progress
) -> None:
    """Count what stands in the file, then tell the stories behind it."""
    shorten = shrunk if shrink else _as_it_is
    seeds = itertools.count(campaign.seed + len(file.before))
    new = in_order(map(draw, seeds), tell, shorten, workers)
    try:
        for told in itertools.chain(file.before, _written(new, file)):
            campaign.add(told)
            share = min(1.0, campaign.minutes / minutes)
            progress(share, f"seed {campaign.seed + campaign.stories}, {len(campaign.broken)} broken")
            if campaign.minutes >= minutes:
                break
    finally:
        new.close()


def _written(new: Iterator[Told], file: ToldFile) -> Iterator[Told]:
    for told in new:
        file.add(told)
        yield told


def _as_it_is(story: Story, _rule: str) -> Story:
    return story
