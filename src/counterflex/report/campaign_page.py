"""The page of a campaign: what a measured cell is worth, recipe by recipe, and how near to the truth it came."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class TruthRow:
    """One line of the comparison with the truth, as printed; ``better`` where the error became smaller."""

    name: str
    before: str
    identified: str
    true: str
    better: bool


@dataclass(frozen=True)
class CampaignOfSeed:
    """One truth."""

    seed: str
    recipes: tuple[RecipeRow, ...]  # In order
    truths: Mapping[str, tuple[TruthRow, ...]]  # By group: what planning uses, stiffness, ..


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
