"""Many stories from one seed: told, counted, and those that break a rule made short and kept."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from counterflex.app.long_jobs.workers import count_of
from counterflex.core import atomic
from counterflex.core.errors import Interrupted
from counterflex.core.progress import Progress, silent
from counterflex.files.summary_file import write_summary
from counterflex_lab.composed.play import shrunk, tell
from counterflex_lab.composed.story import Story, as_text, draw
from counterflex_lab.composed.told import Told, ToldFile, in_order

STORIES: Final = "stories.json"
SUMMARY: Final = "summary.json"


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
    workers: int | None = 1,
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
        workers: Processes that tell them; None: one for each core. Never more than minutes.
        progress: Progress callback, fraction 0 to 1; an interruption ends the campaign with what was told.

    Raises:
        OutputError: The folder cannot be written.
    """
    campaign = Campaign(seed)
    try:
        with ToldFile(Path(out), seed=seed, shrink=shrink) as file:
            _tell_on(campaign, file, minutes, shrink, count_of(workers, math.ceil(minutes)), progress)
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
    with contextlib.closing(in_order(map(draw, seeds), tell, shorten, workers)) as new:
        for told in itertools.chain(file.before, _written(new, file)):
            campaign.add(told)
            share = min(1.0, campaign.minutes / minutes)
            progress(share, f"seed {campaign.seed + campaign.stories}, {len(campaign.broken)} broken")
            if campaign.minutes >= minutes:
                break


def _written(new: Iterator[Told], file: ToldFile) -> Iterator[Told]:
    for told in new:
        file.add(told)
        yield told


def _as_it_is(story: Story, _rule: str) -> Story:
    return story
