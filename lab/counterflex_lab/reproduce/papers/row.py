"""A figure that a paper prints, the rule of its verdict, and the verdict on ours.

The rule is data, written beside the printed value before ours was computed. It is one of

- ``digits``: ours rounds to the printed digits;
- ``equal``: the same number, for counts;
- ``share``: within a share of the printed value;
- ``between``, ``at_least``, ``at_most``: limits of their own.

All but the first two say where the limits come from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from counterflex.core.errors import FileFormatError

Verdict = Literal["reproduced", "differs", "cannot be checked"]
VERDICTS: Final[tuple[Verdict, ...]] = ("reproduced", "differs", "cannot be checked")
_EXACT: Final = 1e-9


@dataclass(frozen=True)
class Rule:
    """Rule by which a value counts as reproduced."""

    least: float  # smallest one, in the unit of the row; -inf where there is no limit
    most: float  # largest one; inf where there is none
    text: str  # limits and where they come from

    def holds(self, value: float) -> bool:
        """Return whether a value counts as reproduced."""
        return self.least <= value <= self.most


@dataclass(frozen=True)
class Row:
    """One figure of a paper."""

    name: str  # key, unique in its paper; the function that computes ours has the same
    place: str  # where it stands in the paper
    what: str  # what it is
    printed: str  # as printed
    unit: str  # of the printed value, ours and the rule; empty for ratios and counts
    rule: Rule | None  # of the verdict; None where nothing can be computed
    reason: str  # why it differs where it does, or why it cannot be checked
    note: str = ""  # what a reader should know in any case
    assumed: tuple[str, ...] = ()  # keys of the paper's assumptions that ours rests on
    stored: str = ""  # experiment whose results ours is taken from; empty where it is computed at once

    def verdict(self, value: float | None) -> Verdict:
        """The verdict on ours; None is a value that could not be computed."""
        if self.rule is None or value is None:
            return "cannot be checked"
        return "reproduced" if self.rule.holds(value) else "differs"


def rule_of(table: str | Mapping[str, Any], printed: str, where: str) -> Rule:
    """The rule of a row.

    Args:
        table: Its value in the data file.
        printed: The printed value as a number; only ``digits``, ``equal`` and ``share`` read it.
        where: Place named in errors.

    Raises:
        FileFormatError: Not one of the rules of this module.
    """
    if table == "digits":
        half = 0.5 * 10.0 ** -_decimals(_number(printed, where)[0])
        value = _number(printed, where)[1]
        return Rule(value - half, value + half, "the printed digits")
    if table == "equal":
        value = _number(printed, where)[1]
        return Rule(value - _EXACT, value + _EXACT, "equal")
    if not isinstance(table, Mapping) or len(table) != 2 or not table.get("because"):
        raise FileFormatError("not a rule", where=where, value=str(table), hint="see reproduce/papers/row.py")
    ((kind, limit),) = ((key, value) for key, value in table.items() if key != "because")
    if kind == "share":
        value = _number(printed, where)[1]
        low, high = sorted((value * (1.0 - limit), value * (1.0 + limit)))
        return Rule(low, high, f"within {100.0 * limit:g} %: {table['because']}")
    if kind == "between":
        return Rule(float(limit[0]), float(limit[1]), f"{limit[0]:g} to {limit[1]:g}: {table['because']}")
    if kind == "at_most":
        return Rule(-math.inf, float(limit), f"at most {limit:g}: {table['because']}")
    if kind == "at_least":
        return Rule(float(limit), math.inf, f"at least {limit:g}: {table['because']}")
    raise FileFormatError("no such rule", where=where, value=kind, limit="share, between, at_most, at_least")


def _number(printed: str, where: str) -> tuple[str, float]:
    try:
        return printed, float(printed)
    except ValueError:
        raise FileFormatError("this rule needs a printed number", where=where, value=printed) from None


def _decimals(printed: str) -> int:
    return len(printed.partition(".")[2])
