"""Where to put the pockets: the most that bridges can tell of the force under a limit of lost stiffness."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.sensing.holder_beam import Gauge
from counterflex.sensing.holder_design.design import Behaviour, behaviour, gain_by_pocket, lost_stiffness
from counterflex.sensing.holder_design.drawing import BRICKS, LEAST_GAP_M, Drawing, Pocket
from counterflex.sensing.strain_holder import lever

_STATIONS = (0.12, 0.3, 0.5, 0.7, 0.88)
_ACROSS = (-1.0, -0.5, 0.0, 0.5, 1.0)
_TRIALS = 4


@dataclass(frozen=True, eq=False)
class Chosen:
    """Places chosen.

    Attributes:
        drawing: With its pockets.
        plain: The holder without them, same grid.
        trials: How often the finite elements were asked.
    """

    drawing: Drawing
    plain: Behaviour
    cut: Behaviour
    trials: int


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


def choose(
    drawing: Drawing, count: int, lost_share: float, mesh_m: float, noise: float, *, bricks: int = BRICKS
) -> Chosen:
    """Choose places for ``count`` pockets like the first of the drawing.

    ``max log det(K^T K)`` with ``K`` the strain per newton at the tool tip, ``s_plain`` by beam theory times the gain
    of the pocket, and ``sum_k kappa_d s_kd^2 <= lost_share`` for each direction d: the compliance that a small pocket
    adds goes with the square of the strain where it is cut. Gain and kappa come from finite elements of the present
    drawing, and again from the choice until it keeps the limit.

    Args:
        drawing: Its first pocket is the template.
        count: Bridges, 3 to 12.
        lost_share: Largest share of the stiffness at the tool tip that may be lost, any direction, 0 .. 1.
        mesh_m: Largest edge of a brick.
        noise: Standard deviation of a bridge's strain.
        bricks: Fewest over every pocket and the wall behind it.

    Raises:
        InputError: No pockets, a number out of range, or no choice within the limit.
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
            return Chosen(now, plain, cut, trial)
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

    def score(rows: list[int]) -> float:
        if len(rows) > 1 and not np.all(free[np.ix_(rows, rows)] | np.eye(len(rows), dtype=np.bool_)):
            return -np.inf
        over = float(np.max(np.sum(cost[rows], axis=0))) / (limit * len(rows) / count) - 1.0
        value = float(np.linalg.slogdet(K[rows].T @ K[rows] + 1e-6 * np.eye(3))[1])
        return value - 100.0 * max(0.0, over)

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


def _free(a: Pocket, b: Pocket) -> bool:
    """Whether both can be cut: as :class:`Drawing` asks of them."""
    if a.side != b.side:
        return True
    gap = max(abs(a.y_m - b.y_m) - 0.5 * (a.width_m + b.width_m), abs(a.z_m - b.z_m) - 0.5 * (a.height_m + b.height_m))
    return gap >= LEAST_GAP_M
