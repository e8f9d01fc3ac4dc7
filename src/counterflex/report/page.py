"""Put the page together: figures, tables, one file, no request to anywhere."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final

import jinja2
import numpy as np
from markupsafe import Markup

from counterflex.core.atomic import write_text
from counterflex.core.errors import InputError
from counterflex.core.printable import printable
from counterflex.core.units import MM, MM_PER_MIN
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.summary import check_summary, seed_rows, table_rows
from counterflex.report.cell_figure import cell_figure
from counterflex.report.data import FeedData, Headline, PredictionData, ReportData
from counterflex.report.distribution_figure import budget_figure, histogram_figure
from counterflex.report.figure_data import (
    COLOUR_BLIND,
    METROLOGY,
    NOT_MACHINED,
    STEPS,
    edges_mm,
    numbers,
    scale_limit_mm,
    script_json,
    stepped,
)
from counterflex.report.glossary import GLOSSARY
from counterflex.report.map_figure import callouts, figure_3d, map_figure, map_picture
from counterflex.report.remaining_figure import remaining_figure, space_figure
from counterflex.report.series_figure import prediction_figure, prediction_map, series_figure, signed_figure

COLOURS: Final = ("#b91c1c", "#1d4ed8", "#15803d", "#b45309", "#7e22ce", "#0e7490", "#be185d", "#4d7c0f", "#334155")


def feed_figure(data: FeedData) -> dict[str, Any]:
    """Programmed feed as a grey line, the written one in the colour of the limit that binds, black where none does."""
    way = data.way_m
    feed = data.feed_m_s / MM_PER_MIN
    traces: list[dict[str, Any]] = [
        _line("programmed", way, np.where(np.isnan(feed), np.nan, data.programmed_m_s / MM_PER_MIN), "#94a3b8", "dot")
    ]
    binds = np.array(data.binds)
    colours = dict(zip(sorted(set(data.binds) - {""}), COLOURS * 3, strict=False))
    for name, colour in {"": "#0f172a", **colours}.items():
        own = binds == name
        shown = own | np.append(own[1:], False)  # a row is the end of its segment: its beginning belongs to it
        if own.any():
            traces.append(_line(name or "no limit binds", way, np.where(shown, feed, np.nan), colour, "solid"))
    layout = {
        "height": 300,
        "margin": {"l": 64, "r": 12, "t": 8, "b": 48},
        "legend": {"orientation": "h", "y": 1.12},
        "xaxis": {"title": {"text": "way along the program, m"}, "zeroline": False},
        "yaxis": {"title": {"text": "feed, mm/min"}, "rangemode": "tozero"},
    }
    return {"data": traces, "layout": layout}


def _line(name: str, way_m: Any, feed: Any, colour: str, dash: str) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": numbers(way_m, 4), "y": numbers(feed, 1),
        "line": {"color": colour, "dash": dash, "width": 1.5 if dash == "dot" else 2.5, "shape": "vh"},
        "connectgaps": False,
    }  # fmt: skip


_ROW_NAMES = {
    "path": "Path error, all cutting",
    "entry": "Path error, entries",
    "exit": "Path error, exits",
    "plateau": "Path error, between them",
    "air": "In the air (not counted)",
    "along": "Along the feed (not counted)",
    "surface": "Surface, floors and walls",
    "floor": "Surface, floors",
    "wall": "Surface, walls",
}

_FIGURES = {"max_mm": "max, mm", "p997_mm": "99.7 %, mm", "rms_mm": "rms, mm"}
"""Columns of the table of figures: name in the summary and heading."""


def report_page(data: ReportData) -> str:
    """The page that compares an uncompensated with a compensated machining, as HTML text.

    All headline figures and figure tables are read from ``data.summary``, so the page and ``summary.json`` cannot
    differ. Everything the page needs is inside it.

    Raises:
        FileFormatError: ``data.summary`` is no summary.
        InputError: It lacks the variants ``nominal`` and ``compensated``.
    """
    summary = check_summary(dict(data.summary))
    if not {"nominal", "compensated"} <= set(summary["variants"]):
        raise InputError("the report compares two variants", value=sorted(summary["variants"]))
    figures: dict[str, Any] = {
        "series": series_figure(data),
        "signed": signed_figure(data.nominal.deviation, data.compensated.deviation),
    }
    places: tuple[Any, ...] = ()
    scales: list[dict[str, Any]] = []
    surface, before, after = data.nominal_surface, data.nominal.surface, data.compensated.surface
    if surface is not None and before is not None and after is not None:
        scales = _scales(data, scale_limit_mm(max(before.surface.max_m, after.surface.max_m) / MM))
        limit = scales[0]["limit"]
        shown = (map_picture(surface, before), map_picture(surface, after))
        places = callouts(*shown)
        figures["map"] = map_figure(*shown, places, limit)
        figures["space_before"] = figure_3d(surface, before, limit)
        figures["space_after"] = figure_3d(surface, after, limit)
        figures["histogram"] = histogram_figure(surface, before, after, scales[-1]["limit"])
    if data.drawing is not None:
        figures["cell"] = cell_figure(data.drawing)
    if data.budget:
        figures["budget"] = budget_figure(data.budget)
    return render(
        "report.html.j2",
        figures,
        scales,
        data=data,
        summary=summary,
        expected=_headline(data.expected),
        cards=_cards(summary),
        verdict=_verdict(summary),
        tolerance=data.tolerance(),
        headings=_FIGURES.values(),
        rows=_figure_rows(summary),
        seeds=seed_rows(summary) if len(summary["seeds"]) > 1 else [],
        levels=_levels(summary),
        features=_feature_rows(data),
        places=[(p.label, f"{p.x_mm:.1f}", f"{p.y_mm:.1f}", signed(p.before_mm), signed(p.after_mm)) for p in places],
        glossary=GLOSSARY,
    )


def prediction_page(data: PredictionData) -> str:
    """The page of a planned program: predicted deflection, correction and force, nothing machined, as HTML text.

    Raises:
        InputError: Columns have different lengths or no rows.
    """
    n = len(data.time_s)
    if n == 0 or any(len(c) != n for c in (data.p_part_tcp, data.deflection_m, data.correction_m, data.force_n)):
        raise InputError("prediction columns are empty or have different lengths", value=n)
    size = np.linalg.norm(data.deflection_m, axis=1) / MM
    worst = int(np.argmax(size))
    correction = np.linalg.norm(data.correction_m, axis=1) / MM
    where = ", ".join(f"{v / MM:.1f}" for v in data.p_part_tcp[worst])
    cards: list[tuple[str, str, str]] = [
        ("Largest predicted deflection", f"{size[worst]:.3f} mm", f"at x y z {where} mm"),
        ("Largest correction", f"{correction.max():.3f} mm", f"mean {correction.mean():.3f} mm"),
        ("Largest mean force", f"{float(np.max(data.force_n)):.0f} N", "over one spindle turn"),
        ("Program time", f"{float(data.time_s[-1]):.1f} s", f"{n} points"),
    ]
    figures = {"prediction": prediction_figure(data), "plan": prediction_map(data), "space": space_figure(data)}
    if data.error_after_m is not None:
        figures["remaining"] = remaining_figure(data)
    if data.feed is not None:
        figures["feed"] = feed_figure(data.feed)
    if data.drawing is not None:
        figures["cell"] = cell_figure(data.drawing)
    return render("prediction.html.j2", figures, [], data=data, cards=cards, headline=_headline(data.headline))


def write_page(page: str, path: str | os.PathLike[str]) -> None:
    """Write a page whole or not at all. Raises OutputError: the folder cannot be written."""
    write_text(path, page.encode("utf-8", "backslashreplace").decode("utf-8"))  # names of files need not be UTF-8


def render(
    template: str,
    figures: Mapping[str, Any],
    scales: list[dict[str, Any]],
    package: str = "counterflex.report",
    **values: Any,
) -> str:
    """Fill a template that extends ``base.html.j2``.

    Args:
        package: Package whose folder ``templates`` has it.
        figures: Plotly figures by the name that ``data-figure`` has in the template.
        values: Whatever the template names; ``data`` must have ``title``, ``subtitle`` and ``created``.
    """
    from plotly.offline import get_plotlyjs

    palettes = {"metrology": stepped(METROLOGY), "colour-blind": stepped(COLOUR_BLIND)}
    solid = {"metrology": stepped((*METROLOGY, NOT_MACHINED)), "colour-blind": stepped((*COLOUR_BLIND, NOT_MACHINED))}
    controls = {"palettes": palettes, "solid": solid, "beyond": 1.0 + 2.0 / STEPS, "scales": scales}
    return (
        _environment(package)
        .get_template(template)
        .render(
            plotly=Markup(get_plotlyjs()),
            figures=Markup(script_json(dict(figures))),
            controls=Markup(script_json(controls)),
            scales=scales,
            shown=set(figures),
            **values,
        )
    )


@cache
def _environment(package: str) -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(name) for name in ("counterflex.report", package)]),
        autoescape=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _cards(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """Headline figures: name, before, after, change."""
    cards = []
    for name, part, figure in (
        ("Path error, 99.7 %", "path", "p997_mm"),
        ("Path error, largest", "path", "max_mm"),
        ("At cutter exit, largest", "exit", "max_mm"),
        ("Machined surface, 99.7 %", "surface", "p997_mm"),
    ):
        values = [summary["variants"][v].get(part, {}).get(figure) for v in ("nominal", "compensated")]
        if None in values:
            continue
        cards.append(_card(name, values[0], values[1]))
    return cards


def _verdict(summary: Mapping[str, Any]) -> str:
    """The result in one sentence; nothing in it is rounded in favour of the method."""
    level = summary["truth_level"]
    path = [summary["variants"][name]["path"]["p997_mm"] for name in ("nominal", "compensated")]
    text = (
        f"On this simulated cell 99.7 % of the cut stays within {path[1]:.3f} mm of the programmed path; before, "
        f"within {path[0]:.3f} mm."
    )
    entry = summary["over_seeds"].get(level, {})
    spread = entry.get("path", {}).get("p997")
    if spread is not None and entry["count"] > 1:
        text += (
            f" Over {entry['count']} simulated cells ({level}), {100.0 * spread['median_remaining']:.1f} % of the "
            f"error remains in the median and {100.0 * spread['worst_remaining']:.1f} % in the worst."
        )
    return text


def _headline(headline: Headline | None) -> list[dict[str, str]]:
    """Cards of the predicted path error, the figures to plan with first; none where it was not predicted."""
    if headline is None:
        return []
    share = "99.7 % of the path in the cut"
    model = _card("Model without its unknowns", *headline.model_mm) | {"note": share}
    if headline.before_mm is None or headline.after_mm is None:
        return [model | {"note": f"{share}. Not looked at: what is not known of the cell"}]
    before, after = headline.before_mm, headline.after_mm
    note = (
        f"Range in nine of ten such cells: before {before[1]:.2f} to {before[2]:.2f} mm, after {after[1]:.2f} to "
        f"{after[2]:.2f} mm. Probability that it gets worse: {headline.worse}"
    )
    return [_card("Expected path error, median", before[0], after[0], 2) | {"note": note}, model]


def _card(name: str, before: float, after: float, digits: int = 3) -> dict[str, str]:
    change = "" if before == 0.0 else f"{100.0 * (after / before - 1.0):+.0f} %".replace("-", "−")
    return {
        "name": name,
        "before": f"{before:.{digits}f}",
        "after": f"{after:.{digits}f}",
        "change": change,
        "worse": "worse" if after > before else "",
        "bar": "0" if before == 0.0 else f"{min(100.0 * after / before, 100.0):.1f}",
    }


def _figure_rows(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows of the figure table, one per kind of deviation."""
    table = {row[0]: row[1:] for row in table_rows(summary)}
    rows = []
    for part, name in _ROW_NAMES.items():
        if f"{part}.max_mm" in table:
            aside = part in ("air", "along")
            cells = [table[f"{part}.{figure}"] for figure in _FIGURES]
            if aside:
                cells = [(*cell[:2], "") for cell in cells]
            rows.append({"name": name, "cells": cells, "aside": aside})
    return rows


