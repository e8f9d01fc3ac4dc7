"""Recipe ``cutting``: force constants of tool and material from test cuts.

What is fitted and reported is the specific force at a thickness inside the data with its exponent and edge force, not
k1.1, which lies 10 to 50 times outside of what milling sees. Which form of the law the data bear is decided by cuts
held out, the simpler one where two do equally well.

Sources: Berger2013 (tests, Kienzle's law); Altintas, Manufacturing Automation (linear law with edge force).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.next_command import next_command
from counterflex.core.progress import Progress, in_parts, saying
from counterflex.core.units import MM
from counterflex.identify.cutting import TITLE
from counterflex.identify.cutting.checks import check
from counterflex.identify.cutting.considered import RUNOUT_M, WEAR, force_sensor, with_shared
from counterflex.identify.cutting.cut_rows import in_air
from counterflex.identify.cutting.force_forms import FORMS, ForceForm, form, solve_physical
from counterflex.identify.cutting.proposal import SETTINGS as PROPOSAL, propose
from counterflex.identify.cutting.report import ChosenForm, Shared, figures, pictures, remarks
from counterflex.identify.cutting.residuals import TOP_SIGMA_M, SlotResiduals, geometry_parameters
from counterflex.identify.cutting.steady_cuts import Cutting, SteadyCuts, pieces_of
from counterflex.identify.data.changes import CuttingLaw
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Figure, Identification, Inputs, Recipe
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate, score_separate
from counterflex.identify.solver.jackknife import parts_of_groups, with_jackknife
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals

KIND = "slots"
LIMIT = 5.0
"""Error of the mean force on cuts not used that the recipe aims at, %."""
_LEAST_PIECES = 5
_FULL_PIECES = 6
"""Fewest pieces for a law of more than six constants: five feeds at one depth tell two of each direction."""
_FEW_CONSTANTS = 6

SETTINGS: dict[str, float | int | str | bool] = {
    "tool": 0,
    "form": "auto",
    "trim_diameters": 1.0,
    "settle_s": 0.2,
    "top_sigma_m": TOP_SIGMA_M,
    "wear_sigma": WEAR,
    "runout_sigma_m": RUNOUT_M,
    "folds": 5,
    "as_stated": False,
    "seed": 0,
}

READING, HELD_OUT, FITTING = "reading the cuts", "held out", "fitting"
WORK: Final = {READING: 0.1, HELD_OUT: 0.7, FITTING: 0.03}
"""Parts of the work with what they cost (processor time of two data sets, ``tools/measure_progress.py``)."""


def identify(inputs: Inputs) -> Identification:
    """Find the force constants from test cuts.

    ``inputs``: The force law before; test slots, held out by cuts. Raises InputError: too few settled cuts, cuts of
    several tools, or data that another reading explains far better.
    """
    cell, data, holdout, options, progress = inputs
    parts = in_parts(progress, WORK)
    tool = int(options["tool"]) or None
    sensor = force_sensor(data)
    wear, eccentric = (as_positive(key, float(options[key]), zero=True) for key in ("wear_sigma", "runout_sigma_m"))
    notes: list[str] = []
    air = [d for d in (*data, *holdout) if in_air(d)]
    for i, dataset in enumerate([*data, *holdout]):
        notes += [] if dataset in air else check(cell, dataset, tool, as_stated=bool(options["as_stated"]))
        parts[READING](0.5 * (i + 1) / (len(data) + len(holdout)))
    cuts = pieces_of(
        cell, [*data, *holdout], Cutting(float(options["trim_diameters"]), float(options["settle_s"])), tool
    )
    problem = _FormChoice(cell, cuts, cuts.pieces.session < len(data), float(options["top_sigma_m"]))
    if problem.train_count < _LEAST_PIECES:
        raise InputError(
            "too few settled pieces of cuts for the constants of a force law",
            value=problem.train_count,
            limit=f"at least {_LEAST_PIECES}",
            hint="Cut slots at several feeds and depths: "
            + next_command("identify cutting", propose=20, cell="CELL", out="DIR"),
        )
    requested = FORMS if options["form"] == "auto" else (form(str(options["form"])),)
    parts[READING](1.0)
    trials = problem.trials(requested, int(options["folds"]), int(options["seed"]), parts[HELD_OUT])
    parts[HELD_OUT](1.0)
    best = _simplest(trials)
    train = problem.train(best.form)
    fit = solve_physical(problem.parameters(best.form), train)
    fit = with_jackknife(fit, [train], parts_of_groups([train]))
    chosen = ChosenForm(cuts, train, best.form, fit, problem.h_ref_m, problem.range_m)
    law, seen = chosen.law(_source(data)), chosen.runout()
    shared = Shared(sensor, wear, eccentric if seen is None else seen.value_m, seen is not None, fit.sigma)
    fit = with_shared(fit, train, law, sensor, wear, shared.runout_m)
    chosen = replace(chosen, fit=fit, shared=shared)
    judged, before = problem.judged(best, bool(holdout))
    parts[FITTING](1.0)
    return Identification(
        recipe="cutting",
        fits={"cutting": fit},
        headline=_headline(judged, before, bool(holdout)),
        figures=figures(chosen, {t.form.text: 100.0 * t.mean for t in trials}),
        changes=(CuttingLaw(law),),
        remarks=(*notes, *remarks(chosen, cell.force_law)),
        pictures=pictures(chosen, cell.force_law),
    )


def row_error(block: Residuals, x: Float) -> Float:
    """Length of each piece's force error over the length of its force, (rows,)."""
    if not isinstance(block, SlotResiduals):
        raise InputError("a block of the cutting recipe holds test cuts", value=block.name)
    force = block.pieces.force
    least = np.linalg.norm(block.pieces.sigma, axis=1)  # a piece without force has no relative error
    out: Float = np.linalg.norm(force - block.predict(x), axis=1) / np.maximum(np.linalg.norm(force, axis=1), least)
    return out


