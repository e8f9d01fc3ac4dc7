"""What the table of CONTRIBUTING.md names is there; the contract of the recipes names every recipe."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ROOT / "src" / "counterflex"


def faults(rows: list[str]) -> list[str]:
    """What of the rows is not there.

    A code span with a slash is a path below the repository or src/counterflex, ``<maker>`` any folder; a bare file name
    stands at the top or in the folder of a path before it; any other word stands in a file of the row.
    """
    found = []
    for row in rows:
        folders: list[Path] = []
        texts: list[str] = []
        words = []
        for span in re.findall(r"`([^`]+)`", row):
            if "/" not in span and not re.fullmatch(r"[\w*]+\.(py|toml|csv|md)", span):
                words.append(span)
                continue
            places = [ROOT, ROOMS] if "/" in span else [ROOT, *folders]
            there = [file for place in places for file in place.glob(re.sub(r"<\w+>", "*", span.rstrip("/")))]
            folders += [file if file.is_dir() else file.parent for file in there]
            texts += [file.read_text(encoding="utf-8") for file in there if file.is_file()]
            found += [] if there else [span]
        found += [word for word in words if not any(word in text for text in texts)]
    return found


def table() -> list[str]:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    part = page.split("## Where do I change ...")[1].split("\nImports point down")[0]
    return [line for line in part.splitlines() if line.startswith("| ")][1:]


def test_everything_the_table_names_is_there() -> None:
    rows = table()
    assert len(rows) > 20
    assert faults(rows) == []


@pytest.mark.parametrize("span", ["core/nowhere.py", "nowhere.py", "NOWHERE"])
def test_what_is_not_there_is_found(span: str) -> None:
    assert faults([f"| a unit | `core/units.py`, `{span}` |"]) == [span]


def test_every_recipe_is_kept_from_the_others() -> None:
    """Layers of one line do not import one another; an exhaustive contract refuses a folder that it does not name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (contract,) = (c for c in contracts if c.get("containers") == ["counterflex.identify"])
    assert contract["exhaustive"] is True
    recipes = {file.parent.name for file in ROOMS.glob("identify/*/recipe.py")}
    (apart,) = (layer.split(" | ") for layer in contract["layers"] if "servo" in layer)  # it stands on timing and play
    assert " | ".join(sorted(recipes - set(apart))) in contract["layers"]
