"""How often the programs of a job use a name: a target of a data list that is used once can be changed there."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from counterflex.integrations.kuka.language.program import KrlMotion
from counterflex.integrations.kuka.language.read.job import Job

_MENTION: Final = re.compile(r"([A-Za-z$]\w*)(\s*\[[^\]]*\])?")


def with_shared(moves: Sequence[KrlMotion], job: Job) -> list[KrlMotion]:
    """Return the motions, with those marked whose target's name is used elsewhere in the job too."""
    if not any(move.target is not None and move.target.in_data for move in moves):
        return list(moves)
    counts = _mentions(job)
    return [replace(move, shared=True) if _shared(move, counts) else move for move in moves]


def _shared(move: KrlMotion, counts: Counter[tuple[str, str]]) -> bool:
    target = move.target
    if target is None or not target.in_data:
        return False
    name, _, index = "".join(target.name.split()).upper().partition("[")
    if not index:
        return counts[name, ""] > 1
    if index[:-1].isdigit():
        return counts[name, index] + counts[name, "?"] + counts[name, ""] > 1
    return sum(count for (other, _), count in counts.items() if other == name) > 1


def _mentions(job: Job) -> Counter[tuple[str, str]]:
    """Count each name with its index; ``?`` stands for a computed one."""
    counts: Counter[tuple[str, str]] = Counter()
    for module in job.modules():
        for code in module.codes:
            for name, index in _MENTION.findall(code):
                inside = "".join(index.split())[1:-1]
                known = f"{inside}]" if inside.isdigit() else "?" if inside else ""
                counts[name.upper(), known] += 1
    return counts
