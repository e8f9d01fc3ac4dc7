"""Ours of Denkena2015: compliance and modes of a KR 500, angle of the spindle, sensing holder, validation cut."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_force
from counterflex.cutting.material import load as load_material
from counterflex.geometry import pose, rotation
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import UndampedModes, modes
from counterflex.robot.elasticity.chain import ElasticChain, frames
from counterflex.robot.elasticity.compliance import cartesian_compliance, shares
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Segment
from counterflex_lab.reproduce.papers.haehn2020 import loaded_poses

ROBOT: Final = "kuka_kr500_r2830"
CENTRE_MM: Final = (1900.0, 0.0, 1200.0)
"""Centre of the working space (assumed)."""
REACH_MM: Final = 350.0
"""Distance of the tool's tip from the flange (assumed)."""
HOLDER_UM_N: Final = (0.137, 0.168, 0.048)
"""Table 1, with gauges: along x, y, z of the hand."""
M: Final = np.array(
    [
        [-2.17, 1.58, -0.26, 3.45, 13.23, 0.46],
        [-3.01, -0.41, 0.27, 2.32, -2.34, -0.23],
        [-5.08, -3.31, 0.83, 6.62, 17.61, 2.45],
    ]
)
"""Eq. 9: force from the six strains."""
ALLOY: Final = "en-aw-7075-linear-190"
ANGLES_DEG: Final = np.arange(20.0, 111.0, 1.0)
"""Of the spindle, in the picture and for the best one."""
PAYLOAD_KG: Final = 500.0
_TRANSLATION: Final = 1e-9
"""Compliance, m/N, given to rigid directions where the printed equations need a stiffness of each."""


def _with_spindle(tilt_deg: float) -> tuple[ElasticChain, Float]:
    """The robot with the spindle at an angle to the flange's axis, and axes (6,) rad that hold it upright."""
    T = pose.make(rotation.about_y(tilt_deg * DEG), np.array([0.0, 0.0, REACH_MM * MM]))
    chain = ElasticChain.build(catalog.load(ROBOT), EndEffector((), T))
    down = pose.make(rotation.about_y(180.0 * DEG), np.array(CENTRE_MM) * MM)
    return chain, inverse(chain, down, "front up noflip").q


def compliance_um_n(tilt_deg: float = 90.0) -> Float:
    """(3, 3) um/N along y (tangential to axis 1), x (radial) and z (axial), holder included.

    Args:
        tilt_deg: Angle of the spindle; 90 is upright at the end effector.
    """
    chain, q = _with_spindle(tilt_deg)
    C = cartesian_compliance(chain, q)[:3, :3]
    order = [1, 0, 2]
    holder = np.diag([HOLDER_UM_N[k] for k in order])
    out: Float = C[np.ix_(order, order)] / UM + holder
    return out


def along(direction: int, tilt_deg: float = 90.0) -> float:
    """Compliance, um/N, in feed (0), radial (1) or axial (2) direction."""
    return float(compliance_um_n(tilt_deg)[direction, direction])


def radial_compliance() -> Float:
    """Mean of the two directions across the tool, um/N, at each of :data:`ANGLES_DEG`; nan where no posture is."""
    return np.array([_radial(angle) for angle in ANGLES_DEG])


def _radial(angle_deg: float) -> float:
    try:
        return float(np.diag(compliance_um_n(angle_deg))[:2].mean())
    except ReachError:
        return float("nan")


def outstretched(mass_kg: float = 0.0) -> UndampedModes:
    """Modes of the arm stretched horizontally, drives held.

    Args:
        mass_kg: Point mass in the flange.
    """
    carried = Segment("load", pose.make(p=np.zeros(3)), mass_kg=mass_kg)
    chain = ElasticChain.build(catalog.load(ROBOT), EndEffector((carried,), np.eye(4)))
    inertia, stiffness, _, _ = matrices(chain, np.zeros(6))
    return modes(inertia, stiffness)


def printed_compliance(chain: ElasticChain, q: Float) -> Float:
    """(6, 6) compliance in TCP axes, m/N and so on, by eq. 3 to 6: ``K_i = J_i^T k_i J_i``, ``(sum K_i^-1)``.

    Args:
        chain: Every direction of every segment yields.
        q: (6,) rad.
    """
    total = np.zeros((6, 6))
    T_base_tcp = frames(chain, q)[-1] @ chain.T_last_tcp
    for T_base_i, c in zip(frames(chain, q), chain.compliance, strict=True):
        T = pose.inverse(T_base_i) @ T_base_tcp
        R, p = T[:3, :3], T[:3, 3]
        J = np.block([[R, rotation.skew(p) @ R], [np.zeros((3, 3)), R]])
        total += np.linalg.inv(J.T @ np.diag(1.0 / c) @ J)
    return total


def springs_in_series() -> float:
    """Largest relative difference of :func:`printed_compliance` from ours."""
    chain, q = _with_spindle(90.0)
    yields = replace(chain, compliance=chain.compliance + _TRANSLATION)
    R = (frames(yields, q)[-1] @ yields.T_last_tcp)[:3, :3]
    turn = np.kron(np.eye(2), R)
    ours, printed = cartesian_compliance(yields, q), turn @ printed_compliance(yields, q) @ turn.T
    return float(np.abs(ours - printed).max() / np.abs(ours).max())


