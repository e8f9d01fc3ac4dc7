"""The six-axis sensor at the flange: what it shows without a process, and the process wrench behind its reading.

``w_sensor = w_bias + w_drift t + w_kelvin (T - T_ref) + weight and inertia + w_offset^T phi(R) + process``, with R the
sensor's rotation in the base, or in the body that the hose pack comes from. All on the tool side of the sensor about
its origin in its axes: what the surroundings do to the tool, so a hanging tool shows a force along gravity (Haehn2020
eq. 12-20, torques included).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive, frozen
from counterflex.core.errors import InputError
from counterflex.core.records import Records, record, records
from counterflex.core.units import STANDARD_GRAVITY
from counterflex.geometry import pose, rotation

# Functions of an orientation: what an offset that depends on the rotation matrix alone can be made of. Degree 1 are the
# nine entries of the rotation matrix, degree 2 the 25 entries of its action on symmetric traceless matrices, ``<S_a, R
# S_b R^T>``. Scaled as here their squares have mean 1 over all rotations, and they are orthogonal to each other and to
# the constant (Peter-Weyl), so no column repeats another.
#
# A polynomial of degree 2 in the unit quaternion (Haehn2020 eq. 17, 15 terms) is, term by term: ten products, which
# span exactly the constant and the nine functions of degree 1; the constant once more; and four linear terms, which
# change sign between q and -q and so are no functions of the orientation.

COUNTS = (0, 9, 34)
"""Number of functions up to degree 0, 1 and 2, the constant not counted."""


def _traceless() -> Float:
    """(5, 3, 3) orthonormal basis of the symmetric traceless matrices."""
    h = math.sqrt(0.5)
    out = np.zeros((5, 3, 3))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[k, i, j] = out[k, j, i] = h
    out[3] = np.diag([h, -h, 0.0])
    out[4] = np.diag([-1.0, -1.0, 2.0]) / math.sqrt(6.0)
    return out


_S = _traceless()
_E = rotation.skew(np.eye(3))
_L = np.einsum("cij,kijb->kcb", _S, np.einsum("kil,blj->kijb", _E, _S) - np.einsum("bil,klj->kijb", _S, _E))


def _second(R: Float) -> Float:
    out: Float = np.einsum("aij,...ik,bkl,...jl->...ab", _S, R, _S, R, optimize=True)
    return out


def degree_of(count: int) -> int:
    """Degree to which a number of functions belongs. Raises InputError: not one of :data:`COUNTS`."""
    if count not in COUNTS:
        raise InputError("functions of the orientation", value=count, limit=", ".join(map(str, COUNTS)))
    return COUNTS.index(count)


def orientation_basis(R_base_sensor: Float, degree: int) -> Float:
    """Values of the functions.

    Args:
        R_base_sensor: (..., 3, 3).
        degree: 0 (none), 1 or 2.

    Returns:
        (..., k) with k of :data:`COUNTS`, dimensionless, mean square 1 each over all rotations.

    Raises:
        InputError: Another degree.
    """
    if degree not in (0, 1, 2):
        raise InputError("degree of the orientation functions", value=degree, limit="0, 1 or 2")
    R = np.asarray(R_base_sensor, dtype=np.float64)
    lead = R.shape[:-2]
    parts = [math.sqrt(3.0) * R.reshape(*lead, 9)] if degree >= 1 else [np.zeros((*lead, 0))]
    if degree == 2:
        parts.append(math.sqrt(5.0) * _second(R).reshape(*lead, 25))
    return np.concatenate(parts, axis=-1)


def orientation_basis_slope(R_base_sensor: Float, degree: int) -> Float:
    """Derivative of :func:`orientation_basis` by a turn of the sensor about its own axes, ``R Exp(delta)``.

    Args:
        R_base_sensor: (..., 3, 3).
        degree: 0, 1 or 2.

    Returns:
        (..., k, 3) per rad.
    """
    R = np.asarray(R_base_sensor, dtype=np.float64)
    lead = R.shape[:-2]
    if degree == 0:
        return np.zeros((*lead, 0, 3))
    first = np.moveaxis(np.einsum("...ij,kjl->k...il", R, _E), 0, -1)
    parts = [math.sqrt(3.0) * first.reshape(*lead, 9, 3)]
    if degree == 2:
        second = np.moveaxis(np.einsum("...ac,kcb->k...ab", _second(R), _L), 0, -1)
        parts.append(math.sqrt(5.0) * second.reshape(*lead, 25, 3))
    return np.concatenate(parts, axis=-2)


REFERENCE_C = 20.0
DOWN: Float = np.array([0.0, 0.0, -STANDARD_GRAVITY])
DOWN.flags.writeable = False

IDLE: Final = record(
    mass=float,  # kg
    com=(float, 3),  # m, centre of gravity in the sensor frame
    bias=(float, 6),  # N, N m
    drift=(float, 6),  # N/s, N m/s
    kelvin=(float, 6),  # N/K, N m/K
    reference_c=float,
    functions=int,  # number of functions of the orientation: 0, 9 or 34
    offset=(float, (34, 6)),  # N, N m, by the functions of the orientation
)
"""What :class:`FlangeSensor` shows without a process, for kernels."""


@dataclass(frozen=True, eq=False)
class FlangeSensor:
    """Constants of a force sensor in the chain."""

    segment: str  # body of the end effector that carries the sensor frame
    T_seg_sensor: Float  # (4, 4) sensor frame in that body
    mass_kg: float  # of what hangs behind the sensor
    p_sensor_com: Float  # (3,) m, its centre of gravity in the sensor frame
    # (6,) N, N m shown with no load at time 0 and the reference temperature
    w_bias: Float = field(default_factory=lambda: np.zeros(6))
    w_drift_per_s: Float = field(default_factory=lambda: np.zeros(6))  # (6,) N/s, N m/s
    w_kelvin: Float = field(default_factory=lambda: np.zeros(6))  # (6,) N/K, N m/K
    reference_c: float = REFERENCE_C  # reference temperature, deg C
    # (k, 6) N, N m: remaining offset by the functions of the orientation; k is 0, 9 or 34
    w_offset: Float = field(default_factory=lambda: np.zeros((0, 6)))
    # (6,) ``xx yy zz xy xz yz`` of what hangs behind, about its centre of gravity, sensor axes
    inertia_kg_m2: Float = field(default_factory=lambda: np.zeros(6))
    # body that the hose pack comes from: its functions are those of the sensor's rotation in this body. Empty: of its
    # rotation in the base
    hose_from: str = ""

    def __post_init__(self) -> None:
        """Check shapes. Raises InputError: a wrong shape, or a mass below zero."""
        shapes: dict[str, tuple[int | None, ...]] = {
            "T_seg_sensor": (4, 4),
            "p_sensor_com": (3,),
            "w_bias": (6,),
            "w_drift_per_s": (6,),
            "w_kelvin": (6,),
            "w_offset": (None, 6),
            "inertia_kg_m2": (6,),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(as_float(f"sensor: {name}", getattr(self, name), shape)))
        as_positive("sensor: mass_kg", self.mass_kg, zero=True)
        degree_of(len(self.w_offset))

    @property
    def degree(self) -> int:
        """Degree of the orientation-dependent offset."""
        return degree_of(len(self.w_offset))

    def record(self) -> Records:
        """(1,) IDLE for :func:`counterflex.sensing.wrench_kernel.idle`."""
        out = records(IDLE)
        one = out[0]
        one.mass, one.com, one.bias, one.drift = self.mass_kg, self.p_sensor_com, self.w_bias, self.w_drift_per_s
        one.kelvin, one.reference_c = self.w_kelvin, self.reference_c
        one.functions = len(self.w_offset)
        one.offset[: len(self.w_offset)] = self.w_offset
        return out


def tensor(inertia_kg_m2: Float) -> Float:
    """Matrix (3, 3) of ``xx yy zz xy xz yz``."""
    xx, yy, zz, xy, xz, yz = inertia_kg_m2
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def turned(T_seg_sensor: Float, turn_rad: Float) -> Float:
    """Sensor frame turned about its own axes by a rotation vector (3,) rad."""
    out: Float = T_seg_sensor @ pose.make(rotation.exp(turn_rad))
    return out
