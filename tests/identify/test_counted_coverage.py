"""What a report says of coverage is what was counted and stands in the table, and every counted recipe says it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from counterflex.identify.counted_coverage import COUNTED, CountedShare

TABLE = (Path(__file__).resolve().parents[2] / "docs/identify/method.md").read_text(encoding="utf-8")


def counted(recipe: str) -> tuple[float, float]:
    """Share of all and of the worst parameter, with errors, now."""
    row = next(
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in TABLE.splitlines()
        if re.match(rf"\| {recipe}\b[^|]*\| errors", line)
    )
    every, _, worst = re.match(r"(\d+), (\d+), (\d+) %", row[2]).groups()  # type: ignore[union-attr]
    return float(every) / 100.0, float(worst) / 100.0


@pytest.mark.parametrize("said", COUNTED.values(), ids=list(COUNTED))
def test_no_report_promises_more_than_was_counted(said: CountedShare) -> None:
    every, worst = counted(said.recipe)
    assert said.share <= every
    assert said.worst_share <= worst