@dataclass(frozen=True, eq=False)
class FormTrial:
    """A form of the law, tried on cuts held out."""

    form: ForceForm
    error: Float  # (n,) relative error of each training piece while it was held out
    held_out: HeldOut  # the errors of both laws

    @property
    def mean(self) -> float:
        """Mean relative error."""
        return float(np.mean(self.error))


class _FormChoice:
    """The pieces, split into training and hold-out, and the blocks and parameters of a form."""

    def __init__(self, cell: CellModel, cuts: SteadyCuts, train: Bool, top_sigma_m: float) -> None:
        self.cell, self.cuts, self.mask = cell, cuts, train
        self.train_count = int(np.sum(train))
        self.geometry = geometry_parameters(cuts.pieces, top_sigma_m)
        self.h_ref_m, self.range_m = MM, (MM, MM)
        if self.train_count:
            rough = self._block(FORMS[0], train, MM)
            h = rough.thickness()
            self.h_ref_m, self.range_m = rough.reference_m(), (float(np.min(h)), float(np.max(h)))

    def _block(self, item: ForceForm, rows: Bool, h_ref_m: float) -> SlotResiduals:
        cuts = self.cuts
        return SlotResiduals(
            cuts.pieces.subset(rows), cuts.cutter, item, h_ref_m, self.cell.force_law, len(cuts.blanks)
        )

    def train(self, item: ForceForm) -> SlotResiduals:
        """The pieces to fit."""
        return self._block(item, self.mask, self.h_ref_m)

    def unseen(self, item: ForceForm) -> SlotResiduals:
        """The pieces of the separate files."""
        return self._block(item, ~self.mask, self.h_ref_m)

    def parameters(self, item: ForceForm) -> Parameters:
        """Constants and geometry."""
        return item.parameters(self.cell.force_law, self.h_ref_m) + self.geometry

    def needed(self) -> list[str]:
        """Geometry, which any use of a force law has to find."""
        return [p.name for p in self.geometry if p.free]

    def trials(self, requested: Sequence[ForceForm], folds: int, seed: int, progress: Progress) -> list[FormTrial]:
        """Hold cuts out of every form that the data can bear; the fullest form is always among them, for the nominal.

        Raises InputError: no form has fewer constants than there are numbers.
        """
        out = []
        full = FORMS[-1]
        forms = list(requested) if full in requested else [*requested, full]
        parts = in_parts(progress, {f"held out: {item.text}": item.count + 3.0 for item in forms})
        for item in forms:
            if self._beyond(item) and item is not full:
                continue
            held_out = cross_validate(
                self.parameters(item),
                [self.train(item)],
                needed=self.needed(),
                error=row_error,
                folds=Folds(folds, seed),
                progress=saying(parts[f"held out: {item.text}"], f"held out: {item.text}"),
            )
            out.append(FormTrial(item, held_out.identified, held_out))
        self._nominal = out[-1].held_out.nominal
        candidates = [t for t in out if t.form in requested and not self._beyond(t.form)]
        if not candidates:
            raise InputError("too few cuts for this form of the force law", value=self.train_count)
        return candidates

    def _beyond(self, item: ForceForm) -> bool:
        """Return whether a form has more constants than the pieces tell."""
        few = self.train_count < _FULL_PIECES and item.count > _FEW_CONSTANTS
        return few or 3 * self.train_count <= item.count + 3

    def judged(self, best: FormTrial, separate: bool) -> tuple[Float, Float]:
        """Relative errors (identified, nominal) of pieces that were not used."""
        if not separate:
            return best.error, self._nominal
        blanks = set(self.cuts.pieces.blank[self.mask].tolist())
        local = [f"top.{i}" for i in range(len(self.cuts.blanks)) if i not in blanks]
        local = [name for name in local if self.geometry.items[self.geometry.index(name)].free]
        own = self._scores(best.form, local)
        return own.identified, own.nominal if best.form is FORMS[-1] else self._scores(FORMS[-1], local).nominal

    def _scores(self, item: ForceForm, local: Sequence[str]) -> HeldOut:
        return score_separate(
            self.parameters(item),
            [self.train(item)],
            [self.unseen(item)],
            needed=[name for name in self.needed() if name not in local],
            local=local,
            error=row_error,
        )


