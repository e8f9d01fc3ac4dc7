"""Measuring cubes on the structure: how the cube behind an elastic element moves against the one before it.

Cube a sits on the body before, cube b on the body behind one or several elastic elements. With the poses of both
without (u) and with load (l), cube b would be at ``T_l* = T_a,l T_a,u^-1 T_b,u`` if nothing between them were elastic;
what it moves beyond, ``T_l*_l``, is what the elements between do under the load they feel::

    d = sum_k J_k(b) c_k (J_k^T w)

over the springs k between the two bodies, taken at the centre of cube b in base axes.

Source: Haehn2020 section 2.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import FileFormatError
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.pulls.blocks import PullLayout, coupled_by
from counterflex.identify.pulls.history import band_slopes, lost_angles, uncertain_angles, unknown_angles
from counterflex.identify.pulls.pulls import Pulls, read_load, read_path
from counterflex.identify.pulls.residuals import COMPONENTS, PullResiduals, misplaced_by
from counterflex.robot.elasticity.chain import ElasticChain, forward, jacobian
from counterflex.robot.elasticity.compliance import element_jacobians

BASE: Final = "base"
SCALE: Final = 0.005
"""How true the sensors of a cube show its motion, and how squarely they look at it; one standard deviation."""


@dataclass(frozen=True, eq=False)
class CubeMotions:
    """Relative motions of n rows."""

    pulls: Pulls  # poses, loads and history; its displacement is the relative motion `T_l*_l` (n, 6) of cube b
    first: Int  # (n,) index of the first segment behind cube a
    last: Int  # (n,) index of the segment that cube b sits on
    p_base_after: Float  # (n, 3) m, centre of cube b
    pairs: tuple[str, ...]  # names of the pairs, by number of the channel `pair`
    pair: Int  # (n,) which pair, from 0
    d_before: Float  # (n, 6) m, rad: how cube a moved, carried to the centre of cube b
    d_after: Float  # (n, 6) m, rad: how cube b moved

    def between(self, segment: Int) -> Bool:
        """(n, k) which segments lie between the cubes of each row."""
        out: Bool = (segment >= self.first[:, None]) & (segment <= self.last[:, None])
        return out


def read_cubes(chain: ElasticChain, data: Dataset) -> CubeMotions:
    """Relative motions of a dataset.

    ``data``: Kind ``cubes``: ``q``, a load as for pulls, ``pair``, ``p_base_before``, ``p_base_after``,
    ``d_before_base``, ``d_after_base`` (n, 6); ``settings.pairs`` as ``["base/axis1", ...]``. Raises FileFormatError: a
    channel or standard deviation is missing, a pair names no bodies of the cell in order.
    """
    q, w, w_sigma = read_load(chain, data)
    history, approach = read_path(data)
    pairs = tuple(str(p) for p in data.settings.get("pairs", ()))
    ends = np.array([_ends(chain, p, data.where) for p in pairs], dtype=np.int64).reshape(-1, 2)
    number = np.rint(data.values("pair")[:, 0]).astype(np.int64) - 1
    if len(pairs) == 0 or np.any((number < 0) | (number >= len(pairs))):
        raise FileFormatError(
            "channel 'pair' counts pairs of cubes that settings.pairs does not name",
            where=data.where,
            value=f"{int(number.min()) + 1} .. {int(number.max()) + 1}",
            limit=f"1 .. {len(pairs)}",
            hint='Write under [settings]: pairs = ["base/axis1", "axis1/axis2", ...]',
        )
    before, after = data.channel("d_before_base"), data.channel("d_after_base")
    p_before, p_after = data.values("p_base_before"), data.values("p_base_after")
    carrying = _carried(before.values, p_after - p_before)
    moved = pose.displaced(pose.make(p=p_after), after.values)
    relative = pose.difference(pose.displaced(pose.make(p=p_after), carrying), moved)
    lever2 = np.sum((p_after - p_before) ** 2, axis=1, keepdims=True)
    variance = after.need_sigma() ** 2 + before.need_sigma() ** 2
    # The turn of cube a carries to the place of cube b: at half a metre 1 urad is already 0.5 um.
    variance[:, :3] += np.max(before.need_sigma()[:, 3:] ** 2, axis=1, keepdims=True) * lever2
    pulls = Pulls(
        name=data.name,
        q=q,
        w_tcp_base=w,
        w_sigma=w_sigma,
        d=relative,
        d_sigma=np.sqrt(variance),
        in_tracker=False,
        p_tcp_measured=np.zeros(3),
        approach=approach,
        history=history,
        group=data.group,
        line=data.line,
        where=data.where,
    )
    return CubeMotions(pulls, ends[number, 0] + 1, ends[number, 1], p_after, pairs, number, carrying, after.values)


def _ends(chain: ElasticChain, pair: str, where: str) -> tuple[int, int]:
    known = (BASE, *chain.names)
    before, _, after = pair.partition("/")
    if before not in known or after not in known or known.index(before) >= known.index(after):
        raise FileFormatError(
            "a pair of cubes names the body before and the one behind",
            where=f"{where}: settings.pairs",
            value=pair,
            limit=" / ".join(known),
            hint="Write for example base/axis1; the first name comes nearer to the base",
        )
    return known.index(before) - 1, known.index(after) - 1


def _carried(d_before: Float, lever: Float) -> Float:
    """Motion (n, 6) of a point on the body of cube a, ``lever`` (n, 3) away from its centre; finite rotation."""
    R = rotation.exp(d_before[:, 3:])
    shift = (R @ lever[:, :, None])[..., 0] - lever
    return np.concatenate([d_before[:, :3] + shift, d_before[:, 3:]], axis=1)


def block(chain: ElasticChain, plan: PullLayout, motions: CubeMotions, scale: float = SCALE) -> PullResiduals:
    """Residuals of relative motions; lost motion of an axis counts where its torsion lies between the cubes.

    Standard deviations: of both cubes as stated, of the lost motion, and of bearings that are not where they are
    thought to be, as in :func:`counterflex.identify.pulls.residuals.misplaced`.

    ``scale``: Relative standard deviation of what the sensors of each cube show, the same in all rows: of the whole
    motion of a cube, of which an element between two cubes leaves a small difference.
    """
    pulls = motions.pulls
    lever = motions.p_base_after - forward(chain, pulls.q)[:, :3, 3]
    columns = element_jacobians(chain, pulls.q)[:, plan.springs.segment, :, plan.springs.direction]
    J = np.moveaxis(columns, 0, -1)
    load = np.einsum("nck,nc->nk", J, pulls.w_tcp_base) * motions.between(plan.springs.segment)
    axes = _at(jacobian(chain, pulls.q), lever) * motions.between(chain.torsion)[:, None, :]
    lost, slope = np.zeros((len(pulls), 6)), np.zeros((len(pulls), 6))
    if pulls.history and chain.play is not None:
        bands = np.array([0.0 if e is None else e.half_band_rad for e in chain.play])
        slope = band_slopes(chain, pulls) * (plan.bands >= 0)
        lost = lost_angles(chain, pulls) - slope * bands
    doubt = uncertain_angles(chain, pulls) if pulls.history else np.tile(unknown_angles(chain), (len(pulls), 1))
    between = motions.between(plan.springs.segment) & (plan.springs.direction >= 3)
    soft = plan.springs.of_chain(chain)
    turned = J * soft * between[:, None, :]
    off = plan.bearing_m * np.linalg.norm(pulls.w_tcp_base[:, :3], axis=1)[:, None, None]
    added = np.sum((axes * doubt[:, None, :]) ** 2, axis=2) + np.sum((_at(turned, lever) * off) ** 2, axis=2)
    added[:, :3] += plan.bearing_m**2 * np.sum((load * soft * between) ** 2, axis=1, keepdims=True)
    acts = motions.between(plan.springs.segment)
    moved = misplaced_by(chain, plan.springs, pulls.q, pulls.w_tcp_base, plan.bearing_m, lambda t: _at(t, lever), acts)
    coupled = coupled_by(chain, plan.springs, pulls.q, pulls.w_tcp_base, lambda t: _at(t, lever), acts)
    shown = np.zeros((len(pulls), 6, chain.n + 1))
    rows = np.arange(len(pulls))
    # The whole motion of each cube, not their difference: an error of scale of the two does not cancel.
    shown[rows, :, motions.first] = -scale * motions.d_before
    shown[rows, :, motions.last + 1] = scale * motions.d_after
    return PullResiduals(
        name=pulls.name,
        group=pulls.group,
        components=COMPONENTS,
        sigma=np.sqrt(pulls.d_sigma**2 + added),
        measured=pulls.d,
        gain=_at(J, lever) * load[:, None, :],
        columns=np.arange(len(plan.springs), dtype=np.int64),
        offset=(axes @ lost[:, :, None])[..., 0],
        band_gain=axes * slope[:, None, :],
        band_columns=plan.bands,
        moved=np.concatenate([moved, coupled, shown], axis=2),
    )


def _at(twists: Float, lever: Float) -> Float:
    """Twists (n, 6, k) given at the TCP, taken at a point ``lever`` (n, 3) m away from it: ``v + omega x lever``."""
    out = twists.copy()
    out[:, :3] -= rotation.skew(lever) @ twists[:, 3:]
    return out
