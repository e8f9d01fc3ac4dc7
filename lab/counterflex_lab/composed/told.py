"""Stories told by one process or by several, in the order of their seeds, and kept on disk as they come.

A campaign that is interrupted, or killed, goes on with the story after the last one that stands in its file: a row of
JSON for each, behind a row that says what they were told with. Where that is another program, the file begins anew.
"""

from __future__ import annotations

import itertools
import json
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Self

from counterflex.app.long_jobs.step_cache import program_files
from counterflex.app.long_jobs.workers import interrupts_deferred, pool_of
from counterflex.core.errors import OutputError
from counterflex_lab.composed.invariants import Broken
from counterflex_lab.composed.play import Outcome
from counterflex_lab.composed.story import Story, stories_in

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


def in_order(stories: Iterator[Story], tell: Teller, shorten: Shortener, workers: int) -> Generator[Told, None, None]:
    """Tell stories, one behind the other or by several processes at a time; they come in their order.

    Args:
        stories: Without end.
        tell: Tells one.
        shorten: Makes one shorter.
        workers: Processes; 1: this one.
    """
    if workers == 1:
        for story in stories:
            yield tell_one(story, tell, shorten)
        return
    with pool_of(workers) as pool:
        waiting: deque[Any] = deque()
        for story in stories:
            with interrupts_deferred():
                waiting.append(pool.submit(tell_one, story, tell, shorten))
            if len(waiting) == _AHEAD * workers:
                yield waiting.popleft().result()


class ToldFile:
    """Outcomes of a campaign in its folder.

    Args:
        folder: Of the campaign; made where there is none.
        facts: What they depend on beside the program.

    Attributes:
        before: What stands in the file already.

    Raises:
        OutputError: The folder cannot be written.
    """

    def __init__(self, folder: Path, **facts: Any) -> None:
        head = json.dumps({"facts": facts, "program": [*program_files(), *program_files("counterflex_lab")]})
        path = folder / TOLD
        self.before: list[Told] = []
        try:
            folder.mkdir(parents=True, exist_ok=True)
            rows = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.is_file() else []
            if rows and rows[0] == head + "\n":
                whole = list(itertools.takewhile(lambda row: row.endswith("\n"), rows))  # the last one may be cut short
                self.before = [_of_row(row) for row in whole[1:]]
            else:
                whole = [head + "\n"]
            path.write_text("".join(whole), encoding="utf-8")
            self._file = path.open("a", encoding="utf-8")
        except OSError as fault:
            raise OutputError(f"cannot write: {fault.strerror or fault}", where=str(path)) from fault

    def __enter__(self) -> Self:
        """Nothing is to be done."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

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
