"""Sections across grooves: the nominal profile and the measured points beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.feature_finding import Feature, Groove
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.evaluate.inspection.registration import Registration
from counterflex.evaluate.measured_values import height_at
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


HALF_M: Final = 1.0 * MM
"""Points nearer to the plane of a section than this belong to it."""
BESIDE_M: Final = 5.0 * MM
"""The section reaches this far beyond the walls."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Measured points of one part in a section, in the plane of the section."""

    across_m: Float  # (n,) m, foot on the nominal surface, to the left of the programmed motion
    height_m: Float  # (n,) m, part z
    normal: Float  # (n, 2) outward normals, across and up
    deviation_m: Float  # (n,) m, positive = material left


@dataclass(frozen=True, eq=False)
class PartSection:
    """A section square to a groove."""

    feature: str  # name of the groove
    place_m: float  # from its start, m
    across_m: Float  # (k,) of the nominal profile, m, to the left of the programmed motion
    height_m: Float  # (k,) of the nominal profile, m, part z; nan beside the blank
    profiles: Mapping[str, Profile]  # by part


def groove_sections(features: Sequence[Feature], parts: Mapping[str, InspectedPart]) -> tuple[PartSection, ...]:
    """A section in the middle of each straight groove, as far as it lies in the blank.

    Args:
        parts: Name to inspected part; all of one nominal part.
    """
    first = next(iter(parts.values()))
    surface = first.part.surface
    nominal = surface.nominal
    out = []
    for groove in features:
        if not isinstance(groove, Groove):
            continue
        radius = groove.radius_m
        run = (groove.end - groove.start)[:2]
        length = float(np.linalg.norm(run))
        u = run / length
        left = np.array([-u[1], u[0]])
        s = np.linspace(0.0, length, 401)
        in_blank = s[np.isfinite(height_at(nominal, groove.start[:2] + s[:, None] * u))]
        if len(in_blank) == 0:
            continue
        place = float(np.median(in_blank))
        centre = groove.start[:2] + place * u
        across = np.linspace(-radius - BESIDE_M, radius + BESIDE_M, 801)
        profiles = {}
        for name, part in parts.items():
            rows = part.rows
            step = rows.points[:, :2] - centre
            near = np.flatnonzero((np.abs(step @ u) < HALF_M) & (np.abs(step @ left) < radius + BESIDE_M))
            normal = np.column_stack([rows.normals[near, :2] @ left, rows.normals[near, 2]])
            near, normal = near[np.linalg.norm(normal, axis=1) > 0.9], normal[np.linalg.norm(normal, axis=1) > 0.9]
            near_z = rows.points[near, 2]
            profiles[name] = Profile(step[near] @ left, near_z, normal, rows.deviation_m[near])
        heights = height_at(nominal, centre + across[:, None] * left)
        out.append(PartSection(groove.name, place, across, heights, profiles))
    return tuple(out)
