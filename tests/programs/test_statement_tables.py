"""Tables of statements: complete rows, unique words, pages of the documentation that print them."""

from __future__ import annotations

import runpy
from collections import Counter
from pathlib import Path

import pytest

from counterflex.programs.reading import statement_tables
from counterflex.programs.statement_table import Statement, StatementTable, Treatment

TOOL = Path(__file__).parents[2] / "tools" / "statement_tables.py"


@pytest.mark.parametrize("language", sorted(statement_tables()))
def test_rows_are_complete(language: str) -> None:
    table = statement_tables()[language]
    assert table.language == language
    twice = [word for word, times in Counter(row.word.upper() for row in table.rows).items() if times > 1]
    assert not twice
    for row in table.rows:
        assert row.reason, row.word
        assert bool(row.remedy) == (row.treatment is Treatment.REFUSED), row.word
        assert row.samples, row.word


def test_pages_print_the_tables() -> None:
    pages = runpy.run_path(str(TOOL))["pages"]()
    assert not [path.name for path, text in pages.items() if path.read_text() != text]


def test_a_table_finds_its_rows_and_counts_them() -> None:
    row = Statement("WaitTime", Treatment.EVALUATED, "dwell", samples=("WaitTime 1;",))
    table = StatementTable("x", "a manual", (row, Statement("Stop|Go", Treatment.REFUSED, "why", "post it", ("a",))))
    assert table.find("WAITTIME") is row
    assert table.find("nothing") is None
    assert table.read_share == 0.5
    assert "`Stop\\|Go`" in table.markdown()
