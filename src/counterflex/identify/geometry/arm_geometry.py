"""Tool poses of an arm whose geometry has parameters, and what each parameter moves.

The chain of :mod:`counterflex.robot.elasticity.chain` with, behind each segment, its sag under own weight and a
constant displacement (:mod:`counterflex.robot.model.calibration`)::

    T_base_tcp = D_base prod_i (fixed_i Rz(theta_i) E_i(c_i l_i) D_i) T_last_tcp D_tcp

    theta_i = sign_i (q_j + sum_k (g_jk,sin sin(k q_j) + g_jk,cos (cos(k q_j) - 1)) + sum_t a_t u_jt(q) - h_j s_j)
              + offset_i

``l_i`` are the loads of own weight on element i, ``c_i`` its compliance; ``g`` are periodic errors of the drives, ``a``
what own weight turns axes 2 and 3 by where masses are not known (:mod:`counterflex.robot.elasticity.axis_sag`).
Parameters are the displacements ``D``, single compliances, masses, the ``g``, the ``a`` and the ``h``, half of the
lost motion of an axis that came in the sense s (:mod:`counterflex.identify.kinematics.approach_sense`); derivatives
are exact (loads are taken where bodies hang at the compliances known before: what a change of sag changes is of
second order).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.geometry import pose, rotation
from counterflex.geometry.rotation import left_jacobian
from counterflex.identify.geometry.pose_residuals import NO_PARAMETERS, components
from counterflex.robot.elasticity.axis_sag import turned_axis
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.gravity import weight_loads
from counterflex.robot.model.calibration import BASE, TCP, displacement
from counterflex.robot.model.elastic_region import growth

_SETTLING_ROUNDS = 3


@dataclass(frozen=True)
class PeriodicTerm:
    """A periodic error of a drive, sine and cosine of a multiple of its angle."""

    axis: int  # 0..5
    order: int  # k, periods per turn
    sine: int  # place of the sine's amplitude among the parameters
    cosine: int  # place of the cosine's


@dataclass(frozen=True, eq=False)
class ArmLayout:
    """Places of the parameters of the arm among all parameters."""

    # places (6,) of the displacement behind a segment, or of `base` and `tcp`; -1 stays as known
    displaced: dict[str, Int] = field(default_factory=dict)
    # (6,) m, rad displacements that are no parameters, by the same names
    known: dict[str, Float] = field(default_factory=dict)
    # places of single compliances, by segment and direction 0..5
    soft: dict[tuple[int, int], int] = field(default_factory=dict)
    mass: dict[int, int] = field(default_factory=dict)  # places of the masses of bodies, by segment
    periodic: tuple[PeriodicTerm, ...] = ()  # errors of drives
    turns: Int | None = None  # (6,) places of what own weight turns axes 2 and 3 by, or None
    lost: dict[int, int] = field(default_factory=dict)  # places of half of the lost motion of an axis, by axis 0..5

    def soft_of(self, segment: int) -> dict[int, int]:
        """Places of the compliances of one segment, by direction."""
        return {d: place for (i, d), place in self.soft.items() if i == segment}

    def displacement_at(self, name: str, x: Float) -> Float | None:
        """(6,) m, rad at the values x, or None where nothing is displaced."""
        index = self.displaced.get(name)
        base = self.known.get(name)
        if index is None:
            return base
        here = components(x, index)
        return here if base is None else np.where(index >= 0, here, base)


class _Frames(NamedTuple):
    """Frames of an arm at the values of its parameters."""

    drives: list[Float]  # frames (m, 4, 4) behind every drive
    ends: list[Float]  # frames (m, 4, 4) behind every sag
    T_last: Float  # frame (m, 4, 4) of the TCP before its displacement
    T: Float  # frame (m, 4, 4) of the TCP
    moves: dict[str, Float]  # (6,) m, rad displacements by name


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """The arm in a set of poses."""

    chain: ElasticChain  # nominal chain: geometry without calibration, with its compliances and masses
    layout: ArmLayout  # where its parameters are
    q: Float  # (m, 6) rad
    # (m, n, 6) of own weight on each element times the factor of its regions, N, N m; None leaves sag out
    loads: Float | None = None
    # (m, b, n, 6) likewise of one kilogram of each of the b bodies whose mass is a parameter, or None
    unit_loads: Float | None = None
    # (m, 6) of counterflex.robot.elasticity.axis_sag.unit_turns, where the layout has their places
    unit_turns: Float | None = None
    sense: Float | None = None  # (m, 6) in which each axis came to the pose, +1, -1 or 0 where it is not known; or None
    _last: dict[bytes, _Frames] = field(default_factory=dict, init=False, repr=False)

    def subset(self, rows: Bool) -> ArmGeometry:
        """The marked poses only."""
        return replace(
            self,
            q=self.q[rows],
            loads=None if self.loads is None else self.loads[rows],
            unit_loads=None if self.unit_loads is None else self.unit_loads[rows],
            unit_turns=None if self.unit_turns is None else self.unit_turns[rows],
            sense=None if self.sense is None else self.sense[rows],
        )

    def poses(self, x: Float) -> Float:
        """T_base_tcp (m, 4, 4) at the values x (p,) of all parameters."""
        return self._frames(x).T.copy()

    def moved(self, x: Float) -> tuple[Float, Int, Float]:
        """Poses of the tool and their derivatives by the parameters.

        ``x``: (p,) values of all parameters, SI.

        Returns:
            T_base_tcp (m, 4, 4); places (k,) of the arm's parameters; (m, 6, k) twist of the TCP (velocity of its
            origin, then rotation, base axes) per unit of each.
        """
        drives, ends, T_last, T, moves = self._frames(x)
        tip = T[:, :3, 3]
        lay, chain = self.layout, self.chain
        loads, compliance = self._loads(x), self._compliance(x)
        yields = np.any(compliance > 0.0, axis=1)
        columns = _Columns(tip, lay, moves)
        heavy = np.zeros((len(self.q), 6, len(lay.mass)))
        if loads is not None:
            delta = compliance * loads
            bends = _elastic_axes(delta)
        columns.displaced(BASE, np.broadcast_to(np.eye(4), T.shape))
        for i, name in enumerate(chain.names):
            R, p = drives[i][:, :3, :3], drives[i][:, :3, 3]
            for places, turns in self._axis_turns(i):
                columns.turns(R[:, :, 2:] * (chain.sign[i] * turns)[:, None, :], p, places)
            soft = lay.soft_of(i)
            if loads is not None and (soft or (lay.mass and yields[i])):
                centre = p + (R @ delta[:, i, :3, None])[..., 0]
                axes = R @ bends[:, i]
                for d, place in soft.items():
                    column = (R if d < 3 else axes)[:, :, d % 3, None] * loads[:, i, d, None, None]
                    if d < 3:
                        columns.shifts(column, np.array([place]))
                    else:
                        columns.turns(column, centre, np.array([place]))
                if self.unit_loads is not None and yields[i]:
                    by = compliance[i] * self.unit_loads[:, :, i]  # (m, bodies, 6)
                    turn = axes @ np.swapaxes(by[:, :, 3:], 1, 2)
                    heavy[:, :3] += R @ np.swapaxes(by[:, :, :3], 1, 2) - rotation.skew(tip - centre) @ turn
                    heavy[:, 3:] += turn
            columns.displaced(name, ends[i])
        columns.displaced(TCP, T_last)
        if loads is not None and lay.mass:
            columns.add(heavy, np.array(list(lay.mass.values())))
        return T, *columns.all()

    def settled(self) -> ArmGeometry:
        """The same poses with the loads of own weight where the bodies are after sag (at the known compliances)."""
        if not np.any(self.chain.mass > 0.0):
            return replace(self, loads=None)
        bare = ArmLayout(known=self.layout.known)
        grown = growth(self.chain.regions, self.chain.names, self.q)  # as much as if the load were larger
        plain = replace(self, layout=bare, loads=grown * weight_loads(self.chain, self.q), unit_loads=None)
        ends = np.stack(plain._frames(np.zeros(0)).ends, axis=1)
        for _ in range(_SETTLING_ROUNDS):
            plain = replace(plain, loads=grown * weight_loads(self.chain, self.q, ends))
            ends = np.stack(plain._frames(np.zeros(0)).ends, axis=1)
        units = None
        if self.layout.mass:
            each = np.eye(self.chain.n)
            ones = [replace(self.chain, mass=each[body], counterbalance=None) for body in self.layout.mass]
            units = np.stack([grown * weight_loads(one, self.q, ends) for one in ones], axis=1)
        return replace(self, loads=plain.loads, unit_loads=units)

    def _loads(self, x: Float) -> Float | None:
        if self.loads is None or self.unit_loads is None:
            return self.loads
        bodies = list(self.layout.mass)
        more = x[list(self.layout.mass.values())] - self.chain.mass[bodies]
        out: Float = self.loads + np.einsum("b,mbnd->mnd", more, self.unit_loads)
        return out

    def _compliance(self, x: Float) -> Float:
        compliance = np.array(self.chain.compliance)
        for (segment, direction), place in self.layout.soft.items():
            compliance[segment, direction] = x[place]
        return compliance

    def _sag(self, x: Float) -> Float | None:
        loads = self._loads(x)
        return None if loads is None else self._compliance(x) * loads

    def _frames(self, x: Float) -> _Frames:
        """Residuals and their derivatives are asked for at the same values one after the other: the last are kept."""
        key = x.tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = self._frames_at(x)
        return self._last[key]

    def _frames_at(self, x: Float) -> _Frames:
        chain, lay, m = self.chain, self.layout, len(self.q)
        names = (BASE, *chain.names, TCP)
        moves = {name: d for name in names if (d := lay.displacement_at(name, x)) is not None}
        step = dict(zip(moves, displacement(_rows(moves)), strict=True))
        bent = self._bent(x)
        T: Float = np.broadcast_to(step.get(BASE, np.eye(4)), (m, 4, 4))
        drives, ends = [], []
        for i, name in enumerate(chain.names):
            T = T @ chain.fixed[i]
            if chain.joint[i] >= 0:
                T = _turned(T, self._angle(i, x))
            drives.append(T)
            if i in bent:
                T = T @ bent[i]
            ends.append(T)
            if name in step:
                T = T @ step[name]
        T_last = T @ chain.T_last_tcp
        return _Frames(drives, ends, T_last, T_last @ step[TCP] if TCP in step else T_last, moves)

    def _bent(self, x: Float) -> dict[int, Float]:
        """Displacements (m, 4, 4) by sag, by segment that yields."""
        delta = self._sag(x)
        if delta is None:
            return {}
        E = _elastic(delta[:, self._soft])
        return {segment: E[:, k] for k, segment in enumerate(self._soft)}

    @cached_property
    def _soft(self) -> list[int]:
        """Segments that yield, or may."""
        known = np.flatnonzero(np.any(self.chain.compliance > 0.0, axis=1)).tolist()
        return sorted({*known, *(segment for segment, _ in self.layout.soft)})

    def _angle(self, i: int, x: Float) -> Float:
        q = self.q[:, self.chain.joint[i]]
        out = q
        for term in self.layout.periodic:
            if term.axis == self.chain.joint[i]:
                k = term.order
                out = out + x[term.sine] * np.sin(k * q) + x[term.cosine] * (np.cos(k * q) - 1.0)
        places, turns = self._turns_of(i)
        if len(places):
            out = out + turns @ x[places]
        angle: Float = self.chain.sign[i] * out + self.chain.offset[i]
        return angle

    def _axis_turns(self, i: int) -> Iterator[tuple[Int, Float]]:
        """Places (k,) and turns (m, k) per unit of all that turns the axis of segment i, before its sign."""
        for term in self.layout.periodic:
            if term.axis == self.chain.joint[i]:
                angle = term.order * self.q[:, term.axis]
                yield np.array([term.sine, term.cosine]), np.stack([np.sin(angle), np.cos(angle) - 1.0], axis=-1)
        places, turns = self._turns_of(i)
        if len(places):
            yield places, turns

    def _turns_of(self, i: int) -> tuple[Int, Float]:
        """Places (k,) of what weight and lost motion turn the axis of segment i by, and the turns (m, k) per unit."""
        places, turns, axis = np.zeros(0, dtype=np.int64), np.zeros((len(self.q), 0)), int(self.chain.joint[i])
        if self.layout.turns is not None and self.unit_turns is not None:
            mine = turned_axis() == axis
            places, turns = self.layout.turns[mine], self.unit_turns[:, mine]
        if self.sense is not None and axis in self.layout.lost:
            places = np.append(places, self.layout.lost[axis])
            turns = np.concatenate([turns, -self.sense[:, [axis]]], axis=1)
        return places, turns


def displaced_arm(chain: ElasticChain, q: Float, known: dict[str, Float] | None = None) -> ArmGeometry:
    """An arm without parameters: a nominal chain with known displacements, sagging under its own weight."""
    layout = ArmLayout(displaced=dict.fromkeys((), NO_PARAMETERS), known=dict(known or {}))
    return ArmGeometry(chain, layout, q).settled()


def _turned(T: Float, angle: Float) -> Float:
    """T (m, 4, 4) followed by a turn about its z by angle (m,)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    out = T.copy()
    out[..., 0] = c * T[..., 0] + s * T[..., 1]
    out[..., 1] = c * T[..., 1] - s * T[..., 0]
    return out


