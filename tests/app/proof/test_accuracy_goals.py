"""The figures that are published are those that this program makes: one seed of them is machined anew.

A planner that became worse fails here, and so does one that became better without its figures being made anew
(`tools/refresh_figures.py`).
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from counterflex.app import examples
from counterflex.app.proof import prove
from counterflex.twin.truth.family import FAMILIES

ROOT = Path(__file__).parents[3]
PARTS = ("path", "entry", "exit", "surface")


def refresh_figures() -> ModuleType:
    spec = importlib.util.spec_from_file_location("refresh_figures", ROOT / "tools" / "refresh_figures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((ROOT / "benchmarks" / "results" / "readme.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def fresh(stored: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The first seed again, for a planner that knows the cell file and for one that knows the cell."""
    folder = tmp_path_factory.mktemp("goals")
    examples.write(folder / "cell.toml")
    seed, family = stored["seeds"][0]["seed"], FAMILIES[stored["family"]]
    found = prove.run(
        folder / "part.ngc", folder / "cell.toml", folder / "out", seeds=[seed], family=family, exact=True, workers=1
    )
    return {item["truth_level"]: item for item in found["seeds"]}


@pytest.mark.long
@pytest.mark.parametrize("level", ["catalogue", "exact"])
@pytest.mark.parametrize("part", PARTS)
def test_what_is_published_is_what_a_fresh_run_leaves(
    level: str, part: str, stored: dict[str, Any], fresh: dict[str, Any]
) -> None:
    seed = stored["seeds"][0]["seed"]
    published = next(row for row in stored["seeds"] if (row["seed"], row["truth_level"]) == (seed, level))
    for variant in ("nominal", "compensated"):
        before = published["variants"][variant][part]["p997_mm"]
        assert fresh[level]["variants"][variant][part]["p997_mm"] == pytest.approx(before, rel=0.03, abs=0.003)


@pytest.mark.long
def test_there_is_an_error_to_take_away(fresh: dict[str, Any]) -> None:
    for item in fresh.values():
        assert item["variants"]["nominal"]["path"]["p997_mm"] > 0.3


def test_the_readme_shows_what_is_stored(stored: dict[str, Any]) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert refresh_figures().with_block(text, stored) == text


def test_what_is_published_is_identified_on_reporting_seeds(stored: dict[str, Any]) -> None:
    levels = stored["over_seeds"]
    assert set(levels) == {"identified", "catalogue", "exact"}
    assert min(row["seed"] for row in stored["seeds"]) > 1000
    assert (
        levels["identified"]["path"]["p997"]["median_remaining"]
        < 0.5 * (levels["catalogue"]["path"]["p997"]["median_remaining"])
    )
