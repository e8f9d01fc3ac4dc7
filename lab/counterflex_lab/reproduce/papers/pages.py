"""Pages of the papers as text: table, experiments, pictures, assumptions, what was left undone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any, Final

from counterflex_lab.reproduce.papers.read import Paper
from counterflex_lab.reproduce.papers.row import VERDICTS
from counterflex_lab.reproduce.papers.still import Still

_MARK: Final = "<!-- written by: counterflex reproduce all; do not edit -->"


def shown(value: float | None) -> str:
    """Ours with three digits."""
    if value is None:
        return "-"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"


def page(paper: Paper, summary: Mapping[str, Any], stills: Sequence[Still]) -> str:
    """The page of a paper.

    Args:
        paper: The paper.
        summary: With its figures.
        stills: Its pictures, in the same folder.
    """
    rows = [row for row in summary["figures"] if row["paper"] == paper.name]
    letters = {key: _letter(k) for k, key in enumerate(paper.assumptions)}
    lines = [
        _MARK,
        "",
        f"# {paper.title}",
        "",
        f"{paper.source}.",
        "",
        f"About: {paper.subject}.",
        "",
        f"{len(rows)} figures: {counted(summary['by_paper'][paper.name])}. What the verdicts mean: "
        "[figures of the papers](index.md).",
        "",
        "| where | figure | printed | ours | unit | verdict | rule | assumed |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [_line(row, letters) for row in rows]
    for verdict, title in (
        ("differs", "Why figures differ"),
        ("cannot be checked", "What cannot be checked"),
        ("reproduced", "Notes"),
    ):
        own = [row for row in rows if row["verdict"] == verdict and row["reason"]]
        if own:
            lines += ["", f"## {title}", ""]
            lines += [f"- {_upper(row['place'])}, {row['what']}: {row['reason']}." for row in own]
    lines += _experiments(paper, summary)
    if stills:
        lines += ["", "## Pictures", "", "All are ours; black is what the paper prints."]
        for still in stills:
            lines += ["", f"![{still.title}]({still.name}.svg)", "", still.caption]
    lines += ["", "## Assumed, because the paper does not say it", ""]
    lines += [f"- {letters[key]}: {text}." for key, text in paper.assumptions.items()]
    lines += ["", "## What the paper left undone", "", "| left undone | counterflex |", "|---|---|"]
    lines += [f"| {what} | {here} |" for what, here in paper.left_open]
    return "\n".join([*lines, ""])


def _line(row: Mapping[str, Any], letters: Mapping[str, str]) -> str:
    """Line of a figure in the table."""
    value = shown(row["ours"]) + (f" ({row['stored']})" if row["stored"] and row["ours"] is not None else "")
    marks = " ".join(letters[key] for key in row["assumed"])
    verdict = f"**{row['verdict']}**" if row["verdict"] == "differs" else row["verdict"]
    texts = (row["place"], row["what"], row["printed"], value, row["unit"], verdict, row["rule"], marks)
    return f"| {' | '.join(texts)} |"


def _experiments(paper: Paper, summary: Mapping[str, Any]) -> list[str]:
    if not paper.experiments:
        return []
    lines = ["", "## Experiments", "", "| name | what | stored results of | on | version |", "|---|---|---|---|---|"]
    for name, what in paper.experiments.items():
        data = summary["experiments"].get(name)
        if data is None:
            lines.append(f"| {name} | {what} | nothing stored | | |")
        else:
            lines.append(f"| {name} | {what} | `{data['command']}` | {data['cells']} | {data['version']} |")
    return lines


def overview(papers: Sequence[Paper], summary: Mapping[str, Any]) -> str:
    """The page over all papers.

    Args:
        papers: In order.
        summary: Of all of them.
    """
    lines = ["| paper | about | " + " | ".join(VERDICTS) + " |", "|---|---|" + "---|" * len(VERDICTS)]
    for paper in papers:
        counts = summary["by_paper"][paper.name]
        numbers = " | ".join(str(counts.get(verdict, 0)) for verdict in VERDICTS)
        lines.append(f"| [{paper.title}]({paper.name}.md) | {paper.subject} | {numbers} |")
    total = " | ".join(str(summary["counts"].get(verdict, 0)) for verdict in VERDICTS)
    lines.append(f"| all | {len(summary['figures'])} figures | {total} |")
    file = resources.files("counterflex_lab.reproduce.papers") / "data" / "overview.md"
    return file.read_text(encoding="utf-8").format(mark=_MARK, counts="\n".join(lines))


def counted(counts: Mapping[str, int]) -> str:
    """``3 reproduced, 1 differs``."""
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts.get(verdict))


def _letter(k: int) -> str:
    return chr(ord("A") + k)


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
