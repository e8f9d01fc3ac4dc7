"""Files with mistakes: R25, R27."""

from __future__ import annotations

import copy
import tempfile
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w

from counterflex.app.compliance_window import require_plausible
from counterflex.core.errors import CounterflexError
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.plausibility import unusual
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_FACTORS: Final = (1e3, float(np.degrees(1.0)), 1e-3)


def _demo() -> str:
    return (resources.files("counterflex.app") / "demo" / "cell.toml").read_text(encoding="utf-8")


def numbers(tables: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], float]]:
    """Every number of a table that is not zero, with the keys that lead to it."""
    if isinstance(tables, dict):
        for key, value in tables.items():
            yield from numbers(value, (*path, key))
    elif isinstance(tables, list):
        for k, value in enumerate(tables):
            yield from numbers(value, (*path, k))
    elif isinstance(tables, int | float) and not isinstance(tables, bool) and tables != 0:
        yield path, float(tables)


def altered(tables: dict[str, Any], path: tuple[Any, ...], value: float) -> str:
    """The file with one number changed."""
    out = copy.deepcopy(tables)
    place: Any = out
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return tomli_w.dumps(out)


def judged(text: str, folder: Path) -> str:
    """Fate of a cell file that is given to a run: ``refused``, ``told`` of a number, or ``passed``."""
    file = folder / "cell.toml"
    file.write_text(text, encoding="utf-8")
    try:
        cell = read_cell(file)
        require_plausible(cell)
    except CounterflexError:
        return "refused"
    return "told" if unusual(cell.tables) else "passed"


def _units(effort: Effort) -> Outcome:
    """R25: every number of the demonstration cell times 1000, 57.3 and a thousandth."""
    tables = tomllib.loads(_demo())
    every = effort.pick(1, 12)
    count = {"refused": 0, "told": 0, "passed": 0}
    passed_over: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as place:
        sound = judged(_demo(), Path(place))
        for path, value in list(numbers(tables))[::every]:
            for factor in _FACTORS:
                verdict = judged(altered(tables, path, value * factor), Path(place))
                count[verdict] += 1
                if verdict == "passed":
                    name = ".".join(str(key) for key in path if not isinstance(key, int))
                    passed_over[name] = passed_over.get(name, 0) + 1
    most = sorted(passed_over, key=lambda name: -passed_over[name])[:6]
    tried = sum(count.values())
    return Outcome(
        count["passed"] == 0 and sound == "passed",
        f"{count['refused']} of {tried} refused, {count['told']} told, {count['passed']} let pass"
        + (f": {', '.join(most)}" if most else ""),
        None,
        None,
        {"refused_share": count["refused"] / tried, "told_share": count["told"] / tried, "tried": float(tried)},
    )


def _truncated(effort: Effort) -> Outcome:
    """R27: a cell file cut at every byte; half of a number, a key or a table is never taken for a whole one."""
    text = _demo()
    every = effort.pick(37, 997)
    wrong, taken, refused = 0, 0, 0
    lines = set(np.cumsum([len(line) for line in text.splitlines(keepends=True)]).tolist())
    with tempfile.TemporaryDirectory() as place:
        for size in range(0, len(text), every):
            try:
                if judged(text[:size], Path(place)) == "refused":
                    refused += 1
                else:
                    taken += 1
            except Exception:  # whatever it is, it is not the one clear line that a user should get
                wrong += 1
    return Outcome(
        wrong == 0,
        f"{refused} of {refused + taken + wrong} refused in one line, {taken} are whole files of {len(lines)} lines by "
        f"themselves (their hash is in the log), {wrong} other exceptions",
    )


SCENARIOS: Final = (
    Scenario(
        "R25",
        "unit-mistakes",
        "every number of the demonstration cell times 1000, 57.3 and 0.001, one at a time",
        "each is refused, by its range or by the compliance of the tool tip (0.1 to 30 um/N at three poses), or told "
        "before the run, by a narrower range",
        _units,
    ),
    Scenario(
        "R27",
        "truncated-cell",
        "a cell file cut short at any byte",
        "refused in one line with where and why, or complete by itself; no other exception",
        _truncated,
    ),
)
