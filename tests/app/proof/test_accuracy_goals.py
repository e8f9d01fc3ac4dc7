"""The published figures are kept: the demonstration part on one simulated cell, a little above what it leaves today.

Each limit is today's figure and a tenth of it: a planner that became worse by more than that fails here, not in the
README. Figures: 99.7 % of the error that remains, of the uncompensated one (docs/summary.md).
"""

from __future__ import annotations

from typing import Any

import pytest

from counterflex.app import examples
from counterflex.app.proof import prove

GOALS = {
    ("catalogue", "path"): 0.113,
    ("catalogue", "entry"): 0.121,
    ("catalogue", "plateau"): 0.102,
    ("catalogue", "exit"): 0.215,
    ("catalogue", "surface"): 0.108,
    ("exact", "path"): 0.061,
    ("exact", "entry"): 0.079,
    ("exact", "plateau"): 0.057,
    ("exact", "exit"): 0.101,
    ("exact", "surface"): 0.025,
}


@pytest.fixture(scope="module")
def variants(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Figures before and after, for a planner that knows the cell file and for one that knows the cell."""
    folder = tmp_path_factory.mktemp("goals")
    examples.write(folder / "cell.toml")
    found = prove.run(folder / "part.ngc", folder / "cell.toml", folder / "out", seeds=[1], exact=True, workers=1)
    return {item["truth_level"]: item["variants"] for item in found["seeds"]}


def test_there_is_an_error_to_take_away(variants: dict[str, Any]) -> None:
    for level in ("catalogue", "exact"):
        assert variants[level]["nominal"]["path"]["p997_mm"] == pytest.approx(1.51, abs=0.02)


@pytest.mark.parametrize(("level", "part"), sorted(GOALS))
def test_what_remains_is_what_is_published(level: str, part: str, variants: dict[str, Any]) -> None:
    before, after = (variants[level][name][part]["p997_mm"] for name in ("nominal", "compensated"))
    assert after / before < 1.1 * GOALS[level, part]