def _simplest(trials: Sequence[FormTrial]) -> FormTrial:
    """The form with the fewest constants among those no worse than the best by more than two standard errors."""
    best = min(trials, key=lambda t: t.mean)
    for trial in sorted(trials, key=lambda t: t.form.count):
        worse = trial.error - best.error
        # Piece by piece: the difference of two forms scatters far less than the errors of either.
        if float(np.mean(worse)) <= 2.0 * float(np.std(worse)) / math.sqrt(len(worse)):
            return trial
    return best


def _headline(identified: Float, before: Float, separate: bool) -> tuple[Figure, ...]:
    where = "of the separate file" if separate else "held out"
    return (
        Figure(
            "holdout_mean_percent",
            f"mean error of the mean force on cuts {where}, of the force",
            100.0 * float(np.mean(identified)),
            100.0 * float(np.mean(before)),
            LIMIT,
        ),
        Figure(
            "holdout_worst_percent",
            f"largest error of the mean force on cuts {where}, of the force",
            100.0 * float(np.max(identified)),
            100.0 * float(np.max(before)),
        ),
    )


def _source(data: Sequence[Dataset]) -> str:
    return "test cuts " + ", ".join(dict.fromkeys(d.name for d in data))


RECIPE = Recipe(
    name="cutting", title=TITLE, kinds=(KIND,), settings={**PROPOSAL, **SETTINGS}, find=identify, propose=propose
)
