"""Tables of what the other side of a protocol must do: every row names a test that is there, and real scenarios."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("rsi.md", "egm.md", "wrench.md", "tracker.md", "howto/twincat-ads.md", "panel.md")
HEADER = "| obligation | what happens otherwise | guarded by |"
SCENARIOS = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")


def _rows(page: str) -> list[list[str]]:
    lines = [line.strip() for line in (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()]
    begin = lines.index(HEADER) + 2
    end = next(k for k in range(begin, len(lines)) if not lines[k].startswith("|"))
    return [line.strip("|").split(" | ") for line in lines[begin:end]]


@pytest.mark.parametrize("page", PAGES)
def test_every_obligation_names_a_test_that_is_there(page: str) -> None:
    rows = _rows(page)
    assert len(rows) >= 5
    for row in rows:
        assert len(row) == 3, row[0]
        tests = re.findall(r"`(tests/[^`]+)`", row[2])
        assert tests or "not guarded" in row[2], row[0]
        for name in tests:
            file, _, function = name.partition("::")
            assert (ROOT / file).is_file(), name
            assert not function or f"def {function}(" in (ROOT / file).read_text(encoding="utf-8"), name


@pytest.mark.parametrize("page", PAGES)
def test_every_fault_scenario_that_is_named_is_one(page: str) -> None:
    for row in _rows(page):
        for first, last in re.findall(r"\bR(\d+)(?: to R(\d+))?", row[2]):
            for number in range(int(first), int(last or first) + 1):
                assert f"| R{number} " in SCENARIOS, row[2]
