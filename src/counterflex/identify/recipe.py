"""What every recipe offers, and what it returns."""

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
    """A number that a user reads, in the unit of the report.

    Attributes:
        name: Key in ``result.json``, with unit suffix: ``holdout_mean_mm``.
        text: What it is, in words.
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
        fits: By name; most recipes have one, named as the recipe.
        headline: The error on data not used, nominal beside it; what decides acceptance is its first entry.
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


class Inputs(NamedTuple):
    """What every recipe identifies from; :meth:`Recipe.identify` has checked and completed it.

    Attributes:
        cell: What is known before: the prior of every parameter, and all that the recipe does not identify.
        data: Datasets that parameters are fitted to, one or more, of the recipe's kinds.
        holdout: Datasets that are predicted only and judge the result; empty means parts of ``data`` held out in turn.
        settings: Every setting of the recipe: what the user set in the place of the defaults.
        progress: Progress callback, fraction 0 to 1.
    """

    cell: CellModel
    data: Sequence[Dataset]
    holdout: Sequence[Dataset]
    settings: Mapping[str, Any]
    progress: Progress


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
        find: The physics: the result of :class:`Inputs`.
        propose: See :data:`Propose`.
    """

    name: str
    title: str
    kinds: tuple[str, ...]
    settings: Mapping[str, float | int | str | bool]
    find: Callable[[Inputs], Identification]
    propose: Propose

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
