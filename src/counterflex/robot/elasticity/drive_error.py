"""Errors of drives: the angle that a link truly has at the angle that the controller shows.

``q_link = q + sum_k (s_k sin(k q) + c_k (cos(k q) - 1))`` for each axis by itself: eccentric gears, encoder discs and
cyclic errors of their reading. Zero at q = 0, which leaves constant offsets to the geometry. What was fitted to a range
of angles says nothing beyond it: there the error fades to zero within :data:`FADE_RAD`. Where the cell has it, what own
weight turns axes 2 and 3 by (:mod:`counterflex.robot.elasticity.axis_sag`) is added; that holds at all angles.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG
from counterflex.robot.elasticity.axis_sag import AxisSag

STEEPEST: Final = 0.5
"""Largest slope of the error that is accepted: beyond it the map from link to controller angle is in doubt."""
FADE_RAD: Final = 10.0 * DEG
"""Angle beyond the measured ones over which an error fades (a smooth step)."""
_STEEP_FADE = 1.5 / FADE_RAD
_ROUNDS = 60
_REST_RAD = 1e-13


@dataclass(frozen=True)
class DriveError:
    """One harmonic of one axis."""

    axis: int  # 0..5
    order: int  # k, periods per turn of the axis
    sine_rad: float  # s_k
    cosine_rad: float  # c_k


@dataclass(frozen=True)
class DriveErrors:
    """The errors of all axes."""

    terms: tuple[DriveError, ...] = ()  # any number per axis
    # lowest and highest angle of each axis that they were found from; empty where not known
    measured_rad: tuple[tuple[float, float], ...] = ()
    sag: AxisSag | None = None  # what own weight turns axes 2 and 3 by, where masses are not known; or None

    def __bool__(self) -> bool:
        """Return whether links are anywhere else than the controller shows."""
        return bool(self.terms) or self.sag is not None

    def __post_init__(self) -> None:
        """Check that each axis keeps turning forward.

        Raises:
            ModelError: An axis that does not exist, an order below 1, or amplitudes that are far too large.
        """
        if self.measured_rad and (len(self.measured_rad) != 6 or any(low > high for low, high in self.measured_rad)):
            raise ModelError(
                "the measured angles of drive errors are not six ranges", value=self.measured_rad, limit="low <= high"
            )
        slope = np.zeros(6)
        for term in self.terms:
            if not 0 <= term.axis <= 5 or term.order < 1:
                raise ModelError("a drive error names no harmonic of an axis", value=(term.axis + 1, term.order))
            size = float(np.hypot(term.sine_rad, term.cosine_rad))
            slope[term.axis] += term.order * size + (2.0 * _STEEP_FADE * size if self.measured_rad else 0.0)
        if np.any(slope > STEEPEST):
            axis = int(np.argmax(slope))
            raise ModelError(
                "the periodic errors of a drive are far too large",
                where=f"axis {axis + 1}",
                value=f"{slope[axis]:.3g} rad per rad",
                limit=f"<= {STEEPEST:g}",
                hint="Check the unit: urad",
            )

    def link_angles(self, q: Float) -> Float:
        """Angles that the links truly have.

        Args:
            q: (..., 6) rad, shown by the controller.

        Returns:
            (..., 6) rad.
        """
        q = as_float("q", q)
        out: Float = q + self._of(q)
        return out

    def controller_angles(self, q_link: Float) -> Float:
        """Angles to command so that the links get where they should: the inverse of :meth:`link_angles`.

        Args:
            q_link: (..., 6) rad, true angles.

        Returns:
            (..., 6) rad; exact to rounding (fixed-point iteration, a contraction by the check on slopes).
        """
        requested = as_float("q_link", q_link)
        q = requested
        for _ in range(_ROUNDS):
            step = requested - self._of(q)
            if float(np.max(np.abs(step - q), initial=0.0)) < _REST_RAD:
                return step
            q = step
        return q

    def merged(self, others: Iterable[DriveError]) -> DriveErrors:
        """These and others, amplitudes of the same harmonic added."""
        sums: dict[tuple[int, int], tuple[float, float]] = {}
        for term in (*self.terms, *others):
            s, c = sums.get((term.axis, term.order), (0.0, 0.0))
            sums[(term.axis, term.order)] = (s + term.sine_rad, c + term.cosine_rad)
        terms = tuple(DriveError(a, k, s, c) for (a, k), (s, c) in sorted(sums.items()))
        return replace(self, terms=terms)

    def outside(self, q: Float) -> tuple[int, ...]:
        """Axes 0..5 with errors that angles (..., 6) rad move beyond what was measured."""
        if not self.measured_rad:
            return ()
        flat = as_float("q", q).reshape(-1, 6)
        return tuple(
            axis
            for axis in sorted({term.axis for term in self.terms})
            if len(flat)
            and (
                float(flat[:, axis].min()) < self.measured_rad[axis][0]
                or float(flat[:, axis].max()) > self.measured_rad[axis][1]
            )
        )

    def _of(self, q: Float) -> Float:
        out = np.zeros_like(q)
        for term in self.terms:
            angle = term.order * q[..., term.axis]
            out[..., term.axis] += term.sine_rad * np.sin(angle) + term.cosine_rad * (np.cos(angle) - 1.0)
        for axis, (low, high) in enumerate(self.measured_rad):
            beyond = np.maximum(np.maximum(low - q[..., axis], q[..., axis] - high), 0.0)
            # The sag is added behind the fade: it follows from weights, not from a range of measured angles.
            share = np.clip(1.0 - beyond / FADE_RAD, 0.0, 1.0)
            out[..., axis] *= share * share * (3.0 - 2.0 * share)
        return out if self.sag is None else out + self.sag.turns(q)