def _levels(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return what remains per truth level, over its seeds."""
    names = {
        "exact": "method error: planner given the truth's constants",
        "catalogue": "method + model error: constants off as listed",
        "identified": "after a measuring campaign",
    }
    rows = []
    for level, entry in summary["over_seeds"].items():
        path = entry.get("path", {})
        if "p997" in path and "max" in path:
            rows.append(
                {
                    "level": level,
                    "meaning": names.get(level, ""),
                    "count": str(entry["count"]),
                    **{
                        f"{figure}_{kind}": f"{100.0 * path[figure][f'{kind}_remaining']:.1f} %"
                        for figure in ("p997", "max")
                        for kind in ("median", "worst")
                    },
                }
            )
    return rows


def _scales(data: ReportData, whole_mm: float) -> list[dict[str, Any]]:
    """Scales of the maps, the first of them shown: the narrowest tolerance, then all that there is.

    Without a tolerance the first is that of 99.7 % of the compensated surface.
    """
    tolerances = [row.tolerance_m / MM for row in data.features if row.tolerance_m > 0.0]
    after = data.compensated.surface
    named: list[tuple[str, float]] = []
    if tolerances:
        named.append((f"±{min(tolerances):g} mm (tolerance)", min(tolerances)))
    elif after is not None:
        fine = scale_limit_mm(max(after.surface.p997_m / MM, 1e-3))
        named.append((f"±{fine:g} mm", fine))
    if not named or whole_mm > named[0][1]:
        named.append((f"±{whole_mm:g} mm (all)", whole_mm))
    return [{"name": name, "limit": value, "ticks": edges_mm(value)} for name, value in named]


def _feature_rows(data: ReportData) -> list[dict[str, Any]]:
    rows = []
    for row in data.features:
        cells: list[dict[str, Any]] = []
        for variant in ("nominal", "compensated"):
            if variant not in row.worst_m:
                cells.append({"value": "not found", "off": "", "ok": False})
                continue
            off = signed(row.material_left_m(variant) / MM)
            cells.append({"value": f"{row.worst_m[variant] / MM:.3f}", "off": off, "ok": row.ok(variant)})
        rows.append(cells)
    return feature_rows(data.features, rows)


def feature_rows(features: Sequence[FeatureRow], cells: Sequence[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Rows of the table of features, each with its cells; a feature is named in its first row."""
    before = ["", *(row.feature for row in features)]
    return [
        {
            "feature": row.feature if row.feature != previous else "",
            "quantity": row.quantity,
            "nominal": f"{row.nominal_m / MM:.3f}",
            "tolerance": f"{'' if row.nominal_m == 0.0 else '±'}{row.tolerance_m / MM:g}",
            "source": row.tolerance_source,
            "cells": own,
        }
        for row, previous, own in zip(features, before, cells, strict=False)
    ]


def signed(value_mm: float) -> str:
    """A deviation with its sign, in mm; ``n/a`` where there is none."""
    return "n/a" if math.isnan(value_mm) else f"{value_mm:+.3f}".replace("-", "−")
