"""Error on data not used: k folds of whole groups, or a separate file.

What is scored is the *use* of the parameters: every row is predicted by a fit that has not seen its group. Beside it
stands the nominal error: the same rows, the same folds, with all parameters at what was known before, except those that
any use has to find first (frames and the like, named by the recipe), which both fits find on the training part.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, share_of, silent
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import Stop, solve

FOLDS: Final = 5
GROSS: Final = 10.0
"""A row off by this many medians with the identified and with the nominal values counts as a gross error."""
_WHOLE: Final = 0.8
"""Share of the work that the fit of all parameters takes, beside that of those needed first."""

RowError = Callable[[Residuals, Float], Float]
"""``error(block, x)`` -> (rows,) error of each row in SI, for the score."""


@dataclass(frozen=True, eq=False)
class Folds:
    """Dealing of rows to the folds that hold them out."""

    count: int = FOLDS
    seed: int = 0  # of the dealing
    # per scored block (rows,) the part 0.. that each row is held out with (regions, files), in place of `count` folds
    # of groups dealt at random
    parts: Mapping[int, Int] | None = None


DEALT: Final = Folds()


class Local(NamedTuple):
    """Parameters that only a separate file has."""

    names: Collection[str] = ()
    blocks: Sequence[Residuals] = ()  # residuals that they are fitted to; empty is the file's own


def row_error(block: Residuals, x: Float) -> Float:
    """Length of each row's residual in SI: (rows,) in the unit of the components, which must be one and the same."""
    out: Float = np.linalg.norm(block.evaluate(x) * block.sigma, axis=1)
    return out


