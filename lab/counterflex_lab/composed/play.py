"""Tell a story, and make a story that breaks a rule as short as it gets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from counterflex_lab.composed.invariants import Broken, Invariants
from counterflex_lab.composed.story import Fault, Story
from counterflex_lab.composed.world import World


@dataclass(frozen=True)
class Outcome:
    """What came of a story.

    Attributes:
        story: The story.
        broken: Rules that did not hold.
        cycles: Of the controller.
        compared: Records computed again.
        states: Cycles in each state of the loop.
        incidents: Cause by which the correction ended, how often.
    """

    story: Story
    broken: tuple[Broken, ...]
    cycles: int
    compared: int
    states: dict[str, int]
    incidents: dict[str, int]


def tell(story: Story) -> Outcome:
    """Tell a story from its beginning to its end."""
    looks = Invariants(story)
    world = World(story, looks)
    world.run()
    looks.end(world)
    return Outcome(story, tuple(looks.broken.values()), world.cycles, world.compared, looks.states, looks.incidents)


def shrunk(story: Story, rule: str, *, most: int = 60, say: Callable[[str], None] = lambda _: None) -> Story:
    """Make a story that breaks a rule shorter: fewer faults, then briefer and smaller ones, then an earlier end.

    Args:
        story: It breaks the rule.
        rule: Name of the rule.
        most: Stories that are told at most.
        say: Told what is tried.

    Returns:
        The shortest one found that still breaks the rule.
    """
    tried = 0
    while True:
        for shorter in _shorter(story, rule):
            if tried >= most:
                return story
            tried += 1
            say(f"{tried}: {len(shorter.faults)} faults, {shorter.length_s:.1f} s")
            if any(one.rule == rule for one in tell(shorter).broken):
                story = shorter
                break
        else:
            return story


def _shorter(story: Story, rule: str) -> Iterator[Story]:
    for k in range(len(story.faults)):
        yield replace(story, faults=story.faults[:k] + story.faults[k + 1 :])
    last = max((fault.end_s for fault in story.faults), default=0.0)
    if rule != "corrects again":
        for length in (last + 1.0, last + 4.0, 0.75 * story.length_s):
            if 2.0 < length < story.length_s - 0.5:
                yield replace(story, length_s=round(length, 1))
    for k, fault in enumerate(story.faults):
        if fault.duration_s > 0.05:
            brief = Fault(fault.kind, fault.at_s, fault.size, round(0.5 * fault.duration_s, 4))
            yield replace(story, faults=(*story.faults[:k], brief, *story.faults[k + 1 :]))
