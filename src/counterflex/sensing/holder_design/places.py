"""Place the pockets: the most that bridges can tell of the force under a limit of lost stiffness."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose
from counterflex.geometry.rotation import skew
from counterflex.sensing.holder_design.bricks import MirroredBody, Solved, solve
from counterflex.sensing.holder_design.drawing import BRICKS, LEAST_GAP_M, Drawing, Pocket
from counterflex.sensing.strain_holder import Gauge, HolderBeam, Sight, lever, sight


@dataclass(frozen=True, eq=False)
class Behaviour:
    """A holder under load."""

    compliance: Float  # (6, 6) m/N, rad/(N m): motion of the tool tip by a wrench about it, holder axes
    # (n, 6) 1/N, 1/(N m): what each bridge shows (strain of a bar in tension) by a wrench about the holder's origin
    sensitivity: Float
    strain: Float  # (n, 3) 1/N: the same by a force at the tool tip
    # what the bridges see of a force at the tool tip, for white noise of one unit each scaled by ``noise``
    sight: Sight | None
    unknowns: int  # of the cheeks that were solved: one where the other is its mirror image

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

    ``mesh_m``: Largest edge of a brick, m. ``cut``: With the pockets; else the original design on the same grid, its
    bridges not evaluated. ``bricks``: Fewest over every pocket and the wall behind it. Raises InputError: the drawing
    cannot be meshed, or a piece of it is held by nothing.
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
    at_ring = np.stack([pose.shift_wrench(w, np.array([0.0, 0.0, -beam.length_m])) for w in np.eye(6)], axis=1)
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

    The surface strain is that of beam theory (:class:`counterflex.sensing.strain_holder.HolderBeam`).
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


_STATIONS = (0.12, 0.3, 0.5, 0.7, 0.88)
_ACROSS = (-1.0, -0.5, 0.0, 0.5, 1.0)
_TRIALS = 4


@dataclass(frozen=True, eq=False)
class Chosen:
    """Places chosen."""

    drawing: Drawing  # with its pockets
    plain: Behaviour  # the holder without them, same grid
    cut: Behaviour
    trials: int  # how often the finite elements were asked

    @classmethod
    def of(
        cls, drawing: Drawing, count: int, lost_share: float, mesh_m: float, noise: float, *, bricks: int = BRICKS
    ) -> Chosen:
        """Choose places for ``count`` pockets like the first of the drawing.

        ``max log det(K^T K)`` with ``K`` the strain per newton at the tool tip, ``s_plain`` by beam theory times the
        gain of the pocket, and ``sum_k kappa_d s_kd^2 <= lost_share`` for each direction d: the compliance that a small
        pocket adds goes with the square of the strain where it is cut. Gain and kappa come from finite elements of the
        present drawing, and again from the choice until it keeps the limit.

        ``count``: Bridges, 3 to 12. ``lost_share``: Largest share of the stiffness at the tool tip that may be lost,
        any direction, 0 .. 1. ``bricks``: Fewest over every pocket and the wall behind it. Raises InputError: no
        pockets, a number out of range, or no choice within the limit.
        """
        if not drawing.pockets:
            raise InputError("the drawing has no pocket to take as the pattern", hint="Give one table [[pockets]]")
        if not 3 <= count <= 12 or not 0.0 < lost_share < 1.0:
            raise InputError("choice of places", value=(count, lost_share), limit="3 .. 12 bridges, a share 0 .. 1")
        places = candidates(drawing, drawing.pockets[0])
        surface = _surface_strain(drawing, places)
        now, limit = drawing, lost_share
        for trial in range(1, _TRIALS + 1):
            plain, cut = (behaviour(now, mesh_m, noise, cut=c, bricks=bricks) for c in (False, True))
            lost = lost_stiffness(plain, cut)
            if trial > 1 and np.all(lost <= lost_share):
                return cls(now, plain, cut, trial)
            gain = float(np.median(np.abs(gain_by_pocket(now, cut))))
            own = _surface_strain(drawing, now.pockets)
            kappa = np.maximum(lost, 0.0) / np.maximum(np.sum(own**2, axis=0), 1e-300)
            if trial > 1:
                limit *= lost_share / float(np.max(lost))
            now = replace(drawing, pockets=_exchange(places, gain * surface, surface**2 * kappa, count, limit))
        raise InputError(
            "no choice of places keeps the limit of lost stiffness",
            value=f"{100.0 * float(np.max(lost)):.1f} %",
            limit=f"{100.0 * lost_share:g} %",
            hint="Make the pockets shallower, fewer, or allow more",
        )


def candidates(drawing: Drawing, template: Pocket) -> tuple[Pocket, ...]:
    """Pockets like ``template`` on both faces of both cheeks, five places along and up to five across each."""
    beam = drawing.beam
    half_y = 0.5 * (beam.width_m - template.width_m)
    ys = sorted({round(half_y * share, 9) for share in _ACROSS})
    zs = [beam.length_m * share for share in _STATIONS]
    return tuple(
        replace(template, side=side, outer=outer, y_m=y, z_m=z)
        for side, outer, y, z in product((-1, 1), (True, False), ys, zs)
    )


def _surface_strain(drawing: Drawing, pockets: tuple[Pocket, ...]) -> Float:
    """(n, 3) 1/N: strain of the plain cheeks' surface at the pockets by a force at the tool tip."""
    beam, gauges = drawing.beam, []
    for p in pockets:
        face = 1.0 if p.outer else -1.0
        x = p.side * 0.5 * (beam.distance_m + face * beam.thickness_m)
        gauges.append(Gauge((x, p.y_m, p.z_m)))
    out: Float = beam.sensitivity(gauges) @ lever(np.array(drawing.p_holder_tcp))
    return out


def _exchange(places: tuple[Pocket, ...], K: Float, cost: Float, count: int, limit: float) -> tuple[Pocket, ...]:
    """Greedy choice, then exchanges while the determinant grows; pockets keep apart and the cost below the limit."""
    free = np.array([[_free(a, b) for b in places] for a in places])
    K = K / np.sqrt(np.mean(K**2))
    score = partial(_score, free, K, cost, limit, count)
    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(max(range(len(places)), key=lambda i: score([*chosen, i])))
    best = score(chosen)
    while True:
        for k in range(count):
            rest = chosen[:k] + chosen[k + 1 :]
            chosen = [*rest[:k], max(range(len(places)), key=lambda i: score([*rest, i])), *rest[k:]]
        now = score(chosen)
        if now <= best + 1e-9:
            return tuple(places[i] for i in chosen)
        best = now


def _score(free: Bool, K: Float, cost: Float, limit: float, count: int, rows: list[int]) -> float:
    """Logarithm of the determinant of the information, less a penalty for cost above the rows' share of the limit."""
    if len(rows) > 1 and not np.all(free[np.ix_(rows, rows)] | np.eye(len(rows), dtype=np.bool_)):
        return -np.inf
    over = float(np.max(np.sum(cost[rows], axis=0))) / (limit * len(rows) / count) - 1.0
    value = float(np.linalg.slogdet(K[rows].T @ K[rows] + 1e-6 * np.eye(3))[1])
    return value - 100.0 * max(0.0, over)


def _free(a: Pocket, b: Pocket) -> bool:
    """Return whether both can be cut: as :class:`Drawing` asks of them."""
    if a.side != b.side:
        return True
    gap = max(abs(a.y_m - b.y_m) - 0.5 * (a.width_m + b.width_m), abs(a.z_m - b.z_m) - 0.5 * (a.height_m + b.height_m))
    return gap >= LEAST_GAP_M
