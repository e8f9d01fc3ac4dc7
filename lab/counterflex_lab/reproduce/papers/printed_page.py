"""The page of figures that papers print beside ours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from counterflex.report.data import Head
from counterflex.report.page import render

_COLOURS: Final = {"reproduced": "#15803d", "differs": "#b45309", "cannot be checked": "#64748b"}


def printed_page(summary: Mapping[str, Any], titles: Mapping[str, str]) -> str:
    """The page, as HTML text."""
    papers, figures = [], {}
    for paper in summary["by_paper"]:
        own = [row for row in summary["figures"] if row["paper"] == paper]
        drawn = [row for row in own if _share(row) is not None]
        if drawn:
            figures[f"bands_{paper}"] = _bands(drawn)
        papers.append({"name": paper, "title": titles[paper], "rows": own, "drawn": bool(drawn)})
    counts = summary["counts"]
    verdict = f"{len(summary['figures'])} figures: " + ", ".join(f"{n} {name}" for name, n in counts.items()) + "."
    head = Head("Figures of the papers beside ours", ", ".join(summary["by_paper"]))
    return render(
        "printed.html.j2",
        figures,
        [],
        package="counterflex_lab.reproduce",
        data=head,
        papers=papers,
        verdict=verdict,
        colours=_COLOURS,
    )


def _share(row: Mapping[str, Any]) -> float | None:
    """Return where ours lies in the band, 0 at its lower and 1 at its upper end."""
    least, most, ours = row["least"], row["most"], row["ours"]
    if ours is None or least is None or most is None or not most > least:
        return None
    share: float = (ours - least) / (most - least)
    return share


def _bands(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    names = [f"{row['what']} " for row in rows]
    shares = [min(3.0, max(-2.0, _share(row) or 0.0)) for row in rows]
    text = [f"printed {row['printed']}, ours {row['ours']:.4g} {row['unit']}" for row in rows]
    data = {
        "type": "scatter", "mode": "markers", "x": shares, "y": names, "text": text, "hoverinfo": "text",
        "marker": {"size": 11, "color": [_COLOURS[row["verdict"]] for row in rows]},
    }  # fmt: skip
    layout = {
        "height": 90 + 26 * math.ceil(len(rows)),
        "margin": {"l": 12, "r": 12, "t": 8, "b": 44},
        "showlegend": False,
        "xaxis": {
            "title": {"text": "ours against what counts as reproduced; farther out is drawn at the edge"},
            "range": [-2.1, 3.1],
            "tickvals": [0, 1],
            "ticktext": ["least", "most"],
            "zeroline": False,
        },
        "yaxis": {"automargin": True, "autorange": "reversed"},
        "shapes": [
            {"type": "rect", "xref": "x", "yref": "paper", "x0": 0, "x1": 1, "y0": 0, "y1": 1, "line": {"width": 0},
             "fillcolor": "rgba(21,128,61,0.12)"},
        ],
    }  # fmt: skip
    return {"data": [data], "layout": layout}
