"""Which other kinds of physics a truth has and how strong they are, drawn from its seed.

Each kind is there with the probability :data:`SHARE_OF_KINDS`. Sources of the ranges stand with each kind; where a
source gives the form only, the range is an assumption of the order that data sheets show.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.units import MM, N_PER_MM, UM
from counterflex.twin.truth.draws import between, happens
from counterflex.twin.truth.family import Family
from counterflex.twin.truth.other import ControllerKind, GearCurve, OtherPhysics
from counterflex.twin.truth.truth import Body, CuttingTruth, Truth

SHARE_OF_KINDS: Final = 0.7
"""Probability of each kind."""
RATED_WIND_UP_RAD: Final = 1.0e-3
"""Wind-up of a gear at its rated torque: 3 to 4 arc minutes (rated torque over stiffness of Nabtesco's RV-E table)."""
MATCH_M: Final = 0.1 * MM
"""Chip thickness at which another force law agrees with the one it replaces."""
_LINEAR_EDGE: Final = ((0.10, 0.27), (0.25, 0.60), (0.02, 0.30))
"""Share of the edge force at that chip, c r a: the seven aluminium sets of CJME 2021, doi 10.1186/s10033-021-00536-9,
table 5 (767 and 27.7 N/mm give 0.27, 951 and 11.1 give 0.10 in c; 789 and 26.8 give 0.25, 169 and 26.6 give 0.61 in r).
"""
_EXPONENT: Final = (0.10, 0.40)
"""Exponents of Kienzle's law: 0.18 to 0.34 in tables of steel and aluminium, wider for r and a."""
_EDGE_N_M: Final = ((2.0 * N_PER_MM, 8.0 * N_PER_MM), (3.0 * N_PER_MM, 12.0 * N_PER_MM), (0.0, 2.0 * N_PER_MM))
_RUNOUT_M: Final = (5.0 * UM, 20.0 * UM)


def other_cutting(cutting: CuttingTruth, seed: int, family: Family) -> CuttingTruth:
    """Another law of the cutting force, equal to ``cutting`` at a chip of 0.1 mm, and more runout.

    Half of those that are there are linear-edge laws (Altintas, Manufacturing Automation: ``F' = K h + K_e``), the
    others power laws with exponents of their own in each direction and an edge force of another direction.

    Args:
        cutting: Of the family without other kinds.
        seed: Of the truth.
        family: Unchanged where it has no other kinds.
    """
    if not family.other or not happens(seed, "other.force", SHARE_OF_KINDS):
        return cutting
    h = MATCH_M
    k, m = np.array(cutting.k_pa), np.array(cutting.exponent)
    whole = k * cutting.h_ref_m**m * h ** (1.0 - m) + np.array(cutting.edge_n_m)
    if happens(seed, "other.force.linear", 0.5):
        edge = whole * [between(seed, f"other.edge.{d}", *r) for d, r in zip("cra", _LINEAR_EDGE, strict=True)]
        exponent = np.zeros(3)
    else:
        edge = np.array([between(seed, f"other.edge.{d}", *r) for d, r in zip("cra", _EDGE_N_M, strict=True)])
        edge = np.minimum(edge, 0.5 * whole)
        exponent = np.array([between(seed, f"other.exponent.{d}", *_EXPONENT) for d in "cra"])
    specific = (whole - edge) / (cutting.h_ref_m**exponent * h ** (1.0 - exponent))
    return replace(
        cutting,
        k_pa=_three(specific),
        exponent=_three(exponent),
        edge_n_m=_three(edge),
        runout_m=between(seed, "other.runout", *_RUNOUT_M),
    )


def other_physics(truth: Truth, seed: int, family: Family) -> OtherPhysics:
    """The kinds that a truth of a seed has; none where the family has none.

    Args:
        truth: The cell as it is without them.
        seed: Of the truth.
        family: Says whether there are other kinds.
    """
    if not family.other:
        return OtherPhysics()
    return OtherPhysics(
        gears=_gears(truth.bodies, seed) if happens(seed, "other.gears", SHARE_OF_KINDS) else (),
        controller=_controller(seed) if happens(seed, "other.controller", SHARE_OF_KINDS) else None,
    )


def _gears(bodies: tuple[Body, ...], seed: int) -> tuple[GearCurve, ...]:
    """Cycloidal gears (a small soft zone, more hysteresis) or strain wave gears, axis by axis."""
    out = []
    for body in bodies:
        if body.joint is None or body.compliance[5] == 0.0:
            continue
        rated = RATED_WIND_UP_RAD / float(body.compliance[5])
        name = f"other.axis{body.joint + 1}.gear"
        if body.joint < 3 or happens(seed, f"{name}.cycloidal", 0.5):
            knots, first, third = (0.04, 0.5), (0.40, 0.70), (1.00, 1.20)
        else:
            knots, first, third = (0.16, 0.6), (0.60, 0.80), (1.10, 1.30)
        out.append(
            GearCurve(
                axis=body.joint,
                torque_nm=(knots[0] * rated, knots[1] * rated),
                share=(between(seed, f"{name}.first", *first), 1.0, between(seed, f"{name}.third", *third)),
                hysteresis_nm=between(seed, f"{name}.hysteresis", 0.003, 0.012) * rated,
                hysteresis_share=between(seed, f"{name}.loaded", 0.005, 0.03),
                hysteresis_rad=between(seed, f"{name}.slip", 20.0e-6, 100.0e-6),
            )
        )
    return tuple(out)


def _controller(seed: int) -> ControllerKind:
    """Rounding begins elsewhere, references are smoothed over 8 to 48 ms, corrections wait up to 2 cycles more."""
    return ControllerKind(
        blending_share=between(seed, "other.blending", 0.6, 1.8),
        smoothing_s=between(seed, "other.smoothing", 8.0e-3, 48.0e-3),
        dead_cycles=int(between(seed, "other.dead", 0.0, 2.999)),
    )


def _three(values: np.ndarray) -> tuple[float, float, float]:
    c, r, a = (float(f"{v:.12g}") for v in values)
    return c, r, a
