"""What every recipe offers, and what it returns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress
from counterflex.identify.data.changes import Change
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.solver.fit import Fit


@dataclass(frozen=True)
class Figure:
    """A number that a user reads, in the unit of the report.

    Attributes:
        name: Key in ``result.json``, with unit suffix: ``holdout_mean_mm``.
        text: What it is, in words.
        value: The number.
        nominal: The same before identification, or None.
        limit: What it should be at most (or None).
    """

    name: str
    text: str
    value: float
    nominal: float | None = None
    limit: float | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """Points or a line of a picture."""

    name: str
    x: Float
    y: Float
    line: bool = False


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of the report: curves over common axes, in shop units, units in the labels."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    note: str = ""


@dataclass(frozen=True, eq=False)
class Identification:
    """What a recipe found.

    Attributes:
        recipe: Its name.
        fits: By name; most recipes have one, named as the recipe.
        headline: The error on data not used, nominal beside it; what decides acceptance is its first entry.
        figures: Further figures.
        changes: What goes into the cell file.
        remarks: Sentences for the report: what was assumed, what the data cannot see, what to measure next.
        pictures: For the report.
    """

    recipe: str
    fits: Mapping[str, Fit]
    headline: tuple[Figure, ...]
    figures: tuple[Figure, ...]
    changes: tuple[Change, ...]
    remarks: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, eq=False)
class Proposal:
    """Measurements to take, in order.

    Attributes:
        recipe: For which recipe.
        kind: Kind of dataset that results.
        columns: (n,) by name, SI, the unit as suffix: ``q1_rad`` ... ``q6_rad``, ``fx_n``, ``time_s``.
        expected: Expected standard deviation by parameter name, SI.
        remarks: How to measure, in words.
        settings: Further facts for the measurement, as in :class:`counterflex.identify.data.dataset.Dataset`.
        units: SI unit of each entry of ``expected`` (``m``, ``rad/(N m)``, ...), where the recipe states it.
        files: Texts that go beside the proposal, by file name: a program that takes the measurements.
    """

    recipe: str
    kind: str
    columns: Mapping[str, Float]
    expected: Mapping[str, float]
    remarks: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


Identify = Callable[[CellModel, Sequence[Dataset], Sequence[Dataset], Mapping[str, Any], Progress], Identification]
"""``identify(cell, data, holdout, settings, progress)``; an empty ``holdout`` means k-fold on ``data``."""
Propose = Callable[[CellModel, int, Mapping[str, Any]], Proposal]
"""``propose(cell, count, settings)``; ``settings["seed"]`` makes it repeatable."""


@dataclass(frozen=True)
class Recipe:
    """One thing to find.

    Attributes:
        name: As typed on the command line.
        title: One line for help and report.
        kinds: Kinds of datasets it uses.
        settings: Options with their defaults (``--set key=value`` on the command line); SI or plain.
        identify: See :data:`Identify`.
        propose: See :data:`Propose`.
    """

    name: str
    title: str
    kinds: tuple[str, ...]
    settings: Mapping[str, float | int | str | bool]
    identify: Identify
    propose: Propose
