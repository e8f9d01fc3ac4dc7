"""Rotations as laboratories write them, turned into matrices, with their standard deviations."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.geometry import rotation

ORDERS: Final[dict[str, str]] = {"xyz_fixed": "zyx", "xyz_intrinsic": "xyz", "zyx_intrinsic": "zyx"}
"""Order of the axes in the product of matrices: ``zyx`` is ``Rz Ry Rx``."""
_ABOUT: Final = {"x": rotation.about_x, "y": rotation.about_y, "z": rotation.about_z}
TOLERANCE: Final = 2e-3
"""How far a quaternion's length or a matrix may be from that of a rotation: four printed digits."""


def matrices(convention: str, numbers: Float) -> Float:
    """Rotation matrices (n, 3, 3).

    Args:
        convention: ``xyz_fixed`` (roll, pitch, yaw: about x, y, z of the fixed frame in this order, ``Rz Ry Rx``),
            ``xyz_intrinsic`` (``Rx Ry Rz``), ``zyx_intrinsic`` (A, B, C of KUKA: ``Rz(A) Ry(B) Rx(C)``),
            ``rotation_vector``, ``quat_wxyz``, ``quat_xyzw`` or ``matrix`` (row by row).
        numbers: (n, 3), (n, 4) or (n, 9); angles in rad.
    """
    if convention == "rotation_vector":
        return rotation.exp(numbers)
    if convention == "quat_wxyz":
        return rotation.from_quat_wxyz(numbers)
    if convention == "quat_xyzw":
        return rotation.from_quat_wxyz(numbers[:, [3, 0, 1, 2]])
    if convention == "matrix":
        return nearest(numbers.reshape(-1, 3, 3))
    out: Float = np.eye(3)[None]
    for axis, angle in _ordered(convention, numbers):
        out = out @ _ABOUT[axis](angle)
    return out


def faulty(convention: str, numbers: Float) -> tuple[Bool, str]:
    """Which rows are no rotations, and what is wrong with the first of them."""
    if convention in ("quat_wxyz", "quat_xyzw"):
        bad = np.abs(np.linalg.norm(numbers, axis=1) - 1.0) > TOLERANCE
        return bad, "the quaternion does not have length 1"
    if convention == "matrix":
        M = numbers.reshape(-1, 3, 3)
        left_handed = np.linalg.det(M) < 0.0
        if np.any(left_handed):
            return left_handed, "the matrix is left-handed (its determinant is negative): an axis is mirrored"
        off = np.max(np.abs(M @ np.swapaxes(M, 1, 2) - np.eye(3)), axis=(1, 2)) > TOLERANCE
        return off, "the matrix is no rotation: its rows are not unit vectors at right angles"
    return np.zeros(len(numbers), dtype=np.bool_), ""


def rotation_sigma(convention: str, numbers: Float, sigma: Float) -> Float:
    """Standard deviations of rotation vectors, about the axes of the first frame (``R = Exp(e) R_true``).

    For angles about axes ``e = sum_k a_k d angle_k`` with ``a_k`` the axis of the k-th turn in the first frame, so
    ``sigma_i^2 = sum_k a_ki^2 sigma_k^2``; other conventions have their standard deviations about the axes already.

    Args:
        numbers: (n, k) as there.
        sigma: (n, 3) rad, of each angle in the file's order (or about the axes).

    Returns:
        (n, 3) rad.
    """
    if convention not in ORDERS:
        return sigma
    out = np.zeros((len(numbers), 3))
    R: Float = np.broadcast_to(np.eye(3), (len(numbers), 3, 3))
    spread = dict(_ordered(convention, sigma))
    for axis, angle in _ordered(convention, numbers):
        out += (R[:, :, "xyz".index(axis)] * spread[axis][:, None]) ** 2
        R = R @ _ABOUT[axis](angle)
    return np.sqrt(out)


def nearest(M: Float) -> Float:
    """Rotation matrices nearest to nearly orthogonal ones (n, 3, 3)."""
    U, _, Vt = np.linalg.svd(M)
    out: Float = U @ Vt
    return out


def _ordered(convention: str, numbers: Float) -> list[tuple[str, Float]]:
    """Axis and angle of each turn in the order of the product; columns stand as the convention's name says."""
    columns = convention.split("_")[0]
    return [(axis, numbers[:, columns.index(axis)]) for axis in ORDERS[convention]]
