"""Every example is named on the page of the examples or one that uses it, and every name on the former is a file.

Scripts of the gallery have pages of their own (``tests/tools/test_gallery.py``).
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
PAGE = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
NAMES = {name for quoted in re.findall(r"`([^`\n]+)`", PAGE) for name in (quoted, quoted.rstrip("/").split("/")[-1])}
PATHS = {
    path
    for page in (ROOT / "docs").rglob("*.md")
    for path in re.findall(r"examples/([\w./-]+)", page.read_text(encoding="utf-8"))
}
FILES = sorted(
    file
    for file in EXAMPLES.rglob("*")
    if file.is_file() and not {"__pycache__", "gallery"} & set(file.relative_to(EXAMPLES).parts)
)


def _named(file: Path) -> bool:
    """By its own name; a folder that tells about its files itself (SOURCE.txt, README.md) is named as a whole."""
    explained = any((file.parent / about).is_file() for about in ("SOURCE.txt", "README.md"))
    return str(file.relative_to(EXAMPLES)) in PATHS or (file.parent if explained else file).name in NAMES


def test_every_example_is_named_on_a_page() -> None:
    assert [str(file.relative_to(EXAMPLES)) for file in FILES if not _named(file)] == []


def test_every_name_on_the_page_is_an_example() -> None:
    there = {file.name for file in FILES}
    rows = [line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `")]
    named = {name.split("/")[-1] for row in rows for name in re.findall(r"`([^`]+\.\w+)`", row)}
    assert named
    assert named <= there


def test_the_smallest_cell_stands_on_the_page_of_the_cell_file() -> None:
    page = (ROOT / "docs" / "cell-file.md").read_text(encoding="utf-8")
    cell = (EXAMPLES / "cells" / "smallest.toml").read_text(encoding="utf-8")
    assert f"```toml\n{cell}```" in page
