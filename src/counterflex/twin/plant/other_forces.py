"""Forces of the other kinds of physics of a truth, added to those of drives, friction and loads at every step."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.twin.plant.friction import apply_bristles, bristle_limit, bristle_parameters, play_torque
from counterflex.twin.plant.mjcf import Coordinates
from counterflex.twin.plant.slow_changes import EVERY_S, SlowChanges
from counterflex.twin.truth.other import GearCurve
from counterflex.twin.truth.truth import Truth

_FADE_RAD: Final = math.radians(10.0)


class PostureSprings:
    """Stiffness of every elastic coordinate over the motor angles.

    ``truth``: With ``regions``; without, nothing changes.

    Attributes:
        free: (k,) coordinates with a spring of the engine's own, all but the torsion of driven bodies.
    """

    def __init__(self, truth: Truth, coordinates: Coordinates) -> None:
        self._mean = coordinates.stiffness
        self._regions = truth.regions
        names = [body.name for body in truth.bodies]
        self._place = [
            int(np.flatnonzero((coordinates.body == names.index(r.segment)) & (coordinates.kind == r.direction))[0])
            for r in truth.regions
        ]
        self.free: Int = np.flatnonzero((coordinates.kind >= 0) & (coordinates.axis < 0))

    def __bool__(self) -> bool:
        """Return whether any spring changes."""
        return bool(self._regions)

    @property
    def stiffest(self) -> Float:
        """(n,) N/m, N m/rad, in the posture in which each is stiffest."""
        out = self._mean.copy()
        for region, place in zip(self._regions, self._place, strict=True):
            out[place] /= min(1.0, *region.factors)
        return out

    def stiffness(self, q: Float) -> Float:
        """(n,) N/m, N m/rad at the motor angles q (6,) rad; 0 for motors."""
        out = self._mean.copy()
        for region, place in zip(self._regions, self._place, strict=True):
            angle = float(q[region.axis])
            inside = float(np.clip(angle, region.angles_rad[0], region.angles_rad[-1]))
            factor = float(np.interp(inside, region.angles_rad, region.factors))
            near = max(0.0, 1.0 - abs(angle - inside) / _FADE_RAD)
            out[place] /= 1.0 + (factor - 1.0) * near
        return out


COLUMNS = 8  # torque_1, torque_2, share_1..3, hysteresis N m, its share of the load, its slip rad


def gear_parameters(gears: tuple[GearCurve, ...]) -> Float:
    """The curves as (6, 8) numbers; a row of zeros is a straight spring."""
    out = np.zeros((6, COLUMNS))
    for g in gears:
        out[g.axis] = (*g.torque_nm, *g.share, g.hysteresis_nm, g.hysteresis_share, g.hysteresis_rad)
    return out


@kernel("float64(float64, float64, float64, float64[::1])", entry=True)
def gear_torque(angle: float, stiffness: float, half_band: float, curve: Float) -> float:
    """Torque of the curve behind a dead band on the wind-up ``angle``, N m, against it."""
    x = abs(angle) - half_band
    if x <= 0.0:
        return 0.0
    knee_1 = curve[0] / (curve[2] * stiffness)
    knee_2 = knee_1 + (curve[1] - curve[0]) / (curve[3] * stiffness)
    if x <= knee_1:
        torque = curve[2] * stiffness * x
    elif x <= knee_2:
        torque = curve[0] + curve[3] * stiffness * (x - knee_1)
    else:
        torque = curve[1] + curve[4] * stiffness * (x - knee_2)
    return float(-torque if angle > 0.0 else torque)


def wind_up(torque: float, stiffness: float, curve: Float) -> float:
    """Wind-up beyond the dead band at which the curve balances ``torque`` N m, with its sign; inverse of the curve."""
    load = abs(torque)
    x = min(load, curve[0]) / curve[2]
    x += min(max(load - curve[0], 0.0), curve[1] - curve[0]) / curve[3]
    x += max(load - curve[1], 0.0) / curve[4]
    return math.copysign(x / stiffness, torque)


@kernel(
    "void(float64[::1], int64[::1], float64[::1], float64[::1], float64[:, ::1], float64[::1], "
    "float64[::1], float64[::1])",
    entry=True,
)
def apply_gears(
    qpos: Float,
    torsion: Int,
    stiffness: Float,
    half_band: Float,
    curves: Float,
    slip_force: Float,
    slip_angle: Float,
    force: Float,
) -> None:
    """Add to ``force`` what curved gears have more than straight springs, hysteresis included, and advance it.

    Args:
        qpos: (n,) coordinates.
        torsion: (6,) coordinate of each torsion, -1 where rigid.
        stiffness: (6,) N m/rad.
        half_band: (6,) rad.
        curves: (6, 8) of :func:`gear_parameters`.
        slip_force: (6,) N m, of the hysteresis elements, updated.
        slip_angle: (6,) rad, wind-up at the last call, updated.
        force: (n,) generalised forces, added to.
    """
    for i in range(6):
        t = torsion[i]
        if t < 0 or curves[i, 2] == 0.0:
            continue
        x = qpos[t]
        torque = gear_torque(x, stiffness[i], half_band[i], curves[i])
        limit = curves[i, 5] + curves[i, 6] * abs(torque)
        f = slip_force[i] - (curves[i, 5] + curves[i, 6] * curves[i, 1]) / curves[i, 7] * (x - slip_angle[i])
        f = min(max(f, -limit), limit)
        slip_force[i] = f
        slip_angle[i] = x
        force[t] += torque - play_torque(x, stiffness[i], half_band[i]) + f


# Springs between elastic coordinates, of one body or of several, that change with the posture.
# ``f_i = -k_ij c(q) x_j``, ``f_j = -k_ij c(q) x_i`` with ``k_ij = share sqrt(k_i k_j)`` and ``c(q) = cos(q_axis -
# phase)``, or 1 where no axis is named. A coordinate coupled with itself has a stiffness that changes with the posture,
# ``k_i (1 + share c(q))``.


def coupling_parameters(truth: Truth, coordinates: Coordinates) -> tuple[Int, Float]:
    """Places (k, 3): two coordinates and the motor coordinate of the axis, -1 without; values (k, 2): k_ij, phase."""
    names = [body.name for body in truth.bodies]
    place, value = [], []
    for c in truth.other.couplings:
        pair = [
            int(np.flatnonzero((coordinates.body == names.index(name)) & (coordinates.kind == direction))[0])
            for name, direction in zip(c.bodies, c.directions, strict=True)
        ]
        mean = math.sqrt(coordinates.stiffness[pair[0]] * coordinates.stiffness[pair[1]])
        place.append((*pair, -1 if c.axis is None else int(coordinates.motor[c.axis])))
        value.append((c.share * mean, c.phase_rad))
    return np.array(place, dtype=np.int64).reshape(-1, 3), np.array(value, dtype=np.float64).reshape(-1, 2)


@kernel("void(float64[::1], int64[:, ::1], float64[:, ::1], float64[::1])", entry=True)
def apply_couplings(qpos: Float, place: Int, value: Float, force: Float) -> None:
    """Add the springs to ``force``.

    Args:
        qpos: (n,) coordinates.
        place: (k, 3) of :func:`coupling_parameters`.
        value: (k, 2) of it.
        force: (n,) generalised forces, added to.
    """
    for k in range(place.shape[0]):
        i, j = place[k, 0], place[k, 1]
        stiffness = value[k, 0]
        if place[k, 2] >= 0:
            stiffness *= math.cos(qpos[place[k, 2]] - value[k, 1])
        force[i] -= stiffness * qpos[j]
        if i != j:
            force[j] -= stiffness * qpos[i]


_STILL: Final = 0.0


@kernel("void(float64[::1], int64[::1], float64[::1], float64[::1], float64[:, ::1], float64[::1])", entry=True)
def gear_loads(qpos: Float, torsion: Int, stiffness: Float, half_band: Float, curves: Float, out: Float) -> None:
    """Set ``out`` (6,) to the torques of the gears without hysteresis, N m; straight ones where the curve is zero."""
    for i in range(6):
        t = torsion[i]
        out[i] = 0.0
        if t < 0:
            continue
        if curves[i, 2] == 0.0:
            out[i] = play_torque(qpos[t], stiffness[i], half_band[i])
        else:
            out[i] = gear_torque(qpos[t], stiffness[i], half_band[i], curves[i])


class OtherForces:
    """Effect of the other kinds of a truth on a plant.

    ``sign``: (6,) of each driven axis. ``stiffness``: (6,) N m/rad, live, of the torsions. ``half_band``: (6,) rad, of
    the dead bands.

    Attributes:
        replaced: (6,) axes whose bristles stand in place of the slip elements on the link side.
        dry: (6,) N m, friction of the bristles of a warm, unloaded joint at standstill.
        bristle_force: (6,) N m, what they hold now.
    """

    def __init__(
        self,
        truth: Truth,
        coordinates: Coordinates,
        slow: SlowChanges,
        *,
        sign: Float,
        stiffness: Float,
        half_band: Float,
        friction: bool,
    ) -> None:
        other = truth.other
        self._slow, self._sign = slow, sign
        self._motor: Int = coordinates.motor
        self._torsion: Int = coordinates.torsion
        self._stiffness, self._band = stiffness, half_band
        self._curves = gear_parameters(other.gears)
        if not friction:
            self._curves[:, 5:7] = 0.0
        self._gear_slip: Float = np.zeros(6)
        self._gear_angle: Float = np.zeros(6)
        self._curved = [gear.axis for gear in other.gears]
        self.replaced: Bool = np.zeros(6, dtype=bool)
        self.replaced[[f.axis for f in other.frictions]] = True
        self._bristles = bristle_parameters(other.frictions if friction else ())
        self._cold: Float = np.zeros(6)
        self._warming_s: Float = np.ones(6)
        for f in other.frictions:
            self._cold[f.axis], self._warming_s[f.axis] = f.cold_share, f.warming_s
        self._warm: Float = 1.0 + self._cold
        self._load: Float = np.zeros(6)
        self._link: Float = np.zeros(6)
        self.bristle_force: Float = np.zeros(6)
        self.dry: Float = np.array([bristle_limit(_STILL, 0.0, 1.0, row) if row[0] else 0.0 for row in self._bristles])
        self._place, self._value = coupling_parameters(truth, coordinates)
        self._before_s = 0.0 if other.thermal is None else other.thermal.before_s
        self._hose_force: Float = np.zeros(len(coordinates.kind))
        self.step_of(EVERY_S)
        self._clock_s, self._count = 0.0, 0

    def step_of(self, step_s: float) -> None:
        """Say the time between calls of :meth:`apply`, s."""
        self._step_s = step_s
        self._every = max(1, round(EVERY_S / step_s))

    def stiffest(self) -> tuple[Float, Float, Float]:
        """Largest stiffness that a small motion meets beyond the straight springs, axis by axis.

        Returns:
            (6,) N m/rad of the gears, hysteresis and curve; (6,) N m/rad of the bristles and (6,) N m s/rad of their
            viscous part, both on the link angle.
        """
        curves, bristles = self._curves, self._bristles
        gears = np.maximum(curves[:, 2:5].max(axis=1) - 1.0, 0.0) * self._stiffness
        stuck = curves[:, 5] + curves[:, 6] * curves[:, 1]
        gears += np.divide(stuck, curves[:, 7], out=np.zeros(6), where=curves[:, 7] > 0.0)
        return gears, bristles[:, 3], bristles[:, 4]

    def program_time(self, time_s: float, tool_growth_m: float) -> None:
        """Put the clock to a time since the start of the program, with the tool in use; before, it is just touched."""
        self._clock_s = self._before_s + time_s
        self._slow.tool_growth_m = tool_growth_m

    def apply(self, q_all: Float, speeds: Float, force: Float) -> None:
        """Add them to ``force`` (n,) at the coordinates (n,) and their speeds (n,), and advance what remembers."""
        if self._count % self._every == 0:
            self._slow_down()
        self._count += 1
        self._clock_s += self._step_s
        gear_loads(q_all, self._torsion, self._stiffness, self._band, self._curves, self._load)
        apply_gears(
            q_all, self._torsion, self._stiffness, self._band, self._curves, self._gear_slip, self._gear_angle, force
        )
        apply_bristles(
            q_all, speeds, self._motor, self._torsion, self._sign, self._load, self._warm, self._bristles,
            self.bristle_force, self._link, force,
        )  # fmt: skip
        self.resting(q_all, force)

    def _slow_down(self) -> None:
        self._slow.update(self._clock_s)
        self._slow.pull(self._hose_force)
        self._warm[:] = 1.0 + self._cold * np.exp(-self._clock_s / self._warming_s)

    def start(self) -> None:
        """Bring what changes slowly up to date, before the search for an equilibrium."""
        self._count = 0
        self._slow_down()

    def resting(self, q_all: Float, force: Float) -> None:
        """Add what acts at rest as well to ``force`` (n,): couplings at the coordinates (n,), and the hose."""
        apply_couplings(q_all, self._place, self._value, force)
        force += self._hose_force

    def bend(self, target: Float, net: Float) -> None:
        """Put the wind-ups of curved gears in place of the straight springs' in a search for the equilibrium.

        Args:
            target: (n,) coordinates of straight springs without dead band, changed.
            net: (n,) generalised forces that they balance.
        """
        for i in self._curved:
            t = self._torsion[i]
            target[t] = wind_up(float(net[t]), float(self._stiffness[i]), self._curves[i])

    def follow(self) -> None:
        """Take the hose along to the engine's present kinematics, in a search for the equilibrium."""
        self._slow.pull(self._hose_force)

    def spring(self, axis: int, angle: float, straight: float) -> float:
        """Torque of an axis' gear at a wind-up, N m, without hysteresis; ``straight`` where the gear is not curved."""
        if axis not in self._curved:
            return straight
        return gear_torque(angle, float(self._stiffness[axis]), float(self._band[axis]), self._curves[axis])

    def rest(self, q_all: Float, held: Float) -> None:
        """Relax what remembers at the coordinates (n,) of an equilibrium; the bristles hold ``held`` (6,) N m."""
        self._gear_slip[:] = 0.0
        torsion = np.where(self._torsion >= 0, q_all[self._torsion], 0.0)
        self._gear_angle[:] = torsion
        self.bristle_force[:] = held
        self._link[:] = q_all[self._motor] + self._sign * torsion
