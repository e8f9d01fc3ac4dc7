"""Constants and growth from runs of the simulated cell over sockets: a pair on one truth, a new tool and a worn one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import production as benchmark

SEED = 1


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the benchmark makes of one seed of a short program."""
    folder: Path = tmp_path_factory.mktemp("twin") / "cell"
    return benchmark.one(SEED, "mild", folder, benchmark.SHORT)


@pytest.mark.long
def test_constants_of_the_truth_are_within_their_interval(row: dict[str, Any]) -> None:
    """The truth has ploughing that the law of the cell lacks; compared is its specific force at their thickness."""
    for name in ("kc", "kr", "ka"):
        assert abs(row[f"{name}_percent"]) < 2.0 * row[f"{name}_sigma_percent"]
    assert row["kr_sigma_percent"] < 10.0
    assert abs(row["kr_percent"]) < 0.6 * abs(row["kr_before_percent"])
    assert row["holdout_percent"] < 0.6 * row["holdout_before_percent"]


@pytest.mark.long
def test_the_worn_tool_shows_its_growth(row: dict[str, Any]) -> None:
    """The same seed twice, forces 20 % larger in the second run."""
    growth, sigma = row["growth_percent"], row["growth_sigma_percent"]
    assert abs(growth - 20.0) < 2.0 * sigma
    assert growth > 3.0 * sigma
