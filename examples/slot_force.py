"""Print the force of a slot: its mean over a revolution, and what the single teeth make of it."""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.units import DEG, MM, N_PER_MM2, UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_force
from counterflex.cutting.tooth_force import tooth_forces

DEPTH_M = 6.0 * MM
FEED_TOOTH_M = 25.0 * MM / (13000.0 / 60.0 * 3)  # 25 mm/s, 13000 rpm, 3 teeth


def main() -> None:
    """Compare mean force, tooth-resolved force, helix, runout and chip path for one and the same slot."""
    kc = 780.0 * N_PER_MM2
    law = KienzleLaw.from_k11(
        kc, 0.25, kr11_pa=0.35 * kc, mr=0.25, ka11_pa=0.15 * kc, ma=0.25,
        h_min_m=1.0 * UM, h_max_m=1.0 * MM, source="Berger2013, ratios assumed", status="assumed",
    )  # fmt: skip
    print(f"slot, D16, 3 teeth, {DEPTH_M / MM:g} mm deep, {FEED_TOOTH_M / UM:.1f} um per tooth; force on the tool, N")
    print(f"{'':34} {'along':>8} {'left':>8} {'up':>8} {'mean':>8} {'peak':>8}")
    for name, helix_deg, runout_um, trochoid in (
        ("straight teeth, circular path", 0.0, 0.0, False),
        ("helix 30 deg", 30.0, 0.0, False),
        ("helix 30 deg, true edge path", 30.0, 0.0, True),
        ("the same with 10 um runout", 30.0, 10.0, True),
    ):
        cutter = Cutter(16.0 * MM, flutes=3, helix_rad=helix_deg * DEG, flute_length_m=35 * MM, runout_m=runout_um * UM)
        depth = engagement_of_arc(cutter, DEPTH_M, 0.0, math.pi)
        teeth = tooth_forces(cutter, law, depth, FEED_TOOTH_M, trochoid=trochoid)
        f = teeth.mean[:3]
        print(
            f"{name:34} {f[0]:8.1f} {f[1]:8.1f} {f[2]:8.1f} {np.linalg.norm(f):8.1f} {teeth.peak_n:8.1f}"
            f"   chip to {teeth.chip_max_m / UM:.1f} um"
        )
    cutter = Cutter(16.0 * MM, flutes=3, flute_length_m=35 * MM)
    closed = mean_force(cutter, law, engagement_of_arc(cutter, DEPTH_M, 0.0, math.pi)[None], FEED_TOOTH_M)
    f = closed.wrench_tcp[0, :3]
    print(f"{'closed form of the mean':34} {f[0]:8.1f} {f[1]:8.1f} {f[2]:8.1f} {np.linalg.norm(f):8.1f}")
    print("The robot, with modes far below the tooth passing frequency of 650 Hz, answers the mean.")


if __name__ == "__main__":
    main()
