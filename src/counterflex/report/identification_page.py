"""The report of an identification: one offline page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.result import Parts, ShownTable, Summary, digits_of
from counterflex.files.shop_unit import unit_of_name
from counterflex.identify.recipe import Identification, Picture
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.observability import DETERMINED
from counterflex.report.data import Fact, Head
from counterflex.report.figure_data import AFTER, BEFORE, numbers
from counterflex.report.page import render

_PALETTE: Final = ("#0369a1", "#c2410c", "#15803d", "#7c3aed", "#b45309", "#0f766e", "#be185d", "#4b5563")
_POINTS: Final = 4000
_SEEN_COLOURS: Final = {"determined": AFTER, "partly": "#b45309", "prior": "#9aa3ad"}
COVERAGE: Final = 1.96


_PRIOR_BAND: Final = {
    "type": "rect",
    "x0": -COVERAGE,
    "x1": COVERAGE,
    "y0": 0,
    "y1": 1,
    "yref": "paper",
    "fillcolor": "#eef1f4",
    "line": {"width": 0},
    "layer": "below",
}


def intervals_figure(fit: Fit) -> dict[str, Any] | None:
    """Every free parameter that has a prior: value and 95 % interval in standard deviations of the prior.

    The grey band is the prior's 95 %; a short bar far inside it is what the data know better.
    """
    names, x, width, colours = [], [], [], []
    for place in fit.free_index[::-1]:
        item = fit.parameters.items[place]
        if not item.has_prior:
            continue
        u = fit.parameters.coordinates(fit.values)[place]
        slope = float(fit.parameters.slope(fit.values)[place])
        names.append(item.label or item.name)
        x.append(float(u))
        width.append(COVERAGE * float(fit.sigma[place]) / slope)
        colours.append(_SEEN_COLOURS[fit.seen[place]])
    if not names:
        return None
    reach = max(2.4, 1.08 * max(abs(v) + w for v, w in zip(x, width, strict=True)))
    traces = []
    for seen, text in (("determined", "determined by the data"), ("partly", "partly"), ("prior", "as known before")):
        mine = [i for i, colour in enumerate(colours) if colour == _SEEN_COLOURS[seen]]
        if mine:
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "name": text,
                    "y": [names[i] for i in mine],
                    "x": [round(x[i], 4) for i in mine],
                    "error_x": {
                        "type": "data",
                        "array": [round(width[i], 4) for i in mine],
                        "thickness": 2,
                        "width": 4,
                    },
                    "marker": {"color": _SEEN_COLOURS[seen], "size": 7},
                    "hovertemplate": "%{y}: %{x:.2f} prior standard deviations<extra></extra>",
                }
            )
    return {
        "data": traces,
        "layout": {
            "height": 90 + 20 * len(names),
            "margin": {"l": 10, "r": 10, "t": 26, "b": 44},
            "xaxis": {
                "title": {"text": "change, in standard deviations of the prior"},
                "range": [-reach, reach],
                "zeroline": True,
            },
            "yaxis": {"automargin": True, "categoryorder": "array", "categoryarray": names, "dtick": 1},
            "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
            "shapes": [_PRIOR_BAND],
        },
    }


def residuals_figure(fit: Fit, names: tuple[str, ...]) -> dict[str, Any]:
    """Size of every row's weighted residual; rows that lost weight stand out."""
    traces: list[dict[str, Any]] = []
    first = 0
    for name, rows, weights, factor, colour in zip(
        names, fit.residuals, fit.weights, fit.sigma_factors, _cycle(len(names)), strict=True
    ):
        size = np.sqrt(np.mean(rows**2, axis=1)) / factor
        index = np.arange(first, first + len(size), dtype=np.float64) + 1
        first += len(size)
        bad = weights < 0.5
        good = _some(np.flatnonzero(~bad))
        traces.append(_points(name, index[good], size[good], colour, 4))
        if np.any(bad):
            traces.append(_points(f"{name}: outliers", index[bad], size[bad], BEFORE, 8))
    top = max((max(t["y"]) for t in traces if t["y"]), default=1.0)
    axis: dict[str, Any] = {"title": {"text": "residual / its standard deviation"}, "rangemode": "tozero"}
    if top > 30.0:
        axis = {"title": {"text": "residual / its standard deviation"}, "type": "log"}
    return {
        "data": traces,
        "layout": {
            "height": 320,
            "margin": {"l": 60, "r": 14, "t": 26, "b": 46},
            "xaxis": {"title": {"text": "row"}},
            "yaxis": axis,
            "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
        },
    }


