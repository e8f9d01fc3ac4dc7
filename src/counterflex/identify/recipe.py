"""Interface of every recipe, and its result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.identify.data.changes import Change
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.solver.fit import Fit


@dataclass(frozen=True)
class Figure:
    """A number that a user reads, in the unit of the report."""

    name: str  # key in `result.json`, with unit suffix: `holdout_mean_mm`
    text: str  # what it is, in words
    value: float
    nominal: float | None = None  # the same before identification, or None
    limit: float | None = None  # what it should be at most (or None)


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
    """Result of a recipe."""

    recipe: str
    fits: Mapping[str, Fit]  # by name; most recipes have one, named as the recipe
    # the error on data not used, nominal beside it; what decides acceptance is its first entry
    headline: tuple[Figure, ...]
    figures: tuple[Figure, ...]
    changes: tuple[Change, ...]  # what goes into the cell file
    # sentences for the report: what was assumed, what the data cannot see, what to measure next
    remarks: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()  # for the report


@dataclass(frozen=True, eq=False)
class Proposal:
    """Measurements to take, in order."""

    recipe: str  # for which recipe
    kind: str  # kind of dataset that results
    columns: Mapping[str, Float]  # (n,) by name, SI, the unit as suffix: `q1_rad` ... `q6_rad`, `fx_n`, `time_s`
    expected: Mapping[str, float]  # expected standard deviation by parameter name, SI
    remarks: tuple[str, ...] = ()  # how to measure, in words
    # further facts for the measurement, as in counterflex.identify.data.dataset.Dataset
    settings: Mapping[str, Any] = field(default_factory=dict)
    # SI unit of each entry of `expected` (`m`, `rad/(N m)`, ...), where the recipe states it
    units: Mapping[str, str] = field(default_factory=dict)
    # texts that go beside the proposal, by file name: a program that takes the measurements
    files: Mapping[str, str] = field(default_factory=dict)


class Inputs(NamedTuple):
    """Inputs of every recipe; :meth:`Recipe.identify` has checked and completed them."""

    cell: CellModel  # what is known before: the prior of every parameter, and all that the recipe does not identify
    data: Sequence[Dataset]  # datasets that parameters are fitted to, one or more, of the recipe's kinds
    # datasets that are predicted only and judge the result; empty means parts of `data` held out in turn
    holdout: Sequence[Dataset]
    settings: Mapping[str, Any]  # every setting of the recipe: what the user set in the place of the defaults
    progress: Progress  # progress callback, fraction 0 to 1


Propose = Callable[[CellModel, int, Mapping[str, Any]], Proposal]
"""``propose(cell, count, settings)``; ``settings["seed"]`` makes it repeatable."""


@dataclass(frozen=True)
class Recipe:
    """One thing to find."""

    name: str  # as typed on the command line
    title: str  # one line for help and report
    kinds: tuple[str, ...]  # kinds of datasets it uses
    # options with their defaults (`--set key=value` on the command line); SI or plain
    settings: Mapping[str, float | int | str | bool]
    find: Callable[[Inputs], Identification]  # the physics: the result of Inputs
    propose: Propose  # see Propose
    # settings that spare what only compares models: readings are checked with them while they are typed
    quick: Mapping[str, float | int | str | bool] = field(default_factory=dict)

    def identify(
        self,
        cell: CellModel,
        data: Sequence[Dataset],
        holdout: Sequence[Dataset] = (),
        settings: Mapping[str, Any] | None = None,
        progress: Progress = silent,
    ) -> Identification:
        """Find what the recipe is for. The head of all recipes: it checks and completes what they get.

        ``holdout``: Datasets that are predicted only; empty means parts of ``data`` held out in turn. ``progress``:
        Progress callback, fraction 0 to 1.

        Returns:
            Fits, the error on data not used, and what goes into the cell file.

        Raises:
            InputError: No data, a dataset of a kind that the recipe does not use, or data that look wrong: units,
                signs, columns or axes mixed up, too little to tell the parameters apart.
            FileFormatError: A channel or a standard deviation is missing, or a value is not a number.
        """
        self.require_usable((*data, *holdout))
        if not data:
            raise InputError(f"the recipe '{self.name}' needs at least one dataset", limit=", ".join(self.kinds))
        complete = {**self.settings, **(settings or {})}
        return self.find(Inputs(cell, tuple(data), tuple(holdout), complete, progress))

    def require_usable(self, datasets: Sequence[Dataset]) -> None:
        """Refuse a dataset of a kind that the recipe does not use.

        Raises:
            InputError: It names the file and the kinds that are used.
        """
        for dataset in datasets:
            if dataset.kind not in self.kinds:
                raise InputError(
                    f"the recipe '{self.name}' does not use such data",
                    where=f"{dataset.where}: kind",
                    value=dataset.kind,
                    limit=", ".join(self.kinds),
                )
