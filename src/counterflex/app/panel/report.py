"""The report of a run that has ended: how it ended, figures, incidents, what the operators did."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any, Final

from counterflex.app.run.recorder import SUMMARY
from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.core.printable import printable

_SHOWN: Final = 50


def read_run(folder: Path) -> dict[str, Any]:
    """Summary of the last run of a folder; empty where there is none that can be read."""
    try:
        content = file_content.json_value(folder / SUMMARY)
    except FileFormatError:
        return {}
    return content if isinstance(content, dict) and content.get("job") == "run" else {}


def report_html(folder: Path) -> str:
    """The report of the last run of a folder; empty where it is not written yet."""
    run = read_run(folder)
    if not run:
        return ""
    ended = run.get("ended", {})
    reply = run.get("compute_us", {})
    figures = [
        ("ended", ended.get("said", run.get("loop_ended", ""))),
        ("cell", run.get("cell", "")),
        ("cycles", run.get("cycles", "")),
        ("time, s", run.get("seconds", "")),
        ("largest correction, µm", run.get("largest_correction_um", "")),
        ("answer, µm: p50, p99, p99.9, max".replace("µm", "µs"), ", ".join(str(v) for v in reply.values())),
        ("records lost", run.get("records_lost", "")),
        ("states, cycles", ", ".join(f"{_words(k)} {v}" for k, v in run.get("states", {}).items())),
        ("causes", ", ".join(_words(cause) for cause in run.get("causes", [])) or "none"),
        ("log", str(folder)),
    ]
    parts = ["<h2>Report of the run</h2>", _table((), figures)]
    incidents = [
        (one.get("number", ""), _words(one.get("state", "")), _words(one.get("cause", "")), one.get("time_s", ""))
        for one in run.get("incidents", [])[:_SHOWN]
    ]
    if incidents:
        parts += ["<h2>Holds and faults</h2>", _table(("number", "state", "cause", "time, s"), incidents)]
    actions = [
        (
            one.get("who", ""),
            one.get("from", ""),
            one.get("action", ""),
            "done" if one.get("done") else one.get("refused"),
        )
        for one in run.get("operator_actions", [])[-_SHOWN:]
    ]
    if actions:
        parts += ["<h2>Operators</h2>", _table(("who", "from", "action", "outcome"), actions)]
    return "".join(parts)


def _table(heads: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    head = "".join(f"<th>{escape(one)}</th>" for one in heads)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(printable(str(cell)))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table>{f'<tr>{head}</tr>' if head else ''}{body}</table>"


def _words(name: object) -> str:
    return str(name).replace("_", " ")
