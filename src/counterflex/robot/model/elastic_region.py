"""Compliances that differ by region of the joint space: a factor on one spring over the angle of one axis.

``c(q) = c f(q_axis)``: f is linear between the angles it is given at and fades to 1 within :data:`FADE_RAD` beyond
them, since what was found in a region says nothing outside it. It has no steps, so neither have deflection and
correction. Several factors on one spring multiply.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG
from counterflex.robot.model.description import LOADS, ComplianceCurve, ElasticRegion

FADE_RAD: Final = 10.0 * DEG
"""Angle beyond the given ones over which a factor fades to 1."""
LEAST: Final = 0.02
MOST: Final = 50.0
"""Factors of one spring at all angles together; beyond them it is another spring."""
ANGLES: Final = (2, 8)
"""Fewest and most angles of one factor."""
DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")


def factor(region: ElasticRegion, q: Float) -> Float:
    """Factor f on the compliance.

    Args:
        region: See :class:`counterflex.robot.model.description.ElasticRegion`.
        q: (..., 6) rad, controller angles.

    Returns:
        (...,) without unit, above 0.
    """
    angle = as_float("q", q)[..., region.axis]
    inside = np.interp(angle, region.angles_rad, region.factors)
    beyond = np.maximum(np.maximum(region.angles_rad[0] - angle, angle - region.angles_rad[-1]), 0.0)
    out: Float = 1.0 + (inside - 1.0) * np.clip(1.0 - beyond / FADE_RAD, 0.0, 1.0)
    return out


def growth(regions: Sequence[ElasticRegion], names: Sequence[str], q: Float) -> Float:
    """Factors on all compliances of a chain.

    Args:
        names: n segments of the chain.
        q: (..., 6) rad.

    Returns:
        (..., n, 6): 1 where no region acts.
    """
    out = np.ones((*np.shape(q)[:-1], len(names), 6))
    for region in regions:
        out[..., list(names).index(region.segment), region.direction] *= factor(region, q)
    return out


def outside(regions: Sequence[ElasticRegion], q: Float) -> tuple[ElasticRegion, ...]:
    """Regions whose angles the joint angles (..., 6) rad leave: there the mean compliance is used."""
    flat = as_float("q", q).reshape(-1, 6)
    return tuple(
        r
        for r in regions
        if len(flat)
        and (float(flat[:, r.axis].min()) < r.angles_rad[0] or float(flat[:, r.axis].max()) > r.angles_rad[-1])
    )


def beyond_regions(regions: Sequence[ElasticRegion], q: Float) -> list[str]:
    """Message where joint angles (..., 6) rad leave the angles of regions."""
    return [
        f"axis {r.axis + 1} leaves the angles at which {describe(r)} was measured ({r.angles_rad[0] / DEG:.0f} to "
        f"{r.angles_rad[-1] / DEG:.0f} deg, [[robot.elastic_region]]): there the mean compliance is used"
        for r in outside(regions, q)
    ]


def describe(region: ElasticRegion) -> str:
    """The spring of a region and the axis it changes over, in words."""
    return f"{region.segment}.{DIRECTIONS[region.direction]} over the angle of axis {region.axis + 1}"


def check_regions(regions: Sequence[ElasticRegion], names: Sequence[str], compliance: Float) -> None:
    """Check that regions can belong to a chain.

    Args:
        names: n segments of the chain.
        compliance: (n, 6) m/N, rad/(N m).

    Raises:
        ModelError: A segment, direction or axis that does not exist; a rigid spring; angles that do not rise; a factor
            out of :data:`LEAST` .. :data:`MOST`, alone or with the others of its spring.
    """
    low, high = np.ones((len(names), 6)), np.ones((len(names), 6))
    for region in regions:
        if region.segment not in names:
            raise ModelError(
                "an elastic region names no segment", value=region.segment, limit=", ".join(names), where=region.segment
            )
        if not (0 <= region.direction <= 5 and 0 <= region.axis <= 5):
            raise ModelError("an elastic region names no spring or axis", value=(region.direction, region.axis + 1))
        i, where = list(names).index(region.segment), describe(region)
        if compliance[i, region.direction] == 0.0:
            raise ModelError(
                "an elastic region of a spring that is rigid changes nothing",
                where=where,
                hint="Give the spring a compliance, or remove the region",
            )
        count = len(region.angles_rad)
        if count != len(region.factors) or not ANGLES[0] <= count <= ANGLES[1]:
            raise ModelError(
                "an elastic region needs as many factors as angles",
                where=where,
                value=f"{count} angles, {len(region.factors)} factors",
                limit=f"{ANGLES[0]} to {ANGLES[1]} of each",
            )
        if not np.all(np.diff(region.angles_rad) > 0.0):
            raise ModelError(
                "the angles of an elastic region do not rise",
                where=where,
                value=", ".join(f"{a / DEG:g}" for a in region.angles_rad),
                limit="rising",
            )
        if not np.all(np.isfinite(region.factors)) or min(region.factors) <= 0.0:
            raise ModelError("a factor on a compliance is not above 0", where=where, value=region.factors, limit="> 0")
        # Factors on one spring multiply, and their extremes may meet in one posture.
        low[i, region.direction] *= min(1.0, *region.factors)
        high[i, region.direction] *= max(1.0, *region.factors)
        if low[i, region.direction] < LEAST or high[i, region.direction] > MOST:
            raise ModelError(
                "the factors on a compliance are far too large or small",
                where=where,
                value=f"{low[i, region.direction]:.3g} to {high[i, region.direction]:.3g}",
                limit=f"{LEAST:g} to {MOST:g}, those of one spring multiplied",
            )


def check_curves(curves: Sequence[ComplianceCurve], names: Sequence[str], compliance: Float) -> None:
    """Check that curves can belong to a chain.

    Args:
        names: n segments of the chain.
        compliance: (n, 6) m/N, rad/(N m).

    Raises:
        ModelError: A segment or direction that does not exist; two curves of one spring; a rigid spring; loads that do
            not rise; a factor out of :data:`LEAST` .. :data:`MOST`.
    """
    seen: set[str] = set()
    for curve in curves:
        if curve.segment not in names or not 0 <= curve.direction <= 5:
            raise ModelError(
                "a compliance curve names no spring",
                value=f"{curve.segment}, direction {curve.direction}",
                limit=", ".join(names),
            )
        name = f"{curve.segment}.{DIRECTIONS[curve.direction]}"
        if name in seen:
            raise ModelError("a spring has two compliance curves", where=name, hint="Put them into one")
        seen.add(name)
        if compliance[list(names).index(curve.segment), curve.direction] == 0.0:
            raise ModelError(
                "a compliance curve of a spring that is rigid changes nothing",
                where=name,
                hint="Give the spring a compliance, or remove the curve",
            )
        count = len(curve.loads)
        if count != len(curve.factors) or not LOADS[0] <= count <= LOADS[1]:
            raise ModelError(
                "a compliance curve needs as many factors as loads",
                where=name,
                value=f"{count} loads, {len(curve.factors)} factors",
                limit=f"{LOADS[0]} to {LOADS[1]} of each",
            )
        if not (np.all(np.isfinite(curve.loads)) and np.all(np.diff(curve.loads) > 0.0)):
            raise ModelError(
                "the loads of a compliance curve do not rise", where=name, value=curve.loads, limit="rising"
            )
        if not all(LEAST <= factor <= MOST for factor in curve.factors):
            raise ModelError(
                "the factors of a compliance curve are far too large or small",
                where=name,
                value=curve.factors,
                limit=f"{LEAST:g} to {MOST:g}",
            )
