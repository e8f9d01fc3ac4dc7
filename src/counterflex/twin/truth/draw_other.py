"""Draw the other kinds of physics of a truth and their strength from its seed.

Each kind is there with the probability :data:`SHARE_OF_KINDS`. Sources of the ranges stand with each kind; where a
source gives the form only, the range is an assumption of the order that data sheets show.
"""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace
from functools import partial
from statistics import NormalDist
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, N_PER_MM, UM
from counterflex.twin.truth import other as kinds
from counterflex.twin.truth.family import Family
from counterflex.twin.truth.truth import Body, CuttingTruth, Drive, Truth

# Numbers drawn from a seed, the same on every machine.
# Every quantity has a random stream of its own, named by seed and quantity, so that adding one changes no other. The
# uniform numbers come from the Mersenne generator, whose output is fixed, and values are rounded to twelve digits, so
# that no library or processor shows in them.

_DIGITS = 12
_NORMAL = NormalDist()


def _uniform(seed: int, name: str) -> float:
    return random.Random(f"counterflex-truth-1:{seed}:{name}").random()


def draw(seed: int, name: str) -> float:
    """A standard normal number that depends on seed and name only; within 3 sigma."""
    low = _NORMAL.cdf(-3.0)
    return float(f"{_NORMAL.inv_cdf(low + _uniform(seed, name) * (1.0 - 2.0 * low)):.{_DIGITS}g}")


def factor(seed: int, name: str, sigma: float) -> float:
    """``exp(sigma draw)``."""
    return float(f"{math.exp(sigma * draw(seed, name)):.{_DIGITS}g}")


def vector(seed: int, name: str, sigma: float) -> Float:
    """(3,) independent normal numbers of standard deviation ``sigma``, in its unit."""
    return np.array([sigma * draw(seed, f"{name}.{c}") for c in "xyz"])


def between(seed: int, name: str, low: float, high: float) -> float:
    """A number from ``low`` to ``high``, every one as likely."""
    return float(f"{low + (high - low) * _uniform(seed, name):.{_DIGITS}g}")


def happens(seed: int, name: str, probability: float) -> bool:
    """True with a probability of 0 .. 1."""
    return _uniform(seed, name) < probability


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
_GAS: Final = (0.6, 1.0)  # What is left of a counterbalance's gas: cylinders lose it and are refilled in service
_TOOLS: Final = 8


