"""Write the pages docs/papers, after storing results of experiments that were run again.

counterflex reproduce all --long --out out/papers
python tools/refresh_papers.py out/papers

Without a folder only the pages are written, from what is stored. `tests/lab/test_papers_pages.py` fails where
the pages are not what the program writes. Of `benchmarks/plan_wall.py` the results in `benchmarks/results` are taken.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.core import atomic
from counterflex_lab.reproduce.papers import table
from counterflex_lab.reproduce.papers.experiments import EXPERIMENTS
from counterflex_lab.reproduce.papers.long_runs import RESULT, text_of
from counterflex_lab.reproduce.papers.read import PAPERS

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs" / "papers"
STORED = ROOT / "lab" / "counterflex_lab" / "reproduce" / "papers" / "stored"
WALLS = ROOT / "benchmarks" / "results" / "plan_wall.json"
CHOICES = ("as programmed", "strategy")


def described() -> str:
    """The version that results are stored with: the commit, marked where files have been changed since."""
    words = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--abbrev=8"]
    made = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    return f"{__version__}, commit {made or 'unknown'}"


def store(folder: Path) -> list[str]:
    """Store what was run in a folder; names of the experiments."""
    stored = []
    for name in EXPERIMENTS:
        file = folder / name / RESULT
        if file.is_file():
            data = {**json.loads(file.read_text(encoding="utf-8")), "version": described()}
            atomic.write_text(STORED / f"{name}.json", text_of(data))
            stored.append(name)
    return stored


def walls() -> dict[str, Any]:
    """Results of the benchmark of the finished wall, those that the rows read."""
    rows = json.loads(WALLS.read_text(encoding="utf-8"))
    words = ["git", "-C", str(ROOT), "log", "-1", "--abbrev=8", "--format=%h", "--", str(WALLS)]
    made = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    return {
        "command": "python benchmarks/plan_wall.py",
        "cells": "truth seeds 1001 to 1005 of the family wide, catalogue",
        "version": f"{__version__}, commit {made or 'unknown'}",
        "results": {"rows": [row for row in rows if row["choice"] in CHOICES and not row["compensated"]]},
    }


def main(folders: list[str]) -> int:
    """Store and write; no folder writes the pages only."""
    for folder in folders:
        print(f"stored: {', '.join(store(Path(folder))) or 'nothing'}")
    if folders:
        atomic.write_text(STORED / "strategy.json", text_of(walls()))
    PAGES.mkdir(exist_ok=True)
    texts = table.files(*table.computed(PAPERS))
    for name, text in texts.items():
        atomic.write_text(PAGES / name, text)
    for old in PAGES.iterdir():
        if old.name not in texts:
            print(f"not written any more: {old.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
