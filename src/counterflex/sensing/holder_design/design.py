"""What a drawn holder does: compliance at the tool tip, strain of every bridge per newton, condition of M."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import wrench
from counterflex.geometry.rotation import skew
from counterflex.sensing.holder_beam import Gauge, HolderBeam
from counterflex.sensing.holder_design.bricks import MirroredBody, Solved, solve
from counterflex.sensing.holder_design.drawing import BRICKS, Drawing, Pocket
from counterflex.sensing.strain_holder import Sight, lever, sight


@dataclass(frozen=True, eq=False)
class Behaviour:
    """A holder under load.

    Attributes:
        compliance: (6, 6) m/N, rad/(N m): motion of the tool tip by a wrench about it, holder axes.
        sensitivity: (n, 6) 1/N, 1/(N m): what each bridge shows (strain of a bar in tension) by a wrench about the
            holder's origin.
        strain: (n, 3) 1/N: the same by a force at the tool tip.
        sight: What the bridges see of a force at the tool tip, for white noise of one unit each scaled by ``noise``.
        unknowns: Of the cheeks that were solved: one where the other is its mirror image.
    """

    compliance: Float
    sensitivity: Float
    strain: Float
    sight: Sight | None
    unknowns: int

    @property
    def tip_m_per_n(self) -> Float:
        """(3,) m/N: deflection of the tool tip in the direction of a force on it."""
        out: Float = np.diag(self.compliance)[:3].copy()
        return out


def behaviour(
    drawing: Drawing, mesh_m: float, noise: float = 0.2e-6, *, cut: bool = True, bricks: int = BRICKS
) -> Behaviour:
    """Solve both cheeks and join them by the rigid ring.

    ``k = sum A^T K_cheek A`` at the ring, ``A`` the motion of a cheek's end by that of the ring; the tool tip is fixed
    to the ring. A bridge of two gauges along z and two across it shows ``(eps_z - eps_y) / (1 + nu)``, the mean under
    the grid.

    Args:
        drawing: The holder.
        mesh_m: Largest edge of a brick, m.
        noise: Standard deviation of a bridge's strain.
        cut: With the pockets; else the original design on the same grid, its bridges not evaluated.
        bricks: Fewest over every pocket and the wall behind it.

    Raises:
        InputError: The drawing cannot be meshed, or a piece of it is held by nothing.
    """
    beam = drawing.beam
    right = solve(drawing.cheek(1, mesh_m, cut=cut, bricks=bricks), beam.e_pa, beam.poisson_ratio)
    solved: dict[int, Solved | MirroredBody] = {1: right}
    solved[-1] = (
        MirroredBody(right)
        if drawing.mirrored
        else solve(drawing.cheek(-1, mesh_m, cut=cut, bricks=bricks), beam.e_pa, beam.poisson_ratio)
    )
    motions = {side: np.eye(6) for side in solved}
    for side, A in motions.items():
        A[:3, 3:] = -skew(np.array([0.5 * side * beam.distance_m, 0.0, 0.0]))
    ring = np.linalg.inv(sum(A.T @ solved[side].stiffness @ A for side, A in motions.items()))
    at_ring = np.stack([wrench.shift(w, np.array([0.0, 0.0, -beam.length_m])) for w in np.eye(6)], axis=1)
    pockets = drawing.pockets if cut else ()
    sensitivity = np.zeros((len(pockets), 6))
    for k, pocket in enumerate(pockets):
        eps = solved[pocket.side].strain(drawing.gauge_points(pocket)).mean(axis=0)
        shown = (eps[2, 2] - eps[1, 1]) / (1.0 + beam.poisson_ratio)
        sensitivity[k] = shown @ motions[pocket.side] @ ring @ at_ring
    p = np.array(drawing.p_holder_tcp)
    arm = np.eye(6)
    arm[:3, 3:] = -skew(p - np.array([0.0, 0.0, beam.length_m]))
    strain = sensitivity @ lever(p)
    seen = sight(strain, np.eye(len(strain)) * noise**2) if len(strain) >= 3 else None
    unknowns = sum(one.unknowns for one in solved.values())
    return Behaviour(arm @ ring @ arm.T, sensitivity, strain, seen, unknowns)


def without_ribs(drawing: Drawing) -> Drawing:
    """The same pockets as plain ones, gauges on the floor."""
    return replace(drawing, pockets=tuple(replace(p, rib_m=0.0) for p in drawing.pockets))


def lost_stiffness(plain: Behaviour, cut: Behaviour) -> Float:
    """(3,) share of the stiffness at the tool tip that the pockets cost, by direction: ``1 - C_plain / C_cut``."""
    out: Float = 1.0 - plain.tip_m_per_n / cut.tip_m_per_n
    return out


def gain_by_pocket(drawing: Drawing, cut: Behaviour) -> Float:
    """(n,) strain of each bridge by that of the plain cheek's surface there, in the force direction that it sees best.

    The surface strain is that of beam theory (:class:`counterflex.sensing.holder_beam.HolderBeam`).
    """
    gauges = tuple(Gauge(_surface(drawing, p)) for p in drawing.pockets)
    plain = drawing.beam.sensitivity(gauges) @ lever(np.array(drawing.p_holder_tcp))
    best = np.argmax(np.abs(plain), axis=1)
    rows = np.arange(len(gauges))
    out: Float = cut.strain[rows, best] / plain[rows, best]
    return out


def beam_tip(beam: HolderBeam, p_holder_tcp: Float) -> tuple[Float, Float]:
    """(3,) and (3,) m/N: deflection of the tool tip of the holder without pockets by beam theory.

    The first by Euler-Bernoulli, the second by Timoshenko with the shear coefficient ``10 (1 + nu) / (12 + 11 nu)`` of
    a rectangle (Cowper 1966). Two prismatic cheeks between the clamped end and a rigid ring.

    ``p_holder_tcp``: (3,) m tool tip.
    """
    nu, L = beam.poisson_ratio, beam.length_m
    g = beam.e_pa / (2.0 * (1.0 + nu))
    shear = L * (12.0 + 11.0 * nu) / (10.0 * (1.0 + nu) * g * beam.thickness_m * beam.width_m)
    arm = np.eye(6)
    arm[:3, 3:] = -skew(np.asarray(p_holder_tcp) - np.array([0.0, 0.0, L]))
    out = []
    for more in (0.0, shear):
        tip = np.linalg.inv(beam.tip_stiffness())
        tip[0, 0] += more
        tip[1, 1] += more
        k = np.linalg.inv(tip)
        ring = np.zeros((6, 6))
        for side in (-0.5, 0.5):
            A = np.eye(6)
            A[:3, 3:] = -skew(np.array([side * beam.distance_m, 0.0, 0.0]))
            ring += A.T @ k @ A
        out.append(np.diag(arm @ np.linalg.inv(ring) @ arm.T)[:3].copy())
    return out[0], out[1]


def _surface(drawing: Drawing, pocket: Pocket) -> tuple[float, float, float]:
    beam = drawing.beam
    face = 1.0 if pocket.outer else -1.0
    x = pocket.side * (0.5 * beam.distance_m + face * 0.5 * beam.thickness_m)
    return x, pocket.y_m, pocket.z_m
