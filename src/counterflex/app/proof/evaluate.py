"""The job ``evaluate``: judge machined programs against the original one; summary and page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from counterflex.app.proof.judge import ProgramComparison
from counterflex.core import atomic
from counterflex.files.summary_file import write_summary


def run(folders: Sequence[str | Path], out: str | Path | None) -> dict[str, Any]:
    """Do the job on files.

    Writes ``summary.json`` and, for two runs, ``report.html`` into ``out``, where it is given.
    """
    comparison = ProgramComparison.of(folders)
    if out is not None:
        from counterflex.app.proof.report import comparison_page
        from counterflex.report.page import write_page

        with atomic.atomic_folder(out) as staging:
            write_summary(staging / "summary.json", comparison.summary)
            if len(comparison.judged) == 2:
                write_page(comparison_page(comparison), staging / "report.html")
    return comparison.summary
