"""Tool poses of an arm whose geometry has parameters, and what each parameter moves.

The chain of :mod:`counterflex.robot.chain` with, behind each segment, its sag under own weight and a constant
displacement (:mod:`counterflex.robot.calibration`)::

    T_base_tcp = D_base prod_i (fixed_i Rz(theta_i) E_i(c_i l_i) D_i) T_last_tcp D_tcp

    theta_i = sign_i (q_j + sum_k (g_jk,sin sin(k q_j) + g_jk,cos (cos(k q_j) - 1))) + offset_i

``l_i`` are the loads of own weight on element i, ``c_i`` its compliance; ``g`` are periodic errors of the drives.
Parameters are the displacements ``D``, single compliances and the ``g``; derivatives are exact (the loads are those of
the compliances known before: the change of loads by a change of sag is of second order).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.geometry import pose, rotation
from counterflex.geometry.rotation_derivative import left_jacobian
from counterflex.identify.placed_frame import NO_PARAMETERS, components
from counterflex.robot.calibration import BASE, TCP, displacement
from counterflex.robot.chain import ElasticChain
from counterflex.robot.gravity import weight_loads

_SETTLING_ROUNDS = 3


@dataclass(frozen=True)
class PeriodicTerm:
    """A periodic error of a drive, sine and cosine of a multiple of its angle.

    Attributes:
        axis: 0..5.
        order: k, periods per turn.
        sine: Place of the sine's amplitude among the parameters.
        cosine: Place of the cosine's.
    """

    axis: int
    order: int
    sine: int
    cosine: int


@dataclass(frozen=True, eq=False)
class ArmLayout:
    """Where the parameters of the arm stand among all parameters.

    Attributes:
        displaced: Places (6,) of the displacement behind a segment, or of ``base`` and ``tcp``; -1 stays as known.
        known: (6,) m, rad displacements that are no parameters, by the same names.
        soft: Places of single compliances, by segment and direction 0..5.
        periodic: Errors of drives.
    """

    displaced: dict[str, Int] = field(default_factory=dict)
    known: dict[str, Float] = field(default_factory=dict)
    soft: dict[tuple[int, int], int] = field(default_factory=dict)
    periodic: tuple[PeriodicTerm, ...] = ()

    def displacement_at(self, name: str, x: Float) -> Float | None:
        """(6,) m, rad at the values x, or None where nothing is displaced."""
        index = self.displaced.get(name)
        base = self.known.get(name)
        if index is None:
            return base
        here = components(x, index)
        return here if base is None else np.where(index >= 0, here, base)


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """The arm in a set of poses.

    Attributes:
        chain: Nominal chain: geometry without calibration, with its compliances and masses.
        layout: Where its parameters are.
        q: (m, 6) rad.
        loads: (m, n, 6) of own weight on each element, N, N m, or None where sag is left out.
    """

    chain: ElasticChain
    layout: ArmLayout
    q: Float
    loads: Float | None = None

    def subset(self, rows: Bool) -> ArmGeometry:
        """The marked poses only."""
        return replace(self, q=self.q[rows], loads=None if self.loads is None else self.loads[rows])

    def poses(self, x: Float) -> Float:
        """T_base_tcp (m, 4, 4) at the values x (p,) of all parameters."""
        return self._frames(x)[-1]

    def moved(self, x: Float) -> tuple[Float, Int, Float]:
        """What the parameters move.

        Args:
            x: (p,) values of all parameters, SI.

        Returns:
            T_base_tcp (m, 4, 4); places (k,) of the arm's parameters; (m, 6, k) twist of the TCP (velocity of its
            origin, then rotation, base axes) per unit of each.
        """
        drives, ends, T_last, T = self._frames(x)
        tip = T[:, :3, 3]
        lay, chain = self.layout, self.chain
        places: list[int] = []
        columns: list[Float] = []

        def turn(axis: Float, centre: Float, place: int) -> None:
            places.append(place)
            columns.append(np.concatenate([np.cross(axis, tip - centre), axis], axis=-1))

        def shift(axis: Float, place: int) -> None:
            places.append(place)
            columns.append(np.concatenate([axis, np.zeros_like(axis)], axis=-1))

        def displaced(name: str, before: Float) -> None:
            index, d = lay.displaced.get(name), lay.displacement_at(name, x)
            if index is None or d is None:
                return
            R = before[:, :3, :3]
            centre = before[:, :3, 3] + R @ d[:3]
            axes = R @ left_jacobian(d[3:])
            for c in range(6):
                if index[c] >= 0 and c < 3:
                    shift(R[:, :, c], int(index[c]))
                elif index[c] >= 0:
                    turn(axes[:, :, c - 3], centre, int(index[c]))

        delta = self._sag(x)
        displaced(BASE, np.broadcast_to(np.eye(4), (len(self.q), 4, 4)))
        for i, name in enumerate(chain.names):
            driven = drives[i]
            for term in lay.periodic:
                if term.axis == chain.joint[i]:
                    angle = term.order * self.q[:, term.axis]
                    axis = chain.sign[i] * driven[:, :3, 2]
                    turn(axis * np.sin(angle)[:, None], driven[:, :3, 3], term.sine)
                    turn(axis * (np.cos(angle) - 1.0)[:, None], driven[:, :3, 3], term.cosine)
            soft = [(d, place) for (segment, d), place in lay.soft.items() if segment == i]
            if soft and self.loads is not None and delta is not None:
                R, e = driven[:, :3, :3], delta[:, i]
                centre = driven[:, :3, 3] + (R @ e[:, :3, None])[..., 0]
                for d, place in soft:
                    load = self.loads[:, i, d, None]
                    if d < 3:
                        shift(R[:, :, d] * load, place)
                    else:
                        turn((R @ _elastic_axis(e, d)[..., None])[..., 0] * load, centre, place)
            displaced(name, ends[i])
        displaced(TCP, T_last)
        if not columns:
            return T, np.zeros(0, dtype=np.int64), np.zeros((len(T), 6, 0))
        return T, np.array(places, dtype=np.int64), np.stack(columns, axis=-1)

    def settled(self) -> ArmGeometry:
        """The same poses with the loads of own weight where the bodies are after sag (at the known compliances)."""
        if not np.any(self.chain.mass > 0.0):
            return replace(self, loads=None)
        plain = replace(self, layout=ArmLayout(known=self.layout.known), loads=weight_loads(self.chain, self.q))
        for _ in range(_SETTLING_ROUNDS):
            ends = np.stack(plain._frames(np.zeros(0))[1], axis=1)
            plain = replace(plain, loads=weight_loads(self.chain, self.q, ends))
        return replace(self, loads=plain.loads)

    def _sag(self, x: Float) -> Float | None:
        if self.loads is None:
            return None
        compliance = np.array(self.chain.compliance)
        for (segment, direction), place in self.layout.soft.items():
            compliance[segment, direction] = x[place]
        out: Float = compliance * self.loads
        return out

    def _frames(self, x: Float) -> tuple[list[Float], list[Float], Float, Float]:
        """Frames behind every drive, behind every sag, of the TCP before its displacement, and of the TCP."""
        chain, lay, m = self.chain, self.layout, len(self.q)
        delta = self._sag(x)
        base = lay.displacement_at(BASE, x)
        T: Float = np.broadcast_to(np.eye(4) if base is None else displacement(base), (m, 4, 4))
        drives, ends = [], []
        for i, name in enumerate(chain.names):
            T = T @ chain.fixed[i]
            if chain.joint[i] >= 0:
                T = _turned(T, self._angle(i, x))
            drives.append(T)
            if delta is not None and (np.any(chain.compliance[i] > 0.0) or any(s == i for s, _ in lay.soft)):
                T = T @ _elastic(delta[:, i])
            ends.append(T)
            d = lay.displacement_at(name, x)
            if d is not None:
                T = T @ displacement(d)
        T_last = T @ chain.T_last_tcp
        d = lay.displacement_at(TCP, x)
        return drives, ends, T_last, T_last if d is None else T_last @ displacement(d)

    def _angle(self, i: int, x: Float) -> Float:
        q = self.q[:, self.chain.joint[i]]
        out = q
        for term in self.layout.periodic:
            if term.axis == self.chain.joint[i]:
                k = term.order
                out = out + x[term.sine] * np.sin(k * q) + x[term.cosine] * (np.cos(k * q) - 1.0)
        angle: Float = self.chain.sign[i] * out + self.chain.offset[i]
        return angle


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


def _elastic(delta: Float) -> Float:
    """E(delta) (m, 4, 4): translation, then z-y'-x'' rotations."""
    return pose.make(rotation.from_zyx(delta[:, [5, 4, 3]]), delta[:, :3])


def _elastic_axis(delta: Float, direction: int) -> Float:
    """(m, 3) axis in the element's frame that the rotation of a direction 3..5 turns about."""
    if direction == 5:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(delta), 3))
    R = rotation.about_z(delta[:, 5])
    if direction == 4:
        return R[:, :, 1]
    out: Float = (R @ rotation.about_y(delta[:, 4]))[:, :, 0]
    return out
