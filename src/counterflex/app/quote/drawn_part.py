"""Parts that drawn errors of the path would leave, as parts that can be measured.

The deviation of a place of the surface is that of :mod:`counterflex.evaluate.path_error.contacts`, of first order in
the error: of all stretches of the path near the place the one that takes most decides. Walls are looked at where the
evaluator's rays meet them, floors at its places; its filter of floors is left out, since one pass of the tool is wider.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import scipy

from counterflex.app.quote.path_errors import PathErrors
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.evaluate.measured_values import height_at
from counterflex.evaluate.path_error.contacts import contacts_of
from counterflex.evaluate.surface import NominalSurface
from counterflex.evaluate.swept_section import swept_section

_BATCH: Final = 100
"""Draws that are looked at together: 1e5 contacts of them take 80 MB."""
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
