"""Write the pages docs/statements/LANGUAGE.md from the tables that drive the readers, and print their coverage.

Usage: python tools/statement_tables.py [--check]. With --check nothing is written; exit 1 if a page is not up to date.
"""

from __future__ import annotations

import sys
from pathlib import Path

from counterflex.programs.reading import statement_tables
from counterflex.programs.statement_table import StatementTable, Treatment

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "statements"


def page(table: StatementTable) -> str:
    """Return the page of a language."""
    return (
        f"# Statements: {table.language}\n\nAll statements of {table.source}, and what the reader does with each. It "
        "refuses a statement that is not listed.\n"
        f"Evaluated or neutral: {table.read_share:.0%} of {len(table.rows)}.\n\n{table.markdown()}"
    )


def index(tables: dict[str, StatementTable]) -> str:
    """Return the page that lists the languages."""
    rows = "".join(f"| [{name}]({name}.md) | {counts(table)} |\n" for name, table in sorted(tables.items()))
    toc = "```{toctree}\n:hidden:\n\n" + "\n".join(sorted(tables)) + "\n```\n"
    return (
        "# Statements of each language\n\nA reader evaluates a statement, passes it as neutral to motion, or refuses "
        "it.\nPrinted by `python tools/statement_tables.py`.\n\n"
        "| language | statements | evaluated | neutral | refused | read |\n|---|---|---|---|---|---|\n"
        f"{rows}\n{toc}"
    )


def counts(table: StatementTable) -> str:
    """Return the number of statements, by treatment, as cells of a table."""
    numbers = [len(table.rows), *(len(table.of(treatment)) for treatment in Treatment)]
    return " | ".join([*map(str, numbers), f"{table.read_share:.0%}"])


def pages() -> dict[Path, str]:
    """Return the text of each page by its path."""
    tables = statement_tables()
    texts = {FOLDER / f"{name}.md": page(table) for name, table in tables.items()}
    return texts | {FOLDER / "index.md": index(tables)}


def main() -> int:
    """Write or check the pages."""
    stale = [path for path, text in pages().items() if not path.is_file() or path.read_text() != text]
    if "--check" in sys.argv:
        print("\n".join(f"{path} is not up to date: python tools/statement_tables.py" for path in stale))
        return 1 if stale else 0
    FOLDER.mkdir(exist_ok=True)
    for path, text in pages().items():
        path.write_text(text)
    for name, table in sorted(statement_tables().items()):
        print(f"{name}: {counts(table)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
