"""The pages docs/papers are what the program writes; the tables render."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from counterflex_lab.reproduce.papers import pages, table
from counterflex_lab.reproduce.papers.printed_page import printed_page
from counterflex_lab.reproduce.papers.read import PAPERS, paper
from counterflex_lab.reproduce.papers.row import VERDICTS

DOCS = Path(__file__).parents[2] / "docs" / "papers"
HINT = "python tools/refresh_papers.py writes the pages anew"
_PIXEL = 1.0


@pytest.fixture(scope="module")
def made() -> tuple[dict[str, Any], dict[str, str]]:
    summary, results = table.computed(PAPERS)
    return summary, table.files(summary, results)


@pytest.mark.long
def test_the_pages_are_what_the_program_writes(made: tuple[dict[str, Any], dict[str, str]]) -> None:
    _, texts = made
    assert {file.name for file in DOCS.iterdir()} == set(texts), HINT
    for name, text in texts.items():
        committed = (DOCS / name).read_text(encoding="utf-8")
        if name.endswith(".md"):
            assert committed == text, f"{name}: {HINT}"
        else:
            _assert_same_picture(name, committed, text)


def _assert_same_picture(name: str, committed: str, text: str) -> None:
    """Equal but for a pixel: the last digits of a curve depend on the computer."""
    number = re.compile(r"-?\d+\.?\d*")
    assert number.sub("#", committed) == number.sub("#", text), f"{name}: {HINT}"
    pairs = zip(number.findall(committed), number.findall(text), strict=True)
    assert all(abs(float(a) - float(b)) <= _PIXEL for a, b in pairs), f"{name}: {HINT}"


def test_the_table_has_enough_rows_and_every_verdict_its_reason(made: tuple[dict[str, Any], dict[str, str]]) -> None:
    summary, texts = made
    rows = summary["figures"]
    assert len(rows) >= 25
    assert sum(summary["counts"].values()) == len(rows)
    for row in rows:
        assert row["verdict"] in VERDICTS
        assert row["rule"] or row["verdict"] == "cannot be checked", row["name"]
        assert row["reason"] or row["verdict"] == "reproduced", row["name"]
        assert (row["ours"] is None) == (row["verdict"] == "cannot be checked"), row["name"]
    for name in PAPERS:
        counts = summary["by_paper"][name]
        assert texts[f"{name}.md"].count("| **differs** |") == counts.get("differs", 0)
        assert texts[f"{name}.md"].count("| reproduced |") == counts.get("reproduced", 0)
        assert (
            len({len(line.split(" | ")) for line in texts[f"{name}.md"].splitlines() if line.startswith("| eq.")}) == 1
        )


def test_links_and_pictures_of_the_pages_are_there(made: tuple[dict[str, Any], dict[str, str]]) -> None:
    _, texts = made
    for name, text in texts.items():
        for target in re.findall(r"\]\(([^)#]+)(?:#[\w-]+)?\)", text) if name.endswith(".md") else ():
            assert (DOCS / target).resolve().is_file() or target in texts, f"{name}: {target}"


def test_cells_and_page_of_a_row(made: tuple[dict[str, Any], dict[str, str]]) -> None:
    summary, _ = made
    rows = {(row["paper"], row["name"]): row for row in summary["figures"]}
    assert table.cells(rows["mandiola2023", "gain"])[2:6] == ["0.01 per cycle at 250 Hz", "2.5", "rad/s", "reproduced"]
    assert len(table.cells(rows["denkena2015", "column_tilt"])) == len(table.COLUMNS)
    html = printed_page(summary, {name: paper(name).title for name in PAPERS})
    assert html.count("<tr>") >= len(rows)


@pytest.mark.parametrize(("value", "text"), [(None, "-"), (0.0, "0"), (17000.4, "17000"), (0.0123456, "0.0123")])
def test_numbers_as_shown(value: float | None, text: str) -> None:
    assert pages.shown(value) == text
