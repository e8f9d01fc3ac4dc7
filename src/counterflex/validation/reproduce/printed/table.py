"""The table of a paper's figures, or of all four papers; summary, page and text for the documentation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.core import atomic
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex.report.printed_page import printed_page
from counterflex.validation.reproduce import haehn, holder, mandiola
from counterflex.validation.reproduce.printed import berger2013, denkena2015, haehn2020, mandiola2023
from counterflex.validation.reproduce.printed.row import PAPERS, Printed

COLUMNS: Final = ("place", "figure", "printed", "ours", "unit", "verdict", "because")
TITLES: Final = {
    "denkena2015": "Denkena and Lepper 2015, Procedia CIRP 35",
    "haehn2020": "Haehn and Weigold 2020, Production Engineering 14",
    "berger2013": "Berger, Halbauer, Lehmann, Euhus and Staedter 2013, ZWF 108",
    "mandiola2023": "Mandiola and others 2023",
}
RUNS: Final = ("denkena2015", "haehn2020", "mandiola2023")
"""Papers whose experiment is repeated in the simulated cell."""


def rows_of(paper: str, runs: Mapping[str, Mapping[str, Any]]) -> list[Printed]:
    """The figures of a paper.

    Args:
        paper: One of :data:`PAPERS`.
        runs: Summaries of repeated experiments, by paper, where there are any.
    """
    if paper == "denkena2015":
        return denkena2015.rows(runs.get(paper))
    if paper == "berger2013":
        return berger2013.rows()
    if paper == "haehn2020":
        return haehn2020.rows(runs.get(paper))
    return mandiola2023.rows(runs.get(paper))


def run(
    papers: Sequence[str],
    out: str | Path | None,
    *,
    repeat: bool = False,
    quick: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Compute the table; repeat the experiments first where that is asked for.

    Args:
        papers: Some of :data:`PAPERS`.
        out: Folder; ``summary.json``, ``report.html`` and ``figures.md``, and a folder of each experiment. None writes
            nothing, and repeats nothing.
        repeat: Repeat the experiments of :data:`RUNS`, or go on with those of ``out``.
        quick: Repeat them as briefly as they can be.
        workers: Runs at a time; None is one per core.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary: ``figures``, ``counts`` by verdict, and by paper.
    """
    runs: dict[str, Mapping[str, Any]] = {}
    repeated = [paper for paper in papers if repeat and out is not None and paper in RUNS]
    parts = in_parts(progress, {**dict.fromkeys(repeated, 20.0), "table": 1.0})
    for paper in repeated:
        folder = Path(str(out)) / paper
        if paper == "haehn2020":
            runs[paper] = haehn.run(folder, quick=quick, workers=workers, progress=parts[paper])
        elif paper == "denkena2015":
            runs[paper] = holder.run(folder, quick=quick, workers=workers, progress=parts[paper])
        else:
            runs[paper] = mandiola.run(folder, quick=quick, workers=workers, progress=parts[paper])
    rows = [row for paper in papers for row in rows_of(paper, runs)]
    summary = {
        "figures": [row.plain() for row in rows],
        "counts": dict(Counter(row.verdict for row in rows)),
        "by_paper": {paper: dict(Counter(row.verdict for row in rows if row.paper == paper)) for paper in papers},
        "repeated": "briefly" if runs and quick else "as printed" if runs else "not",
        "counterflex": __version__,
    }
    parts["table"](1.0)
    if out is not None:
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        write_summary(folder / "summary.json", summary)
        atomic.write_text(folder / "figures.md", markdown(summary))
        write_page(printed_page(summary, TITLES), folder / "report.html")
    return summary


def cells(row: Mapping[str, Any]) -> list[str]:
    """A figure as printed in a table, see :data:`COLUMNS`."""
    ours = "-" if row["ours"] is None else f"{row['ours']:.3g}" if abs(row["ours"]) < 1000 else f"{row['ours']:.0f}"
    return [row["place"], row["what"], row["printed"], ours, row["unit"], row["verdict"], row["reason"]]


def markdown(summary: Mapping[str, Any]) -> str:
    """The tables as text for the documentation."""
    lines = []
    for paper in PAPERS:
        own = [row for row in summary["figures"] if row["paper"] == paper]
        if own:
            lines += [f"## {TITLES[paper]}", "", f"| {' | '.join(COLUMNS)} |", f"|{'---|' * len(COLUMNS)}"]
            lines += [f"| {' | '.join(cells(row))} |" for row in own]
            assumed = sorted({row["assumed"] for row in own if row["assumed"]})
            lines += [
                "",
                "Assumed, because the paper does not say it: " + "; ".join(assumed) + "." if assumed else "",
                "",
            ]
    return "\n".join(lines)
