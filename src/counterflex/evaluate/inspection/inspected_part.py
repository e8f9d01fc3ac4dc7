"""Inspected part as features, sections and maps need it: a measured surface, or a measured path of the tool."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.evaluate.inspection.registration import Registration
from counterflex.evaluate.surface import SurfaceDeviation


class InspectedPart(Protocol):
    """A measured part on its nominal one."""

    @property
    def part(self) -> NominalPart:
        """Nominal part."""

    @property
    def registration(self) -> Registration:
        """Registration on the nominal part."""

    @property
    def rows(self) -> PartDeviations:
        """Deviations at places of the nominal surface."""

    @property
    def pitch_m(self) -> float:
        """Distance of the rows from each other, m."""

    @property
    def left_out(self) -> Float:
        """(k, 3) m, measured points that count for no face, part frame."""

    @property
    def p_part_tcp(self) -> Float:
        """(n, 3) m, the undisturbed path, part frame."""

    @property
    def nominal_outline(self) -> Float | None:
        """(n, 2) m, radius and corner radius of the tool at each row of that path; None: one tool."""

    def shifted(self, step: Float) -> InspectedPart:
        """The same part lying elsewhere by a small shift and turn (6,) about the registration's centre: m, rad."""

    def redrawn(self, rng: np.random.Generator) -> InspectedPart | None:
        """The same part with the noise of its measurement added once more; None where that is not possible."""

    def exits(self, point: Float, direction: Float) -> Float:
        """See :class:`~counterflex.evaluate.features.MeasurablePart`."""

    def heights(self, xy: Float) -> Float:
        """See :class:`~counterflex.evaluate.features.MeasurablePart`."""

    def place_sigma_m(self) -> float:
        """Standard deviation of a wall or floor place by the noise of the measurement alone, m."""

    def surface_deviation(self) -> SurfaceDeviation:
        """The map."""
