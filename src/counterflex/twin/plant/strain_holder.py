"""The instrumented spindle holder of the simulated laboratory, with the faults that real ones have.

The structure is a frame of beams; gauges sit a little off, their factors scatter, bolted joints and glue give
hysteresis (slip elements on each bridge's strain), temperature leaves a rest, amplifiers add noise and a slow wander.

Signals of the bridge amplifiers of the instrumented holder while the simulated cell works, sample by sample.

The same holder as :class:`counterflex.twin.plant.strain_holder.InstrumentedHolder`, taken on in time: slip elements and
wander have a memory, the holder warms up, a thermometer on it shows that with an error of its own.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.geometry import pose
from counterflex.geometry.rotation import skew
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_changes import hose_of

_KAPPA = 5.0 / 6.0


@dataclass(frozen=True)
class HolderShape:
    """The holder as it was made; frame: z along the cheeks to the spindle, x through both, y across."""

    length_m: float = 0.18  # of the cheeks
    distance_m: float = 0.16  # between their middles
    thickness_m: tuple[float, float] = (0.0153, 0.0148)  # of each cheek, at -x and +x
    width_m: tuple[float, float] = (0.124, 0.112)  # at the clamped end and at the ring
    notch_z_m: tuple[float, ...] = (0.045, 0.09, 0.135)  # stations of notches, in both cheeks
    notch_share: float = 0.9  # width that a notch leaves
    notch_m: float = 0.006  # length of a notch along z
    base_m: float = 0.06  # height of the base plate's section (its depth along z)
    ring_m: float = 0.05  # height of the ring's section
    e_pa: float = 206e9
    poisson_ratio: float = 0.29

    def strain_frame(self, elements: int = 72) -> StrainFrame:
        """Assemble and solve the frame. Returns the frame with its answers to unit loads on the ring."""
        s = self
        cuts = [c for z in s.notch_z_m for c in (z - 0.5 * s.notch_m, z + 0.5 * s.notch_m)]
        z = np.unique(np.round(np.concatenate([np.linspace(0.0, s.length_m, elements + 1), cuts]), 9))
        n = len(z) - 1
        count = 2 * (n + 1) + 2  # cheeks, middle of the base plate, middle of the ring
        base, ring = count - 2, count - 1
        K = np.zeros((6 * count, 6 * count))
        sections: list[list[tuple[float, float, float, float]]] = [[], []]
        stiffness: list[list[Float]] = [[], []]
        for side in range(2):
            for e in range(n):
                middle = 0.5 * (z[e] + z[e + 1])
                width = s.width_m[0] + (s.width_m[1] - s.width_m[0]) * middle / s.length_m
                if any(abs(middle - c) < 0.5 * s.notch_m for c in s.notch_z_m):
                    width *= s.notch_share
                section = _rectangle(s.thickness_m[side], width)
                k = _element(float(z[e + 1] - z[e]), section, s.e_pa, s.poisson_ratio)
                sections[side].append(section)
                stiffness[side].append(k)
                _add(K, side * (n + 1) + e, side * (n + 1) + e + 1, k)
        turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # local z along the holder's x
        T = np.kron(np.eye(4), turn)
        for middle, height, at in ((base, s.base_m, 0), (ring, s.ring_m, n)):
            for side in range(2):
                k = _element(0.5 * s.distance_m, _rectangle(height, s.width_m[0]), s.e_pa, s.poisson_ratio)
                cheek = side * (n + 1) + at
                ends = (cheek, middle) if side == 0 else (middle, cheek)
                _add(K, *ends, T @ k @ T.T)
        at_ring = np.eye(6)
        at_ring[3:, :3] = skew(np.array([0.0, 0.0, -s.length_m]))
        x = _bent(K, n + 1, at_ring)  # the middle of the base plate is bolted to the flange
        cheek_ends: Float = np.empty((2, n, 6, 6))
        for side in range(2):
            for e in range(n):
                a = 6 * (side * (n + 1) + e)
                cheek_ends[side, e] = (stiffness[side][e] @ x[a : a + 12])[6:]
        return StrainFrame(s, z, tuple(tuple(row) for row in sections), cheek_ends, x[6 * ring : 6 * ring + 6])


def _rectangle(t: float, b: float) -> tuple[float, float, float, float]:
    """Area, second moments about the axes along t and along b ... and torsion constant of a section t x b."""
    # Returns area, moment for bending across b (``t b^3 / 12``), moment for bending across t (``b t^3 / 12``), torsion.
    short, long = min(t, b), max(t, b)
    torsion = long * short**3 * (1.0 / 3.0 - 0.21 * short / long * (1.0 - (short / long) ** 4 / 12.0))
    return t * b, t * b**3 / 12.0, b * t**3 / 12.0, torsion


def _element(length: float, section: tuple[float, float, float, float], e: float, nu: float) -> Float:
    """(12, 12) stiffness of a beam along its local z; section as :func:`_rectangle` with t along x and b along y."""
    area, ix, iy, torsion = section
    g = e / (2.0 * (1.0 + nu))
    k = np.zeros((12, 12))
    for i, stiffness in ((2, e * area / length), (5, g * torsion / length)):
        k[i, i] = k[i + 6, i + 6] = stiffness
        k[i, i + 6] = k[i + 6, i] = -stiffness
    for u, r, inertia, sign in ((0, 4, iy, 1.0), (1, 3, ix, -1.0)):
        phi = 12.0 * e * inertia / (_KAPPA * g * area * length**2)
        c = e * inertia / (length**3 * (1.0 + phi))
        places = [u, r, u + 6, r + 6]
        k[np.ix_(places, places)] += c * np.array(
            [
                [12.0, sign * 6.0 * length, -12.0, sign * 6.0 * length],
                [sign * 6.0 * length, (4.0 + phi) * length**2, -sign * 6.0 * length, (2.0 - phi) * length**2],
                [-12.0, -sign * 6.0 * length, 12.0, -sign * 6.0 * length],
                [sign * 6.0 * length, (2.0 - phi) * length**2, -sign * 6.0 * length, (4.0 + phi) * length**2],
            ]
        )
    return k


@dataclass(frozen=True, eq=False)
class StrainFrame:
    """The frame, solved for unit loads."""

    shape: HolderShape
    stations_m: Float  # (n + 1,) z of the nodes of a cheek
    sections: tuple[tuple[tuple[float, float, float, float], ...], ...]  # (2, n) sections of the elements, as tuples
    # (2, n, 6, 6) force and moment on the upper end of each cheek element, holder axes, per unit load (last axis) about
    # the holder's origin
    end_forces: Float
    compliance: Float  # (6, 6) m/N ... of the ring's middle about the holder's origin

    def strain(self, p_holder_gauge: Float, angle_rad: float) -> Float:
        """Strain per unit load along a direction in the surface.

        Args:
            p_holder_gauge: (3,) m, taken to the nearest surface of the nearer cheek.
            angle_rad: To z, towards y on faces across x, towards x on edges across y.

        Returns:
            (6,) 1/N, 1/(N m).

        Raises:
            InputError: The point is not between the ends of the cheeks.
        """
        s = self.shape
        x, y, z = (float(v) for v in p_holder_gauge)
        if not 0.0 <= z <= s.length_m:
            raise InputError("a gauge is not on the cheeks", value=z, limit=f"0..{s.length_m} m")
        side = 1 if x > 0.0 else 0
        e = min(int(np.searchsorted(self.stations_m, z, side="right")) - 1, len(self.stations_m) - 2)
        section = self.sections[side][e]
        area, ix, iy, torsion = section
        t = float(np.sqrt(12.0 * iy / area))
        b = area / t
        x -= (side - 0.5) * s.distance_m
        lever = self.stations_m[e + 1] - z
        f = self.end_forces[side, e]
        mx, my = f[3] - lever * f[1], f[4] + lever * f[0]
        g = s.e_pa / (2.0 * (1.0 + s.poisson_ratio))
        on_face = abs(abs(x) - 0.5 * t) / t < abs(abs(y) - 0.5 * b) / b
        x, y = (np.sign(x) * 0.5 * t, y) if on_face else (x, np.sign(y) * 0.5 * b)
        eps = (f[2] / area + mx * y / ix - my * x / iy) / s.e_pa
        twist = f[5] * min(t, b) / torsion
        if on_face:
            gamma = (1.5 * f[1] / area * (1.0 - (2.0 * y / b) ** 2) + twist * np.sign(x)) / g
        else:
            gamma = (1.5 * f[0] / area * (1.0 - (2.0 * x / t) ** 2) - 0.75 * twist * np.sign(y)) / g
        c, d = np.cos(angle_rad), np.sin(angle_rad)
        out: Float = eps * (c * c - s.poisson_ratio * d * d) + gamma * c * d
        return out


def _add(K: Float, a: int, b: int, k: Float) -> None:
    """Add an element between nodes ``a`` and ``b`` to the stiffness of the frame."""
    places = np.r_[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
    K[np.ix_(places, places)] += k


def _bent(K: Float, stations: int, load: Float) -> Float:
    """(m, 6) displacements of all nodes under loads (6, 6) on the last one, the ring; the base before it stands.

    Solved from station to station, 12 unknowns each: of all at once the last bits depend on the number of threads.
    """
    both = np.arange(6)[None] + 6 * np.arange(stations)[:, None]
    groups = [*np.hstack([both, both + 6 * stations]), np.arange(len(K) - 6, len(K))]
    rest, steps = K[np.ix_(groups[0], groups[0])], []
    for a, b in itertools.pairwise(groups):
        steps.append((a, b, np.linalg.solve(rest, K[np.ix_(a, b)])))
        rest = K[np.ix_(b, b)] - K[np.ix_(b, a)] @ steps[-1][2]
    x = np.zeros((len(K), 6))
    x[groups[-1]] = np.linalg.solve(rest, load)
    for a, b, follows in reversed(steps):
        x[a] = -follows @ x[b]
    return x


SAMPLE_S = 1e-3
"""Sampling of the bridge amplifiers."""
NOISE, WANDER = 0.22e-6, 0.015e-6
"""Standard deviation of a sample; of the wander over one second."""
PLACE_M, ANGLE_RAD, FACTOR_SHARE, NOTCH_SHARE = 0.4 * MM, 1.0 * DEG, 0.01, 0.05
KELVIN = 0.05 * UM
HYSTERESIS_SHARE, HYSTERESIS_AT = 0.004, (0.5e-6, 2.0e-6, 6.0e-6)
REFERENCE_C = 22.0
FORCE_N = 0.5
"""Noise of the reference dynamometer."""
PAPER_GAUGES = tuple((side * 0.0875, side * y * MM, 0.09, 0.0, 2.0) for side in (-1.0, 1.0) for y in (10.0, -10.0, 7.5))
"""Six bridges in notches half way up the outer faces of the cheeks, along them: a layout that makes the matrix and the
errors what Denkena2015 prints; the paper's own places were lost with its figures."""
PAPER_TCP_M = (0.07, 0.0, 0.42)
"""Tool tip that goes with it, holder frame."""


