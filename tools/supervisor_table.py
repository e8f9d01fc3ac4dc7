"""Write the tables of states, requests and counters into docs/online.md, from what the loop's own code does.

States: every state of the compiled supervisor with every input. Requests of an operator: asked of a loop in each state.
Counters of a session: judged in every state of the counter.

Usage: python tools/supervisor_table.py [--check]. With --check nothing is written; exit 1 if the page is out of date.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.state.states import Cause, State

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "references"), str(ROOT / "tools")]
import request_table  # noqa: E402
from supervisor_space import FEATURES, STAYS, Space, all_inputs, explore  # noqa: E402

PAGE: Final = ROOT / "docs" / "online.md"
PARTS: Final = ("states", "requests", "counters")
"""Of the page; each stands between two comments."""
_SECONDS = OnlineSettings().supervisor, OnlineSettings().period_s
OUTPUT: Final = {
    State.IDLE: "zero",
    State.READY: "zero",
    State.ARMED: "zero, all checks active",
    State.ACTIVE: f"the correction, faded in within {_SECONDS[0].rise * _SECONDS[1]:g} s",
    State.HOLD: "the correction of the last cycle",
    State.RAMP_OUT: "slowly to zero, `ramp_mm_s`",
    State.FAULT: (
        f"the correction of the last cycle with a stop request for {_SECONDS[0].stop * _SECONDS[1]:g} s, then no answer"
    ),
}
WORDS: Final = {
    "healthy": ("all checks passed", "a check fails"),
    "arm": ("a person arms", "nobody arms"),
    "enable": ("the program wants the correction", "the program does not want it"),
    "stop": ("a stop", "no stop"),
    "reset": ("a person resets", "no reset"),
    "at_zero": ("the correction is zero and at rest", "a correction is in effect"),
    "away": ("the correction is away in the cut", "it is not away in the cut"),
    "soft": ("a cause of a hold", "no cause of a hold"),
    "hard": ("a cause of a fault", "no cause of a fault"),
    "lasts": (f"held for {_SECONDS[0].hold * _SECONDS[1]:g} s", "held for less"),
    "settled": (f"{_SECONDS[0].good * _SECONDS[1]:g} s without a cause", "not yet calm"),
    "ends": ("asked to end", "not asked to end"),
    "may_ramp": ("the robot stands or nothing is cut", "the robot moves in the cut"),
    "stands": ("the robot stands", "the robot moves"),
    "in_cut": ("material is or may be cut", "nothing is cut"),
    "may_return": ("a return is left and process monitoring did not hold it", "no return is left, or it is watched"),
    "remains": ("a cause other than missing telegrams remains", "no cause but missing telegrams remains"),
}
"""In the table: where it is so, and where it is not."""
MADE: Final[Mapping[str, Callable[[Mapping[str, Bool]], Bool]]] = {
    "ends": lambda f: f["stop"] | ~f["enable"] | f["ending"],
    "may_ramp": lambda f: f["stands"] | ~f["in_cut"],
    "may_return": lambda f: ~f["watched"] & ~f["spent"],
    "remains": lambda f: f["hard"] & ~f["silence"],
}
"""Words of several features."""
ASKED: Final = {
    State.ACTIVE: ("hard", "soft", "ends", "may_ramp"),
    State.HOLD: ("hard", "soft", "ends", "may_ramp", "lasts", "settled", "may_return", "stands"),
    State.RAMP_OUT: ("hard", "at_zero", "healthy", "may_ramp", "lasts"),
    State.FAULT: ("reset", "at_zero", "remains"),
}
"""Words that decide; of the other states all single features may."""
_SINGLE = ("hard", "healthy", "arm", "stop", "soft", "at_zero", "enable", "away", "reset", "stands", "in_cut")


def truth(space: Space, state: State) -> tuple[tuple[str, ...], dict[tuple[bool, ...], int]]:
    """Return the words that decide in a state, and the next state for each combination of them that is met.

    Raises:
        AssertionError: They do not decide alone.
    """
    codes = np.flatnonzero(space.outcome[state] != STAYS)
    following = space.outcome[state][codes]
    flags = {name: (codes >> k & 1).astype(bool) for k, name in enumerate(FEATURES)}
    flags |= {name: make(flags) for name, make in MADE.items()}
    names = list(ASKED.get(state, _SINGLE))
    table = _decided(flags, names, following)
    assert table is not None, f"{state.name} is not decided by {', '.join(names)}"
    for name in list(names):
        fewer = _decided(flags, [other for other in names if other != name], following)
        if fewer is not None:
            names.remove(name)
            table = fewer
    return tuple(names), table


def _decided(flags: Mapping[str, Bool], names: list[str], following: Int) -> dict[tuple[bool, ...], int] | None:
    columns = np.stack([flags[name] for name in names], axis=1) if names else np.zeros((len(following), 0), bool)
    rows = np.unique(np.column_stack([columns, following]).astype(np.int64), axis=0)
    table = {tuple(bool(each) for each in row[:-1]): int(row[-1]) for row in rows}
    return table if len(table) == len(rows) else None


def products(table: Mapping[tuple[bool, ...], int], target: int) -> list[dict[int, bool]]:
    """Return the fewest conditions that I found under which the next state is `target`: one of them must hold."""
    wanted = [row for row, state in table.items() if state == target]
    others = [row for row, state in table.items() if state != target]
    found: list[dict[int, bool]] = []
    for row in wanted:
        literals = dict(enumerate(row))
        for k in range(len(row)):
            wider = {j: value for j, value in literals.items() if j != k}
            if not any(_fits(wider, other) for other in others):
                literals = wider
        found.append(literals)
    found.sort(key=lambda each: (len(each), sorted(each.items())))
    kept: list[dict[int, bool]] = []
    for literals in found:
        if any(_fits(literals, row) and not any(_fits(other, row) for other in kept) for row in wanted):
            kept.append(literals)
    for literals in list(kept):
        rest = [other for other in kept if other is not literals]
        if all(any(_fits(other, row) for other in rest) for row in wanted):
            kept = rest
    return kept


def _fits(literals: Mapping[int, bool], row: tuple[bool, ...]) -> bool:
    return all(row[k] == value for k, value in literals.items())


def transitions(space: Space, state: State) -> list[tuple[State, str]]:
    """Return each next state with its conditions in words."""
    names, table = truth(space, state)
    out = []
    hard = names.index("hard") if "hard" in names else None
    faults = {row for row in table if hard is not None and row[hard]}
    first = bool(faults) and all(table[row] == State.FAULT for row in faults)
    for target in sorted(set(table.values()) - {int(state)}, key=lambda each: (each == State.FAULT, each)):
        free = {row: end for row, end in table.items() if not (first and target != State.FAULT and row in faults)}
        ways = [
            ", ".join(WORDS[names[k]][0 if value else 1] for k, value in each.items())
            for each in products(free, target)
        ]
        out.append((State(target), "; or ".join(ways)))
    return out


def causes(space: Space, state: State, target: State) -> str:
    """Return the causes with which a state is left."""
    bits = int(space.causes[state, target])
    found = [cause for cause in Cause if bits >> cause & 1]
    plain = {Cause.NONE: "none", Cause.OPERATOR: "operator", Cause.PROGRAM: "program"}
    plain |= {Cause.ENABLE_LOST: "enable lost", Cause.HELD_TOO_LONG: "held too long"}
    words = [plain[cause] for cause in found if cause in plain]
    return ", ".join([*(["the one found"] if any(cause not in plain for cause in found) else []), *words])


def text(space: Space | None = None) -> str:
    """Return the part of the page."""
    space = explore() if space is None else space
    state, held, stop = (space.fields(name) for name in ("state", "feed_hold", "stop"))
    lines = [
        f"Written by `python tools/supervisor_table.py`: {len(space.keys)} states of the supervisor,",
        f"counters told apart, with {len(all_inputs())} inputs each. A cause of a fault goes before all else.",
        "Where nothing of it is the case, the state stays.",
        "",
        "| state | output | feed hold | next | when | cause |",
        "|---|---|---|---|---|---|",
    ]
    for one in State:
        values = {int(value) for value in held[state == one]}
        hold = {(0,): "no", (1,): "yes", (0, 1): "as before"}[tuple(sorted(values))]
        hold += ", stop behind a ramp" if np.any(stop[state == one]) else ""
        first = f"| {_name(one)} | {OUTPUT[one]} | {hold} |"
        for target, when in transitions(space, one):
            lines.append(f"{first} {_name(target)} | {when} | {causes(space, one, target)} |")
            first = "| | | |"
    return "\n".join(lines) + "\n"


def _name(state: State) -> str:
    return state.name.lower().replace("_", " ")


def page(space: Space | None = None) -> str:
    """Return the page with its parts written anew."""
    out = PAGE.read_text(encoding="utf-8")
    for name, new in zip(PARTS, (text(space), request_table.requests(), request_table.counters()), strict=True):
        begin, end = f"<!-- {name}: written by tools/supervisor_table.py -->\n", f"<!-- end of {name} -->\n"
        before, there, rest = out.partition(begin)
        _, ended, after = rest.partition(end)
        assert there, f"no place for the {name} in {PAGE.name}"
        assert ended, f"the {name} in {PAGE.name} have no end"
        out = f"{before}{begin}\n{new}\n{end}{after}"
    return out


def main() -> int:
    """Write or check the page."""
    new = page()
    if "--check" in sys.argv:
        stale = PAGE.read_text(encoding="utf-8") != new
        print(f"{PAGE} is not up to date: python tools/supervisor_table.py" if stale else "up to date")
        return int(stale)
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
