"""The report of an identification: one offline page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from counterflex.files.shop_unit import digits_of, unit_of_name
from counterflex.identify.recipe import Identification
from counterflex.identify.solver.fit import Fit
from counterflex.report.data import Fact
from counterflex.report.identification_figures import (
    correlation_figure,
    intervals_figure,
    picture_figure,
    residuals_figure,
    seen_words,
)
from counterflex.report.page import render

_OUTLIERS = 20


@dataclass(frozen=True)
class _Head:
    """What the house style's frame asks for."""

    title: str
    subtitle: str
    created: str
    notes: tuple[str, ...]
    timing: tuple[Fact, ...]
    versions: Mapping[str, str]


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
    head = _Head(
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