@dataclass(frozen=True, eq=False)
class InstrumentedHolder:
    """A holder as it truly is."""

    frame: StrainFrame
    sensitivity: Float  # (n, 6) 1/N, 1/(N m): what the bridges truly show per load about the holder's origin
    zero: Float  # (n,) strain shown with no load
    per_kelvin: Float  # (n,) 1/K

    def still(self, force: Float, p_holder_load: Float) -> Float:
        """(m, n) strain without hysteresis, noise and temperature of forces (m, 3) N at points (m, 3) m."""
        f, p = np.atleast_2d(force), np.broadcast_to(p_holder_load, np.atleast_2d(force).shape)
        w = np.concatenate([f, np.cross(p, f)], axis=1)
        out: Float = w @ self.sensitivity.T
        return out

    def record(
        self,
        force: Float,
        p_holder_load: Float,
        temperature_c: Float,
        rng: np.random.Generator,
        step_s: float = SAMPLE_S,
    ) -> Float:
        """(m, n) what the amplifiers show along a history of load, each sample the mean over its step.

        ``force``: (m, 3) N in order, from rest. ``p_holder_load``: (3,) or (m, 3) m. ``temperature_c``: (m,) deg C.
        """
        s = self.still(force, p_holder_load)
        s = s + hysteresis(s) + self.zero + np.outer(np.asarray(temperature_c) - REFERENCE_C, self.per_kelvin)
        wander = np.cumsum(rng.standard_normal(s.shape), axis=0) * WANDER * np.sqrt(step_s)
        out: Float = s + wander + NOISE * np.sqrt(SAMPLE_S / step_s) * rng.standard_normal(s.shape)
        return out


