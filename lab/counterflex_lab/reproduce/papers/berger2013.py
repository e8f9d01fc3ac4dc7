"""Ours of Berger2013: cutting data, force formulas, constants, strategy, stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MS, UM
from counterflex.cutting.arc_integrals import cosine_power_integral, sine_power_integral
from counterflex.cutting.chip import circle_thickness, trochoid_thickness
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_force, zero_normal_force_immersion
from counterflex.cutting.material import load as load_material
from counterflex.geometry import pose
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import modes
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance, deflection
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Segment

DIAMETER_M: Final = 6.0 * MM
FLUTES: Final = 4
CYCLE_S: Final = 45.0 * MS
"""Of the KRC1."""
RATIO: Final = 0.7
"""Radial over cutting force of the tool steel (assumed)."""
ROBOT: Final = "kuka_kr300_r2500_ultra"
POSTURE: Final = np.array([0.0, -70.0, 110.0, 0.0, 50.0, 0.0]) * DEG
REACH_M: Final = 350.0 * MM
PAYLOAD_KG: Final = 125.0
PUSH_N: Final = 100.0


@dataclass(frozen=True)
class Cut:
    """One row of table 1, and the material here."""

    cutting_speed_m_s: float
    spindle_rpm: float  # spindle speed, 1/min
    tooth_m: float  # feed per tooth, m
    feed_mm_min: float
    material: str  # row of our table of materials

    def turned(self) -> float:
        """Spindle speed, 1/min, that the cutting speed means."""
        return self.cutting_speed_m_s * 60.0 / (math.pi * DIAMETER_M)

    def feed(self) -> float:
        """Feed, mm/min, that spindle speed and feed per tooth mean."""
        return self.spindle_rpm * FLUTES * self.tooth_m / MM

    def law(self) -> ForceLaw:
        """Force law of the material; its radial ratio is assumed where the table has none."""
        material = load_material(self.material)
        return material.law() if material.radial is not None else material.with_ratios(kr_over_kc=RATIO, ka_over_kc=0.0)


ALUMINIUM: Final = Cut(300.0 / 60.0, 17000.0, 0.03 * MM, 2040.0, "en-aw-7075-linear-190")
STEEL: Final = Cut(84.0 / 60.0, 4450.0, 0.008 * MM, 140.0, "x37crmov5-1-qt-vdi11")


def too_large(share: float) -> float:
    """By which factor f_z for h_m makes the chip of eq. 1 too large.

    Args:
        share: Width of cut, share of the diameter.
    """
    phi = math.acos(1.0 - 2.0 * share)
    return phi / (1.0 - math.cos(phi))


def mean_thickness_gap() -> float:
    """Largest relative difference of eq. 3 from the mean thickness of the force model, over 30 arcs of a slot."""
    cutter = Cutter(diameter_m=DIAMETER_M, flutes=FLUTES, helix_rad=0.0, flute_length_m=10.0 * MM)
    law, tooth = ALUMINIUM.law(), ALUMINIUM.tooth_m
    worst = 0.0
    for entry in np.radians([0.0, 10.5, 30.0, 50.0, 70.0, 90.0]):
        for leave in entry + np.radians([20.0, 35.5, 50.0, 70.0, 90.0]):
            depths = engagement_of_arc(cutter, MM, float(entry), float(leave))
            ours = mean_force(cutter, law, depths[None], tooth, allow_extrapolation=True).h_mean_m[0]
            printed = tooth * (math.cos(entry) - math.cos(leave)) / (leave - entry)
            worst = max(worst, abs(float(ours) / printed - 1.0))
    return worst


def feed_force_gap() -> float:
    """Spread of the difference of eq. 4 from the integral of ``sin^2 + sin cos``."""
    phi = np.linspace(0.0, math.pi, 200)
    printed = 0.25 * (2.0 * phi - np.sin(2.0 * phi) - 2.0 * np.cos(phi) ** 2)
    ours = np.array([sine_power_integral(2.0, p) + cosine_power_integral(1.0, p) for p in phi])
    return float(np.ptp(printed - ours))


def circle_gap(cut: Cut) -> tuple[Float, Float]:
    """Immersion (n,) deg, and thickness of the circle less that of the trochoid (n,), % of the feed per tooth."""
    phi = np.radians(np.linspace(1.0, 179.0, 179))
    radii = np.full(FLUTES, 0.5 * DIAMETER_M)
    gap = circle_thickness(phi, cut.tooth_m) - trochoid_thickness(phi, cut.tooth_m, radii)
    return phi / DEG, 100.0 * gap / cut.tooth_m


def zero_normal_width(cut: Cut, tooth_m: float | None = None) -> float:
    """Width of cut, share of the diameter, without force normal to the feed, up-milling.

    Args:
        cut: Material and feed.
        tooth_m: Another feed per tooth, m.
    """
    feed = cut.tooth_m if tooth_m is None else tooth_m
    return 0.5 * (1.0 - math.cos(zero_normal_force_immersion(cut.law(), feed)))


def _chain() -> ElasticChain:
    return ElasticChain.build(catalog.load(ROBOT), EndEffector((), pose.make(p=np.array([0.0, 0.0, REACH_M]))))


def softest_um_n() -> float:
    """Compliance of the softest direction, um/N."""
    return float(np.linalg.eigvalsh(cartesian_compliance(_chain(), POSTURE)[:3, :3])[-1] / UM)


def nonlinear_percent() -> float:
    """Departure of the finite law from the linear one at :data:`PUSH_N`, largest of the axes, % of the deflection."""
    w = np.hstack([PUSH_N * np.eye(3), np.zeros((3, 3))])
    q = np.tile(POSTURE, (3, 1))
    finite, linear = (
        deflection(_chain(), q, w, equilibrium=True)[:, :3],
        deflection(_chain(), q, w, nonlinear=False)[:, :3],
    )
    share = np.linalg.norm(finite - linear, axis=1) / np.linalg.norm(linear, axis=1)
    return float(100.0 * share.max())


def lowest_hz() -> float:
    """Lowest frequency of the arm with :data:`PAYLOAD_KG` on the flange, drives held, Hz."""
    carried = Segment("load", pose.make(p=np.zeros(3)), mass_kg=PAYLOAD_KG)
    chain = ElasticChain.build(catalog.load(ROBOT), EndEffector((carried,), np.eye(4)))
    inertia, stiffness, _, _ = matrices(chain, POSTURE)
    return float(modes(inertia, stiffness).omega_rad_s[0] / (2.0 * math.pi))


OURS: Final[Mapping[str, Callable[[], float]]] = {
    "eq_1_slot": partial(too_large, 1.0 - 1e-12),
    "eq_1_wall": partial(too_large, 0.05),
    "eq_3": mean_thickness_gap,
    "eq_4": feed_force_gap,
    "circle_aluminium": lambda: float(np.abs(circle_gap(ALUMINIUM)[1]).max()),
    "circle_steel": lambda: float(np.abs(circle_gap(STEEL)[1]).max()),
    "rpm_aluminium": ALUMINIUM.turned,
    "feed_aluminium": ALUMINIUM.feed,
    "rpm_steel": STEEL.turned,
    "feed_steel": STEEL.feed,
    "point_distance": lambda: ALUMINIUM.feed_mm_min / 60.0 * CYCLE_S,
    "kc_arithmetic": lambda: 100.0 * (780.0 - 776.0) / 780.0,
    "mc_arithmetic": lambda: 100.0 * (0.274 / 0.23 - 1.0),
    "zero_normal_aluminium": partial(zero_normal_width, ALUMINIUM),
    "zero_normal_steel": partial(zero_normal_width, STEEL),
    "resonance": lowest_hz,
    "compliance": softest_um_n,
    "linear": nonlinear_percent,
}
"""Ours, by the name of the row."""


def _less(run: Mapping[str, Any], workpiece: str) -> float | None:
    """Median of what the strategy takes away of the uncompensated wall's error, %."""
    left = {
        (row["choice"], row["seed"]): float(row["p997_mm"])
        for row in run["rows"]
        if row["workpiece"] == workpiece and not row["compensated"]
    }
    gains = [1.0 - left["strategy", seed] / left["as programmed", seed] for name, seed in left if name == "strategy"]
    return float(100.0 * np.median(gains)) if gains else None


MEASURED: Final[Mapping[str, Callable[[Mapping[str, Any]], float | None]]] = {
    "kc_identified": lambda run: float(run["kc_percent"]),
    "mc_identified": lambda run: float(run["mc_percent"]),
    "computed_measured": lambda run: float(run["held_out_percent"]),
    "strategy_aluminium": lambda run: _less(run, "EN AW-7075"),
    "strategy_steel": lambda run: _less(run, "X37CrMoV5-1"),
}
"""Ours from the results of an experiment, by the name of the row."""