def other_cutting(cutting: CuttingTruth, seed: int, family: Family) -> CuttingTruth:
    """Another law of the cutting force, equal to ``cutting`` at a chip of 0.1 mm, and more runout.

    Half of those that are there are linear-edge laws (Altintas, Manufacturing Automation: ``F' = K h + K_e``), the
    others power laws with exponents of their own in each direction and an edge force of another direction.
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


def _is_there(seed: int, kind: str) -> bool:
    return happens(seed, f"other.{kind}", SHARE_OF_KINDS)


def other_cell(truth: Truth, seed: int, family: Family) -> Truth:
    """A truth with the kinds that its seed has; the same where the family has none."""
    if not family.other:
        return truth
    there = partial(_is_there, seed)
    bodies = _with_bearings(truth.bodies, seed) if there("couplings") else truth.bodies
    other = kinds.OtherPhysics(
        gears=_gears(bodies, seed) if there("gears") else (),
        frictions=_frictions(truth, seed) if there("frictions") else (),
        couplings=_couplings(bodies, seed) if there("couplings") else (),
        controller=_controller(seed) if there("controller") else None,
        thermal=_thermal(seed) if there("thermal") else None,
        hose=_hose(truth.bodies, seed) if there("hose") else None,
        tools=tuple(_tool(seed, number) for number in range(1, _TOOLS + 1)) if there("tools") else (),
    )
    balance = truth.counterbalance
    if balance is not None and there("counterbalance"):
        lost = between(seed, "other.gas", *_GAS)
        balance = replace(balance, gas_constant_j=lost * balance.gas_constant_j)
    drives = truth.drives
    if there("following"):
        drives = tuple(_trailing(drive, seed, axis) for axis, drive in enumerate(drives))
    return replace(truth, bodies=bodies, other=other, counterbalance=balance, drives=drives)


def _rated_nm(body: Body) -> float:
    return RATED_WIND_UP_RAD / float(body.compliance[5])


def _sprung(bodies: tuple[Body, ...]) -> list[tuple[int, Body]]:
    """Driven bodies with torsion, by axis."""
    return [(b.joint, b) for b in bodies if b.joint is not None and b.compliance[5] > 0.0]


def _gears(bodies: tuple[Body, ...], seed: int) -> tuple[kinds.GearCurve, ...]:
    """Cycloidal gears (a small soft zone, more hysteresis) or strain wave gears, axis by axis."""
    # Strain wave gears have K1 / K2 of 0.6 to 0.8 up to about a sixth of the rated torque and K3 / K2 of 1.1 to 1.3.
    out = []
    for axis, body in _sprung(bodies):
        rated = _rated_nm(body)
        name = f"other.axis{axis + 1}.gear"
        if axis < 3 or happens(seed, f"{name}.cycloidal", 0.5):
            knots, first, third = (0.04, 0.5), (0.40, 0.70), (1.00, 1.20)
        else:
            knots, first, third = (0.16, 0.6), (0.60, 0.80), (1.10, 1.30)
        out.append(
            kinds.GearCurve(
                axis=axis,
                torque_nm=(knots[0] * rated, knots[1] * rated),
                share=(between(seed, f"{name}.first", *first), 1.0, between(seed, f"{name}.third", *third)),
                hysteresis_nm=between(seed, f"{name}.hysteresis", 0.003, 0.012) * rated,
                hysteresis_share=between(seed, f"{name}.loaded", 0.005, 0.03),
                hysteresis_rad=between(seed, f"{name}.slip", 20.0e-6, 100.0e-6),
            )
        )
    return tuple(out)


def _frictions(truth: Truth, seed: int) -> tuple[kinds.BristleFriction, ...]:
    """Bristles in place of slip elements, as strong as these together."""
    # Bittencourt and Gunnarsson 2012 (at the motor, torque over the largest one): dry friction of 0.03 that doubles at
    # 1.3 times the largest torque; a Stribeck speed of about 9 rad/s, 0.05 rad/s behind a gear of 200. The largest
    # torque is taken as 2.5 times the rated one. Warming up takes a share of it within an hour.
    out = []
    for axis, body in _sprung(truth.bodies):
        dry = sum(truth.drives[axis].link_friction_nm)
        if dry == 0.0:
            continue
        name = f"other.axis{axis + 1}.bristles"
        slip = float(np.dot(truth.drives[axis].link_slip_rad, truth.drives[axis].link_friction_nm)) / dry
        out.append(
            kinds.BristleFriction(
                axis=axis,
                coulomb_nm=dry,
                stiction_share=between(seed, f"{name}.stiction", 1.05, 1.35),
                stribeck_rad_s=between(seed, f"{name}.stribeck", 0.03, 0.08),
                bristle_rad=slip * between(seed, f"{name}.slip", 0.6, 1.4),
                viscous_nm_s=dry * between(seed, f"{name}.viscous", 0.5, 1.5),
                load_nm=3.3 * _rated_nm(body) * between(seed, f"{name}.load", 0.7, 1.4),
                cold_share=between(seed, f"{name}.cold", 0.0, 0.35),
                warming_s=between(seed, f"{name}.warming", 1200.0, 3600.0),
            )
        )
    return tuple(out)


def _with_bearings(bodies: tuple[Body, ...], seed: int) -> tuple[Body, ...]:
    # "Bearings of axes 1 to 3 that tilt where a description has them rigid, 2 to 5 times as stiff as the gear
    # twists.""" The order of moment rigidity over torsional rigidity in rating tables of cycloidal gears with output
    # bearings.
    out = []
    for body in bodies:
        if body.joint in (0, 1, 2) and body.compliance[5] > 0.0:
            compliance = np.array(body.compliance)
            for d in (3, 4):
                stiffer = between(seed, f"other.{body.name}.bearing.{d}", 2.0, 5.0)
                compliance[d] = compliance[d] or float(f"{compliance[5] / stiffer:.12g}")
            body = replace(body, compliance=compliance)
        out.append(body)
    return tuple(out)