def hysteresis(strain: Float) -> Float:
    """(m, n) what slip elements add to strains (m, n) along their history: stops at some sizes of strain.

    Each stop follows the strain until it slips; together they open a loop of :data:`HYSTERESIS_SHARE` of the range.
    """
    limit = np.array(HYSTERESIS_AT)[:, None]
    residual, out = np.zeros((len(limit), strain.shape[1])), np.empty_like(strain)
    steps = np.diff(strain, axis=0, prepend=0.0)
    for k in range(len(strain)):
        residual = np.minimum(np.maximum(residual + steps[k], -limit), limit)
        out[k] = residual.sum(axis=0)
    return np.asarray(HYSTERESIS_SHARE * out, dtype=np.float64)


def instrumented_holder(
    gauges: Sequence[Sequence[float]] | Float, seed: int, shape: HolderShape | None = None
) -> InstrumentedHolder:
    """The holder of a laboratory.

    ``gauges``: Per bridge its intended place: x, y, z m, angle rad, notch factor. ``shape``: None: of reference.
    """
    frame = (shape if shape is not None else HolderShape()).strain_frame()
    places = as_float("gauges", gauges, (None, 5))
    rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-holder-1:{seed}").getrandbits(64)))
    off = PLACE_M * rng.standard_normal((len(places), 3))
    turn = ANGLE_RAD * rng.standard_normal(len(places))
    factor = (1.0 + FACTOR_SHARE * rng.standard_normal(len(places))) * (1.0 + NOTCH_SHARE * rng.standard_normal(1))
    rows = []
    for place, d, da, k in zip(places, off, turn, factor, strict=True):
        p = place[:3] + d
        p[2] = np.clip(p[2], 0.0, frame.shape.length_m)
        along, across = frame.strain(p, place[3] + da), frame.strain(p, place[3] + da + 0.5 * np.pi)
        rows.append(k * place[4] * (along - across) / (1.0 + frame.shape.poisson_ratio))
    zero, per_kelvin = 20e-6 * rng.standard_normal(len(places)), KELVIN * rng.standard_normal(len(places))
    return InstrumentedHolder(frame, np.array(rows), zero, per_kelvin)