def _rows(moves: dict[str, Float]) -> Float:
    """Displacements (k, 6)."""
    return np.array(list(moves.values())).reshape(-1, 6)


def _elastic(delta: Float) -> Float:
    """E(delta) (..., 4, 4): translation, then z-y'-x'' rotations."""
    return pose.make(rotation.from_zyx(delta[..., [5, 4, 3]]), delta[..., :3])


def _elastic_axes(delta: Float) -> Float:
    """(..., 3, 3) axes in the element's frame that its rotations rx, ry, rz turn about, as columns."""
    out = np.zeros((*delta.shape[:-1], 3, 3))
    out[..., 2, 2] = 1.0
    R = rotation.about_z(delta[..., 5])
    out[..., 1] = R[..., 1]
    out[..., 0] = (R @ rotation.about_y(delta[..., 4]))[..., 0]
    return out


class _Columns:
    """Twists of the TCP per unit of each parameter, collected."""

    def __init__(self, tip: Float, layout: ArmLayout, moves: dict[str, Float]) -> None:
        self.tip, self.layout, self.moves = tip, layout, moves
        self.turning = dict(zip(moves, left_jacobian(_rows(moves)[:, 3:]), strict=True))
        self.blocks: list[Float] = []
        self.places: list[Int] = []

    def add(self, columns: Float, places: Int) -> None:
        """Twists (m, 6, k)."""
        self.blocks.append(columns)
        self.places.append(places)

    def shifts(self, axes: Float, places: Int) -> None:
        """Translations along axes (m, 3, k)."""
        self.add(np.concatenate([axes, np.zeros_like(axes)], axis=1), places)

    def turns(self, axes: Float, centre: Float, places: Int) -> None:
        """Rotations about axes (m, 3, k) through centres (m, 3)."""
        self.add(np.concatenate([-rotation.skew(self.tip - centre) @ axes, axes], axis=1), places)

    def displaced(self, name: str, before: Float) -> None:
        """The displacement behind frames (m, 4, 4)."""
        index = self.layout.displaced.get(name)
        if index is None or name not in self.moves:
            return
        R = before[:, :3, :3]
        first, last = index[:3] >= 0, index[3:] >= 0
        self.shifts(R[:, :, first], index[:3][first])
        centre = before[:, :3, 3] + R @ self.moves[name][:3]
        self.turns((R @ self.turning[name])[:, :, last], centre, index[3:][last])

    def all(self) -> tuple[Int, Float]:
        """Places (k,) and twists (m, 6, k)."""
        if not self.blocks:
            return np.zeros(0, dtype=np.int64), np.zeros((len(self.tip), 6, 0))
        return np.concatenate(self.places).astype(np.int64), np.concatenate(self.blocks, axis=-1)
