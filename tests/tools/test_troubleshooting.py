"""Texts quoted on the page of troubleshooting are printed by the program; exit statuses are those of the loop."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from counterflex.runtime.state.states import Cause

CAUSES = {cause.name.lower().replace("_", " ") for cause in Cause}
"""As the status line, `log show` and the panel write them."""
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
SYMPTOMS = [line.split(" | ")[0].removeprefix("| ") for line in PAGE.splitlines() if line.startswith("| ")]


@cache
def _source() -> str:
    files = [file for ending in ("*.py", "*.js") for file in (ROOT / "src").rglob(ending)]
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


@pytest.mark.parametrize("text", sorted({q for symptom in SYMPTOMS for q in re.findall(r"`([^`]+)`", symptom)}))
def test_quoted_texts_are_in_the_program(text: str) -> None:
    assert text in CAUSES or text in _source()


def test_exit_statuses_are_explained_on_the_page_of_the_loop() -> None:
    online = (ROOT / "docs" / "online.md").read_text(encoding="utf-8")
    table = online.split("## Exit status of run")[1].split("\n## ")[0]
    statuses = re.findall(r"exit status (\d+)", " ".join(SYMPTOMS))
    assert statuses
    assert all(f"| {status} |" in table for status in statuses)