WARM_K, WARM_S = 3.0, 900.0
"""How much the holder warms up from the begin of a run on, and over which time: a spindle at work."""
THERMOMETER_K: Final = 0.05


class StrainStream:
    """The amplifiers' side.

    ``plant``: In which it is; the next body hangs on it. ``warm_k``: See :data:`WARM_K`.

    Raises:
        InputError: There is no such body, or nothing behind it.
    """

    def __init__(
        self,
        holder: InstrumentedHolder,
        segment: str,
        plant: Plant,
        rng: np.random.Generator,
        step_s: float = SAMPLE_S,
        warm_k: float = WARM_K,
    ) -> None:
        names = [body.name for body in plant.truth.bodies]
        if segment not in names[:-1]:
            raise InputError("no spindle holder can sit there", value=segment, limit=", ".join(names[:-1]))
        self._holder, self._segment, self._plant, self._rng = holder, segment, plant, rng
        self._carried, self._step_s, self._warm_k = names[names.index(segment) + 1], step_s, warm_k
        n = len(holder.zero)
        self._limit: Float = np.array(HYSTERESIS_AT)[:, None]
        self._slip: Float = np.zeros((len(HYSTERESIS_AT), n))
        self._before: Float = np.zeros(n)
        self._wander: Float = np.zeros(n)

    def load(self) -> Float:
        """(6,) N, N m on the holder about its origin in its axes: process, weight, inertia, hose, of this moment."""
        plant = self._plant
        T_holder_base = pose.inverse(plant.body_pose(self._segment))
        w = pose.carry_wrench(T_holder_base @ plant.body_pose(self._carried), plant.section_wrench(self._carried))
        pack = plant.truth.other.hose
        if pack is not None:
            arm, tool = plant.body_pose(pack.arm_body), plant.body_pose(plant.truth.bodies[-1].name)
            place, pull = hose_of(pack).on_tool(arm, tool, plant.truth.gravity_base)
            w = w + pose.carry_wrench(T_holder_base @ pose.make(p=place), pull)
        out: Float = w
        return out

    def sample(self, load: Float, time_s: float) -> tuple[Float, float]:
        """Strain that the amplifiers show and temperature that the thermometer shows.

        ``load``: (6,) N, N m, mean of :meth:`load` since the last sample. Returns (n,) dimensionless, deg C.
        """
        holder, rng = self._holder, self._rng
        still = holder.sensitivity @ load
        self._slip = np.clip(self._slip + still - self._before, -self._limit, self._limit)
        self._before = still
        warmer = self._warm_k * -math.expm1(-time_s / WARM_S)
        self._wander += WANDER * math.sqrt(self._step_s) * rng.standard_normal(len(still))
        noise = NOISE * math.sqrt(SAMPLE_S / self._step_s) * rng.standard_normal(len(still))
        strain = still + HYSTERESIS_SHARE * self._slip.sum(axis=0) + holder.zero + warmer * holder.per_kelvin
        return strain + self._wander + noise, REFERENCE_C + warmer + THERMOMETER_K * float(rng.standard_normal())


# A spindle holder as a space frame of Timoshenko beam elements: strain at any point of its cheeks under load.
# Other equations than a calibration's linear map or a drawing's prismatic cheeks: an elastic base plate and spindle
# ring, cheeks that taper and differ in thickness, shear deformation, notches that weaken the sections they cut.
