"""Probability that a feature keeps its tolerance: the share of drawn cells in which it does.

A share of draws is itself known by their number only: of k of n that hold, the probability is that of Jeffreys' prior,

    p = (k + 1/2) / (n + 1),   90 % of it within the quantiles of Beta(k + 1/2, n - k + 1/2)

so that it is never 0 or 1. Source: Brown, Cai and DasGupta 2001, "Interval estimation for a binomial proportion".

Parts that drawn errors of the path would leave, as parts that can be measured.

The deviation of a place of the surface is that of :mod:`counterflex.evaluate.path_error.contacts`, of first order in
the error: of all stretches of the path near the place the one that takes most decides. Walls are looked at where the
evaluator's rays meet them, floors at its places; its filter of floors is left out, since one pass of the tool is wider.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from counterflex.app.inputs import Job
from counterflex.app.proof.judge import candidates_of, outline_of
from counterflex.app.quote.path_errors import PathErrors
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.evaluate.feature_finding import Feature
from counterflex.evaluate.features import FeatureRow, Machined, measure_features
from counterflex.evaluate.inspection.cad_rows import CadFeatures
from counterflex.evaluate.inspection.feature_rows import features_shown
from counterflex.evaluate.measured_values import height_at
from counterflex.evaluate.path_error.contacts import contacts_of
from counterflex.evaluate.prismatic.finding import PrismaticFeature
from counterflex.evaluate.surface import NominalSurface
from counterflex.evaluate.swept_section import swept_section
from counterflex.files.cell.cell import Cell

_BATCH: Final = 100  # Draws that are looked at together: 1e5 contacts of them take 80 MB
_SLOPE_M: Final = 0.75 * MM
_EVEN_M: Final = 50.0 * UM
"""Difference of the rise over that length to either side above which a floor is not one slope."""


class DrawnParts:
    """All drawn parts; each is asked alone, the values of all are found together."""

    def __init__(
        self,
        errors: PathErrors,
        surface: NominalSurface,
        p_part_tcp: Float,
        outline: Float | None,
        cutter_of: Callable[[int], Cutter],
    ) -> None:
        """Prepare the parts.

        Args:
            surface: That the undisturbed program makes.
            p_part_tcp: (n, 3) m, its path.
            outline: (n, 2) m, radius and corner radius of the tool at each row of it; None: one tool.
            cutter_of: Gives the cutter of a tool number.
        """
        self._errors, self._surface, self._cutter_of = errors, surface, cutter_of
        reach = surface.cutter.radius_m + surface.reach_m
        self._section = swept_section(p_part_tcp, surface.cutter if outline is None else outline, reach)
        self._flat = np.ascontiguousarray(errors.error_m.reshape(len(errors.error_m), -1).T)  # (3 k, draws)
        size = np.linalg.norm(errors.error_m, axis=2)
        self._reach_m = 2.0 * float(size.max(initial=0.0))
        self._known: dict[bytes, Float] = {}

    def parts(self) -> dict[str, DrawnPart]:
        """Every drawn part by its number."""
        return {str(k): DrawnPart(self, k) for k in range(len(self._errors.error_m))}

    def left(self, points: Float, normals: Float) -> Float:
        """(m, draws) m, material left at places (m, 3) with outward normals; nan where the program made none."""
        errors, path = self._errors, self._errors.plan.path
        contacts = contacts_of(path, errors.nodes, self._cutter_of, points, normals, self._reach_m)
        out = np.full((len(points), self._flat.shape[1]), np.nan)
        if len(contacts.place) == 0:
            return out
        pairs, k = len(contacts.place), 3 * contacts.node
        columns = np.concatenate([k + c for c in range(3)] + [k - 3 + c for c in range(3)])
        weight = [contacts.share * contacts.normal[:, c] for c in range(3)]
        weight += [(1.0 - contacts.share) * contacts.normal[:, c] for c in range(3)]
        A = scipy.sparse.csr_matrix(
            (np.concatenate(weight), (np.tile(np.arange(pairs), 6), columns)), (pairs, len(self._flat))
        )
        begin, made = np.flatnonzero(np.diff(contacts.place, prepend=-1)), np.flatnonzero(contacts.made)
        for first in range(0, out.shape[1], _BATCH):
            some = slice(first, first + _BATCH)
            own = contacts.gap_m[:, None] + A @ self._flat[:, some]
            out[made, some] = np.minimum.reduceat(own, begin, axis=0)
        return out

    def exits(self, point: Float, direction: Float) -> Float:
        """(m, draws) m, reach of the cut along rays, see :class:`.MeasurablePart`."""
        key = b"wall" + np.ascontiguousarray(point).tobytes() + np.ascontiguousarray(direction).tobytes()
        if key not in self._known:
            nominal, normal = self._section.wall_exit(point, direction, 0.0)
            there = np.isfinite(nominal)
            place = point.copy()
            place[:, :2] += np.where(there, nominal, 0.0)[:, None] * direction
            outward = np.column_stack([-normal, np.zeros(len(point))])
            slant = np.sum(normal * direction, axis=1)
            slant = np.where(there & (np.abs(slant) > 0.1), slant, np.nan)
            self._known[key] = nominal[:, None] - self.left(place, outward) / slant[:, None]
        return self._known[key]

    def heights(self, xy: Float) -> Float:
        """(m, draws) m, heights of the floor, see :class:`.MeasurablePart`."""
        key = b"floor" + np.ascontiguousarray(xy).tobytes()
        if key not in self._known:
            base, normal = height_at(self._surface.nominal, xy), self._upward(xy)
            there = np.isfinite(base)
            place = np.column_stack([xy, np.where(there, base, 0.0)])
            rise = self.left(place, normal) / normal[:, 2:]
            self._known[key] = np.where(there, base, np.nan)[:, None] + rise
        return self._known[key]

    def _upward(self, xy: Float) -> Float:
        """(m, 3) unit normals of the nominal floor; straight up where it is level, bends or ends."""
        grid, here, ways = self._surface.nominal, height_at(self._surface.nominal, xy)[:, None], _SLOPE_M * np.eye(2)
        ahead = np.stack([height_at(grid, xy + way) for way in ways], axis=1) - here
        behind = here - np.stack([height_at(grid, xy - way) for way in ways], axis=1)
        floor = np.all(np.abs(ahead - behind) < _EVEN_M, axis=1)  # beside a wall, or off the map, it is not
        slope = 0.5 * (ahead + behind) / _SLOPE_M
        normal = np.column_stack([-np.where(floor[:, None], slope, 0.0), np.ones(len(xy))])
        out: Float = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return out


class DrawnPart:
    """One of the drawn parts: a :class:`.MeasurablePart`."""

    def __init__(self, parts: DrawnParts, number: int) -> None:
        """Name the part by its number."""
        self._parts, self._number = parts, number

    def exits(self, point: Float, direction: Float) -> Float:
        """See :class:`.MeasurablePart`."""
        out: Float = self._parts.exits(point, direction)[:, self._number]
        return out

    def heights(self, xy: Float) -> Float:
        """See :class:`.MeasurablePart`."""
        out: Float = self._parts.heights(xy)[:, self._number]
        return out


_WIDE: Final = (0.05, 0.95)
_WIDEST: Final = 0.9
UNTOUCHED: Final = "the program cuts no such feature"
PARTLY: Final = "the program cuts a part of it"
NO_TOLERANCE_KIND: Final = "no draw informs a tolerance of this kind"
Tolerances = Mapping[tuple[str, str], float]


@dataclass(frozen=True)
class Share:
    """Probability by the share of draws, with what the number of draws leaves open."""

    held: int
    of: int

    @property
    def probability(self) -> float:
        """Mean of it."""
        return (self.held + 0.5) / (self.of + 1.0)

    @property
    def interval(self) -> tuple[float, float]:
        """Ends between which it lies in nine of ten cases, as far as the number of draws goes."""
        low, high = scipy.stats.beta.ppf(_WIDE, self.held + 0.5, self.of - self.held + 0.5)
        return float(low), float(high)


@dataclass(frozen=True, eq=False)
class DrawnFeature:
    """A quantity of a feature over the drawn cells."""

    feature: str
    quantity: str
    nominal_m: float
    tolerance_m: float
    tolerance_source: str
    off_m: Float  # (draws,) m, worst value less nominal

    def ok(self, tolerance_m: float | None = None) -> Bool:
        """(draws,) whether it holds the tolerance, its own or another one."""
        out: Bool = np.abs(self.off_m) <= (self.tolerance_m if tolerance_m is None else tolerance_m)
        return out

    def held(self, tolerance_m: float | None = None) -> Share:
        """Probability to hold the tolerance, its own or another one."""
        ok = self.ok(tolerance_m)
        return Share(int(np.count_nonzero(ok)), len(ok))

    @property
    def off_90_m(self) -> tuple[float, float]:
        """Ends of what it is off in nine of ten cells, m."""
        low, high = np.quantile(self.off_m, _WIDE)
        return float(low), float(high)

    @property
    def held_90_m(self) -> float:
        """Tolerance, +- m, that nine of ten cells hold."""
        return float(np.quantile(np.abs(self.off_m), _WIDEST))


@dataclass(frozen=True, eq=False)
class Quoted:
    """Features of a part over the drawn cells."""

    features: tuple[DrawnFeature, ...]
    not_looked_at: tuple[tuple[str, str], ...]  # What no probability is given of, and why

    @property
    def all_held(self) -> Share:
        """Probability that all features that are looked at hold at once."""
        ok = np.all([one.ok() for one in self.features], axis=0)
        return Share(int(np.count_nonzero(ok)), len(ok))

    @property
    def mean(self) -> float:
        """Mean probability of the features."""
        return float(np.mean([one.held().probability for one in self.features]))


@dataclass(frozen=True, eq=False)
class QuotedPart:
    """Part that is quoted: the surface that the program makes, faces of a solid, tolerances."""

    job: Job
    cell: Cell
    surface: NominalSurface
    faces: CadFeatures | None = None
    tolerances_m: Tolerances | None = None
    not_measured: tuple[str, ...] = ()  # Names of tolerances of the CAD file that no face holds

    def require_made(self) -> None:
        """Refuse tolerances of other features than the program makes, before minutes of drawing.

        Raises:
            InputError: None of them names a feature of the program.
        """
        given, made = list(self.tolerances_m or {}), [one.name for one in self.features]
        if given and not {feature for feature, _ in given} & set(made):
            raise InputError(
                "none of the tolerances is of what the program makes",
                value=f"{given[0][1]} of {given[0][0]}",
                limit=", ".join(made) or "nothing",
                hint="Features are named as in the table of inspect and prove",
            )

    def quoted(self, errors: PathErrors) -> Quoted:
        """Measure the features on every drawn part.

        Raises:
            InputError: No tolerance is of a feature that the program makes.
        """
        path, cell, given = self.job.path, self.cell, self.tolerances_m or {}
        outline = outline_of(path, cell)
        drawn = DrawnParts(errors, self.surface, path.p_part_tcp, outline, cell.cutter)
        parts = drawn.parts()
        rows = measure_features(self.surface, path.p_part_tcp, self.features, parts, given, outline=outline)
        left_out = [(name, NO_TOLERANCE_KIND) for name in self.not_measured]
        if self.faces is not None:
            of_faces, untouched = self.faces.drawn(drawn.left)
            rows = (*rows, *of_faces)
            left_out += [(name, UNTOUCHED) for name in untouched]
        left_out += self._without_rows(rows)
        looked_at = []
        for row in rows:
            if len(row.worst_m) < len(parts) or any(row.partly(name) for name in row.worst_m):
                left_out.append((f"{row.quantity} of {row.feature}", PARTLY))
            else:
                looked_at.append(_drawn(row, parts))
        if not looked_at:
            raise InputError(
                "the program makes no feature whose tolerance could be quoted", where=self.job.program.name
            )
        return Quoted(tuple(looked_at), tuple(left_out))

    @cached_property
    def features(self) -> tuple[Feature | PrismaticFeature, ...]:
        """Features that the undisturbed program makes."""
        path, outline = self.job.path, outline_of(self.job.path, self.cell)
        made = Machined(self.surface.nominal, path.p_part_tcp, None, outline)
        return features_shown(self.surface, path.p_part_tcp, candidates_of(path, self.cell), made, outline)

    def _without_rows(self, rows: Sequence[FeatureRow]) -> list[tuple[str, str]]:
        """Tolerances of what the program does not make, or of what no draw informs."""
        measured = {(row.feature, row.quantity) for row in rows}
        made = {row.feature for row in rows}
        missing = [key for key in self.tolerances_m or {} if key not in measured]
        if missing and len(missing) == len(self.tolerances_m or {}):
            raise InputError(
                "none of the tolerances is of what the program makes",
                value=f"{missing[0][1]} of {missing[0][0]}",
                limit=", ".join(f"{row.quantity} of {row.feature}" for row in rows) or "nothing",
            )
        return [
            (f"{quantity} of {feature}", NO_TOLERANCE_KIND if feature in made else UNTOUCHED)
            for feature, quantity in missing
        ]


def _drawn(row: FeatureRow, parts: Mapping[str, object]) -> DrawnFeature:
    off = np.array([row.worst_m[name] for name in parts]) - row.nominal_m
    return DrawnFeature(row.feature, row.quantity, row.nominal_m, row.tolerance_m, row.tolerance_source, off)
