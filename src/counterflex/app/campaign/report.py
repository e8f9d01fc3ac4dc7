"""Fill the campaign's page from its summary, so that page and ``summary.json`` cannot differ."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from counterflex import __version__
from counterflex.app.compensation.headline import error_rows
from counterflex.app.prediction_interval import worse_text
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.evaluate.summary import TRUTH_LEVELS
from counterflex.files.shop_unit import unit_of_name
from counterflex.report.data import Fact, Head
from counterflex.report.page import render


@dataclass(frozen=True)
class FigureRow:
    """A figure of an identification."""

    text: str
    before: str  # With the cell before it, as printed, or empty
    value: str


@dataclass(frozen=True)
class RecipeRow:
    """One recipe of one campaign."""

    recipe: str
    rows: str  # Measured rows, fit and validation, as printed
    verdict: str  # ``accepted``, or why it was not
    accepted: bool  # Whether the cell file took it over
    figures: tuple[FigureRow, ...]
    seconds: str
    report: str = ""  # Where the report of the identification is, relative to the page, or empty

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> RecipeRow:
        """Build the row of one recipe."""
        return cls(
            recipe=row["recipe"],
            rows=" + ".join(str(value) for value in row["rows"].values()),
            verdict=row["why"],
            accepted=row["accepted"],
            figures=tuple(
                FigureRow(
                    figure["text"],
                    "" if figure["nominal"] is None else f"{figure['nominal']:.4g}",
                    f"{figure['value']:.4g} {unit_of_name(figure['name'])}".strip(),
                )
                for figure in row["headline"]
            ),
            seconds=f"{sum(row['seconds'].values()):.0f} s",
            report=row["report"],
        )


@dataclass(frozen=True)
class TruthRow:
    """One line of the comparison with the truth, as printed; ``better`` where the error became smaller."""

    name: str
    before: str
    identified: str
    true: str
    better: bool

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> TruthRow:
        """Build the row of one truth."""
        goal = 0.0 if row["true"] is None else row["true"]
        return cls(
            name=f"{row['name']}, {row['unit']}",
            before=f"{row['before']:.4g}",
            identified=f"{row['identified']:.4g}",
            true="" if row["true"] is None else f"{row['true']:.4g}",
            better=abs(row["identified"] - goal) <= abs(row["before"] - goal),
        )


@dataclass(frozen=True)
class CampaignOfSeed:
    """One truth."""

    seed: str
    recipes: tuple[RecipeRow, ...]  # In order
    truths: Mapping[str, tuple[TruthRow, ...]]  # By group: what planning uses, stiffness, ..

    @classmethod
    def of(cls, item: Mapping[str, Any]) -> CampaignOfSeed:
        """Build from the files of the campaign of one seed."""
        truths: dict[str, tuple[TruthRow, ...]] = {}
        for group, title in _GROUPS.items():
            rows = [row for row in item["parameter_errors"] if row["group"] == group]
            if rows:
                truths[title] = tuple(TruthRow.of(row) for row in rows)
        return cls(
            seed="as the cell file" if item["seed"] is None else f"seed {item['seed']}",
            recipes=tuple(RecipeRow.of(row) for row in item["recipes"]),
            truths=truths,
        )


@dataclass(frozen=True, kw_only=True)
class CampaignData(Head):
    """Everything on the page."""

    verdict: str  # The result in one sentence, or empty where nothing was machined
    cards: Sequence[tuple[str, str, str]]
    columns: Sequence[str]  # Header of the table over the seeds
    rows: Sequence[Sequence[str]]
    seeds: tuple[CampaignOfSeed, ...]
    facts: tuple[Fact, ...] = ()

    def page(self) -> str:
        """The page, as HTML text."""
        return render("campaign.html.j2", {}, [], data=self)


COLUMNS: Final = (
    "seed",
    "uncompensated mm",
    "nominal cell mm",
    "remains",
    "identified cell mm",
    "remains",
    "exact constants mm",
    "remains",
)
SETUP_COLUMNS: Final = (
    "program",
    "placement",
    "posture",
    "planned with",
    "uncompensated mm",
    "worst mm",
    "compensated mm",
    "worst mm",
    "remains",
    "worst",
    "cells",
    "failed",
)
_LEVEL_WORDS: Final = {"catalogue": "cell file", "identified": "identified cell", "exact": "exact constants"}
_GROUPS: Final = {
    "use": "What planning uses",
    "stiffness": "Elastic elements",
    "masses": "Masses",
    "drives": "Drives",
    "cutting": "Cutting",
}
_LIBRARIES: Final = ("numpy", "scipy", "numba", "mujoco", "polars")


def campaign_page_of(summary: Mapping[str, Any]) -> str:
    """The page of a campaign's summary, as HTML."""
    rows = rows_of(summary)
    with_exact = any(row[-1] != "-" for row in rows)
    shown = [row if with_exact else row[:-2] for row in rows]
    columns: Sequence[str] = COLUMNS if with_exact else COLUMNS[:-2]
    if "setups" in summary:
        columns, shown = SETUP_COLUMNS, [tuple(row) for row in setup_rows(summary)]
    return CampaignData(
        title=f"Campaign: {summary['cell']}",
        subtitle=f"{summary['robot']}, set up as a laboratory would, on simulated cells",
        created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        verdict=verdict(summary),
        cards=_cards(summary),
        columns=columns,
        rows=shown,
        seeds=tuple(CampaignOfSeed.of(item) for item in summary["campaigns"]),
        facts=(
            Fact("Cell", str(summary["cell"])),
            Fact("Robot", str(summary["robot"])),
            *((Fact("Program", str(summary["program"])),) if summary["program"] else ()),
        ),
        timing=(Fact("Whole campaign", f"{summary['seconds']:.0f} s"),),
        versions={
            "counterflex": __version__,
            "Python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _LIBRARIES},
        },
    ).page()


