"""Print the deflection of the KR 300 R2500 ultra in the 60 load cases of Haehn2020, section 3.1."""

from __future__ import annotations

import numpy as np

from counterflex.core.units import DEG, MM
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.model import catalog, load_cases


def main() -> None:
    """Solve every pose in the branch front, elbow up, wrist not flipped, and tabulate the deflection under 750 N."""
    chain = ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"), load_cases.end_effector())
    print("TCP assumed at (300, 0, 150) mm in the flange; flange z forward, x down; 750 N; deflection in mm")
    print(f"{'pos':>3} {'turn':>5} {'force':>5} {'dx':>7} {'dy':>7} {'dz':>7} {'norm':>6} {'linear':>7}  joints, deg")
    norms = []
    for case in load_cases.cases():
        q = inverse(chain, case.T_base_tcp, "front up noflip").q
        d = compliance.deflection(chain, q, case.w_tcp_base)[:3] / MM
        linear = compliance.deflection(chain, q, case.w_tcp_base, nonlinear=False)[:3] / MM
        norms.append(float(np.linalg.norm(d)))
        print(
            f"{case.position:3d} {case.orientation:>5} {case.direction:>5} {d[0]:7.3f} {d[1]:7.3f} {d[2]:7.3f} "
            f"{norms[-1]:6.3f} {np.linalg.norm(linear):7.3f}  {np.round(q / DEG, 1).tolist()}"
        )
    print(
        f"mean {np.mean(norms):.3f} mm, {min(norms):.3f} to {max(norms):.3f}; published "
        f"model {load_cases.MODEL_MEAN_MM} mm, measured {load_cases.MEASURED_MEAN_MM} mm"
    )


if __name__ == "__main__":
    main()