def position_error(block: Residuals, x: Float) -> Float:
    """Length of the first three components of each row's residual, m: the position of a pose or a point."""
    out: Float = np.linalg.norm((block.evaluate(x) * block.sigma)[:, :3], axis=1)
    return out


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of held-out rows."""

    block: Int  # (n,) place of each scored row's block in what was given
    row: Int  # (n,) its row in that block
    fold: Int  # (n,) the fold that held it out; 0 for a separate file
    nominal: Float  # (n,) error with the values known before, SI
    identified: Float  # (n,) error with the values found, SI
    gross: Bool  # (n,) gross errors of the measurement, left out of the figures: see GROSS
    fits: tuple[Fit, ...]  # the fits of the folds; of a separate file one

    @property
    def count(self) -> int:
        """Rows that the figures rest on."""
        return int(np.sum(~self.gross))

    def mean(self) -> tuple[float, float]:
        """Mean error (identified, nominal), SI."""
        return float(np.mean(self.identified[~self.gross])), float(np.mean(self.nominal[~self.gross]))

    def rms(self) -> tuple[float, float]:
        """Root mean square error (identified, nominal), SI."""
        identified, before = self.identified[~self.gross], self.nominal[~self.gross]
        return float(np.sqrt(np.mean(identified**2))), float(np.sqrt(np.mean(before**2)))

    def largest(self) -> tuple[float, float]:
        """Largest error (identified, nominal), SI."""
        return float(np.max(self.identified[~self.gross])), float(np.max(self.nominal[~self.gross]))

    def quantile(self, share: float) -> tuple[float, float]:
        """Error that this share (0..1) of the rows keeps (identified, nominal), SI."""
        identified, before = self.identified[~self.gross], self.nominal[~self.gross]
        return float(np.quantile(identified, share)), float(np.quantile(before, share))


def fold_of_groups(groups: Sequence[Int], folds: int = FOLDS, seed: int = 0) -> tuple[Int, ...]:
    """Deal whole groups to folds so that each block has about the same number of rows in every fold.

    Args:
        groups: Per block (rows,) group ids, shared between the blocks.
        folds: How many; fewer where there are fewer groups.
        seed: Of the order in which groups are dealt.

    Returns:
        Per block (rows,) the fold 0..folds-1 of every row.

    Raises:
        InputError: Fewer than two folds or fewer than two groups.
    """
    ids = np.unique(np.concatenate([np.asarray(g, dtype=np.int64) for g in groups])) if groups else np.zeros(0, int)
    if folds < 2 or len(ids) < 2:
        raise InputError(
            "too few groups of rows to hold any out",
            value=f"{len(ids)} groups, {folds} folds",
            limit="at least 2 of each",
            hint="Measure more poses, or give a separate file with --holdout",
        )
    folds = min(folds, len(ids))
    sizes = np.zeros((len(ids), len(groups)))
    places = [np.searchsorted(ids, g) for g in groups]
    for b, place in enumerate(places):
        np.add.at(sizes[:, b], place, 1.0)
    order = np.random.default_rng(seed).permutation(len(ids))
    # The largest groups first: what is dealt last fills up the differences, which only small ones can.
    order = order[np.argsort(-sizes[order].sum(axis=1), kind="stable")]
    filled = np.zeros((folds, len(groups)))
    total = np.maximum(sizes.sum(axis=0), 1.0)
    fold_of = np.empty(len(ids), dtype=np.int64)
    for i in order:
        load = np.sum((filled + sizes[i]) ** 2 / total - filled**2 / total, axis=1)
        fold_of[i] = int(np.argmin(load))
        filled[fold_of[i]] += sizes[i]
    return tuple(fold_of[place] for place in places)


def cross_validate(
    parameters: Parameters,
    blocks: Sequence[Residuals],
    *,
    needed: Collection[str] = (),
    error: RowError = row_error,
    scored: Collection[int] | None = None,
    folds: Folds = DEALT,
    robust: bool = True,
    start: Float | None = None,
    stop: Stop | None = None,
    progress: Progress = silent,
) -> HeldOut:
    """Predict every row by a fit that has not seen its group.

    Args:
        parameters: As for :func:`counterflex.identify.solver.solve.solve`.
        needed: Names of parameters that any use has to find first (frames): fitted for the nominal error as well.
        error: Error of the rows of a block at given values.
        scored: Places of the blocks that are scored; None scores all. Blocks not scored always train.
        start: (p,) SI to start the fits from; None is nominal.
        progress: Told about folds.

    Returns:
        Errors of all scored rows, in the order of blocks and rows.

    Raises:
        InputError: Too few groups, or a name in ``needed`` that is no parameter.
    """
    judged = range(len(blocks)) if scored is None else sorted(scored)
    if folds.parts is None:
        dealt = dict(
            zip(judged, fold_of_groups([blocks[i].group for i in judged], folds.count, folds.seed), strict=True)
        )
    else:
        dealt = {i: np.asarray(folds.parts[i], dtype=np.int64) for i in judged}
    count = 1 + max(int(np.max(f, initial=0)) for f in dealt.values())
    pieces: list[tuple[int, Int, int, Float, Float]] = []
    fits = []
    for fold in range(count):
        training = [b.subset(dealt[i] != fold) if i in dealt else b for i, b in enumerate(blocks)]
        fold_progress = share_of(progress, fold / count, (fold + 1) / count, f"held out {fold + 1} of {count}")
        pair = _fit_both(parameters, training, needed, robust, start, stop, fold_progress)
        fits.append(pair[0])
        for i in judged:
            mine = dealt[i] == fold
            if np.any(mine):
                unseen = blocks[i].subset(mine)
                identified, before = error(unseen, pair[0].values), error(unseen, pair[1])
                pieces.append((i, np.flatnonzero(mine), fold, before, identified))
        fold_progress(1.0)
    return _collect(pieces, fits)


def score_separate(
    parameters: Parameters,
    blocks: Sequence[Residuals],
    unseen: Sequence[Residuals],
    *,
    needed: Collection[str] = (),
    local: Collection[str] | Local = (),
    error: RowError = row_error,
    robust: bool = True,
    start: Float | None = None,
    stop: Stop | None = None,
    progress: Progress = silent,
) -> HeldOut:
    """Predict the rows of a separate file by a fit to the other data.

    Args:
        blocks: Measurements to fit.
        unseen: Measurements to predict.
        needed: Names of parameters that any use has to find first: fitted to ``blocks`` for the nominal error as well.
        local: Names of parameters that are found anew for the separate file (the tracker stood elsewhere that day):
            fitted to ``unseen``, or the blocks named there, all others held, for both errors.
        error: Error of the rows of a block at given values.
        start: (p,) SI to start the fit from; None is nominal.
        progress: Told about the fits.

    Returns:
        Errors of all rows of ``unseen``.

    Raises:
        InputError: Nothing to predict, or an unknown name.
    """
    if sum(len(b.group) for b in unseen) == 0:
        raise InputError("the separate file contains nothing to predict")
    own = local if isinstance(local, Local) else Local(local)
    for name in own.names:
        parameters.index(name)
    fit, nominal = _fit_both(parameters, blocks, needed, robust, start, stop, progress)
    values, before = fit.values, nominal
    if own.names:
        placing = own.blocks or unseen
        values = _with_local(parameters, values, own.names, placing, robust, stop)
        before = _with_local(parameters, before, own.names, placing, robust, stop)
    pieces = [
        (i, np.arange(len(b.group), dtype=np.int64), 0, error(b, before), error(b, values))
        for i, b in enumerate(unseen)
    ]
    return _collect(pieces, [fit])


def _fit_both(
    parameters: Parameters,
    training: Sequence[Residuals],
    needed: Collection[str],
    robust: bool,
    start: Float | None,
    stop: Stop | None,
    progress: Progress,
) -> tuple[Fit, Float]:
    """The fit, and the values known before with what any use needs fitted."""
    for name in needed:
        parameters.index(name)
    fit = solve(parameters, training, robust=robust, start=start, stop=stop, progress=share_of(progress, 0.0, _WHOLE))
    # The nominal error gets frames of its own: else it would show where the tracker stands, not what the arm is off by.
    only = parameters.with_fixed([name for name in parameters.names if name not in set(needed)])
    if not np.any(only.free):
        return fit, parameters.nominal
    begin = parameters.nominal
    if start is not None:
        begin = np.where(only.free, start, begin)
    nominal_progress = share_of(progress, _WHOLE, 1.0)
    return fit, solve(only, training, robust=robust, start=begin, stop=stop, progress=nominal_progress).values


def _with_local(
    parameters: Parameters,
    values: Float,
    names: Collection[str],
    blocks: Sequence[Residuals],
    robust: bool,
    stop: Stop | None,
) -> Float:
    own = {name: float(v) for name, v in zip(parameters.names, values, strict=True) if name not in set(names)}
    return solve(parameters.with_nominal(own).with_fixed(own), blocks, robust=robust, start=values, stop=stop).values


def _collect(pieces: Sequence[tuple[int, Int, int, Float, Float]], fits: Sequence[Fit]) -> HeldOut:
    block = np.concatenate([np.full(len(rows), i, dtype=np.int64) for i, rows, _, _, _ in pieces])
    row = np.concatenate([rows for _, rows, _, _, _ in pieces])
    fold = np.concatenate([np.full(len(rows), f, dtype=np.int64) for _, rows, f, _, _ in pieces])
    nominal = np.concatenate([before for _, _, _, before, _ in pieces])
    identified = np.concatenate([errors for _, _, _, _, errors in pieces])
    gross = np.zeros(len(row), dtype=np.bool_)
    for i in np.unique(block):
        mine = block == i
        # Both must be far off: a row that only the new values miss is their error, and must count against them.
        gross[mine] = (identified[mine] > GROSS * np.median(identified[mine])) & (
            nominal[mine] > GROSS * np.median(nominal[mine])
        )
    order = np.lexsort((row, block))
    return HeldOut(block[order], row[order], fold[order], nominal[order], identified[order], gross[order], tuple(fits))