def _couplings(bodies: tuple[Body, ...], seed: int) -> tuple[kinds.Coupling, ...]:
    """Between rotations of a body, between those of neighbours, and of each with the posture; gears' torsions none."""
    turning = [
        (body, [d for d in (3, 4, 5) if body.compliance[d] > 0.0 and (body.joint is None or d < 5)])
        for body in bodies[:-1]
    ]
    axes = list(itertools.accumulate((0 if b.joint is None else b.joint for b, _ in turning), max))
    out = []
    for (body, directions), axis in zip(turning, axes, strict=True):
        for first, second in itertools.combinations(directions, 2):
            share = between(seed, f"other.{body.name}.{first}{second}", -0.20, 0.20)
            out.append(kinds.Coupling((body.name, body.name), (first, second), share))
        for d in directions:
            name = f"other.{body.name}.posture.{d}"
            share, phase = between(seed, name, -0.15, 0.15), between(seed, f"{name}.phase", -math.pi, math.pi)
            out.append(kinds.Coupling((body.name, body.name), (d, d), share, min(axis + 1, 5), phase))
    for ((body, directions), (other, others)), axis in zip(itertools.pairwise(turning), axes[1:], strict=True):
        for d in sorted(set(directions) & set(others)):
            share = between(seed, f"other.{body.name}.{other.name}.{d}", -0.15, 0.15)
            out.append(kinds.Coupling((body.name, other.name), (d, d), share, axis, 0.0))
    return tuple(out)


def _controller(seed: int) -> kinds.ControllerKind:
    """Rounding begins elsewhere, references are smoothed over 8 to 48 ms, corrections wait up to 2 cycles more."""
    return kinds.ControllerKind(
        blending_share=between(seed, "other.blending", 0.6, 1.8),
        smoothing_s=between(seed, "other.smoothing", 8.0e-3, 48.0e-3),
        dead_cycles=int(between(seed, "other.dead", 0.0, 2.999)),
    )


def _trailing(drive: Drive, seed: int, axis: int) -> Drive:
    """Speed feed-forward of 97.5 to 99.5 %: what is missing trails by ``(1 - share) v / Kv``."""
    if drive.following_gain_per_s is not None:
        return drive
    missing = between(seed, f"other.axis{axis + 1}.missing", 0.005, 0.025)
    return replace(drive, following_gain_per_s=drive.position_gain_per_s / missing)


def _thermal(seed: int) -> kinds.Thermal:
    """A spindle that grows by 20 to 80 um and an arm that drifts by 40 um (1 sigma) in each direction."""
    x, y, z = (float(v) for v in vector(seed, "other.drift", 40.0 * UM))
    return kinds.Thermal(
        before_s=between(seed, "other.before", 300.0, 1800.0),
        spindle_m=between(seed, "other.growth", 20.0 * UM, 80.0 * UM),
        spindle_s=between(seed, "other.growth.time", 500.0, 1200.0),
        arm_m=(x, y, z),
        arm_s=between(seed, "other.drift.time", 2400.0, 5400.0),
    )


def _hose(bodies: tuple[Body, ...], seed: int) -> kinds.HosePack | None:
    """Power, coolant and air of a spindle: some kg, held back by a spring of some tens of N."""
    arm = next((body.name for body in bodies[:-1] if body.joint == 3), None)
    if arm is None:
        return None
    far, near = (vector(seed, f"other.hose.{end}", 30.0 * MM) for end in ("arm", "tool"))
    return kinds.HosePack(
        arm_body=arm,
        p_arm_clamp=(0.15 + far[0], 0.05 + far[1], 0.10 + far[2]),
        p_tool_clamp=(0.05 + near[0], near[1], 0.12 + near[2]),
        mass_kg=between(seed, "other.hose.mass", 2.0, 6.0),
        slack_m=between(seed, "other.hose.slack", 0.35, 0.55),
        pull_n_m=between(seed, "other.hose.pull", 40.0, 200.0),
        bending_nm=between(seed, "other.hose.bending", 3.0, 12.0),
    )


def _tool(seed: int, number: int) -> kinds.ToolOff:
    """Length as a presetter leaves it, diameter in the tolerance field h10 of 10 to 18 mm (ISO 286: 0 to -70 um)."""
    return kinds.ToolOff(
        number=number,
        length_m=15.0 * UM * draw(seed, f"other.tool{number}.length"),
        diameter_m=-between(seed, f"other.tool{number}.diameter", 0.0, 70.0 * UM),
    )


def _three(values: np.ndarray) -> tuple[float, float, float]:
    c, r, a = (float(f"{v:.12g}") for v in values)
    return c, r, a