def correlation_figure(fit: Fit) -> dict[str, Any] | None:
    """Correlation of the free parameters as a map; None for fewer than two."""
    names = [fit.parameters.items[i].label or fit.parameters.items[i].name for i in fit.free_index]
    if len(names) < 2:
        return None
    return {
        "data": [
            {
                "type": "heatmap",
                "x": names,
                "y": names,
                "z": [numbers(row, 3) for row in fit.correlation],
                "zmin": -1,
                "zmax": 1,
                "colorscale": [[0, "#c2410c"], [0.25, "#f3b08f"], [0.5, "#ffffff"], [0.75, "#9cc7e6"], [1, "#0369a1"]],
                "colorbar": {"title": {"text": "correlation"}, "thickness": 14},
                "hovertemplate": "%{y} with %{x}: %{z:.2f}<extra></extra>",
            }
        ],
        "layout": {
            "height": min(960, 220 + 17 * len(names)),
            "margin": {"l": 10, "r": 10, "t": 10, "b": 10},
            "xaxis": {"automargin": True, "showticklabels": len(names) <= 60, "tickangle": -60, "dtick": 1},
            "yaxis": {"automargin": True, "showticklabels": len(names) <= 60, "autorange": "reversed", "dtick": 1},
        },
    }


def picture_figure(picture: Picture) -> dict[str, Any]:
    """A picture of the recipe."""
    traces = []
    for curve, colour in zip(picture.curves, _cycle(len(picture.curves)), strict=True):
        if curve.line:
            step = max(1, len(curve.x) // _POINTS)
            x, y = curve.x[::step], curve.y[::step]
            line = {"color": colour, "width": 1.5}
            traces.append({"type": "scatter", "mode": "lines", "name": curve.name, **_xy(x, y), "line": line})
        else:
            some = _some(np.arange(len(curve.x)))
            traces.append(_points(curve.name, curve.x[some], curve.y[some], colour, 5))
    return {
        "data": traces,
        "layout": {
            "height": 340,
            "margin": {"l": 64, "r": 14, "t": 26, "b": 46},
            "xaxis": {"title": {"text": picture.x_label}},
            "yaxis": {"title": {"text": picture.y_label}},
            "showlegend": len(picture.curves) > 1,
            "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
        },
    }


def seen_words(fit: Fit) -> list[str]:
    """Return what the data see of which parameters, in sentences."""
    out = []
    for state, text in (
        ("prior", "keep their former values; these data do not determine them"),
        ("partly", f"are known better than before, but not by {1.0 / DETERMINED:g} times"),
        ("held", "were not requested and keep their former values"),
    ):
        names = [p.label or p.name for p, seen in zip(fit.parameters, fit.seen, strict=True) if seen == state]
        if names:
            shown = ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
            out.append(f"{shown}: {text}.")
    return out + [f"{sentence}." for sentence in fit.hidden if not sentence.startswith("not determined by")]


def _xy(x: Float, y: Float) -> dict[str, Any]:
    return {"x": [float(f"{v:.6g}") for v in x], "y": [None if np.isnan(v) else float(f"{v:.6g}") for v in y]}


def _points(name: str, x: Float, y: Float, colour: str, size: int) -> dict[str, Any]:
    marker = {"color": colour, "size": size, "opacity": 0.75}
    return {"type": "scatter", "mode": "markers", "name": name, **_xy(x, y), "marker": marker}


def _some(index: Any) -> Any:
    """At most :data:`_POINTS` of the places, evenly."""
    return index[:: max(1, -(-len(index) // _POINTS))]


def _cycle(count: int) -> tuple[str, ...]:
    return tuple(_PALETTE[i % len(_PALETTE)] for i in range(count))


_OUTLIERS = 20


def identification_page(identification: Identification, result: Mapping[str, Any]) -> str:
    """The page, as HTML text.

    All numbers in tables are read from ``result``, so page and ``result.json`` cannot differ.

    Args:
        result: The content of ``result.json``.
    """
    figures: dict[str, Any] = {}
    fits = []
    for i, (name, fit) in enumerate(identification.fits.items()):
        table = result["fits"][name]
        shown = {
            f"intervals{i}": intervals_figure(fit),
            f"residuals{i}": residuals_figure(fit, fit_blocks(fit, table)),
            f"correlation{i}": correlation_figure(fit),
        }
        figures.update({key: figure for key, figure in shown.items() if figure is not None})
        fits.append(
            {
                "name": name,
                "i": i,
                "rows": [_row(row) for row in table["parameters"] if row["free"]],
                "held": [_row(row) for row in table["parameters"] if not row["free"]],
                "outliers": table["outliers"][:_OUTLIERS],
                "more": max(0, len(table["outliers"]) - _OUTLIERS),
                "facts": _facts(table),
                "words": seen_words(fit),
            }
        )
    for i, picture in enumerate(identification.pictures):
        figures[f"picture{i}"] = picture_figure(picture)
    head = Head(
        title=result["title"][:1].upper() + result["title"][1:],
        subtitle=f"{result['recipe']} of {result['cell']}, from {', '.join(d['name'] for d in result['data'])}",
        created=result["date"],
        notes=tuple(result["remarks"]),
        timing=(Fact("reading, fitting, hold-out", f"{result['seconds']:.1f} s"),),
        versions=result["versions"],
    )
    return render(
        "identification.html.j2",
        figures,
        [],
        data=head,
        verdict=_verdict(result),
        cards=[_card(f) for f in result["headline"]],
        numbers=[{**f, "unit": _unit(f["name"])} for f in result["figures"]],
        fits=fits,
        pictures=[(f"picture{i}", p.title, p.note) for i, p in enumerate(identification.pictures)],
        provenance=_provenance(result),
        number=_number,
    )


def fit_blocks(fit: Fit, table: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of a fit's blocks where its outliers tell them, else their numbers."""
    named = {o["block"] for o in table["outliers"]}
    if len(fit.residuals) == 1:
        return (next(iter(named), "rows"),)
    return tuple(f"block {i + 1}" for i in range(len(fit.residuals)))


def _verdict(result: Mapping[str, Any]) -> str:
    head = result["headline"][0]
    unit = _unit(head["name"])
    text = f"{head['text'][:1].upper()}{head['text'][1:]}: {_number(head['value'])} {unit}".rstrip()
    if head["nominal"]:
        part = head["value"] / head["nominal"]
        before = f"{_number(head['nominal'])} {unit}".rstrip()
        text += f"; with the values before {before}, so {100.0 * part:.0f} % of it remains"
    return f"{text}. Evaluated on held-out data: {result['holdout']}."


def _card(figure: Mapping[str, Any]) -> dict[str, Any]:
    before, value = figure["nominal"], figure["value"]
    share = None if not before else value / before
    return {
        "name": figure["text"],
        "before": None if before is None else _number(before),
        "after": _number(value),
        "unit": _unit(figure["name"]),
        "bar": None if share is None else f"{min(100.0 * share, 100.0):.1f}",
        "change": "" if share is None else f"{100.0 * (share - 1.0):+.0f} %".replace("-", "−"),
        "limit": None if figure["limit"] is None else _number(figure["limit"]),
    }


def _row(row: Mapping[str, Any]) -> dict[str, str]:
    fixed = row["low"] is None
    return {
        "label": row["label"],
        "unit": row["unit"],
        "value": _number(row["value"], 5),
        "sigma": "" if fixed else _number(row["sigma"], 2),
        "interval": "" if fixed else f"{_number(row['low'], 5)} … {_number(row['high'], 5)}",
        "nominal": _number(row["nominal"], 5),
        "prior": "" if row["prior_sigma"] is None else _number(row["prior_sigma"], 2),
        "seen": {"determined": "determined", "partly": "partly", "prior": "prior", "held": "held"}[row["seen"]],
    }


def _facts(table: Mapping[str, Any]) -> tuple[Fact, ...]:
    factors = ", ".join(f"{value:.2f}" for value in table["sigma_factors"])
    return (
        Fact("Rows", ", ".join(str(count) for count in table["rows"]), "", "per block of like measurements"),
        Fact("Rank", f"{table['rank']} of {table['free']} free parameters"),
        Fact("Condition", f"{table['condition']:.3g}", "", "largest by smallest singular value, in prior units"),
        Fact("Reduced chi square", f"{table['chi2_reduced']:.2f}", "", f"{table['dof']:.0f} degrees of freedom"),
        Fact("Residuals exceed the stated standard deviations by", factors, "", "per block; intervals are widened"),
        Fact("Why the solver stopped", table["reason"], "", "" if table["converged"] else "it did not converge"),
        *((Fact("Against their bounds", ", ".join(table["at_bound"])),) if table["at_bound"] else ()),
    )


def _provenance(result: Mapping[str, Any]) -> tuple[Fact, ...]:
    rows = [Fact("Cell before", result["cell_file"], "", result["cell"])]
    for what, key in (("Data", "data"), ("Held out", "holdout_data")):
        for d in result[key]:
            count = f"{d['rows']} rows in {d['groups']} groups"
            rows.append(Fact(what, d["manifest"], d["sha256"][:16], f"{d['kind']}, {count}"))
    settings = ", ".join(f"{key} = {value}" for key, value in result["settings"].items())
    rows.append(Fact("Settings", settings or "none"))
    return tuple(rows)


def _unit(name: str) -> str:
    return unit_of_name(name).replace("um", "µm")


def _number(value: float | None, digits: int = 4) -> str:
    if value is None:
        return "n/a"
    return digits_of(value, digits).replace("-", "−")


_LISTED: Final = 5  # Outliers of a fit that the prompt names
_SENTENCES: Final = 3
_PARAMETERS: Final = 60


class IdentificationSummary(Summary):
    """Figures, parameters, outliers, and what the data do not see."""

    def _shown(self) -> Parts:
        rows = [one | {"unit": unit_of_name(one["name"])} for one in (*self["headline"], *self["figures"])]
        columns = "figure=text | identified=value:D4 | before=nominal:D4 | unit"
        yield ShownTable.of(self.line("{recipe} of {cell}"), columns, rows)
        for name, fit in self["fits"].items():
            free = [row for row in fit["parameters"] if row["free"]]
            yield ShownTable.of(
                f"Parameters of {name}",
                "parameter=label | value:D5 | standard deviation=sigma:D2 | unit | before=nominal:D5 | "
                "by the data=seen",
                free[:_PARAMETERS],
                f"Rank {fit['rank']} of {fit['free']}, condition {fit['condition']:.2g}, {sum(fit['rows'])} rows, "
                f"{len(fit['outliers'])} outliers. {fit['reason']}",
            )
            if len(free) > _PARAMETERS:
                yield f"note: {len(free) - _PARAMETERS} more parameters in report.html"
            yield from _doubts(fit, self["remarks"])
        yield from self.each("remarks", "note: {}")


def _doubts(fit: Mapping[str, Any], remarks: Sequence[str]) -> Parts:
    if not fit["converged"]:
        yield "warning: the solver did not converge"
    for name in fit["at_bound"]:
        yield f"warning: {name} rests against its bound; the data would have it beyond"
    for outlier in fit["outliers"][:_LISTED]:
        yield f"outlier: {outlier['where']}: {outlier['size']:.1f} times its standard deviation"
    if len(fit["outliers"]) > _LISTED:
        yield f"outlier: {len(fit['outliers']) - _LISTED} more in result.json"
    hidden = [sentence for sentence in fit["hidden"] if sentence not in remarks]
    yield from (f"note: {sentence}" for sentence in hidden[:_SENTENCES])
    if len(hidden) > _SENTENCES:
        yield f"note: {len(hidden) - _SENTENCES} more such sentences in report.html"