def bodies_percent() -> float:
    """Share of link arm and arm in the deflection along the force, mean of the 60 load cases of Haehn2020, %."""
    chain, q, w = loaded_poses()
    parts = np.einsum("nsk,nk->ns", shares(chain, q, w)[..., :3], w[:, :3])
    named = [k for k, name in enumerate(chain.names) if "arm" in name]
    return float(100.0 * (parts[:, named].sum(axis=1) / parts.sum(axis=1)).mean())


def hand_ratio() -> float:
    """Mean torsional stiffness of axes 4 to 6 over that of axes 1 to 3 of Haehn2020 table 1."""
    driven = [s for s in catalog.load("kuka_kr300_r2500_ultra").segments if s.joint is not None]
    k = np.array([1.0 / s.compliance[5] for s in driven])
    return float(k[3:].mean() / k[:3].mean())


def determined() -> float:
    """Coefficients of a 3 by 6 matrix that loads at one point determine: 3 by the rank of the strains.

    Loads as in section 4: both signs in the plane, one along the normal, 300 N; strain linear in force.
    """
    shape = np.linalg.pinv(M)
    loads = 300.0 * np.vstack([np.eye(3), -np.eye(3)[:2]])
    return float(3 * np.linalg.matrix_rank(loads @ shape.T))


def cut_force_n() -> float:
    """Mean force of the validation cut across the tool, N."""
    cutter = Cutter(diameter_m=12.0 * MM, flutes=3, helix_rad=30.0 * DEG, flute_length_m=20.0 * MM)
    feed_m = 3000.0 * MM / 12000.0 / 3
    entry = float(np.arccos(1.0 - 2.0 * 1.0 / 12.0))
    depths = engagement_of_arc(cutter, 10.0 * MM, 0.0, entry)
    law = load_material(ALLOY).law()
    wrench = mean_force(cutter, law, depths[None], feed_m, allow_extrapolation=True).wrench_tcp[0]
    return float(np.linalg.norm(wrench[:2]))


def _noise_ratio() -> float:
    size = np.linalg.norm(M, axis=1)
    return float(size[2] / size[:2].mean())


def _cosine() -> float:
    return float(M[0] @ M[2] / (np.linalg.norm(M[0]) * np.linalg.norm(M[2])))


OURS: Final[Mapping[str, Callable[[], float]]] = {
    "springs_in_series": springs_in_series,
    "first_mode": lambda: float(outstretched().omega_rad_s[0] / (2.0 * np.pi)),
    "first_mode_loaded": lambda: float(outstretched(PAYLOAD_KG).omega_rad_s[0] / (2.0 * np.pi)),
    "first_mode_axis_1": lambda: 100.0 * float(outstretched().strain[0, 0]),
    "modes_of_gears": lambda: float(len(set(np.argmax(outstretched().strain[:, :6], axis=0)) & set(range(6)))),
    "bodies": bodies_percent,
    "hand_axes": hand_ratio,
    "tilted_spindle": lambda: float(100.0 * np.trace(compliance_um_n(55.0)) / np.trace(compliance_um_n())),
    "best_angle": lambda: float(ANGLES_DEG[np.nanargmin(radial_compliance())]),
    "independent_forces": _cosine,
    "determined": determined,
    "noise_ratio": _noise_ratio,
    "compliance_feed": lambda: along(0),
    "compliance_radial": lambda: along(1),
    "compliance_axial": lambda: along(2),
    "force_of_feed_deviation": cut_force_n,
    "force_of_radial_deviation": cut_force_n,
}
"""Ours, by the name of the row."""


def _loop(run: Mapping[str, Any], key: str) -> float | None:
    value = run["rows"].get("holder force", {}).get(key)
    return None if value is None else float(value)


def _lost(run: Mapping[str, Any], k: int) -> float:
    return 100.0 * (1.0 - float(run["plain_um_n"][k]) / float(run["pockets_um_n"][k]))


MEASURED: Final[Mapping[str, Callable[[Mapping[str, Any]], float | None]]] = {
    "holder_x": lambda run: float(run["plain_um_n"][0]),
    "holder_y": lambda run: float(run["plain_um_n"][1]),
    "holder_z": lambda run: float(run["plain_um_n"][2]),
    "lost_x": lambda run: _lost(run, 0),
    "lost_y": lambda run: _lost(run, 1),
    "lost_z": lambda run: _lost(run, 2),
    "stiffest_axis": lambda run: float(run["pockets_um_n"][2]) / min(float(v) for v in run["pockets_um_n"][:2]),
    "bridged_notch": lambda run: float(run["rib_gain"]),
    "force_error_feed": lambda run: _loop(run, "feed_n"),
    "force_error_radial": lambda run: _loop(run, "radial_n"),
    "force_error_axial": lambda run: _loop(run, "axial_n"),
    "left": lambda run: _loop(run, "median_plateau_mm"),
    "cycle": lambda run: float(run["median_ms"]),
}
"""Ours from the results of an experiment, by the name of the row."""
