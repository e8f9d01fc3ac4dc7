"""The page of a campaign: what a measured cell is worth, recipe by recipe, and how near to the truth it came."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from counterflex.report.data import Fact
from counterflex.report.page import render


@dataclass(frozen=True)
class FigureRow:
    """A figure of an identification.

    Attributes:
        before: With the cell before it, as printed, or empty.
    """

    text: str
    before: str
    value: str


@dataclass(frozen=True)
class RecipeRow:
    """One recipe of one campaign.

    Attributes:
        rows: Measured rows, fit and validation, as printed.
        verdict: ``accepted``, or why it was not.
        accepted: Whether the cell file took it over.
        report: Where the report of the identification is, relative to the page, or empty.
    """

    recipe: str
    rows: str
    verdict: str
    accepted: bool
    figures: tuple[FigureRow, ...]
    seconds: str
    report: str = ""


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
    """One truth.

    Attributes:
        recipes: In order.
        truths: By group: what planning uses, stiffness, ...
    """

    seed: str
    recipes: tuple[RecipeRow, ...]
    truths: Mapping[str, tuple[TruthRow, ...]]


@dataclass(frozen=True)
class CampaignData:
    """Everything on the page.

    Attributes:
        verdict: The result in one sentence, or empty where nothing was machined.
        columns: Header of the table over the seeds.
    """

    title: str
    subtitle: str
    created: str
    verdict: str
    cards: Sequence[tuple[str, str, str]]
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    seeds: tuple[CampaignOfSeed, ...]
    facts: tuple[Fact, ...] = ()
    timing: tuple[Fact, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)


def campaign_page(data: CampaignData) -> str:
    """The page, as HTML text."""
    return render("campaign.html.j2", {}, [], data=data)
