"""Functions of an orientation: what an offset that depends on the rotation matrix alone can be made of.

Degree 1 are the nine entries of the rotation matrix, degree 2 the 25 entries of its action on symmetric traceless
matrices, ``<S_a, R S_b R^T>``. Scaled as here their squares have mean 1 over all rotations, and they are orthogonal to
each other and to the constant (Peter-Weyl), so no column repeats another.

A polynomial of degree 2 in the unit quaternion (Haehn2020 eq. 17, 15 terms) is, term by term: ten products, which span
exactly the constant and the nine functions of degree 1; the constant once more; and four linear terms, which change
sign between q and -q and so are no functions of the orientation.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import rotation

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
