"""The table of a paper's figures, or of all four papers: ours, verdicts, and the files that show them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex_lab.reproduce.papers import berger2013, denkena2015, haehn2020, mandiola2023, pages
from counterflex_lab.reproduce.papers.pictures import PICTURES, Results
from counterflex_lab.reproduce.papers.printed_page import printed_page
from counterflex_lab.reproduce.papers.read import PAPERS, Paper, paper, stored
from counterflex_lab.reproduce.papers.row import Row
from counterflex_lab.reproduce.papers.still import svg

COLUMNS: Final = ("place", "figure", "printed", "ours", "unit", "verdict", "because")
_MODULES: Final = {
    "denkena2015": denkena2015,
    "haehn2020": haehn2020,
    "berger2013": berger2013,
    "mandiola2023": mandiola2023,
}
NOT_STORED: Final = "no results of this experiment are stored; run with --long"
_NOISE: Final = 1e-9
"""Below this a value is one of rounding, and differs from computer to computer."""


def functions(name: str) -> tuple[Mapping[str, Callable[[], float]], Mapping[str, Callable[..., float | None]]]:
    """Functions that compute ours of a paper: at once, and from the results of an experiment, by name of the row."""
    module = _MODULES[name]
    return module.OURS, module.MEASURED


def ours(name: str, row: Row, results: Results) -> float | None:
    """Ours; None where it cannot be computed, or where the results of the experiment are missing."""
    at_once, measured = functions(name)
    if row.rule is None:
        return None
    if not row.stored:
        return at_once[row.name]()
    return measured[row.name](results[row.stored]) if row.stored in results else None


def run(
    papers: Sequence[str],
    out: str | Path | None = None,
    *,
    long: bool = False,
    seeds: Sequence[int] = (1001, 1002, 1003),
    level: str = "identified",
    quick: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Compute the table; run the experiments first where that is asked for.

    Args:
        papers: Some of :data:`~counterflex_lab.reproduce.papers.read.PAPERS`.
        out: Folder; ``summary.json``, ``report.html``, a page and pictures of each paper, and with ``long`` a folder of
            each experiment. None writes nothing.
        long: Run the experiments again, or go on with those of ``out``, instead of taking what was stored of them.
        seeds: Truth seeds of the experiments.
        level: ``identified`` or ``catalogue``: how well their loops know the cell.
        quick: Run them as briefly as they can be.
        workers: Runs at a time; None is one per core.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary: ``figures``, ``counts`` by verdict, ``by_paper``, ``experiments``.

    Raises:
        InputError: ``long`` without a folder.
        CounterflexError: As the experiments.
    """
    if long and out is None:
        raise InputError("experiments need a folder", where="--long", hint="Give --out DIR")
    chosen = [paper(name) for name in papers]
    parts = in_parts(progress, {"experiments": 50.0 if long else 1.0, "table": 4.0})
    experiments = None
    if long:
        from counterflex_lab.reproduce.papers.long_runs import run_again

        names = list(dict.fromkeys(name for item in chosen for name in item.experiments))
        experiments = run_again(names, Path(str(out)), papers, seeds, level, quick, workers, parts["experiments"])
    parts["experiments"](1.0)
    summary, results = computed(papers, experiments, progress=parts["table"])
    if out is not None:
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files(summary, results).items():
            atomic.write_text(folder / file, text)
        write_summary(folder / "summary.json", summary)
        write_page(printed_page(summary, {item.name: item.title for item in chosen}), folder / "report.html")
    progress(1.0, "done")
    return summary


def computed(
    papers: Sequence[str], experiments: Mapping[str, Mapping[str, Any]] | None = None, *, progress: Progress = silent
) -> tuple[dict[str, Any], Results]:
    """The summary of :func:`run`, and the results of the experiments by name.

    Args:
        papers: Some of :data:`~counterflex_lab.reproduce.papers.read.PAPERS`.
        experiments: Experiments that were run again; None takes what is stored.
        progress: Progress callback, fraction 0 to 1.
    """
    chosen = [paper(name) for name in papers]
    if experiments is None:
        names = dict.fromkeys(name for item in chosen for name in item.experiments)
        experiments = {name: data for name in names if (data := stored(name)) is not None}
    results: Results = {name: data["results"] for name, data in experiments.items()}
    summary = _summary(chosen, results, progress)
    summary["experiments"] = {
        name: {key: value for key, value in data.items() if key != "results"} for name, data in experiments.items()
    }
    return summary, results


def _summary(papers: Sequence[Paper], results: Results, progress: Progress) -> dict[str, Any]:
    rows = [(item, row) for item in papers for row in item.rows]
    figures = []
    for k, (item, row) in enumerate(rows):
        progress(k / len(rows), f"{item.name}: {row.name}")
        figures.append(figure(item, row, ours(item.name, row, results)))
    return {
        "figures": figures,
        "counts": dict(Counter(row["verdict"] for row in figures)),
        "by_paper": {
            item.name: dict(Counter(row["verdict"] for row in figures if row["paper"] == item.name)) for item in papers
        },
        "counterflex": __version__,
    }


def figure(item: Paper, row: Row, value: float | None) -> dict[str, Any]:
    """A row with ours, as plain values.

    Args:
        item: Its paper.
        row: The row.
        value: Ours.
    """
    verdict = row.verdict(value)
    reason = row.reason
    if verdict == "reproduced":
        reason = row.note
    elif row.rule is not None and value is None:
        reason = NOT_STORED
    limits = () if row.rule is None else (row.rule.least, row.rule.most)
    least, most = (None if abs(v) == float("inf") else float(f"{v:.6g}") for v in limits) if limits else (None, None)
    return {
        "paper": item.name,
        "name": row.name,
        "place": row.place,
        "what": row.what,
        "unit": row.unit,
        "printed": row.printed,
        "ours": None if value is None else 0.0 if abs(value) < _NOISE else float(f"{value:.4g}"),
        "least": least,
        "most": most,
        "rule": "" if row.rule is None else row.rule.text,
        "verdict": verdict,
        "reason": reason,
        "assumed": list(row.assumed),
        "stored": row.stored,
    }


def files(summary: Mapping[str, Any], results: Results) -> dict[str, str]:
    """Page and pictures of each paper, and with all of them a page over all: texts by file name.

    Args:
        summary: Of :func:`run`.
        results: Of the experiments, by name.
    """
    out = {}
    for name in summary["by_paper"]:
        stills = PICTURES[name](results)
        out[f"{name}.md"] = pages.page(paper(name), summary, stills)
        out |= {f"{still.name}.svg": svg(still) for still in stills}
    if set(summary["by_paper"]) == set(PAPERS):
        out["index.md"] = pages.overview([paper(name) for name in PAPERS], summary)
    return out


def title(name: str) -> str:
    """Title of a paper."""
    return paper(name).title


def assumed(name: str) -> list[str]:
    """Assumptions that a paper leaves open."""
    return list(paper(name).assumptions.values())


def cells(row: Mapping[str, Any]) -> list[str]:
    """A figure as printed in a table, see :data:`COLUMNS`."""
    because = row["rule"] if row["verdict"] == "reproduced" else row["reason"]
    return [row["place"], row["what"], row["printed"], pages.shown(row["ours"]), row["unit"], row["verdict"], because]
