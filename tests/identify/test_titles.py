"""One title for every recipe: in the help, in the results, over the report, in the documentation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from counterflex.cli.commands import identify
from counterflex.identify.recipes import RECIPES, own_title

DOCS = Path(__file__).resolve().parents[2] / "docs"
ROW = re.compile(r"^\| \[`([a-z-]+)`\]\((identify/[a-z-]+\.md)\) \| (.*?) \| (.*?) \|$", re.MULTILINE)


@pytest.mark.parametrize("name", sorted(RECIPES.own))
def test_a_recipe_has_one_title(name: str) -> None:
    """Ten of ten had drifted apart: help, report and page said different things of the same recipe."""
    rows = {row[1]: row for row in ROW.finditer((DOCS / "identify.md").read_text(encoding="utf-8"))}
    title = RECIPES[name].title
    assert title == own_title(name)
    assert f"{rows[name][3]}, from {rows[name][4]}" == title
    assert f"`{name}`: {title}" in identify._LIST
    page = (DOCS / rows[name][2]).read_text(encoding="utf-8")
    assert page.startswith(f"# {name.capitalize().replace('-', ' ')}")  # the page is the recipe's
