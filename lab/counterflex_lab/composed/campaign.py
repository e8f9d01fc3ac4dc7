"""Many stories from one seed: told, counted, and those that break a rule made short and kept."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from counterflex.core import atomic
from counterflex.core.errors import Interrupted
from counterflex.core.progress import Progress, silent
from counterflex.files.summary_file import write_summary
from counterflex_lab.composed.play import Outcome, shrunk, tell
from counterflex_lab.composed.story import Story, as_text, draw
from counterflex_lab.composed.world import PERIOD_S

STORIES: Final = "stories.json"
SUMMARY: Final = "summary.json"


@dataclass(eq=False)
class Campaign:
    """What came of many stories.

    Attributes:
        seed: Of the first; each has the next.
        stories: Told so far.
        cycles: Of the controllers.
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
        return self.cycles * PERIOD_S / 60.0

    @property
    def per_real(self) -> float:
        """Simulated time by the processor's."""
        return self.cycles * PERIOD_S / self.computing_s if self.computing_s else 0.0

    def add(self, outcome: Outcome) -> None:
        """Count a story."""
        self.stories += 1
        self.cycles += outcome.cycles
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
    out: str | Path, *, minutes: float, seed: int = 0, shrink: bool = True, progress: Progress = silent
) -> Campaign:
    """Tell stories until so many minutes of cells are simulated; write what came of them.

    Args:
        out: Folder: ``summary.json``, and ``stories.json`` with the shortened stories that broke a rule.
        minutes: Simulated, at least one story.
        seed: Of the first story; the next one has the next.
        shrink: Make stories that break a rule shorter.
        progress: Progress callback, fraction 0 to 1; an interruption ends the campaign with what was told.

    Raises:
        OutputError: The folder cannot be written.
    """
    campaign = Campaign(seed)
    try:
        while campaign.minutes < minutes or not campaign.stories:
            story = draw(seed + campaign.stories)
            progress(min(1.0, campaign.minutes / minutes), f"seed {story.seed}, {len(campaign.broken)} broken")
            begin = time.process_time()
            outcome = tell(story)
            campaign.computing_s += time.process_time() - begin
            campaign.add(outcome)
            for one in outcome.broken:
                shortest = shrunk(story, one.rule) if shrink else story
                campaign.kept.append((f"{one.rule}: {one.words}", shortest))
    except (KeyboardInterrupt, Interrupted):
        campaign.interrupted = True
    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / STORIES, as_text(campaign.kept))
        write_summary(staging / SUMMARY, campaign.summary())
    return campaign