def rows_of(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table of a campaign, one per truth, as printed.

    Seed; 99.7 % path error of the uncompensated program, mm; then mm and what remains, %, of the program compensated
    with the cell file as it was, with the identified cell, and with the truth's exact constants.
    """
    by: dict[Any, dict[str, Any]] = {}
    for entry in summary.get("seeds", []):
        by.setdefault(entry["seed"], {})[entry["truth_level"]] = entry
    rows = []
    for seed, levels in by.items():
        before = next(iter(levels.values()))["variants"]["nominal"]["path"]["p997_mm"]
        cells = ["none" if seed is None else str(seed), f"{before:.3f}"]
        for level in TRUTH_LEVELS:
            if level not in levels:
                cells += ["-", "-"]
                continue
            value = levels[level]["variants"]["compensated"]["path"]["p997_mm"]
            cells += [f"{value:.3f}", f"{100.0 * value / before:.1f} %"]
        rows.append(tuple(cells))
    return rows


def setup_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the table of several set-ups: median and worst over the simulated cells."""
    rows = []
    for entry in summary["setups"]:
        cells = [
            entry["program"],
            entry["placement"] or "cell file",
            entry["posture"],
            _LEVEL_WORDS[entry["truth_level"]],
        ]
        for key, form in (
            ("nominal_p997_mm", "{:.3f}"),
            ("compensated_p997_mm", "{:.3f}"),
            ("remains_percent", "{:.1f} %"),
        ):
            value = entry[key]
            cells += ["-", "-"] if value is None else [form.format(value["median"]), form.format(value["worst"])]
        failed = f"{entry['failed']}: {entry['fault']}" if entry["failed"] else "0"
        rows.append([*cells, str(entry["cells"]), failed])
    return rows


def remaining(summary: Mapping[str, Any], level: str) -> list[float]:
    """Share of the 99.7 % path error that remains at a truth level, per seed."""
    return [
        entry["variants"]["compensated"]["path"]["p997_mm"] / entry["variants"]["nominal"]["path"]["p997_mm"]
        for entry in summary.get("seeds", [])
        if entry["truth_level"] == level
    ]


def verdict(summary: Mapping[str, Any]) -> str:
    """The result in one sentence; empty where nothing was machined with an identified cell."""
    identified, catalogue = remaining(summary, "identified"), remaining(summary, "catalogue")
    if not identified:
        return ""
    cells = f"{len(identified)} simulated cells" if len(identified) > 1 else "one simulated cell"
    text = f"On {cells}, {100.0 * statistics.median(identified):.1f} % of the 99.7 % path error remains"
    text += " in the median" if len(identified) > 1 else ""
    text += (
        f" after compensation with the identified cell, {100.0 * statistics.median(catalogue):.1f} % with the cell file"
    )
    return text + " as it was."


def _cards(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    cards = []
    headline = summary.get("prediction", {}).get("headline")
    if headline is not None:
        for what in ("before", "after"):
            median, low, high = headline[f"{what}_mm"]
            cards.append(
                (
                    f"Expected path error {what}, with the cell file",
                    f"{median:.2f} mm",
                    f"{low:.2f} to {high:.2f} mm in nine of ten such cells",
                )
            )
        worse = worse_text(headline["probability_of_worse"])
        cards.append(("Probability that it gets worse", worse, "with the cell file as it was"))
    for level, name in (
        ("catalogue", "with the cell file"),
        ("identified", "with the identified cell"),
        ("exact", "with exact constants"),
    ):
        shares = remaining(summary, level)
        if shares:
            worst = f"worst {100.0 * max(shares):.1f} %, best {100.0 * min(shares):.1f} %"
            cards.append((f"Remaining path error, {name}", f"{100.0 * statistics.median(shares):.1f} %", worst))
    recipes = [row for item in summary["campaigns"] for row in item["recipes"]]
    if recipes:
        taken = sum(1 for row in recipes if row["accepted"])
        rest = (
            "the others were no better than before"
            if taken < len(recipes)
            else "each better than before on unseen data"
        )
        cards.append(("Identifications taken over", f"{taken} of {len(recipes)}", rest))
    return cards


def headline_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """First headline figure of every recipe: seed, recipe, figure, before, identified, whether it was taken over."""
    rows = []
    for item in summary["campaigns"]:
        for row in item["recipes"]:
            shown = RecipeRow.of(row)
            first = shown.figures[0] if shown.figures else FigureRow("refused", "", "")
            seed = "none" if item["seed"] is None else str(item["seed"])
            rows.append([seed, shown.recipe, first.text, first.before, first.value, "yes" if shown.accepted else "no"])
    return rows


def refusals(summary: Mapping[str, Any]) -> list[str]:
    """Return why recipes were not taken over, a line each."""
    lines = []
    for item in summary["campaigns"]:
        of = "" if item["seed"] is None else f"seed {item['seed']}: "
        lines += [f"{of}{row['recipe']} not taken over: {row['why']}" for row in item["recipes"] if not row["accepted"]]
    return lines


class CampaignSummary(Summary):
    """Identified parameters, and path errors before and after."""

    def _shown(self) -> Parts:
        if lines := headline_rows(self):
            columns = ["seed", "recipe", "figure", "before", "identified", "taken over"]
            yield ShownTable("Identified on the twin; errors on held-out measurements", columns, lines)
        yield from refusals(self)
        if expected := error_rows(self.get("prediction", {})):
            title = "Expected of all such cells, with the cell file as it was"
            yield ShownTable(title, ["", "value", ""], expected)
        if rows := rows_of(self):
            end = None if any(row[-1] != "-" for row in rows) else -2  # without exact constants they have no columns
            yield ShownTable("99.7 % path error before and after", COLUMNS[:end], [row[:end] for row in rows])
            yield verdict(self)
        if "setups" in self:
            yield ShownTable("99.7 % path error over the simulated cells", SETUP_COLUMNS, setup_rows(self))
