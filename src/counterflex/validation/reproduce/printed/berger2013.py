"""Figures of Berger, Halbauer, Lehmann, Euhus and Staedter 2013: cutting data, constants, chip, strategy, stiffness."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.units import MM
from counterflex.cutting.arc_integrals import cosine_power_integral, sine_power_integral
from counterflex.cutting.force import zero_normal_force_immersion
from counterflex.cutting.material import load as load_material
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector
from counterflex.validation.reproduce.printed.row import Printed, around

PAPER: Final = "berger2013"
DIAMETER_M: Final = 6.0 * MM
FLUTES: Final = 4
CYCLE_S: Final = 0.045
"""Cycle of the KRC1."""
CUTS: Final = {
    "EN AW-7075": (300.0, 17000.0, 0.03, 2040.0, "en-aw-7075-linear-190"),
    "X37CrMoV5-1": (84.0, 4450.0, 0.008, 140.0, "x37crmov5-1-qt-vdi11"),
}
"""Table 1: v_c m/min, rpm, f_z mm, feed mm/min; and the material here."""
RATIO: Final = 0.7
"""Assumed radial over cutting force of the tool steel: its table has none."""


def _table_1() -> list[Printed]:
    out = []
    for name, (speed, rpm, tooth, feed, _) in CUTS.items():
        turned = speed / (math.pi * DIAMETER_M)
        out += [
            Printed(
                PAPER,
                "table 1",
                f"{name}: spindle speed of {speed:g} m/min at 6 mm",
                "1/min",
                f"{rpm:g}",
                turned,
                *around(rpm, 0.01),
                "1 %, the paper's rounding",
                f"{rpm:g} 1/min are {rpm * math.pi * DIAMETER_M:.0f} m/min",
            ),
            Printed(
                PAPER,
                "table 1",
                f"{name}: feed of {tooth:g} mm a tooth, {FLUTES} teeth",
                "mm/min",
                f"{feed:g}",
                rpm * FLUTES * tooth,
                *around(feed, 0.02),
                "2 %, the paper's rounding",
            ),
        ]
    fastest = CUTS["EN AW-7075"][3] * MM / 60.0 * CYCLE_S
    slowest = CUTS["X37CrMoV5-1"][3] * MM / 60.0 * CYCLE_S
    out.append(
        Printed(
            PAPER,
            "eq. 5",
            "least distance of points, EN AW-7075, 45 ms",
            "mm",
            "0.5",
            fastest / MM,
            0.45,
            0.55,
            "",
            f"0.5 mm follow from neither cut of table 1 (X37CrMoV5-1: {slowest / MM:.2f} mm); they need "
            f"{0.5 * 60.0 / CYCLE_S:.0f} mm/min",
        )
    )
    return out


def _table_2() -> list[Printed]:
    return [
        Printed(
            PAPER, "table 2", "k_c1.1 against the literature", "%", "0.5", 100.0 * (780.0 - 776.0) / 780.0, 0.45, 0.55
        ),
        Printed(
            PAPER, "table 2", "exponent m_c against the literature", "%", "19", 100.0 * (0.274 / 0.23 - 1.0), 18.5, 19.5
        ),
    ]


def _chip() -> list[Printed]:
    """Eq. 1, 3 and 4."""
    slot = math.pi / 2.0
    wall = math.acos(1.0 - 2.0 * 0.05)  # radial width of a twentieth of the diameter
    mean = (1.0 - math.cos(wall)) / wall
    phi = np.linspace(0.0, math.pi, 200)
    printed = 0.25 * (2.0 * phi - np.sin(2.0 * phi) - 2.0 * np.cos(phi) ** 2)
    ours = np.array([sine_power_integral(2.0, p) + cosine_power_integral(1.0, p) for p in phi])
    constant = printed - ours
    return [
        Printed(
            PAPER,
            "eq. 1",
            "f_z for h_m, slot: how much too large",
            "",
            "1, f_z printed for h_m",
            slot,
            0.99,
            1.01,
            "",
            "the chip is as thick as f_z in the middle of the slot only; with h_m of eq. 3 the formula holds",
        ),
        Printed(
            PAPER,
            "eq. 1",
            "the same at a twentieth of the diameter",
            "",
            "1, f_z printed for h_m",
            1.0 / mean,
            0.99,
            1.01,
            "",
            "likewise: thin cuts are worse",
        ),
        Printed(
            PAPER,
            "eq. 4",
            "largest difference from the integral of sin2 + sin cos, constant taken off",
            "",
            "0",
            float(np.ptp(constant)),
            0.0,
            1e-9,
            "arithmetic; it takes the radial coefficient equal to the tangential one and drops the exponent",
        ),
    ]


def _strategy() -> list[Printed]:
    out = []
    for name, (_, _, tooth, _, row) in CUTS.items():
        material = load_material(row)
        law = material.law() if material.radial is not None else material.with_ratios(kr_over_kc=RATIO, ka_over_kc=0.0)
        width = 0.5 * (1.0 - math.cos(zero_normal_force_immersion(law, tooth * MM)))
        out.append(
            Printed(
                PAPER,
                "strategy",
                f"{name}: width of cut without normal force, up-milling, share of D",
                "",
                "0.5",
                width,
                0.45,
                0.55,
                "a tenth; the paper says itself that it moves with the feed",
                "it follows from k_r/k_c at that feed; half the diameter needs k_r/k_c = pi/2",
                "" if material.radial is not None else f"k_r/k_c = {RATIO:g}, which the table does not give",
            )
        )
    return out


def _robot() -> list[Printed]:
    robot = catalog.load("kuka_kr300_r2500_ultra")
    chain = ElasticChain.build(robot, EndEffector((), pose.make(p=np.array([0.0, 0.0, 350.0 * MM]))))
    q = np.radians([0.0, -70.0, 110.0, 0.0, 50.0, 0.0])
    softest = float(np.linalg.eigvalsh(cartesian_compliance(chain, q)[:3, :3])[-1] * 1e6)
    return [
        Printed(
            PAPER,
            "validation",
            "deflection of the 125 kg robot by force",
            "um/N",
            "10 (0.1 mm per 10 N)",
            softest,
            5.0,
            20.0,
            "",
            "ours is a KR 300 without spindle; no robot of the catalogue is that soft: stand, gripper and part of the "
            "paper's cell must be in its figure",
            "axes at 0, -70, 110, 0, 50, 0 deg",
        ),
        Printed(
            PAPER,
            "validation",
            "computed against measured force",
            "%",
            "up to 15",
            None,
            why="the force signals are not printed; on the simulated cell: identify cutting, docs/identify/cutting.md",
        ),
        Printed(
            PAPER,
            "validation",
            "less deviation by the strategy",
            "%",
            "30",
            None,
            why="neither the cuts nor the part are described; on the simulated cell: docs/strategy.md",
        ),
    ]


def rows() -> list[Printed]:
    """The table."""
    return [*_table_1(), *_table_2(), *_chip(), *_strategy(), *_robot()]
