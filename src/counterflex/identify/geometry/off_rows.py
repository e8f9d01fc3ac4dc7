"""Consecutive rows of a session that are all off: a target not yet settled, another tool or reflector, a warm-up.

A fit without these rows predicts them, and a row counts as off where its position differs from the prediction by far
more than nearly all other rows do. Rows that the fit has absorbed do not show in its residuals, so every window is left
out in turn, to first order: with residuals r, Jacobian J and covariance C in fit coordinates::

    (C^-1 - J_w^T J_w) du = J_w^T r_w,    residuals without the window: r + J du

The best window is extended to all rows that are off, and then the fit is made again without them: they are reported
only if that fit confirms it. A row's error counts over ``sqrt(1 + h)``, h the variance of its prediction over that of a
measurement, because poses at the end of the joint space are predicted from afar; over ``sqrt(1 - h)`` where it is
fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import solve

FEWEST: Final = 4
"""Fewest rows of a block: fewer are single outliers, which the robust fit names one by one."""
OTHERS: Final = 8
"""Fewest rows of a session beside the block."""
FAR: Final = 2.5
"""Error of each row of a block over the error that :data:`NEARLY_ALL` of the other rows stay below. Chosen on clean
sessions sorted by the angle of an axis, where it reaches 1.6 (an end of the joint space predicted from the rest)."""
NEARLY_ALL: Final = 0.95
LEFT_OUT: Final = 1.0 / 3.0
"""Largest share of a session that is left out; above it nobody knows which part is right."""
GAPS: Final = 0.1
"""Share of the rows within a block that may happen to be near their prediction."""
_SUSPECT: Final = 3.0
"""Error over the median of the others from which a row is tried: the confirming fit decides."""
_GRID: Final = 24
"""Share of a session, as its inverse, below which a window cannot bend the fit."""
_LONGER: Final = 1.4
_MOST: Final = 3
_LEAST: Final = 1e-12
_LEAST_FREE: Final = 0.1


@dataclass(frozen=True, eq=False)
class FitSession:
    """Rows of one dataset in the order of the file, as rows of the residuals that hold them."""

    data: Dataset
    block: Int  # (n,) which residuals
    row: Int  # (n,) which of their rows

    def left_out(self, keep: Sequence[Bool], rows: Int) -> list[Bool]:
        """Rows of the residuals that are kept, without some of this dataset."""
        out = [k.copy() for k in keep]
        for i in rows:
            out[self.block[i]][self.row[i]] = False
        return out


@dataclass(frozen=True, eq=False)
class OffRows:
    """A block of consecutive rows that are all off."""

    data: Dataset
    rows: Int  # (k,) its rows, from 0, consecutive
    least_m: float  # error of the row that is off least, against the fit without the block
    most_m: float  # the same of the row that is off most
    usual_m: float  # error that NEARLY_ALL of the other rows stay below

    @property
    def share(self) -> float:
        """Of the rows of the session."""
        return len(self.rows) / len(self.data)

    def sentence(self) -> str:
        """The finding in words."""
        first, last = int(self.rows[0]), int(self.rows[-1])
        n = len(self.data)
        where = "at the beginning of" if first == 0 else "at the end of" if last == n - 1 else "within"
        lines = f"lines {int(self.data.line[first])} to {int(self.data.line[last])}"
        others = f"{100.0 * NEARLY_ALL:.0f} % of the other {n - len(self.rows)} rows"
        return (
            f"{self.data.name}: rows {first + 1} to {last + 1} ({lines}) {where} the session are all off, by "
            f"{self.least_m / MM:.3g} to {self.most_m / MM:.3g} mm; {others} are within {self.usual_m / MM:.3g} mm"
        )

    def remedy(self) -> str:
        """Advice: what to look for, and what to write into the manifest."""
        first, last, line = int(self.rows[0]), int(self.rows[-1]), self.data.line
        if first == 0 and last + 1 < len(line):
            keep = f"first_line = {int(line[last + 1])} under [rows]"
        elif last == len(line) - 1 and first > 0:
            keep = f"last_line = {int(line[first - 1])} under [rows]"
        else:
            keep = "two manifests, first_line and last_line under [rows]"
        return (
            f"Look for a target that had not settled, another tool or reflector, a tracker or an arm that was warming "
            f"up; leave them out with {keep}, or give them their own manifest with target or tracker under [settings]"
        )


def off_rows(
    parameters: Parameters, blocks: Sequence[Residuals], fit: Fit, sessions: Sequence[FitSession]
) -> tuple[OffRows, ...]:
    """Find consecutive rows of fitted sessions that are all off."""
    out: list[OffRows] = []
    keep = [np.ones(len(b.group), dtype=np.bool_) for b in blocks]
    for session in sessions:
        suspects: list[Int] = []
        fewer, again = keep, fit
        for _ in range(_MOST):
            rows = _suspected(_OffRows(blocks, again, session, fewer))
            rest = fewer if rows is None else session.left_out(fewer, rows)
            if rows is None or not all(np.any(k) for k in rest):
                break
            suspects.append(rows)
            fewer, again = rest, _fitted(parameters, blocks, again, rest)
            seen = _OffRows(blocks, again, session, fewer)
            confirmed = [b for b in (_confirmed(seen, one) for one in suspects) if b is not None]
            # One block may hide another: what is not confirmed is judged again without the next one.
            if len(confirmed) == len(suspects):
                out += confirmed
                for block in confirmed:
                    keep = session.left_out(keep, block.rows)
                suspects, fewer, fit = [], keep, _fitted(parameters, blocks, again, keep)
                again = fit
    return tuple(out)


def _fitted(parameters: Parameters, blocks: Sequence[Residuals], fit: Fit, keep: Sequence[Bool]) -> Fit:
    return solve(parameters, [b.subset(k) for b, k in zip(blocks, keep, strict=True)], start=fit.values)


def off_rows_of_unseen(blocks: Sequence[Residuals], fit: Fit, sessions: Sequence[FitSession]) -> tuple[OffRows, ...]:
    """Find the same in sessions that are predicted only."""
    none = [np.zeros(len(b.group), dtype=np.bool_) for b in blocks]
    out = []
    for session in sessions:
        seen = _OffRows(blocks, fit, session, none)
        rows = _run(seen.errors())
        block = None if rows is None else _confirmed(seen, rows)
        out += [] if block is None else [block]
    return tuple(out)


def without(
    data: Sequence[Dataset], blocks: Sequence[OffRows], *, as_stated: bool
) -> tuple[list[Dataset], tuple[str, ...]]:
    """Leave blocks of rows out of their datasets.

    ``as_stated``: The user insists on the data as they are: nothing is left out. Raises InputError: more than
    :data:`LEFT_OUT` of a session is off.
    """
    if as_stated:
        return list(data), tuple(f"{b.sentence()}; used as stated, as requested." for b in blocks)
    out, remarks = list(data), []
    for i, d in enumerate(data):
        mine = [b for b in blocks if b.data is d]
        if not mine:
            continue
        keep = np.ones(len(d), dtype=np.bool_)
        for b in mine:
            keep[b.rows] = False
            remarks.append(f"{b.sentence()}. They were left out. {b.remedy()}.")
        if np.mean(~keep) > LEFT_OUT:
            raise InputError(
                mine[0].sentence(),
                where=d.where or d.name,
                value=f"{int(np.sum(~keep))} of {len(d)} rows",
                limit=f"{100.0 * LEFT_OUT:.0f} %, beyond which it is open which part is right",
                hint=f"{mine[0].remedy()}. If the data are right, add --set as_stated=true",
            )
        out[i] = d.rows(keep)
    return out, tuple(remarks)


class _OffRows:
    """Rows of one session at a fit, and their errors without some of them.

    Attributes:
        kept: (n,) rows that were fitted.
    """

    def __init__(self, blocks: Sequence[Residuals], fit: Fit, session: FitSession, kept: Sequence[Bool]) -> None:
        x, free = fit.values, fit.free_index
        slope = fit.parameters.slope(x)[free]
        n = len(session.row)
        self.session, self.covariance = session, fit.covariance
        self._information = np.linalg.inv(fit.covariance)
        self.kept = np.zeros(n, dtype=np.bool_)
        self._r: list[Float] = [np.zeros(0)] * n
        self._J: list[Float] = [np.zeros(0)] * n
        self._off, self._slope = np.zeros((n, 3)), np.zeros((n, 3, len(free)))
        self._variance = np.ones(n)
        fitted = np.cumsum([np.any(k) for k in kept]) - 1
        for b in np.unique(session.block):
            block, mine = blocks[b], np.flatnonzero(session.block == b)
            rows, weights = session.row[mine], np.zeros(len(block.group))
            known = bool(np.any(kept[b]))
            factor = fit.sigma_factors[fitted[b]] if known else max(fit.sigma_factors)
            if known:
                weights[kept[b]] = np.sqrt(fit.weights[fitted[b]])
            residuals, J = block.evaluate(x), block.jacobian(x)[:, :, free] * slope
            size = block.sigma[rows][:, :3]
            self.kept[mine] = kept[b][rows]
            self._off[mine] = residuals[rows][:, :3] * size
            self._slope[mine] = J[rows][:, :3] * size[:, :, None]
            self._variance[mine] = factor**2 * np.sum(size**2, axis=1)
            for i, row in zip(mine, rows, strict=True):
                self._r[i], self._J[i] = (weights[row] / factor * part[row] for part in (residuals, J))

    def lengths(self) -> Float:
        """(n,) m, errors of the positions."""
        out: Float = np.linalg.norm(self._off, axis=1)
        return out

    def errors(self, window: Int | None = None) -> Float:
        """(n,) m: errors of the positions, of equal variance; without a window of rows, to first order."""
        C, off, inside = self.covariance, self._off, ~self.kept
        if window is not None:
            J, r = np.concatenate([self._J[i] for i in window]), np.concatenate([self._r[i] for i in window])
            value, vector = np.linalg.eigh(self._information - J.T @ J)
            # Without a window that alone holds a parameter the information is singular or, by rounding, negative there.
            C = (vector / np.maximum(value, _LEAST * value[-1])) @ vector.T
            off = off + self._slope @ (C @ (J.T @ r))
            inside = inside.copy()
            inside[window] = True
        h = np.sum((self._slope @ C) * self._slope, axis=(1, 2)) / self._variance
        scale = np.where(inside, 1.0 + h, np.maximum(1.0 - h, _LEAST_FREE))
        out: Float = np.linalg.norm(off, axis=1) / np.sqrt(scale)
        return out


def _suspected(seen: _OffRows) -> Int | None:
    """Rows of the window that is off most when it is left out, extended to all that are off beside it."""
    n = len(seen.session.row)
    if np.sum(seen.kept) < OTHERS + FEWEST:
        return None
    best, rows = 0.0, _run(np.where(seen.kept, seen.errors(), 0.0))
    for length in _lengths(n):
        for first in range(0, n - length + 1, max(1, length // 4)):
            window = np.arange(first, first + length)
            if not np.all(seen.kept[window]):
                continue
            error = np.where(seen.kept, seen.errors(window), 0.0)
            # Their median, not their largest: the rest of the same block may still lie outside of the window.
            others = np.delete(error, window)
            # Rows of the same block may lie outside of the window: the upper part of the others says little yet.
            score = float(np.quantile(error[window], GAPS)) / max(float(np.median(others)), 1e-12)
            if score > max(best, _SUSPECT):
                run = _run(error, window)
                best, rows = (score, run) if run is not None else (best, rows)
    return rows


def _lengths(n: int) -> list[int]:
    """Lengths of windows: from those that can bend a fit of n rows to its half."""
    out, length = [], float(max(FEWEST, n // _GRID))
    while length <= (n - OTHERS) and length <= 0.5 * n:
        out.append(round(length))
        length *= _LONGER
    return sorted(set(out))


def _run(error: Float, window: Int | None = None) -> Int | None:
    """The longest run of rows that are off, about a window where one is given; None where there is none."""
    # Rows are off beyond FAR times what NEARLY_ALL of the rest stay below, the rest being all others.
    usual = float(np.median(error if window is None else np.delete(error, window)))
    off = error > _SUSPECT * usual
    best: Int | None = None
    starts = np.flatnonzero(off & ~np.r_[False, off[:-1]])
    for first in starts.tolist():
        last = first
        for i in range(first + 1, len(off)):
            if off[i] and np.mean(~off[first : i + 1]) <= GAPS:
                last = i
        if window is not None and not (first <= window[-1] and last >= window[0]):
            continue
        if last - first + 1 >= FEWEST and (best is None or last - first + 1 > len(best)):
            best = np.arange(first, last + 1)
    return best


def _confirmed(seen: _OffRows, rows: Int) -> OffRows | None:
    """The block, trimmed to rows that are off against the fit without it; None where they are not."""
    error, length = seen.errors(), seen.lengths()
    others = seen.kept.copy() if np.any(seen.kept) else np.ones(len(error), dtype=np.bool_)
    others[rows] = False
    if np.sum(others) < OTHERS:
        return None
    off = error > FAR * float(np.quantile(error[others], NEARLY_ALL))
    mine = rows[off[rows]]
    if len(mine) < FEWEST:
        return None
    block = np.arange(mine[0], mine[-1] + 1)
    if np.mean(~off[block]) > GAPS:
        return None
    rest = float(np.quantile(length[others], NEARLY_ALL))
    return OffRows(seen.session.data, block, float(np.min(length[mine])), float(np.max(length[mine])), rest)
